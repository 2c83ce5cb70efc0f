"""Checks of the numbers and objects that a caller gives; an error is one clear line."""

from __future__ import annotations

import math
from typing import TypeVar

from deshake.errors import DeshakeError

__all__ = ["check_above_zero", "check_kind", "check_share"]

T = TypeVar("T")


def check_above_zero(*, most: float = math.inf, **numbers: float | None) -> None:
    """Check that numbers are finite and above 0; None passes.

    Parameters
    ----------
    most : float
        The largest number that is allowed.
    **numbers : float or None
        The numbers by their names.

    Raises
    ------
    ValueError
        If a number is infinite, not a number, not above 0, or larger than `most`.

    """
    for name, number in numbers.items():
        if number is not None and not (math.isfinite(number) and 0 < number <= most):
            limit = "" if math.isinf(most) else f" and at most {most:g}"
            raise ValueError(f"{name} is {number!r}: it must be above 0{limit}")


def check_share(**shares: float | None) -> None:
    """Check that numbers are from 0 to 1; None passes.

    Raises
    ------
    ValueError
        If a number is not.

    """
    for name, share in shares.items():
        if share is not None and not 0 <= share <= 1:
            raise ValueError(f"{name} is {share!r}: it must be from 0 to 1")


def check_kind(value: object, kind: type[T], hint: str) -> T:
    """Return an object if it is of a kind.

    Raises
    ------
    DeshakeError
        If it is not.

    """
    if not isinstance(value, kind):
        raise DeshakeError(f"not a {kind.__name__}: {type(value).__name__}", hint=hint)
    return value
