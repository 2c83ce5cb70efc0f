"""Every kind of photo into every format, through the command line, read back by other programs.

The tables of docs/formats.md say what is tried and what must come out of it. All fixtures are made
here, byte by byte: the EXIF has values that break naive writers.
"""

from __future__ import annotations

import itertools
import struct
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image
from support import metadata_readers
from support.crafted_photos import CITY, HEIGHT, ICC, KINDS, NOTE, TITLE, WIDTH, codes, photo

from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.metadata.provenance import read_provenance
from deshake.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterable

ENDINGS = {
    "JPEG": "jpg",
    "PNG": "png",
    "TIFF": "tif",
    "WebP": "webp",
    "AVIF": "avif",
    "JPEG 2000": "jp2",
    "HEIC": "heic",
    "RAW": "dng",
}
LOSSY = ("JPEG", "WebP", "AVIF")
COLOURS = {"grey": 1, "grey + alpha": 2, "RGB": 3, "RGB + alpha": 4}
DOCUMENT = (Path(__file__).parents[2] / "docs" / "formats.md").read_text("utf-8")


def table(head: str) -> list[dict[str, str]]:
    """Read the table of docs/formats.md whose header begins with `head`."""
    lines = DOCUMENT[DOCUMENT.index(f"| {head} |") :].splitlines()
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in itertools.takewhile(lambda line: line.startswith("|"), lines)
    ]
    return [dict(zip(rows[0], row, strict=True)) for row in rows[2:]]


SOURCES = [
    (row["from"], int(depth), COLOURS[colours.strip()])
    for row in table("from")
    for depth in row["bits"].split(",")
    for colours in row["colours"].split(",")
]
INTO = {row.pop("into"): row for row in table("into")}
FORMATS = tuple(INTO["EXIF"])


@pytest.fixture(scope="module")
def readers():
    with metadata_readers.exiftool() as exiftool:
        yield (*metadata_readers.READERS, *([exiftool] if exiftool else []))


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """The kernel of a camera that stood still, which leaves the pixels as they are."""
    path = tmp_path_factory.mktemp("kernel") / "still.npz"
    write_kernel(
        path,
        KernelFile(RotationKernel.from_path([(0, 0, 0)], Camera.from_focal(40, HEIGHT, WIDTH))),
    )
    return path


def there(kinds: Iterable[str], source: str, channels: int) -> set[str]:
    """Which kinds of metadata a photo of the sources has.

    A grey one has no profile of colours, a RAW file gets one as it is developed.
    """
    missing = {"IPTC"} if source not in {"JPEG", "PNG", "TIFF", "RAW"} else set()
    missing |= {"profile"} if source == "JPEG 2000" else set()
    expected = set(kinds) - missing - ({"profile"} if channels < 3 else set())
    return (expected - {"profile"}) | {"developed"} if source == "RAW" else expected


def check_metadata(path: Path, form: str, kinds: set[str], err: str, readers: object) -> None:
    expected = {
        "EXIF": ("Acme", 5.8, 0.5, 1, WIDTH, HEIGHT),
        "maker note": NOTE,
        "GPS": 48 + 51 / 60 + 30 / 3600,
        "XMP": CITY,
        "IPTC": TITLE,
        "profile": ICC,
    }
    with_exiftool = len(readers) > len(metadata_readers.READERS)
    if form == "JPEG 2000" and not with_exiftool:
        pytest.skip("exiftool alone reads the metadata of a JPEG 2000, and is not installed")
    read = [fields for reader in readers if (fields := reader(path))]
    for kind in KINDS:
        if kind == "profile" and "developed" in kinds:
            continue
        values = [fields[kind] for fields in read if kind in fields]
        if kind in kinds and INTO[kind][form] == "kept":
            assert len(values) >= (2 if form != "JPEG 2000" else 1) - (not with_exiftool), kind
            for item in values:
                assert item == pytest.approx(expected[kind]), kind
        else:
            assert not values, kind
    left_out = [kind for kind in KINDS if kind in kinds and INTO[kind][form] == "left out"]
    assert [f"{form} has no place for {kind}" in err for kind in left_out] == [True] * len(left_out)
    assert all(
        fields["comment"] == b"\0\0no charset"[:11] for fields in read if "comment" in fields
    )
    assert {fields["orientation"] for fields in read if "orientation" in fields} == {1}
    assert {fields["software"] for fields in read if "software" in fields} == {
        f"deshake {__version__}"
    }
    assert read_provenance(path)["deshake"] == __version__
    data = path.read_bytes()
    assert b"the old thumb" not in data
    if "maker note" in kinds:  # its offset still leads where it led
        at = data.index(b"NOTE")
        begin = data.rindex(b"II*\0", 0, at)
        (offset,) = struct.unpack_from("<I", data, at + 4)
        assert data[begin + offset :].startswith(NOTE)


def check_pixels(path: Path, source: Path, form: str, depth: int, channels: int) -> None:
    wanted = codes(depth, channels)
    if source.suffix == ".jpg":
        with Image.open(source) as picture:
            wanted = np.atleast_3d(np.asarray(picture))
    if channels == 4 and source.suffix in {".webp", ".avif"}:  # full opacity is not kept
        wanted, channels = wanted[..., :3], 3
    wanted = np.rot90(wanted, -1)
    if form == "TIFF":
        read = np.atleast_3d(tifffile.imread(path))
    elif form in {"PNG", "JPEG 2000"}:
        read = np.atleast_3d(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
        read = read[..., {1: [0], 2: [0, 3], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[channels]]
    else:
        with Image.open(path) as picture:
            read = np.asarray(picture.convert("RGB"))
        wanted = wanted[..., [0, 0, 0] if channels < 3 else [0, 1, 2]]
    lossy = form in LOSSY or source.suffix in {".avif", ".heic"}
    if not lossy:
        assert np.array_equal(read, wanted)
        return
    assert read.shape == wanted.shape
    result, right = (item / np.iinfo(item.dtype).max for item in (read, wanted))
    assert np.abs(result - right).mean() < 0.025


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(("source", "depth", "channels"), SOURCES)
def test_everything_goes_everywhere(
    deshake, tmp_path, still, readers, *, source, depth, channels, form
):
    path, out = tmp_path / f"a.{ENDINGS[source]}", tmp_path / f"out.{ENDINGS[form]}"
    path.write_bytes(photo(source, depth, channels, KINDS, 1 if source == "AVIF" else 6))
    outcome = deshake("deblur", path, still, "-o", out)
    assert outcome.code == 0
    check_metadata(out, form, there(KINDS, source, channels), outcome.err, readers)
    if source != "RAW":  # whose colours are the sensor's
        check_pixels(out, path, form, depth, channels)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("source", "depth", "channels"), SOURCES)
def test_each_kind_goes_alone(deshake, tmp_path, still, readers, *, source, depth, channels, kind):
    form = {"HEIC": "JPEG", "RAW": "TIFF"}.get(source, source)  # what is read, but not written
    path, out = tmp_path / f"a.{ENDINGS[source]}", tmp_path / f"out.{ENDINGS[form]}"
    path.write_bytes(photo(source, depth, channels, (kind,), 1 if source == "AVIF" else 6))
    outcome = deshake("deblur", path, still, "-o", out)
    assert outcome.code == 0
    assert "metadata" not in outcome.err
    check_metadata(out, form, there([kind], source, channels), outcome.err, readers)
