"""Files that are broken on purpose: valid files of every format, and a mutator with a seed."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from typing import TYPE_CHECKING

import cv2
import numpy as np
import tifffile
from PIL import Image
from skimage import data

from deshake.files.kernel_file import CameraFile, KernelFile, write_camera, write_kernel
from deshake.files.registration_file import RegistrationFile, write_registration
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel

from .crafted_photos import KINDS, written
from .heic_writer import heic

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

__all__ = ["HEIGHT", "WIDTH", "bombs", "mutated", "picture", "seeds"]

WIDTH, HEIGHT = 64, 48
_HOSTILE = (
    0,
    1,
    0x7F,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x10000,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFF0,
    0xFFFFFFFF,
)
_MAX_FLIPS = 24


def picture(depth: int = 8) -> np.ndarray:
    """Make a small photo, blurred a little along a slant."""
    sharp = cv2.resize(data.astronaut(), (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    blurred = cv2.filter2D(sharp.astype(np.float32), -1, np.eye(3, dtype=np.float32) / 3)
    kind = np.uint8 if depth == 8 else np.uint16
    return np.rint(blurred * (np.iinfo(kind).max / 255)).astype(kind)


def seeds(folder: Path) -> dict[str, bytes]:
    """Make valid files of every kind that is read, by name; the folder holds them meanwhile."""
    plain, deep = picture(), picture(16)
    files = {
        "a.jpg": written("JPEG", plain, KINDS, 6),
        "a.png": written("PNG", plain, KINDS, 1),
        "deep.png": written("PNG", deep, KINDS, 8),
        "a.tif": written("TIFF", deep, KINDS, 3),
        "a.webp": written("WebP", plain, KINDS, 1),
        "progressive.jpg": _saved(plain, "JPEG", progressive=True, quality=85),
        "lossy.webp": _saved(plain, "WEBP", quality=90),
        "lzw.tif": _saved(plain, "TIFF", compression="tiff_lzw"),
        "a.avif": _saved(plain, "AVIF", quality=90),
        "a.jp2": _saved(plain, "JPEG2000"),
        "a.dng": _dng(),
        "a.heic": heic(plain),
    }
    stream = io.BytesIO()
    tifffile.imwrite(stream, deep, tile=(16, 16), compression="zlib", predictor=True, metadata=None)
    files["tiled.tif"] = stream.getvalue()
    camera = Camera.from_focal(60, HEIGHT, WIDTH)
    turn = RotationKernel.from_path([(-0.02, -0.02, 0), (0.02, 0.02, 0)], camera)
    write_kernel(folder / "kernel.npz", KernelFile(turn, 0.9, {"command": "none"}), overwrite=True)
    write_camera(folder / "camera.npz", CameraFile(camera, "made"), overwrite=True)
    known = RegistrationFile(np.zeros(3), 1.0, camera, 1.0, {})
    write_registration(folder / "registration.npz", known, overwrite=True)
    for name in ("kernel.npz", "camera.npz", "registration.npz"):
        files[name] = (folder / name).read_bytes()
    return files


def _saved(codes: np.ndarray, form: str, **options: object) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(codes).save(stream, form, **options)
    return stream.getvalue()


def _dng() -> bytes:
    """Write the sensor's data of a camera with a Bayer pattern, as a DNG."""
    plain = picture(16).astype(float) / 65535
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    mosaic = np.take_along_axis(plain**2.2, (y % 2 + x % 2)[..., None], -1)[..., 0]
    identity = [part for value in np.eye(3).ravel() for part in (int(value), 1)]
    tags = [
        (33421, "H", 2, (2, 2), True),
        (33422, "B", 4, bytes((0, 1, 1, 2)), True),
        (50706, "B", 4, bytes((1, 4, 0, 0)), True),
        (50708, "s", 0, "Sensor Works One", True),
        (50717, "I", 1, 15000, True),
        (50721, "2i", 9, identity, True),
        (50728, "2I", 3, (1, 1, 1, 1, 1, 1), True),
    ]
    stream = io.BytesIO()
    codes = np.rint(mosaic * 15000).astype(np.uint16)
    tifffile.imwrite(stream, codes, photometric=32803, extratags=tags, metadata=None)
    return stream.getvalue()


def mutated(sound: bytes, random: np.random.Generator) -> tuple[str, bytes]:
    """Break a file in one way; return the way and the file."""
    ways = (_flip, _truncate, _swap, _cut_out, _repeat, _hostile_sizes, _hostile_sizes, _png_chunk)
    way = ways[random.integers(len(ways))]
    return way.__name__.strip("_"), way(bytearray(sound), random)


def _place(length: int, random: np.random.Generator) -> int:
    """Choose a place, as often in the first kilobyte as anywhere."""
    return int(random.integers(min(length, 1024) if random.random() < 0.5 else length))


def _flip(out: bytearray, random: np.random.Generator) -> bytes:
    for _ in range(random.integers(1, _MAX_FLIPS)):
        out[_place(len(out), random)] ^= 1 << int(random.integers(8))
    return bytes(out)


def _truncate(out: bytearray, random: np.random.Generator) -> bytes:
    return bytes(out[: _place(len(out), random)])


def _swap(out: bytearray, random: np.random.Generator) -> bytes:
    size = int(random.integers(4, max(5, len(out) // 4)))
    a, b = (int(random.integers(len(out) - size)) for _ in range(2))
    out[a : a + size], out[b : b + size] = out[b : b + size], out[a : a + size]
    return bytes(out)


def _cut_out(out: bytearray, random: np.random.Generator) -> bytes:
    at = _place(len(out), random)
    del out[at : at + int(random.integers(1, 64))]
    return bytes(out)


def _repeat(out: bytearray, random: np.random.Generator) -> bytes:
    at = _place(len(out), random)
    out[at:at] = out[at : at + int(random.integers(1, 256))] * int(random.integers(1, 40))
    return bytes(out)


def _hostile_sizes(out: bytearray, random: np.random.Generator) -> bytes:
    """Overwrite numbers of two or four bytes, of either order, by ones that break sums."""
    for _ in range(random.integers(1, 6)):
        code = ("<H", ">H", "<I", ">I")[random.integers(4)]
        size = struct.calcsize(code)
        at = _place(len(out) - size, random) // 2 * 2
        number = _HOSTILE[random.integers(len(_HOSTILE))] & (1 << 8 * size) - 1
        struct.pack_into(code, out, at, number)
    return bytes(out)


def _png_chunk(out: bytearray, random: np.random.Generator) -> bytes:
    """Break the content of a PNG's chunk, or mix the chunks up, under checksums that are right."""
    if out[:4] != b"\x89PNG":
        return _hostile_sizes(out, random)
    chunks, at = [], 8
    while at < len(out):
        (size,) = struct.unpack_from(">I", out, at)
        chunks.append((bytes(out[at + 4 : at + 8]), bytearray(out[at + 8 : at + 8 + size])))
        at += 12 + size
    if random.random() < 0.3:
        random.shuffle(chunks)
    for _ in range(random.integers(1, 4)):
        content = chunks[random.integers(len(chunks))][1]
        if len(content) > 4:
            content[:] = (_flip, _hostile_sizes)[random.integers(2)](content, random)
    return bytes(out[:8]) + b"".join(_chunk(*chunk) for chunk in chunks)


def bombs(sound: dict[str, bytes]) -> dict[str, Callable[[], bytes]]:
    """Return what makes small files that would become huge ones, by name."""

    def tiff() -> bytes:
        stream, codes = io.BytesIO(), np.zeros((12_000, 12_000), np.uint8)
        tifffile.imwrite(stream, codes, compression="zlib", metadata=None)
        return stream.getvalue()

    def npz() -> bytes:
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            head = (
                b"\x93NUMPY\1\0v\0{'descr': '<f8', 'fortran_order': False, 'shape': (26214400,), }"
            )
            archive.writestr("format.npy", head.ljust(127) + b"\n" + bytes(200 << 20))
        return stream.getvalue()

    def in_png(name: bytes, before: bytes) -> bytes:
        return _zeros_png(64, 0, 1, _chunk(name, before + _packed_zeros(400 << 20)))

    descriptions = b"XML:com.adobe.xmp\0\0\0\0\0" + b"<rdf:Description " * 500_000
    return {
        "bomb-grey.png": lambda: _zeros_png(16_000, 0, 1),
        "bomb-deep.png": lambda: _zeros_png(8_000, 6, 2),
        "bomb-large.png": lambda: _zeros_png(20_000, 0, 1),
        "bomb-profile.png": lambda: in_png(b"iCCP", b"x\0\0"),
        "bomb-packet.png": lambda: in_png(b"iTXt", b"XML:com.adobe.xmp\0\1\0\0\0"),
        "bomb-text.png": lambda: in_png(b"zTXt", b"Raw profile type exif\0\0"),
        "bomb-xmp.png": lambda: _zeros_png(64, 0, 1, _chunk(b"iTXt", descriptions)),
        "bomb-strip.tif": tiff,
        "bomb-array.npz": npz,
        "bomb-size.jpg": lambda: _resized(sound["progressive.jpg"], b"\xff\xc2", ">H", 5, 7),
        "bomb-size.jp2": lambda: _resized(sound["a.jp2"], b"\xff\x51", ">I", 6, 10),
        "bomb-size.avif": lambda: _resized(sound["a.avif"], b"ispe", ">I", 8, 12),
        "bomb-size.heic": lambda: _resized(sound["a.heic"], b"ispe", ">I", 8, 12),
        "bomb-size.dng": lambda: _resized(
            sound["a.dng"], struct.pack("<HHI", 256, 4, 1), "<I", 8, 20
        ),
        "bomb-flat.webp": lambda: _saved(np.zeros((12_000, 12_000, 3), np.uint8), "WEBP", method=0),
    }


def _chunk(name: bytes, content: bytes) -> bytes:
    check = struct.pack(">I", zlib.crc32(name + content))
    return struct.pack(">I", len(content)) + name + content + check


def _packed_zeros(size: int) -> bytes:
    """Compress zeros: the blocks of a megabyte, time and again, and their checksum by its rule."""

    def blocks(length: int) -> bytes:
        packer = zlib.compressobj(9, wbits=-zlib.MAX_WBITS)
        return packer.compress(bytes(length)) + packer.flush(zlib.Z_FULL_FLUSH)

    whole, rest = divmod(size, 1 << 20)
    packed = blocks(1 << 20) * whole + blocks(rest) + b"\x03\0"
    return b"\x78\xda" + packed + struct.pack(">HH", size % 65521, 1)


def _zeros_png(side: int, kind: int, sample: int, more: bytes = b"") -> bytes:
    """Make a black PNG, with another chunk before its pixels."""
    head = struct.pack(">IIBBBBB", side, side, 8 * sample, kind, 0, 0, 0)
    packed = _packed_zeros(side * (1 + side * sample * {0: 1, 6: 4}[kind]))
    body = _chunk(b"IHDR", head) + more + _chunk(b"IDAT", packed)
    return b"\x89PNG\r\n\x1a\n" + body + _chunk(b"IEND", b"")


def _resized(sound: bytes, mark: bytes, code: str, *offsets: int) -> bytes:
    """Write other sides into a file's header, at offsets from a mark."""
    out = bytearray(sound)
    for offset in offsets:
        struct.pack_into(code, out, out.index(mark) + offset, 16_000)
    return bytes(out)
