"""How much time a method takes for a better picture."""

from __future__ import annotations

from typing import Literal

__all__ = ["Quality"]

Quality = Literal["fast", "default", "high"]
"""Fewer iterations, the default, or more of them and a denoiser."""
