"""The kinds of values that options take: measures, counts, shares, sizes, rectangles, grids."""

from __future__ import annotations

import math
import re
from typing import Final, TypeVar

import click

__all__ = ["Count", "Grid", "Number", "PhotoFormat", "Region", "Share", "Size"]

T = TypeVar("T")

_MAX_DIGITS = 9
"""Digits of the longest number of pixels."""


_LONGEST = 40
"""Characters of a value that a message repeats."""


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


class _Typed(click.ParamType[T]):
    """A value that the help shows as its name, in the letters of the name."""

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:  # noqa: ARG002
        """Show the name."""
        return self.name


class Number(_Typed[float]):
    """A finite number above 0, and not above `most`, shown as `unit` in the help."""

    def __init__(self, unit: str, most: float = math.inf) -> None:
        self.name = unit
        self.most = most

    def convert(
        self,
        value: object,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> float:
        """Read the number; the error says what is allowed."""
        try:
            number = float(str(value))
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and 0 < number <= self.most):
            limit = "" if math.isinf(self.most) else f", at most {self.most:g}"
            self.fail(f"{value!r} is not a number above 0{limit}", param, ctx)
        return number


class Count(_Typed[int]):
    """A whole number from `least` to `most`, shown as `name` in the help."""

    def __init__(self, least: int, most: int, name: str = "N") -> None:
        self.name = name
        self.least = least
        self.most = most

    def convert(
        self,
        value: object,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> int:
        """Read the number; the error says what is allowed."""
        text = str(value).strip()
        # Longer ones are beyond any bound, and Python refuses to read very long ones.
        count = int(text) if re.fullmatch(r"[+-]?\d{1,18}", text, re.ASCII) else None
        if count is None or not self.least <= count <= self.most:
            limits = f"{self.least} to {self.most}"
            self.fail(f"{_short(text)!r} is not a whole number from {limits}", param, ctx)
        return count


class Share(_Typed[float]):
    """A number from 0 to 1, or a percentage from 0% to 100%."""

    name = "SHARE"

    def convert(
        self,
        value: object,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> float:
        """Read the number, as it is or in percent."""
        text = str(value).strip()
        number = text.removesuffix("%")
        try:
            share = float(number) / (1 if number == text else 100)
        except ValueError:
            share = math.nan
        if not 0 <= share <= 1:
            self.fail(
                f"{_short(text)!r} is not a share: a number from 0 to 1, or 0% to 100%", param, ctx
            )
        return share


class PhotoFormat(click.Choice[str]):
    """A format in which photos are written; jpg and tif are other words for jpeg and tiff."""

    _SHORT: Final = {"jpg": "jpeg", "tif": "tiff"}

    def __init__(self) -> None:
        super().__init__(["jpeg", "png", "tiff", "webp", "avif", "jp2"], case_sensitive=False)

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Read the name."""
        name = value.lower()
        return super().convert(self._SHORT.get(name, name), param, ctx)


class Region(_Typed[tuple[int, int, int, int]]):
    """A rectangle of the photo, X,Y,W,H: upper left pixel, width and height."""

    name = "X,Y,W,H"

    def convert(
        self,
        value: object,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> tuple[int, int, int, int]:
        """Read the four whole numbers; fail unless the rectangle holds a pixel."""
        if isinstance(value, tuple):
            return value  # converted before
        text = ",".join(map(str, value)) if isinstance(value, list) else str(value)
        match = re.fullmatch(r"(\d+),(\d+),(\d+),(\d+)", text.replace(" ", ""))
        if not match:
            self.fail(f"{value!r} is not four whole numbers X,Y,W,H", param, ctx)
        if max(map(len, match.groups())) > _MAX_DIGITS:
            self.fail("it reaches beyond any photo", param, ctx)
        x, y, width, height = (int(part) for part in match.groups())
        if width == 0 or height == 0:
            self.fail(f"{value!r} holds no pixel", param, ctx)
        return x, y, width, height


class Grid(_Typed[tuple[int, int]]):
    """Two counts, as in 5x7, of `least` to 99 each, shown as `name` in the help."""

    def __init__(self, name: str = "ROWSxCOLS", least: int = 1) -> None:
        self.name = name
        self.least = least

    def convert(
        self,
        value: object,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> tuple[int, int]:
        """Read the two whole numbers."""
        if isinstance(value, tuple):
            return value  # converted before
        match = re.fullmatch(r"([1-9]\d?)[xX]([1-9]\d?)", str(value))
        if not match or min(int(match[1]), int(match[2])) < self.least:
            limits = f"{self.least} to 99"
            self.fail(
                f"{value!r} is not {self.name} with {limits} of each, such as 5x7", param, ctx
            )
        return int(match[1]), int(match[2])


class Size(_Typed[int]):
    """Bytes of memory, as in 800M, 4G or 2.5GiB; at least a megabyte."""

    name = "SIZE"

    def convert(
        self,
        value: object,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> int:
        """Read the number and its unit; the error says what is allowed."""
        if isinstance(value, int):
            return value  # converted before
        match = re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?) ?([MGT])(I?B)?", str(value).upper())
        if not match:
            self.fail(f"{value!r} is not a size such as 800M, 4G or 2.5GiB", param, ctx)
        number, unit, more = match.groups()
        thousand = 1024 if more == "IB" else 1000
        count = float(number) * thousand ** (2 + "MGT".index(unit))
        if count < 1e6:
            self.fail(f"{value!r} is less than a megabyte", param, ctx)
        return int(count)
