"""HEIC files for tests: no free encoder of HEVC is at hand, so pictures go in as raw samples.

Every block of 16 x 16 is coded as PCM, which HEVC allows: a block is one arithmetically coded bin,
a terminating one, and its samples. Sizes are multiples of 16.

References: ITU-T H.265, Secs. 7.3, 9.3; ISO/IEC 23008-12; ISO/IEC 14496-12 and -15.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["heic", "stored"]

_BLOCK = 16
# The ranges of the less probable bin in the first states, at a range of 448 to 510 (Table 9-52).
_RANGES = (240, 227, 216, 205, 195, 185, 175, 166, 158, 150, 142, 135, 128, 122, 116, 110, 104, 99)
_YCC = np.array(  # of full range, ITU-R BT.601
    [[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]]
)


class _Bits:
    """A string of bits."""

    def __init__(self) -> None:
        self.bits: list[int] = []

    def u(self, count: int, value: int) -> _Bits:
        self.bits += [value >> shift & 1 for shift in range(count - 1, -1, -1)]
        return self

    def ue(self, *values: int) -> _Bits:
        for value in values:
            length = (value + 1).bit_length()
            self.u(2 * length - 1, value + 1)
        return self

    def align(self) -> _Bits:
        return self.u(-len(self.bits) % 8, 0)

    def stop(self) -> bytes:
        return self.u(1, 1).align().data()

    def data(self) -> bytes:
        return np.packbits(self.bits).tobytes()


def _nal(kind: int, payload: bytes) -> bytes:
    """Wrap a payload: no three bytes in it look like a start code."""
    out, zeros = bytearray(struct.pack(">H", kind << 9 | 1)), 0
    for byte in payload:
        if zeros == 2 and byte <= 3:
            out.append(3)
            zeros = 0
        out.append(byte)
        zeros = zeros + 1 if byte == 0 else 0
    return bytes(out)


def _profile_level(bits: _Bits, depth: int) -> _Bits:
    profile = 1 if depth == 8 else 2
    bits.u(8, profile).u(32, 3 << 29 if depth == 8 else 1 << 29)
    return bits.u(4, 0b1001).u(32, 0).u(12, 0).u(8, 93)


def _parameter_sets(height: int, width: int, depth: int) -> dict[int, bytes]:
    """Return the sets of parameters by their kinds: video, sequence and picture."""
    video = _profile_level(_Bits().u(4, 0).u(2, 3).u(6, 0).u(3, 0).u(1, 1).u(16, 0xFFFF), depth)
    video.u(1, 1).ue(0, 0, 0).u(6, 0).ue(0).u(2, 0)
    sequence = _profile_level(_Bits().u(4, 0).u(3, 0).u(1, 1), depth).ue(0, 1, width, height)
    sequence.u(1, 0).ue(depth - 8, depth - 8, 0).u(1, 1).ue(0, 0, 0)
    sequence.ue(1, 0, 0, 2, 0, 0)  # coding blocks of 16 alone, transforms of 4 to 16
    sequence.u(3, 0).u(1, 1).u(4, depth - 1).u(4, depth - 1).ue(1, 0).u(1, 1)  # PCM
    sequence.ue(0).u(5, 0)
    picture = _Bits().ue(0, 0).u(7, 0).ue(0, 0, 0).u(3, 0).ue(0, 0).u(6, 0).u(1, 0)
    picture.u(1, 1).u(1, 0).u(1, 1).u(2, 0).ue(0).u(2, 0)  # no deblocking
    return {32: _nal(32, video.stop()), 33: _nal(33, sequence.stop()), 34: _nal(34, picture.stop())}


def _slice(planes: list[NDArray[np.integer]], depth: int) -> bytes:
    """Code the planes of a picture, 4:2:0, all as PCM."""
    bits = _Bits().u(2, 0b10).ue(0, 2, 0)
    bits.u(1, 1).align()
    height, width = planes[0].shape
    places = [(y, x) for y in range(0, height, _BLOCK) for x in range(0, width, _BLOCK)]
    for index, (y, x) in enumerate(places):
        # one whole block, then "PCM follows", which ends the arithmetic coding
        low = (508 if index else 510) - _RANGES[index] - 2
        bits.u(8, low >> 1).u(1, 1).align()
        for number, plane in enumerate(planes):
            step = 1 if number == 0 else 2
            size = _BLOCK // step
            for code in plane[y // step :, x // step :][:size, :size].ravel():
                bits.u(depth, int(code))
    bits.u(8, 508 >> 1).u(1, 1).align()
    return _nal(19, bits.data())


def stored(picture: NDArray[np.integer], depth: int) -> list[NDArray[np.integer]]:
    """Turn RGB codes, equal in squares of 2 x 2, into planes of YCbCr 4:2:0 of full range."""
    top = (1 << depth) - 1
    ycc = picture.astype(float) @ _YCC.T
    ycc[..., 1:] += (top + 1) // 2
    codes = np.clip(np.rint(ycc), 0, top).astype(int)
    return [codes[..., 0], codes[::2, ::2, 1], codes[::2, ::2, 2]]


def _box(name: bytes, *contents: bytes, full: int | None = None) -> bytes:
    head = b"" if full is None else struct.pack(">I", full)
    content = head + b"".join(contents)
    return struct.pack(">I4s", len(content) + 8, name) + content


def heic(
    picture: NDArray[np.integer],
    *,
    depth: int = 8,
    exif: bytes = b"",
    xmp: bytes = b"",
    icc: bytes = b"",
    turns: int = 0,
    colours: tuple[int, int] = (1, 13),
    auxiliary: bytes = b"",
) -> bytes:
    """Write a HEIC file.

    Parameters
    ----------
    picture : (H, W, 3) array of int
        RGB codes of `depth` bits, equal in squares of 2 x 2; both sides multiples of 16, and no
        more than 18 blocks of 16 x 16 in all.
    depth : {8, 10}
        Bits a sample.
    exif, xmp, icc : bytes
        Metadata.
    turns : int
        Quarter turns anticlockwise that a reader has to make.
    colours : (int, int)
        Primaries and transfer by the numbers of ITU-T H.273.
    auxiliary : bytes
        The kind of a second picture that belongs to the first one.

    """
    height, width = picture.shape[:2]
    sets = _parameter_sets(height, width, depth)
    coded = _slice(stored(picture, depth), depth)
    configuration = bytes([1, 1 if depth == 8 else 2]) + struct.pack(
        ">I", 3 << 29 if depth == 8 else 1 << 29
    )
    configuration += b"\x90" + bytes(5) + bytes([93, 0xF0, 0, 0xFC, 0xFD, 0xF8 | depth - 8])
    configuration += bytes([0xF8 | depth - 8, 0, 0, 0x0F, len(sets)])
    for kind, unit in sets.items():
        configuration += struct.pack(">BHH", 0x80 | kind, 1, len(unit)) + unit
    properties = [
        _box(b"hvcC", configuration),
        _box(b"ispe", struct.pack(">II", width, height), full=0),
        _box(b"pixi", bytes([3, depth, depth, depth]), full=0),
        _box(b"colr", b"nclx", struct.pack(">HHHB", *colours, 6, 0x80)),
    ]
    if icc:
        properties.append(_box(b"colr", b"prof", icc))
    if turns:
        properties.append(_box(b"irot", bytes([turns])))
    items = [(b"hvc1", b"", struct.pack(">I", len(coded)) + coded)]
    own = [list(range(1, len(properties) + 1))]
    if auxiliary:
        properties.append(_box(b"auxC", auxiliary + b"\0", full=0))
        items.append((b"hvc1", b"", items[0][2]))
        own.append([1, 2, 3, 4, len(properties)])
    if exif:
        items.append((b"Exif", b"", bytes(4) + exif))
    if xmp:
        items.append((b"mime", b"application/rdf+xml\0", xmp))
    infos = [
        _box(b"infe", struct.pack(">HH4s", number, 0, kind) + b"\0" + rest, full=2 << 24)
        for number, (kind, rest, _) in enumerate(items, 1)
    ]
    references = [
        _box(b"auxl" if kind == b"hvc1" else b"cdsc", struct.pack(">HHH", number, 1, 1))
        for number, (kind, _, _) in enumerate(items, 1)
        if number > 1
    ]
    associations = b"".join(
        struct.pack(">HB", number, len(which)) + bytes(0x80 | index for index in which)
        for number, which in enumerate(own, 1)
    )

    def meta(start: int) -> bytes:
        places, at = b"", start
        for number, (_, _, content) in enumerate(items, 1):
            places += struct.pack(">HHHII", number, 0, 1, at, len(content))
            at += len(content)
        return _box(
            b"meta",
            _box(b"hdlr", bytes(4) + b"pict" + bytes(13), full=0),
            _box(b"pitm", struct.pack(">H", 1), full=0),
            _box(b"iinf", struct.pack(">H", len(items)), *infos, full=0),
            *([_box(b"iref", *references, full=0)] if references else []),
            _box(
                b"iprp",
                _box(b"ipco", *properties),
                _box(b"ipma", struct.pack(">I", len(own)), associations, full=0),
            ),
            _box(b"iloc", struct.pack(">BBH", 0x44, 0, len(items)), places, full=0),
            full=0,
        )

    brands = _box(b"ftyp", b"heic", bytes(4), b"mif1heic" if depth == 8 else b"mif1heix")
    head = len(brands) + len(meta(0)) + 8
    return brands + meta(head) + _box(b"mdat", *(content for _, _, content in items))
