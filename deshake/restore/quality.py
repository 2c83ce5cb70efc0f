"""The quality of a result, which costs time."""

from __future__ import annotations

from typing import Literal

__all__ = ["Quality"]

Quality = Literal["fast", "default", "high"]
"""Fewer iterations, the default, or more of them and a denoiser."""
