from __future__ import annotations

import numpy as np
import pytest

from deshake.formats.transfer import (
    LINEAR,
    NAMED,
    SRGB,
    Power,
    Table,
    Transfer,
    decode,
    encode,
    is_clipped,
)

TABLE = Table(np.linspace(0, 1, 1024) ** 1.5 * 0.5 + np.linspace(0, 1, 1024) * 0.5)
CURVES: list[Transfer] = [*NAMED.values(), Power(1.8), Power(563 / 256), Power(0.5), TABLE]


@pytest.mark.parametrize("curve", CURVES, ids=lambda curve: curve.name)
@pytest.mark.parametrize("depth", [8, 16])
def test_encoding_decoded_codes_gives_the_same_codes(curve: Transfer, depth: int) -> None:
    codes = np.arange(1 << depth).astype(np.uint8 if depth == 8 else np.uint16).reshape(16, -1)
    light = decode(codes, curve)
    assert light.dtype == np.float32
    assert (light[0, 0], light[-1, -1]) == (0, 1)
    assert np.all(np.diff(light.ravel()) > 0)
    back = encode(light, curve, 8 if depth == 8 else 16)
    assert back.dtype == codes.dtype
    assert np.array_equal(back, codes)


@pytest.mark.parametrize("curve", CURVES, ids=lambda curve: curve.name)
def test_encoding_takes_the_nearest_code(curve: Transfer) -> None:
    edges = (np.arange(255) + 0.5) / 255  # halfway between codes
    light = curve.to_linear(edges)
    assert np.array_equal(encode(light * (1 - 1e-5), curve, 8), np.arange(255))
    assert np.array_equal(encode(light * (1 + 1e-5), curve, 8), np.arange(255) + 1)


@pytest.mark.parametrize("shape", [(768,), (16, 48), (16, 16, 3), (0, 4, 3), (3, 0)])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_each_code_is_decoded_by_the_curve(shape: tuple[int, ...], kind: type) -> None:
    codes = np.arange(np.prod(shape)).astype(kind).reshape(shape)[::-1]
    light = decode(codes, SRGB)
    assert (light.shape, light.dtype) == (shape, np.float32)
    expected = SRGB.to_linear(codes / np.iinfo(kind).max)
    assert np.array_equal(light, expected.astype(np.float32))


def test_srgb_has_the_standards_values() -> None:
    # 18 % grey is code 117.65 / 255 = 0.46135; the two pieces meet at 0.04045
    assert SRGB.to_linear(np.array([0.46135612950044164]))[0] == pytest.approx(0.18, abs=1e-12)
    assert SRGB.to_linear(np.array([0.04045]))[0] == pytest.approx(0.04045 / 12.92)
    below, above = SRGB.to_linear(np.array([0.04045, 0.0404501]))
    assert above - below < 1e-7


def test_sixteen_bits_do_not_band() -> None:
    ramp = np.linspace(0, 1, 200_001)
    codes = encode(ramp, NAMED["srgb"], 16).astype(int)
    # the curve is nowhere flatter than 0.4398, so each of the top half's codes must occur
    assert np.array_equal(np.unique(codes[codes > 32768]), np.arange(32769, 65536))


def test_values_outside_are_clipped_and_nan_is_refused() -> None:
    light = np.array([-1.0, -0.0, 1.0, 1.5, np.inf])
    assert encode(light, SRGB, 8).tolist() == [0, 0, 255, 255, 255]
    with pytest.raises(ValueError, match="not a number"):
        encode(np.array([0.5, np.nan]), SRGB, 16)


@pytest.mark.parametrize("light", [[0, 0.5, 0.5, 1], [0, 0.6, 0.5, 1]])
def test_tables_that_lose_codes_are_refused(light: list[float]) -> None:
    with pytest.raises(ValueError, match="rises strictly"):
        Table(np.array(light))


def test_clipping_counts_the_top_two_codes() -> None:
    assert is_clipped(np.array([253, 254, 255], np.uint8)).tolist() == [False, True, True]
    assert is_clipped(np.array([65277, 65278, 65535], np.uint16)).tolist() == [False, True, True]


@pytest.mark.parametrize("curve", [SRGB, LINEAR, Power(1.8), Table(np.linspace(0, 1, 50) ** 1.5)])
def test_floating_point_numbers_survive_beyond_black_and_white(curve: Transfer) -> None:
    values = np.array([-3, -0.4, 0, 0.3, 1, 1.5, 20], np.float32)
    light = decode(values, curve)
    assert light.dtype == np.float32
    assert np.all(np.diff(light) > 0)
    assert light[2] == 0
    assert light[4] == pytest.approx(1)
    assert encode(light, curve, 32) == pytest.approx(values, rel=1e-5)
    assert not is_clipped(values).any()
