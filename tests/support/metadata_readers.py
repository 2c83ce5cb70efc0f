"""What other programs find in a photo's metadata, by kind of it."""

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

    Found = dict[str, Any]
    Reader = Callable[[Path], Found]

__all__ = ["READERS", "exiftool"]


def _tags(exif: Image.Exif) -> Found:
    below, gps = exif.get_ifd(0x8769), exif.get_ifd(0x8825)
    found = {}
    if 271 in exif:
        odd = (0x920A, 0x920B, 0xA301, 0xA002, 0xA003)
        found["EXIF"] = (exif[271], *(float(below[tag]) for tag in odd))
        found["comment"] = bytes(below[0x9286])
    if 0x927C in below:
        found["maker note"] = bytes(below[0x927C])[8:]
    if gps:
        found["GPS"] = _degrees(gps[2])
    if 274 in exif:
        found["orientation"] = exif[274]
    return found | ({"software": exif[305]} if 305 in exif else {})


def _by_pillow(path: Path) -> Found:
    try:
        with Image.open(path) as picture:
            picture.load()
            found = _tags(picture.getexif())
            iptc = IptcImagePlugin.getiptcinfo(picture)
            found |= {"IPTC": iptc[2, 5].decode()} if iptc else {}
            raw = picture.info.get("Raw profile type iptc")
            if raw:
                data = bytes.fromhex("".join(raw.split()[2:]))
                found["IPTC"] = re.search(rb"\x1c\x02\x05\0\x07(.{7})", data)[1].decode()
            xmp, icc = picture.info.get("xmp"), picture.info.get("icc_profile")
            return found | _city(xmp or b"") | ({"profile": icc} if icc else {})
    except UnidentifiedImageError:  # grey and alpha of 16 bits in a TIFF
        return {}


def _by_opencv(path: Path) -> Found:
    kinds, blocks = cv2.imreadWithMetadata(str(path), cv2.IMREAD_UNCHANGED)[1:]
    found = {}
    for kind, block in zip(kinds, blocks, strict=True):
        data = block.tobytes()
        if kind == cv2.IMAGE_METADATA_EXIF:
            exif = Image.Exif()
            exif.load(data.removeprefix(b"Exif\0\0"))
            found |= _tags(exif)
        elif kind == cv2.IMAGE_METADATA_XMP:
            found |= _city(data)
        elif kind == cv2.IMAGE_METADATA_ICCP:
            found["profile"] = data
    return found


def _by_piexif(path: Path) -> Found:
    if path.suffix not in {".jpg", ".tif", ".webp"}:  # which is all that piexif reads
        return {}
    read = piexif.load(str(path))
    found = {
        "orientation": read["0th"][274],
        "software": read["0th"].get(305, b"").decode() or None,
    }
    if read["GPS"]:
        found["GPS"] = _degrees(top / bottom for top, bottom in read["GPS"][2])
    if 0x927C in read["Exif"]:
        found["maker note"] = read["Exif"][0x927C][8:]
    return found


def _by_tifffile(path: Path) -> Found:
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
            found["GPS"] = _degrees(parts[i] / parts[i + 1] for i in (0, 2, 4))
        found |= _city(bytes(read.get(700, b"")))
        found |= {"profile": bytes(read[34675])} if 34675 in read else {}
        if 33723 in read:
            found["IPTC"] = re.search(rb"\x1c\x02\x05\0\x07(.{7})", bytes(read[33723]))[1].decode()
        return found


def _degrees(parts: Iterable[float]) -> float:
    return sum(float(part) / 60**power for power, part in enumerate(parts))


def _city(packet: bytes) -> dict[str, str]:
    found = re.search(rb'City="([^"]*)"', packet)
    return {} if found is None else {"XMP": found[1].decode("utf-8")}


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

    def ask(path: Path) -> Found:
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
        note = base64.b64decode(read.get("EXIF:MakerNoteUnknown", "base64:")[7:])
        found |= {"maker note": note[8:]} if note else {}
        profile = read.get("ICC_Profile:ICC_Profile", "")
        return found | ({"profile": base64.b64decode(profile[7:])} if profile else {})

    yield ask
    run.communicate(b"-stay_open\nFalse\n", timeout=60)
