"""Progress of a piece of work: the share of it that is done, and a text for the user."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    Progress = Callable[[float, str], None]

__all__ = ["part"]


def part(progress: Progress | None, start: float, end: float) -> Progress | None:
    """Return a callback that reports a part of the work to `progress`."""
    if progress is None:
        return None
    return lambda share, text: progress(start + (end - start) * share, text)
