from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import ImageCms

from deshake.formats.icc import profile_transfer
from deshake.formats.transfer import LINEAR, SRGB, Power, Table
from deshake.metadata.profiles import power_profile

if TYPE_CHECKING:
    from collections.abc import Callable


def curv(*entries: float) -> bytes:
    return struct.pack(f">4s4xI{len(entries)}H", b"curv", len(entries), *map(int, entries))


def para(kind: int, *numbers: float) -> bytes:
    fixed = [round(number * 65536) for number in numbers]
    return struct.pack(f">4s4xHxx{len(fixed)}i", b"para", kind, *fixed)


def test_littlecms_own_srgb_profile_is_srgb() -> None:
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    assert profile_transfer(profile) is SRGB


@pytest.mark.parametrize("grey", [False, True])
def test_simple_curves(make_icc: Callable[..., bytes], *, grey: bool) -> None:
    def read(curve: bytes) -> object:
        return profile_transfer(make_icc(curve, grey=grey))

    srgb = SRGB.to_linear(np.linspace(0, 1, 1024))
    assert read(curv()) is LINEAR
    assert read(curv(2.2 * 256)) == Power(563 / 256)
    assert read(para(0, 1.8)) == Power(round(1.8 * 65536) / 65536)
    assert read(para(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)) is SRGB
    assert read(curv(*np.rint(65535 * srgb))) is SRGB


def test_a_table_with_a_flat_foot_is_recognised_as_its_power(
    make_icc: Callable[..., bytes],
) -> None:
    table = np.rint(65535 * np.linspace(0, 1, 4096) ** 2.2)
    assert table[1] == table[2] == 0
    assert profile_transfer(make_icc(curv(*table))) == Power(2.2)


def test_any_other_rising_table_is_used_unchanged(make_icc: Callable[..., bytes]) -> None:
    x = np.linspace(0, 1, 256)
    table = np.rint(65535 * (0.3 * x + 0.7 * x**3))
    curve = profile_transfer(make_icc(curv(*table)))
    assert isinstance(curve, Table)
    assert np.array_equal(curve.light, table / 65535)


def test_an_odd_parametric_curve_becomes_a_table(make_icc: Callable[..., bytes]) -> None:
    a = 1.0992968  # BT.709: ((x + a - 1) / a) ** (1 / 0.45) above, x / 4.5 below
    curve = profile_transfer(make_icc(para(3, 1 / 0.45, 1 / a, (a - 1) / a, 1 / 4.5, 0.0812429)))
    assert isinstance(curve, Table)
    half = curve.to_linear(np.array([0.5]))[0]
    assert half == pytest.approx(((0.5 + a - 1) / a) ** (1 / 0.45), abs=1e-4)


def test_curves_that_are_not_simple_give_none(make_icc: Callable[..., bytes]) -> None:
    assert profile_transfer(b"") is None
    assert profile_transfer(b"\0" * 200) is None
    assert profile_transfer(make_icc(curv(2.2 * 256), blue=curv(1.8 * 256))) is None
    assert profile_transfer(make_icc(curv(0))) is None
    assert profile_transfer(make_icc(curv(65535, 0))) is None
    assert profile_transfer(make_icc(curv(0, 100, 100, 65535))) is None
    assert profile_transfer(make_icc(para(7, 1))) is None
    assert profile_transfer(make_icc(para(1, 2, 0, 0))) is None
    assert profile_transfer(make_icc(b"mft2")) is None
    assert profile_transfer(make_icc(struct.pack(">4s4xI", b"curv", 1 << 31))) is None


def test_damaged_profiles_do_no_harm(make_icc: Callable[..., bytes]) -> None:
    profile = make_icc(curv(*range(0, 65536, 257)))
    for size in range(len(profile)):
        profile_transfer(profile[:size])


def lut_profile(gamma: float) -> bytes:
    """Make a profile that has a table in place of curves and primaries: sRGB's, with a power."""
    tables = np.rint(65535 * np.linspace(0, 1, 256) ** gamma).astype(">u2").tobytes() * 3
    corners = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), -1).reshape(-1, 3)
    d50 = [[0.4361, 0.3851, 0.1431], [0.2225, 0.7169, 0.0606], [0.0139, 0.0971, 0.7141]]
    grid = np.rint(32768 * corners @ np.transpose(d50)).astype(">u2").tobytes()
    lut = b"mft2" + bytes(4) + bytes([3, 3, 2, 0])
    lut += np.rint(65536 * np.eye(3)).astype(">i4").tobytes() + struct.pack(">HH", 256, 2)
    lut += tables + grid + struct.pack(">6H", 0, 65535, 0, 65535, 0, 65535)
    white = b"XYZ " + bytes(4) + struct.pack(">3i", 63190, 65536, 54061)
    text = "desc".encode("utf-16-be")
    words = struct.pack(">4s4xII4sII", b"mluc", 1, 12, b"enUS", len(text), 28) + text
    tags = {b"desc": words, b"cprt": words, b"wtpt": white, b"A2B0": lut}
    table, body = b"", b""
    for name, content in tags.items():
        table += struct.pack(">4sII", name, 132 + 12 * len(tags) + len(body), len(content))
        body += content + bytes(-len(content) % 4)
    head = struct.pack(">I4xI4s4s4s12x4s28x", 132 + len(table) + len(body), 0x02400000, b"scnr",
                       b"RGB ", b"XYZ ", b"acsp")  # fmt: skip
    head += white[8:]
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + body


@pytest.mark.parametrize("gamma", [1.0, 1.8, 2.4])
def test_the_greys_of_a_colour_table_give_its_curve(gamma: float) -> None:
    curve = profile_transfer(lut_profile(gamma))
    assert isinstance(curve, Power)
    assert curve.gamma == pytest.approx(gamma, abs=0.05)


def test_greys_like_srgbs_are_srgbs() -> None:
    assert profile_transfer(lut_profile(2.22)) in {SRGB, Power(2.22), Power(2.21), Power(2.23)}


def test_the_greys_give_one_curve_for_channels_that_differ() -> None:
    whole = power_profile(2.2)
    curve = para(0, 2.2)
    assert whole.count(curve) == 1  # shared by the channels
    own = whole + para(0, 2.3) + bytes(2)
    at = own.index(b"bTRC") + 4
    own = own[:at] + struct.pack(">I", len(whole)) + own[at + 4 :]
    own = struct.pack(">I", len(own)) + own[4:]
    curve_of_greys = profile_transfer(own)
    assert isinstance(curve_of_greys, Power)
    assert 2.15 < curve_of_greys.gamma < 2.3
