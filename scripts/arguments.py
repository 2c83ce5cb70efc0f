"""Arguments of the scripts: what several of them read from their command lines."""

from __future__ import annotations

import argparse

__all__ = ["at_least"]


def at_least(least: int, text: str) -> int:
    """Read a whole number that must not be too small."""
    try:
        number = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
    if number < least:
        raise argparse.ArgumentTypeError(f"must be at least {least}")
    return number
