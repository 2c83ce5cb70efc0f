"""Errors that the benchmarks raise on purpose."""

from __future__ import annotations

__all__ = ["MissingDataError"]


class MissingDataError(Exception):
    """Data are not there: the message says which, and what option names their place."""
