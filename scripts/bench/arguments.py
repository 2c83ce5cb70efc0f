"""Arguments that several programs read from their command lines."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["add_jobs", "add_recordings", "add_threads", "at_least", "names"]


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


def add_recordings(parser: argparse.ArgumentParser, *, required: bool) -> None:
    """Add the option that names the recordings of hands (`bench.hands`)."""
    text = "folder of a phone's orientation logs, *.txt"
    parser.add_argument("--data", type=Path, required=required, metavar="DIR", help=text)


def add_jobs(parser: argparse.ArgumentParser, default: int, what: str = "cases") -> None:
    """Add the option of how many cases, or other things, are worked on at once."""
    text = f"{what} at once; default: {default}"
    parser.add_argument("--jobs", type=partial(at_least, 1), default=default, help=text)


def add_threads(parser: argparse.ArgumentParser, default: int | None) -> None:
    """Add the option of how many threads deshake uses; None: its own default."""
    text = "of deshake; default: " + ("its own" if default is None else f"{default}")
    parser.add_argument(
        "--threads", type=partial(at_least, 1), default=default, metavar="N", help=text
    )
