"""The quality of a result; a higher one takes more time."""

from __future__ import annotations

from typing import Literal

__all__ = ["Quality"]

Quality = Literal["fast", "default", "high"]
"""Fewer iterations, the default number, or more iterations and a denoiser."""
