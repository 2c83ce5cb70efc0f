from __future__ import annotations

import re

import click
import pytest

from deshake.cli.values import Count, Grid, Number, PhotoFormat, Region, Share
from deshake.formats.encoding import ENDINGS, SUFFIXES


def converted(kind, texts):
    """Convert texts; what is refused becomes the message."""
    values = []
    for text in texts:
        try:
            values.append(kind.convert(text, None, None))
        except click.BadParameter as error:
            values.append(error.message)
    return values


def refused(kind, texts, what):
    """List the texts that are taken, or refused in other words."""
    values = zip(texts, converted(kind, texts), strict=True)
    return {text: value for text, value in values if not re.search(what, str(value))}


def test_numbers_are_finite_positive_and_bounded():
    texts = ["0", "-1", "nan", "inf", "1e999", "wide", "", "46"]
    assert refused(Number("DEGREES", most=45), texts, "not a number above 0, at most 45") == {}


def test_numbers():
    texts = ["3", "0.5", 7, "45"]
    assert converted(Number("DEGREES", most=45), texts) == [3.0, 0.5, 7.0, 45.0]


def test_shares():
    values = {
        "0": 0.0,
        "0.5": 0.5,
        1: 1.0,
        "80%": 0.8,
        "80 %": 0.8,
        "12.5%": 0.125,
        "0%": 0.0,
        "100%": 1.0,
        " 5% ": 0.05,
        "7%": 0.07,
    }
    assert converted(Share(), values) == list(values.values())


def test_a_share_is_from_0_to_1_or_a_percentage():
    texts = ["-0.1", "1.01", "nan", "inf", "", "half", "80", "101%", "-1%", "%", "nan%"]
    texts += ["5%%", "%5"]
    assert refused(Share(), texts, "a number from 0 to 1, or 0% to 100%") == {}


def test_counts():
    assert converted(Count(1, 10), ["1", " 7 ", 10, "+3"]) == [1, 7, 10, 3]


def test_a_count_is_a_whole_number_in_its_range():
    texts = ["0", "11", "-1", "1.5", "", "two", "1e1", "9" * 5000, True]
    assert refused(Count(1, 10), texts, "is not a whole number from 1 to 10") == {}
    assert max(map(len, converted(Count(1, 10), texts))) < 120


def test_region():
    assert converted(Region(), [[10, 20, 300, 400], "10, 20,300,400"]) == [(10, 20, 300, 400)] * 2


def test_a_region_is_four_whole_numbers_and_holds_a_pixel():
    texts = ["", "1,2,3", "1,2,3,4,5", "-1,0,5,5", "1.5,0,5,5", "a,b,c,d"]
    assert refused(Region(), texts, "four whole numbers") == {}
    assert refused(Region(), ["1,2,0,4", "1,2,3,0"], "holds no pixel") == {}


def test_grid():
    assert converted(Grid(), ["5x7", "1X99"]) == [(5, 7), (1, 99)]


def test_a_grid_is_rows_by_columns():
    texts = ["", "5", "0x4", "4x0", "100x2", "-1x2", "5x7x2", "5*7"]
    assert refused(Grid(), texts, "ROWSxCOLS") == {}


@pytest.mark.parametrize("kind", [Number("PX"), Region(), Grid()])
def test_values_convert_twice_to_the_same(kind):
    text = {"PX": "3", "X,Y,W,H": "1,2,3,4", "ROWSxCOLS": "2x3"}[kind.name]
    once = kind.convert(text, None, None)
    assert kind.convert(once, None, None) == once


def test_the_help_keeps_the_letters_of_a_unit():
    option = click.Option(["--filters"], type=Grid())
    context = click.Context(click.Command("x"))
    assert option.get_help_record(context)[0] == "--filters ROWSxCOLS"


def test_formats():
    texts = ["jpeg", "JPG", "tif", "Jp2"]
    assert converted(PhotoFormat(), texts) == ["jpeg", "jpeg", "tiff", "jp2"]


def test_formats_are_those_that_are_written():
    assert {SUFFIXES[f".{name}"] for name in PhotoFormat().choices} == set(ENDINGS)
    for name in ("gif", "heic", "raw", ""):
        with pytest.raises(click.BadParameter, match="not one of"):
            PhotoFormat().convert(name, None, None)
