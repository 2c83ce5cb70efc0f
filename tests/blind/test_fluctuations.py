from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from deshake.blind.fluctuations import Fluctuations, box_filtered

SIZE = 32
BAND = 0.07, 0.4
SIDE = 7


@pytest.fixture
def spectra() -> np.ndarray:
    """The power spectra of three tiles of noise, whole planes, (3, N, N)."""
    tiles = np.random.default_rng(5).normal(size=(3, SIZE, SIZE))
    return (np.abs(np.fft.fft2(tiles)) ** 2).astype(np.float32)


def half(spectra: np.ndarray) -> np.ndarray:
    """The half of the plane that a real transform has."""
    return spectra[..., : SIZE // 2 + 1]


def whole(values: np.ndarray) -> np.ndarray:
    """The whole plane (P, N, N) from its half, by the symmetry."""
    mirrored = np.roll(values[:, ::-1, -2:0:-1], 1, 1)
    return np.concatenate([values, mirrored], -1)


def periodic_box(spectra: np.ndarray, side: int) -> np.ndarray:
    """Each plane, filtered by a box as a torus."""
    return np.stack([uniform_filter(one, side, mode="wrap") for one in spectra.astype(float)])


def test_a_half_has_the_whole(spectra) -> None:
    np.testing.assert_allclose(whole(half(spectra)), spectra, rtol=1e-5)


@pytest.mark.parametrize("side", [3, 7])
@pytest.mark.parametrize("times", [1, 2])
def test_a_box_filter_on_a_half_is_that_on_the_torus(spectra, side, times) -> None:
    wanted = spectra
    for _ in range(times):
        wanted = periodic_box(wanted, side)
    filtered = box_filtered(half(spectra), side, times)
    np.testing.assert_allclose(filtered, half(wanted), rtol=1e-4)


def test_fluctuations_are_what_two_boxes_leave_without_the_means_along_lines(spectra) -> None:
    logs = np.log(spectra)
    rest = logs - periodic_box(periodic_box(logs, SIDE), SIDE)
    frequency = np.fft.fftfreq(SIZE)
    radius = np.hypot(frequency[:, None], frequency)
    inside = (radius > BAND[0]) & (radius < BAND[1])
    turn = np.mod(np.arctan2(frequency[:, None], frequency), np.pi) / np.pi
    line = np.minimum((turn * SIZE).astype(int), SIZE - 1)
    for n in np.unique(line[inside]):
        own = inside & (line == n)
        rest[:, own] -= rest[:, own].mean(1, keepdims=True)
    rest[:, ~inside] = 0
    fluctuations = Fluctuations(SIZE, BAND, SIDE)
    values = fluctuations.of(half(logs))
    assert fluctuations.product(values, values) == pytest.approx((rest**2).sum(), rel=1e-4)
    assert values.std() == pytest.approx(rest[:, inside].std(), rel=0.01)
    counted = np.repeat(values, fluctuations.counts.astype(int), axis=1)
    np.testing.assert_allclose(np.sort(counted), np.sort(rest[:, inside]), atol=1e-4)


def test_means_along_lines_are_subtracted_once(spectra) -> None:
    fluctuations = Fluctuations(SIZE, BAND, SIDE)
    values = fluctuations.of(half(np.log(spectra)))
    again = fluctuations.off_lines(values.copy())
    np.testing.assert_allclose(again, values, atol=1e-5)
    lifted = values + np.float32(3)  # one number along each line
    np.testing.assert_allclose(fluctuations.off_lines(lifted), values, atol=1e-5)


def test_what_is_the_same_along_each_line_is_left_out() -> None:
    fluctuations = Fluctuations(SIZE, BAND, SIDE)
    frequency = np.fft.fftfreq(SIZE)
    turn = np.mod(np.arctan2(frequency[:, None], frequency), np.pi) / np.pi
    lines = half(np.floor(turn * SIZE).astype(np.float32)).ravel()  # a number for each line
    values = lines[fluctuations._places][None].repeat(3, 0)
    assert np.ptp(values) > 10
    assert fluctuations.off_lines(values) == pytest.approx(0, abs=1e-3)
    rng = np.random.default_rng(3)
    one, other = (rng.normal(size=values.shape).astype(np.float32) for _ in range(2))
    left = fluctuations.product(fluctuations.off_lines(one.copy()), other)
    right = fluctuations.product(one, fluctuations.off_lines(other.copy()))
    assert left == pytest.approx(right, rel=1e-3)  # a projection


def test_fluctuations_are_linear_and_have_their_adjoint(spectra) -> None:
    fluctuations = Fluctuations(SIZE, BAND, SIDE)
    one, other = half(spectra), half(np.log(spectra))
    mixed = fluctuations.of(2 * one - 30 * other)
    scale = np.abs(mixed).max()
    both = 2 * fluctuations.of(one) - 30 * fluctuations.of(other)
    np.testing.assert_allclose(mixed, both, atol=1e-5 * scale)
    values = fluctuations.of(other)
    left = fluctuations.product(fluctuations.of(one), values)
    right = float(np.vdot(whole(one), whole(fluctuations.adjoint(values))))
    assert left == pytest.approx(right, rel=1e-4)
