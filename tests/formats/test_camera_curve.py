from __future__ import annotations

import numpy as np
import pytest

from deshake.formats.camera_curve import CameraCurve, light_before, light_behind
from deshake.formats.transfer import LINEAR, SRGB, decode, encode


def test_the_curve_is_that_of_its_description() -> None:
    light = np.linspace(0, 1, 101, dtype=np.float32)
    even = light.astype(float) ** 0.44
    wanted = (0.45 * even + 0.55 * even**2 * (3 - 2 * even)) ** 2
    np.testing.assert_allclose(light_behind(light), wanted, atol=2e-6)


def test_the_light_before_the_curve_is_that_which_the_curve_turns_into_the_light() -> None:
    light = np.linspace(-0.5, 4, 10001).astype(np.float32)
    np.testing.assert_allclose(light_behind(light_before(light)), light, atol=3e-6)
    before = light_before(light)
    assert before.dtype == np.float32
    assert (np.diff(before) > 0).all()


def test_black_and_white_stay_and_the_middle_becomes_darker_before_the_curve() -> None:
    np.testing.assert_allclose(light_before(np.array([0.0, 1.0])), [0, 1], atol=1e-6)
    middle = np.array([0.2, 0.3, 0.4])
    assert (light_before(middle) < middle).all()


def test_half_the_curve_lies_between_the_curve_and_none() -> None:
    light = np.linspace(0.1, 0.9, 81).astype(np.float32)
    before, half = light_before(light), light_before(light, 0.5)
    assert half.dtype == np.float32
    assert (before < half).all()
    assert (half < light).all()
    even = np.linspace(0, 1, 101) ** 0.47
    behind = (0.725 * even + 0.275 * even**2 * (3 - 2 * even)) ** 2
    np.testing.assert_allclose(light_before(behind, 0.5), np.linspace(0, 1, 101), atol=3e-6)


def test_above_white_the_curve_goes_on_without_a_corner() -> None:
    below, above = np.array([0.999, 1.0]), np.array([1.0, 1.001])
    slopes = [float(np.diff(light_before(pair))[0]) for pair in (below, above)]
    assert slopes[0] == pytest.approx(slopes[1], rel=0.02)


@pytest.mark.parametrize("transfer", [SRGB, LINEAR])
@pytest.mark.parametrize("depth", [8, 16])
def test_codes_survive_the_light_before_the_curve(transfer, depth) -> None:
    codes = np.arange(1 << depth).astype(np.uint8 if depth == 8 else np.uint16)[None]
    curve = CameraCurve(transfer)
    np.testing.assert_array_equal(encode(decode(codes, curve), curve, depth), codes)
    assert curve.name == f"{transfer.name} and a camera's tone curve"
    light = light_before(decode(codes, transfer))
    np.testing.assert_allclose(decode(codes, curve), light, atol=2e-6)
