from __future__ import annotations

import click
import pytest

from deshake.cli.values import Count, Grid, Number, PhotoFormat, Region, Share
from deshake.formats.encoding import ENDINGS, SUFFIXES


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "1e999", "wide", "", "46"])
def test_numbers_are_finite_positive_and_bounded(text):
    with pytest.raises(click.BadParameter, match="not a number above 0, at most 45"):
        Number("DEGREES", most=45).convert(text, None, None)


@pytest.mark.parametrize(("text", "value"), [("3", 3.0), ("0.5", 0.5), (7, 7.0), ("45", 45.0)])
def test_numbers(text, value):
    assert Number("DEGREES", most=45).convert(text, None, None) == value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *(("0", 0.0), ("0.5", 0.5), (1, 1.0), ("80%", 0.8), ("80 %", 0.8), ("12.5%", 0.125)),
        *(("0%", 0.0), ("100%", 1.0), (" 5% ", 0.05), ("7%", 0.07)),
    ],
)
def test_shares(text, value):
    assert Share().convert(text, None, None) == value


@pytest.mark.parametrize(
    "text",
    ["-0.1", "1.01", "nan", "inf", "", "half", "80", "101%", "-1%", "%", "nan%", "5%%", "%5"],
)
def test_a_share_is_from_0_to_1_or_a_percentage(text):
    with pytest.raises(click.BadParameter, match="a number from 0 to 1, or 0% to 100%"):
        Share().convert(text, None, None)


@pytest.mark.parametrize(("text", "value"), [("1", 1), (" 7 ", 7), (10, 10), ("+3", 3)])
def test_counts(text, value):
    assert Count(1, 10).convert(text, None, None) == value


@pytest.mark.parametrize("text", ["0", "11", "-1", "1.5", "", "two", "1e1", "9" * 5000, True])
def test_a_count_is_a_whole_number_in_its_range(text):
    with pytest.raises(click.BadParameter, match="is not a whole number from 1 to 10") as error:
        Count(1, 10).convert(text, None, None)
    assert len(str(error.value)) < 120


def test_region():
    assert Region().convert([10, 20, 300, 400], None, None) == (10, 20, 300, 400)
    assert Region().convert("10, 20,300,400", None, None) == (10, 20, 300, 400)


@pytest.mark.parametrize("text", ["", "1,2,3", "1,2,3,4,5", "-1,0,5,5", "1.5,0,5,5", "a,b,c,d"])
def test_a_region_is_four_whole_numbers(text):
    with pytest.raises(click.BadParameter, match="four whole numbers"):
        Region().convert(text, None, None)


@pytest.mark.parametrize("text", ["1,2,0,4", "1,2,3,0"])
def test_a_region_holds_a_pixel(text):
    with pytest.raises(click.BadParameter, match="holds no pixel"):
        Region().convert(text, None, None)


@pytest.mark.parametrize(("text", "value"), [("5x7", (5, 7)), ("1X99", (1, 99))])
def test_grid(text, value):
    assert Grid().convert(text, None, None) == value


@pytest.mark.parametrize("text", ["", "5", "0x4", "4x0", "100x2", "-1x2", "5x7x2", "5*7"])
def test_a_grid_is_rows_by_columns(text):
    with pytest.raises(click.BadParameter, match="ROWSxCOLS"):
        Grid().convert(text, None, None)


@pytest.mark.parametrize("kind", [Number("PX"), Region(), Grid()])
def test_values_convert_twice_to_the_same(kind):
    text = {"PX": "3", "X,Y,W,H": "1,2,3,4", "ROWSxCOLS": "2x3"}[kind.name]
    once = kind.convert(text, None, None)
    assert kind.convert(once, None, None) == once


def test_the_help_keeps_the_letters_of_a_unit():
    option = click.Option(["--filters"], type=Grid())
    context = click.Context(click.Command("x"))
    assert option.get_help_record(context)[0] == "--filters ROWSxCOLS"


@pytest.mark.parametrize(
    ("text", "value"), [("jpeg", "jpeg"), ("JPG", "jpeg"), ("tif", "tiff"), ("Jp2", "jp2")]
)
def test_formats(text, value):
    assert PhotoFormat().convert(text, None, None) == value


def test_formats_are_those_that_are_written():
    assert {SUFFIXES[f".{name}"] for name in PhotoFormat().choices} == set(ENDINGS)
    for name in ("gif", "heic", "raw", ""):
        with pytest.raises(click.BadParameter, match="not one of"):
            PhotoFormat().convert(name, None, None)
