"""What ``--json`` prints: one object a line, that every reader of JSON takes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["print_json"]

_REPLACEMENT = "\N{REPLACEMENT CHARACTER}"


def print_json(report: Mapping[str, object]) -> None:
    """Print a report to standard output.

    Names that are not UTF-8 have surrogates in Python, which JSON's readers refuse: each byte that
    is none becomes U+FFFD.
    """
    click.echo(json.dumps(_readable(report)))


def _readable(value: object) -> object:
    """Return JSON data in whose texts no surrogate stands alone."""
    match value:
        case str():
            return "".join(_REPLACEMENT if "\ud800" <= c <= "\udfff" else c for c in value)
        case dict():
            return {_readable(key): _readable(item) for key, item in value.items()}
        case list() | tuple():
            return [_readable(item) for item in value]
        case _:
            return value
