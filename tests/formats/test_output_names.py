from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from deshake.errors import OutputError
from deshake.formats.encoding import ENDINGS
from deshake.formats.output_names import default_output, output_ending, output_name

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("a.jpg", "a.deshaken.jpg"),
        ("a.b.TIF", "a.b.deshaken.TIF"),
        ("noending", "noending.deshaken"),
        ("dir.x/a.png", "a.deshaken.png"),
    ],
)
def test_default_names(name: str, expected: str) -> None:
    assert output_name(name) == expected


def test_the_default_output_is_beside_the_input_or_in_the_given_folder(tmp_path: Path) -> None:
    source = tmp_path / "a.jpg"
    source.write_bytes(b"x")
    folder = tmp_path / "out"
    folder.mkdir()
    assert default_output(source) == tmp_path / "a.deshaken.jpg"
    assert default_output(source, folder) == folder / "a.deshaken.jpg"
    assert default_output(source, folder / "b.png") == folder / "b.png"


@pytest.mark.parametrize("overwrite", [False, True])
def test_the_photo_itself_is_refused(tmp_path: Path, *, overwrite: bool) -> None:
    source = tmp_path / "a.jpg"
    source.write_bytes(b"x")
    with pytest.raises(OutputError, match="the output is the input itself"):
        default_output(source, source, overwrite=overwrite)


@pytest.mark.parametrize(
    ("name", "form", "ending"),
    [
        ("a.JPG", None, ".JPG"),
        ("a.JPE", "JPEG", ".JPE"),
        ("a.JPG", "PNG", ".png"),
        ("a.tiff", "TIFF", ".tiff"),
        ("a.nef", None, ".tif"),
        ("a.nef", "JPEG", ".jpg"),
        ("a.heic", "TIFF", ".tif"),
        ("noending", "JPEG2000", ".jp2"),
    ],
)
def test_the_ending_is_the_photos_own_if_it_stands_for_the_format(
    name: str, form: str | None, ending: str
) -> None:
    assert output_ending(name, form) == ending
    assert output_name(name, form).endswith(f".deshaken{ending}")


def test_every_format_has_its_usual_ending() -> None:
    assert set(ENDINGS.values()) == {".jpg", ".png", ".tif", ".webp", ".avif", ".jp2"}
