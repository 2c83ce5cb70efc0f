"""Lines of a table in Markdown."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["head", "row"]


def row(cells: Iterable[object]) -> str:
    """Return a line of a table."""
    return "| " + " | ".join(map(str, cells)) + " |"


def head(titles: Iterable[str]) -> str:
    """Return the two lines at the head of a table."""
    line = row(titles)
    return f"{line}\n{'|---' * (line.count('|') - 1)}|"
