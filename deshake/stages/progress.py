"""How far a piece of work has come: told as a share of it and a word on what is being done."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    Progress = Callable[[float, str], None]

__all__ = ["part"]


def part(progress: Progress | None, start: float, end: float) -> Progress | None:
    """Return what tells `progress` of a part of the work."""
    if progress is None:
        return None
    return lambda share, text: progress(start + (end - start) * share, text)
