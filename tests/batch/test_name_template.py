from __future__ import annotations

from pathlib import Path

import pytest

from deshake.batch.folders import InputPhoto
from deshake.batch.name_template import NameTemplate
from deshake.errors import OutputError


def place(text, path, below="", form=None):
    return NameTemplate(text, form).place(InputPhoto(Path(path), Path(below))).as_posix()


@pytest.mark.parametrize(
    ("text", "path", "below", "result"),
    [
        ("sharp/{folder}/{stem}_x.{ext}", "in/d/e/a.JPG", "d/e", "sharp/d/e/a_x.JPG"),
        ("sharp/{folder}/{stem}_x.{ext}", "in/a.jpg", "", "sharp/a_x.jpg"),
        ("{folder}/{stem}.{ext}", "in/a.jpg", "", "a.jpg"),
        ("{parent}/{stem}.png", "/in/one/a.jpg", "", "one/a.png"),
        ("o/{parent}-{stem}.{ext}", "/a.jpg", "", "o/-a.jpg"),
        ("a{{b}}/{stem}{{1}}.{ext}", "x.jpg", "", "a{b}/x{1}.jpg"),
        ("/top/{stem}.{ext}", "a.b.nef", "", "/top/a.b.tif"),
        ("{stem}.{ext}", "{ext}.jpg", "", "{ext}.jpg"),
    ],
)
def test_fields_are_those_of_the_photo(text, path, below, result):
    assert place(text, path, below) == result


def test_the_parent_is_a_name_also_where_the_path_has_none(tmp_path, monkeypatch):
    (tmp_path / "one" / "two").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "one" / "two")
    assert place("o/{parent}.{ext}", "a.jpg") == "o/two.jpg"
    assert place("o/{parent}.{ext}", "../a.jpg") == "o/one.jpg"


def test_the_ending_is_that_of_the_format():
    assert place("{stem}.{ext}", "a.JPG", form="JPEG") == "a.JPG"
    assert place("{stem}.{ext}", "a.png", form="JPEG") == "a.jpg"
    assert place("{stem}.tiff", "a.png", form="TIFF") == "a.tiff"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{stem", "a brace stands alone"),
        ("stem}.jpg", "a brace stands alone"),
        (
            "{name}.jpg",
            r"\{name\} is no field; there are \{folder\}, \{parent\}, \{stem\}, \{ext\}",
        ),
        ("{}.jpg", r"\{\} is no field"),
        ("{0}.jpg", r"\{0\} is no field"),
        ("{stem.__class__}.jpg", r"\{stem.__class__\} is no field"),
        ("{stem[0]}.jpg", r"\{stem\[0\]\} is no field"),
        ("{stem:>9999999999}.jpg", r"\{stem:>9999999999\} is no field"),
        ("{stem!r}.jpg", r"\{stem!r\} is no field"),
        ("{folder/stem}.jpg", r"\{folder/stem\} is no field"),
        ("o/{stem}", "has to end in"),
        ("o/{stem}{ext}", "has to end in"),
        ("{stem}.nef", "has to end in"),
        ("{ext}/x.gif", "has to end in"),
        ("o/{folder}/../{stem}.{ext}", "no .. behind a field"),
    ],
)
def test_wrong_templates_are_refused(text, says):
    with pytest.raises(ValueError, match=says):
        NameTemplate(text)


def test_an_ending_of_another_format_is_refused():
    with pytest.raises(ValueError, match="another format than --format"):
        NameTemplate("{stem}.png", "JPEG")


@pytest.mark.parametrize("text", ["out/{stem}/x.{ext}", "out/{folder}/{stem}/{stem}.jpg"])
def test_no_name_of_a_photo_leads_out_of_the_folder(text):
    assert Path("...jpg").stem == ".."
    with pytest.raises(OutputError, match="leads out of out"):
        place(text, "...jpg")
    assert place("../out/{stem}-/x.{ext}", "...jpg") == "../out/..-/x.jpg"


def test_a_name_without_fields_is_no_template():
    template = NameTemplate("o/a{{1}}.jpg")
    assert not template.has_fields
    assert template.name == Path("o/a{1}.jpg")
