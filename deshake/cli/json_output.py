"""The output of ``--json``: one object a line, which every reader of JSON accepts."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["print_json", "readable"]

_REPLACEMENT = "\N{REPLACEMENT CHARACTER}"


def print_json(report: Mapping[str, object]) -> None:
    """Print a report to standard output, with its texts made `readable`."""
    click.echo(json.dumps(_readable(report)))


def readable(text: str) -> str:
    """Return a text in which no surrogate stands alone.

    Names that are not UTF-8 have surrogates in Python, which JSON's readers refuse: each byte that
    does not fit becomes U+FFFD.
    """
    return "".join(_REPLACEMENT if "\ud800" <= c <= "\udfff" else c for c in text)


def _readable(value: object) -> object:
    """Return JSON data with readable texts."""
    match value:
        case str():
            return readable(value)
        case dict():
            return {_readable(key): _readable(item) for key, item in value.items()}
        case list() | tuple():
            return [_readable(item) for item in value]
        case _:
            return value
