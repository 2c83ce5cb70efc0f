from __future__ import annotations

import struct
import time
import tracemalloc
from typing import TYPE_CHECKING

import numpy as np
import piexif
import pytest
from support.mutated_files import mutated

from deshake.metadata.camera_tags import (
    CameraTags,
    _by_directories,
    _by_piexif,
    _camera_tags,
    read_camera_tags,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Entry = tuple[int, int, int, bytes]

BYTE, ASCII, SHORT, LONG, FRACTION, UNDEFINED = 1, 2, 3, 4, 5, 7
SLONG, SFRACTION, FLOAT, DOUBLE, UTF8 = 9, 10, 11, 12, 129
MAKE, MODEL, EXIF, GPS, INTEROP = 0x010F, 0x0110, 34665, 34853, 40965
ARTIST, COMMENT, MAKER_NOTE = 0x013B, 0x9C9C, 0x927C
FOCAL, ISO, FOCAL_35MM, WIDTH, HEIGHT, CROP_SIZE = 0x920A, 0x8827, 0xA405, 0xA002, 0xA003, 0xC620
MARKER = b"Exif\0\0"
LENS, THUMBNAIL, LENGTH = 0xA434, 513, 514


MAIN_AT, BELOW_AT, GPS_AT, THUMBNAIL_AT, END = 8, 4000, 8000, 12_000, 16_000

TAGS = CameraTags(
    make="Canon",
    model="IXUS 70",
    focal_mm=5.8,
    focal_35mm=35,
    pixel_size=(2592, 1944),
    iso=80,
)


def text(tag: int, value: bytes, kind: int = ASCII) -> Entry:
    return tag, kind, len(value), value


def block(order: str = "<", *, size: int = END, after: int = 0, **changed: list[Entry]) -> bytes:
    """Make the block of a camera; entries of a directory replace those of the same tag."""

    def number(code: str, *values: float) -> bytes:
        return struct.pack(f"{order}{code}", *values)

    out = bytearray(size)
    out[:8] = (b"II*\0" if order == "<" else b"MM\0*") + number("I", MAIN_AT)
    directories: dict[str, tuple[int, list[Entry]]] = {
        "main": (
            MAIN_AT,
            [
                text(MAKE, b"Canon\0"),
                text(MODEL, b"IXUS 70 \0\0"),
                (EXIF, LONG, 1, number("I", BELOW_AT)),
                (GPS, LONG, 1, number("I", GPS_AT)),
            ],
        ),
        "below": (
            BELOW_AT,
            [
                (ISO, SHORT, 1, number("H", 80)),
                (FOCAL, FRACTION, 1, number("II", 58, 10)),
                text(MAKER_NOTE, b"maker\0note\1\2\3", UNDEFINED),
                (WIDTH, LONG, 1, number("I", 2592)),
                (HEIGHT, SHORT, 1, number("H", 1944)),
                (FOCAL_35MM, SHORT, 1, number("H", 35)),
            ],
        ),
        "gps": (GPS_AT, [text(1, b"N\0")]),
        "thumbnail": (THUMBNAIL_AT, [(THUMBNAIL, LONG, 1, number("I", 9000))]),
    }
    for name, (at, stated) in directories.items():
        new = {entry[0] for entry in changed.get(name, [])}
        entries = [entry for entry in stated if entry[0] not in new] + changed.get(name, [])
        struct.pack_into(f"{order}H", out, at, len(entries))
        place, behind = at + 2, at + 2 + 12 * len(entries) + 4
        for tag, kind, count, raw in entries:
            struct.pack_into(f"{order}HHI", out, place, tag, kind, count)
            if len(raw) <= 4:
                out[place + 8 : place + 8 + len(raw)] = raw
            else:
                struct.pack_into(f"{order}I", out, place + 8, behind)
                out[behind : behind + len(raw)] = raw
                behind += len(raw)
            place += 12
        if name == "main":
            struct.pack_into(f"{order}I", out, place, after)
    return bytes(out)


def pack(code: str, *values: float) -> bytes:
    return struct.pack(f"<{code}", *values)


@pytest.mark.parametrize("order", ["<", ">"])
def test_piexif_reads_a_sound_block(order: str) -> None:
    sound = block(order, after=THUMBNAIL_AT)
    assert _by_piexif(sound) is not None
    assert read_camera_tags(sound) == TAGS


def test_the_block_reaches_piexif_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    read, load = [], piexif.load
    monkeypatch.setattr(piexif, "load", lambda given: (read.append(given), load(given))[1])
    sound = block()
    assert read_camera_tags(sound) == TAGS
    assert read == [sound]


@pytest.mark.parametrize(
    ("entry", "field", "expected"),
    [
        ((FOCAL, FRACTION, 1, pack("II", 58, 0)), "focal_mm", None),
        ((FOCAL, FRACTION, 1, pack("II", 0, 0)), "focal_mm", None),
        ((FOCAL, FRACTION, 1, pack("II", 0, 7)), "focal_mm", None),
        ((FOCAL, FRACTION, 1, pack("II", 2**32 - 1, 1)), "focal_mm", 2**32 - 1),
        ((FOCAL_35MM, SHORT, 1, pack("H", 0)), "focal_35mm", None),
        ((WIDTH, SLONG, 1, pack("i", 1000)), "pixel_size", (1000, 1944)),
        ((WIDTH, SLONG, 1, pack("i", -1000)), "pixel_size", None),
        ((ISO, LONG, 1, pack("I", 102_400)), "iso", 102_400),
        (text(LENS, b"  EF 24-105 \0\xff"), "lens_model", "EF 24-105"),
        (text(LENS, b"\0"), "lens_model", ""),
        (text(LENS, "Zoom é\0".encode()), "lens_model", "Zoom é"),
        (text(LENS, b"Zoom \xe9\0"), "lens_model", "Zoom \ufffd"),
    ],
)
def test_piexif_reads_odd_values_of_the_right_type(
    entry: Entry, field: str, expected: object
) -> None:
    sound = block(below=[entry])
    assert _by_piexif(sound) is not None
    assert getattr(read_camera_tags(sound), field) == expected
    assert read_camera_tags(sound) == _camera_tags(*_by_directories(sound))


@pytest.mark.parametrize(
    "entry",
    [
        (CROP_SIZE, SHORT, 2, pack("HH", 4000, 3000)),
        (CROP_SIZE, LONG, 2, pack("II", 4000, 3000)),
        (CROP_SIZE, FRACTION, 2, pack("IIII", 8000, 2, 3000, 1)),
    ],
)
def test_piexif_reads_the_size_of_a_negative(entry: Entry) -> None:
    sound = block(main=[entry], below=[(WIDTH, SHORT, 1, pack("H", 0))])
    assert _by_piexif(sound) is not None
    assert read_camera_tags(sound).pixel_size == (4000, 3000)


# What our own reader reads from a block of each kind, and how that differs from a sound block.
FALLBACKS = {
    "a signed fraction": (block(below=[(FOCAL, SFRACTION, 1, pack("ii", 58, 10))]), {}),
    "a double": (block(below=[(FOCAL, DOUBLE, 1, pack("d", 5.8))]), {}),
    "a float": (block(below=[(FOCAL, FLOAT, 1, pack("f", 5.5))]), {"focal_mm": 5.5}),
    "a whole number": (block(below=[(FOCAL, SHORT, 1, pack("H", 6))]), {"focal_mm": 6}),
    "two numbers that look like a fraction": (
        block(below=[(FOCAL, SHORT, 2, pack("HH", 58, 10))]),
        {"focal_mm": 58},
    ),
    "two fractions": (block(below=[(FOCAL, FRACTION, 2, pack("4I", 58, 10, 1, 1))]), {}),
    "two sensitivities": (block(below=[(ISO, SHORT, 2, pack("HH", 80, 0))]), {}),
    "a fraction for a whole number": (
        block(below=[(FOCAL_35MM, FRACTION, 1, pack("II", 35, 1))]),
        {},
    ),
    "a text without its NUL": (block(main=[text(MODEL, b"IXUS 70")]), {}),
    "a text without its type": (block(main=[text(MODEL, b"IXUS 70\0", UNDEFINED)]), {}),
    "a text in UTF-8": (block(main=[text(MODEL, b"IXUS 70\0", UTF8)]), {}),
    "another text in UTF-8": (block(main=[text(ARTIST, b"Somebody\0", UTF8)]), {}),
    "an unknown type": (block(main=[(ARTIST, 99, 1, b"\1")]), {}),
    "a count of zero": (block(gps=[(2, FRACTION, 0, b"")]), {}),
    "a huge count": (block(gps=[(2, BYTE, 2**22, b"")]), {}),
    "a huge count of the maker note": (
        block(below=[(MAKER_NOTE, UNDEFINED, 2**32 - 1, b"")]),
        {},
    ),
    "a long array of numbers": (block(below=[text(COMMENT, bytes(2000), BYTE)]), {}),
    "a value beyond the end": (block(main=[(ARTIST, ASCII, 20_000, b"")]), {}),
    "a tag twice": (block(main=[text(ARTIST, b"A\0"), text(ARTIST, b"B\0")]), {}),
    "positions beyond the end": (block(main=[(GPS, LONG, 1, pack("I", END))]), {}),
    "two pointers": (block(main=[(EXIF, LONG, 2, pack("II", BELOW_AT, GPS_AT))]), {}),
    "a pointer that is no number": (block(main=[(GPS, ASCII, 4, b"abc\0")]), {}),
    "a pointer to nowhere of the interoperability": (
        block(below=[(INTEROP, LONG, 1, pack("I", 2**32 - 1))]),
        {},
    ),
    "a thumbnail beyond the end": (block(after=2**32 - 1), {}),
    "a thumbnail that is no number": (
        block(after=THUMBNAIL_AT, thumbnail=[text(THUMBNAIL, b"a\0"), text(LENGTH, b"b\0")]),
        {},
    ),
    "a directory cut in two": (
        block()[: BELOW_AT + 2 + 5 * 12],
        {"focal_mm": None, "focal_35mm": None},
    ),
    "a longer block than a JPEG holds": (block(size=65_528), {}),
    "a block that ends before its EXIF directory": (
        block()[:BELOW_AT],
        {"focal_mm": None, "focal_35mm": None, "pixel_size": None, "iso": None},
    ),
}


@pytest.mark.parametrize("kind", FALLBACKS)
def test_our_own_reader_reads_what_piexif_does_not(kind: str) -> None:
    odd, changed = FALLBACKS[kind]
    assert _by_piexif(odd) is None
    assert read_camera_tags(odd) == CameraTags(**{**vars(TAGS), **changed})


def test_the_main_directory_may_end_the_block() -> None:
    cut = b"II*\0" + pack("IH", 8, 1) + pack("HHI", MAKE, ASCII, 4) + b"abc\0"
    assert _by_piexif(cut) is None
    assert read_camera_tags(cut) == CameraTags(make="abc")
    assert _by_piexif(cut + bytes(4)) is not None
    assert read_camera_tags(cut + bytes(4)) == CameraTags(make="abc")


def test_our_own_reader_reads_bigtiff() -> None:
    big = b"II" + pack("HHHQQ", 43, 8, 0, 16, 1) + pack("HHQ", MAKE, ASCII, 4) + b"abc\0"
    assert _by_piexif(big + bytes(12)) is None
    assert read_camera_tags(big + bytes(12)) == CameraTags(make="abc")


def test_a_block_is_never_taken_for_the_name_of_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "photo").write_bytes(block())
    assert piexif.load(b"photo")["0th"][MAKE] == b"Canon"
    assert read_camera_tags(b"photo") == CameraTags()


@pytest.mark.parametrize(
    ("odd", "tag", "misread"),
    [
        (block(below=[(FOCAL, SHORT, 2, pack("HH", 58, 10))]), FOCAL, (58, 10)),
        (block(below=[text(LENS, b"EF 24-105")]), LENS, b"EF 24-10"),
        (block(below=[(LENS, ASCII, 10, pack("I", END - 3))])[:-3] + b"EF ", LENS, b"EF "),
    ],
)
def test_piexif_alone_would_misread(odd: bytes, tag: int, misread: object) -> None:
    assert piexif.load(odd)["Exif"][tag] == misread
    assert _by_piexif(odd) is None


@pytest.mark.parametrize("kind", FALLBACKS)
def test_no_block_takes_much_time_or_memory(kind: str) -> None:
    odd, _ = FALLBACKS[kind]
    read_camera_tags(odd)  # imports piexif
    tracemalloc.start()
    started = time.process_time()
    read_camera_tags(odd)
    seconds, (_, peak) = time.process_time() - started, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert seconds < 1
    assert peak < 2**20


def test_many_entries_of_the_same_bytes_do_not_take_long() -> None:
    entries = pack("HHII", COMMENT, SHORT, 1000, 8) * 5000
    started = time.process_time()
    assert read_camera_tags(b"II*\0" + pack("IH", 8, 5000) + entries + bytes(4)) == CameraTags()
    assert time.process_time() - started < 1


def test_both_readers_agree_on_mutated_blocks(make_exif: Callable[..., bytes]) -> None:
    fraction = (58, 10)
    stated = {FOCAL: fraction, ISO: 80, LENS: "EF 24-105", MAKER_NOTE: b"maker note"}
    camera = {MAKE: "Canon", MODEL: "IXUS 70"}
    written = piexif.dump({"0th": camera, "Exif": stated, "GPS": {1: "N"}}).removeprefix(MARKER)
    random = np.random.default_rng(11)
    by_piexif = 0
    for sound in (written, make_exif("<"), make_exif(">")):
        for _ in range(1000):
            way, broken = mutated(sound, random)
            read = read_camera_tags(broken)
            assert read == _camera_tags(*_by_directories(broken)), way
            by_piexif += _by_piexif(broken) is not None
    assert 100 < by_piexif < 2900
