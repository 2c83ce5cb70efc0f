"""Every kind of photo into every format, through the command line, read back by other programs.

The tables of docs/formats.md say what is tried and what must come out of it. All fixtures are made
here, byte by byte: the EXIF has values that break naive writers.
"""

from __future__ import annotations

import base64
import itertools
import json
import re
import shutil
import struct
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import piexif
import pytest
import tifffile
from crafted_photos import CITY, ICC, KINDS, NOTE, TITLE, codes, photo
from PIL import Image, IptcImagePlugin, UnidentifiedImageError

from deshake import __version__
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.io.kernel_file import KernelFile, write_kernel

if TYPE_CHECKING:
    from collections.abc import Iterable

ENDINGS = {"JPEG": "jpg", "PNG": "png", "TIFF": "tif", "WebP": "webp"}
COLOURS = {"grey": 1, "grey + alpha": 2, "RGB": 3, "RGB + alpha": 4}
DOCUMENT = (Path(__file__).parents[2] / "docs" / "formats.md").read_text("utf-8")


def table(head: str) -> list[dict[str, str]]:
    """Read the table of docs/formats.md that begins so."""
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


# Readers: what each finds, by kind.


def tags(exif: Image.Exif) -> dict[str, object]:
    below, gps = exif.get_ifd(0x8769), exif.get_ifd(0x8825)
    found = {}
    if 271 in exif:
        odd = (0x920A, 0x920B, 0xA301, 0xA002, 0xA003)
        found["EXIF"] = (exif[271], *(float(below[tag]) for tag in odd))
        found["comment"] = bytes(below[0x9286])
    if 0x927C in below:
        found["maker note"] = bytes(below[0x927C])[8:]
    if gps:
        found["GPS"] = degrees(gps[2])
    return found | {"orientation": exif[274], "software": exif.get(305)}


def by_pillow(path: Path) -> dict[str, object]:
    try:
        with Image.open(path) as picture:
            picture.load()
            found = tags(picture.getexif())
            iptc = IptcImagePlugin.getiptcinfo(picture)
            found |= {"IPTC": iptc[2, 5].decode()} if iptc else {}
            raw = picture.info.get("Raw profile type iptc")
            if raw:
                data = bytes.fromhex("".join(raw.split()[2:]))
                found["IPTC"] = re.search(rb"\x1c\x02\x05\0\x07(.{7})", data)[1].decode()
            xmp, icc = picture.info.get("xmp"), picture.info.get("icc_profile")
            return found | city(xmp or b"") | ({"profile": icc} if icc else {})
    except UnidentifiedImageError:  # grey and alpha of 16 bits in a TIFF
        return {}


def by_opencv(path: Path) -> dict[str, object]:
    kinds, blocks = cv2.imreadWithMetadata(str(path), cv2.IMREAD_UNCHANGED)[1:]
    found = {}
    for kind, block in zip(kinds, blocks, strict=True):
        data = block.tobytes()
        if kind == cv2.IMAGE_METADATA_EXIF:
            exif = Image.Exif()
            exif.load(data.removeprefix(b"Exif\0\0"))
            found |= tags(exif)
        elif kind == cv2.IMAGE_METADATA_XMP:
            found |= city(data)
        elif kind == cv2.IMAGE_METADATA_ICCP:
            found["profile"] = data
    return found


def by_piexif(path: Path) -> dict[str, object]:
    if path.suffix == ".png":
        return {}  # which piexif does not read
    read = piexif.load(str(path))
    found = {
        "orientation": read["0th"][274],
        "software": read["0th"].get(305, b"").decode() or None,
    }
    if read["GPS"]:
        found["GPS"] = degrees(top / bottom for top, bottom in read["GPS"][2])
    if 0x927C in read["Exif"]:
        found["maker note"] = read["Exif"][0x927C][8:]
    return found


def by_tifffile(path: Path) -> dict[str, object]:
    if path.suffix != ".tif":
        return {}
    with tifffile.TiffFile(path) as file:
        page = file.pages.first
        read = {tag.code: tag.value for tag in page.tags}
        below, gps = read.get(34665, {}), read.get(34853)
        found = {"orientation": int(read[274]), "software": read.get(305)}
        if 271 in read:
            top, bottom = below["FocalLength"]
            odd = ("FlashEnergy", "SceneType", "PixelXDimension", "PixelYDimension")
            found["EXIF"] = (read[271], top / bottom, *(below[name] for name in odd))
            found["comment"] = bytes(below["UserComment"])
        if "MakerNote" in below:
            found["maker note"] = bytes(below["MakerNote"])[8:]
        if gps:
            parts = gps["GPSLatitude"]
            found["GPS"] = degrees(parts[i] / parts[i + 1] for i in (0, 2, 4))
        found |= city(bytes(read.get(700, b"")))
        found |= {"profile": bytes(read[34675])} if 34675 in read else {}
        if 33723 in read:
            found["IPTC"] = re.search(rb"\x1c\x02\x05\0\x07(.{7})", bytes(read[33723]))[1].decode()
        return found


def degrees(parts: Iterable[float]) -> float:
    return sum(float(part) / 60**power for power, part in enumerate(parts))


def city(packet: bytes) -> dict[str, str]:
    found = re.search(rb'City="([^"]*)"', packet)
    return {} if found is None else {"XMP": found[1].decode("utf-8")}


@pytest.fixture(scope="module")
def exiftool():
    """Keep one exiftool running; a function that asks it, or None."""
    if shutil.which("exiftool") is None:
        yield None
        return
    run = subprocess.Popen(
        ["exiftool", "-stay_open", "True", "-@", "-"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    odd = (
        "Make",
        "FocalLength",
        "FlashEnergy",
        "SceneType",
        "ExifImageWidth",
        "ExifImageHeight",
    )
    wanted = (*odd, "Orientation", "Software", "GPSLatitude", "XMP:City", "IPTC:ObjectName")
    how = ["-j", "-n", "-b", "-G0", *(f"-{name}" for name in wanted), "-ICC_Profile"]

    def ask(path: Path) -> dict[str, object]:
        run.stdin.write("\n".join([*how, str(path), "-execute\n"]).encode())
        run.stdin.flush()
        answer = b""
        while not answer.endswith(b"{ready}\n"):
            answer += run.stdout.readline()
        [read] = json.loads(answer.removesuffix(b"{ready}\n"))
        found = {"orientation": read["EXIF:Orientation"], "software": read.get("EXIF:Software")}
        found |= {"GPS": read["EXIF:GPSLatitude"]} if "EXIF:GPSLatitude" in read else {}
        if "EXIF:Make" in read:
            found["EXIF"] = tuple(read[f"EXIF:{name}"] for name in odd)
        found |= {"XMP": read["XMP:City"]} if "XMP:City" in read else {}
        found |= {"IPTC": read["IPTC:ObjectName"]} if "IPTC:ObjectName" in read else {}
        profile = read.get("ICC_Profile:ICC_Profile", "")
        return found | ({"profile": base64.b64decode(profile[7:])} if profile else {})

    yield ask
    run.communicate(b"-stay_open\nFalse\n", timeout=20)


# What must come out.


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """The kernel of a camera that stood still, which leaves the pixels as they are."""
    path = tmp_path_factory.mktemp("kernel") / "still.npz"
    write_kernel(
        path, KernelFile(RotationKernel.from_path([(0, 0, 0)], Camera.from_focal(20, 16, 24)))
    )
    return path


def there(kinds: Iterable[str], source: str, channels: int) -> set[str]:
    """Which kinds of metadata a photo of the sources has: a grey one has no profile of colours."""
    missing = {"IPTC"} if source == "WebP" else set()
    return set(kinds) - missing - ({"profile"} if channels < 3 else set())


def check_metadata(path: Path, form: str, kinds: set[str], err: str, exiftool: object) -> None:
    expected = {
        "EXIF": ("Acme", 5.8, 0.5, 1, 24, 16),
        "maker note": NOTE,
        "GPS": 48 + 51 / 60 + 30 / 3600,
        "XMP": CITY,
        "IPTC": TITLE,
        "profile": ICC,
    }
    readers = [by_pillow, by_opencv, by_piexif, by_tifffile, *([exiftool] if exiftool else [])]
    read = [found for reader in readers if (found := reader(path))]
    for kind in KINDS:
        told = [found[kind] for found in read if kind in found]
        if kind in kinds and INTO[kind][form] == "kept":
            assert len(told) >= (2 if exiftool else 1), kind
            for item in told:
                assert item == pytest.approx(expected[kind]), kind
        else:
            assert not told, kind
    left_out = [kind for kind in kinds if INTO[kind][form] == "left out"]
    assert [f"{form} has no place for {kind}" in err for kind in left_out] == [True] * len(left_out)
    assert all(found["comment"] == b"\0\0no charset"[:11] for found in read if "comment" in found)
    assert {found["orientation"] for found in read if "orientation" in found} == {1}
    assert {found["software"] for found in read if "software" in found} == {
        f"deshake {__version__}"
    }
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
    if source.suffix == ".webp":  # which keeps no opacity that is full
        wanted, channels = wanted[..., :3], 3
    wanted = np.rot90(wanted, -1)
    if form == "TIFF":
        assert np.array_equal(np.atleast_3d(tifffile.imread(path)), wanted)
        return
    if form == "PNG":
        read = np.atleast_3d(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
        order = {1: [0], 2: [0, 3], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[channels]
        assert np.array_equal(read[..., order], wanted)
        return
    with Image.open(path) as picture:
        read = np.asarray(picture.convert("RGB")).astype(float)
    grey = channels < 3
    plain = wanted[..., [0, 0, 0] if grey else [0, 1, 2]] / (257 if depth == 16 else 1)
    assert read.shape == plain.shape
    assert np.abs(read - plain).mean() < 6


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(("source", "depth", "channels"), SOURCES)
def test_everything_goes_everywhere(
    deshake, tmp_path, still, exiftool, *, source, depth, channels, form
):
    path, out = tmp_path / f"a.{ENDINGS[source]}", tmp_path / f"out.{ENDINGS[form]}"
    path.write_bytes(photo(source, depth, channels, KINDS, 6))
    outcome = deshake("deblur", path, still, "-o", out)
    assert outcome.code == 0
    check_metadata(out, form, there(KINDS, source, channels), outcome.err, exiftool)
    check_pixels(out, path, form, depth, channels)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("source", "depth", "channels"), SOURCES)
def test_each_kind_goes_alone(deshake, tmp_path, still, exiftool, *, source, depth, channels, kind):
    path, out = tmp_path / f"a.{ENDINGS[source]}", tmp_path / f"out.{ENDINGS[source]}"
    path.write_bytes(photo(source, depth, channels, (kind,), 8))
    outcome = deshake("deblur", path, still, "-o", out)
    assert (outcome.code, outcome.err) == (0, "")
    check_metadata(out, source, there([kind], source, channels), outcome.err, exiftool)
