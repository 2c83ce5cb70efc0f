"""The metadata of a photo as other programs read them, by their kinds."""

from __future__ import annotations

import base64
import contextlib
import json
import re
import shutil
import subprocess
from typing import TYPE_CHECKING, Any

import cv2
import piexif
import tifffile
from PIL import Image, IptcImagePlugin, UnidentifiedImageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    Fields = dict[str, Any]
    Reader = Callable[[Path], Fields]

__all__ = ["READERS", "exiftool"]


def _tags(exif: Image.Exif) -> Fields:
    below, gps = exif.get_ifd(0x8769), exif.get_ifd(0x8825)
    fields = {}
    if 271 in exif:
        odd = (0x920A, 0x920B, 0xA301, 0xA002, 0xA003)
        fields["EXIF"] = (exif[271], *(float(below[tag]) for tag in odd))
        fields["comment"] = bytes(below[0x9286])
    if 0x927C in below:
        fields["maker note"] = bytes(below[0x927C])[8:]
    if gps:
        fields["GPS"] = _degrees(gps[2])
    if 274 in exif:
        fields["orientation"] = exif[274]
    return fields | ({"software": exif[305]} if 305 in exif else {})


def _by_pillow(path: Path) -> Fields:
    try:
        with Image.open(path) as picture:
            picture.load()
            fields = _tags(picture.getexif())
            iptc = IptcImagePlugin.getiptcinfo(picture)
            fields |= {"IPTC": iptc[2, 5].decode()} if iptc else {}
            raw = picture.info.get("Raw profile type iptc")
            if raw:
                data = bytes.fromhex("".join(raw.split()[2:]))
                fields["IPTC"] = re.search(rb"\x1c\x02\x05\0\x07(.{7})", data)[1].decode()
            xmp, icc = picture.info.get("xmp"), picture.info.get("icc_profile")
            return fields | _city(xmp or b"") | ({"profile": icc} if icc else {})
    except UnidentifiedImageError:  # grey and alpha of 16 bits in a TIFF
        return {}


def _by_opencv(path: Path) -> Fields:
    kinds, blocks = cv2.imreadWithMetadata(str(path), cv2.IMREAD_UNCHANGED)[1:]
    fields = {}
    for kind, block in zip(kinds, blocks, strict=True):
        data = block.tobytes()
        if kind == cv2.IMAGE_METADATA_EXIF:
            exif = Image.Exif()
            exif.load(data.removeprefix(b"Exif\0\0"))
            fields |= _tags(exif)
        elif kind == cv2.IMAGE_METADATA_XMP:
            fields |= _city(data)
        elif kind == cv2.IMAGE_METADATA_ICCP:
            fields["profile"] = data
    return fields


def _by_piexif(path: Path) -> Fields:
    if path.suffix not in {".jpg", ".tif", ".webp"}:  # which is all that piexif reads
        return {}
    read = piexif.load(str(path))
    fields = {
        "orientation": read["0th"][274],
        "software": read["0th"].get(305, b"").decode() or None,
    }
    if read["GPS"]:
        fields["GPS"] = _degrees(top / bottom for top, bottom in read["GPS"][2])
    if 0x927C in read["Exif"]:
        fields["maker note"] = read["Exif"][0x927C][8:]
    return fields


def _by_tifffile(path: Path) -> Fields:
    if path.suffix != ".tif":
        return {}
    with tifffile.TiffFile(path) as file:
        page = file.pages.first
        read = {tag.code: tag.value for tag in page.tags}
        below, gps = read.get(34665, {}), read.get(34853)
        fields = {"orientation": int(read[274]), "software": read.get(305)}
        if 271 in read:
            top, bottom = below["FocalLength"]
            odd = ("FlashEnergy", "SceneType", "PixelXDimension", "PixelYDimension")
            fields["EXIF"] = (read[271], top / bottom, *(below[name] for name in odd))
            fields["comment"] = bytes(below["UserComment"])
        if "MakerNote" in below:
            fields["maker note"] = bytes(below["MakerNote"])[8:]
        if gps:
            parts = gps["GPSLatitude"]
            fields["GPS"] = _degrees(parts[i] / parts[i + 1] for i in (0, 2, 4))
        fields |= _city(bytes(read.get(700, b"")))
        fields |= {"profile": bytes(read[34675])} if 34675 in read else {}
        if 33723 in read:
            fields["IPTC"] = re.search(rb"\x1c\x02\x05\0\x07(.{7})", bytes(read[33723]))[1].decode()
        return fields


def _degrees(parts: Iterable[float]) -> float:
    return sum(float(part) / 60**power for power, part in enumerate(parts))


def _city(packet: bytes) -> dict[str, str]:
    city = re.search(rb'City="([^"]*)"', packet)
    return {} if city is None else {"XMP": city[1].decode("utf-8")}


READERS = (_by_pillow, _by_opencv, _by_piexif, _by_tifffile)


@contextlib.contextmanager
def exiftool() -> Iterator[Reader | None]:
    """Keep one exiftool running; give a function that asks it, or None if it is not installed."""
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
    how = [
        "-j",
        "-n",
        "-b",
        "-G0",
        *(f"-{name}" for name in wanted),
        "-ICC_Profile",
        "-EXIF:MakerNoteUnknown",
    ]

    def ask(path: Path) -> Fields:
        run.stdin.write("\n".join([*how, str(path), "-execute\n"]).encode())
        run.stdin.flush()
        answer = b""
        while not answer.endswith(b"{ready}\n"):
            answer += run.stdout.readline()
        [read] = json.loads(answer.removesuffix(b"{ready}\n"))
        fields = {"orientation": read["EXIF:Orientation"], "software": read.get("EXIF:Software")}
        fields |= {"GPS": read["EXIF:GPSLatitude"]} if "EXIF:GPSLatitude" in read else {}
        if "EXIF:Make" in read:
            fields["EXIF"] = tuple(read[f"EXIF:{name}"] for name in odd)
        fields |= {"XMP": read["XMP:City"]} if "XMP:City" in read else {}
        fields |= {"IPTC": read["IPTC:ObjectName"]} if "IPTC:ObjectName" in read else {}
        note = base64.b64decode(read.get("EXIF:MakerNoteUnknown", "base64:")[7:])
        fields |= {"maker note": note[8:]} if note else {}
        profile = read.get("ICC_Profile:ICC_Profile", "")
        return fields | ({"profile": base64.b64decode(profile[7:])} if profile else {})

    yield ask
    run.communicate(b"-stay_open\nFalse\n", timeout=60)
