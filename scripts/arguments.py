"""Arguments of the scripts: what several of them read from their command lines."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["at_least", "names"]


def at_least(least: int, text: str) -> int:
    """Read a whole number that must not be too small."""
    try:
        number = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
    if number < least:
        raise argparse.ArgumentTypeError(f"must be at least {least}")
    return number


def names(text: str, known: Sequence[str]) -> list[str]:
    """Read a list of names, separated by commas."""
    chosen = [name.strip() for name in text.split(",")]
    if not set(chosen) <= set(known):
        message = f"{text!r} is not among {', '.join(known)}"
        raise argparse.ArgumentTypeError(message)
    return chosen
