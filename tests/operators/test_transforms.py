from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.operators.transforms import (
    ComplexTransforms,
    PackedTransforms,
    squared_responses,
    transforms,
)
from deshake.signal.gradients import adjoint_differences, differences

KINDS = [ComplexTransforms, PackedTransforms]
LENGTHS = [8, 20, 47, 64]


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


def pictures(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def filtered(blocks: np.ndarray, spectrum: np.ndarray) -> np.ndarray:
    """Filter blocks (..., N, N) by the textbook."""
    return np.fft.irfft2(np.fft.rfft2(blocks) * spectrum, blocks.shape[-2:])


@pytest.mark.parametrize("least", LENGTHS)
def test_transforms_are_undone(kind, least: int) -> None:
    fourier = kind(least)
    n = fourier.length
    assert n >= least
    blocks = pictures(2, 3, n, n)
    before = blocks.copy()
    spectra = fourier.rfft(blocks)
    np.testing.assert_array_equal(blocks, before)
    assert spectra.nbytes == 6 * fourier.nbytes
    back = fourier.irfft(spectra)
    assert back.dtype == np.float32
    np.testing.assert_allclose(back / fourier.gain, blocks, atol=1e-5)
    part = fourier.irfft(fourier.rfft(blocks), 5) / fourier.gain
    np.testing.assert_allclose(part, blocks[..., :5, :5], atol=1e-5)


def test_smaller_blocks_lie_in_the_corner_of_zeros(kind) -> None:
    fourier = kind(20)
    small = pictures(2, 7, 6)
    back = fourier.irfft(fourier.rfft(small)) / fourier.gain
    np.testing.assert_allclose(back[:, :7, :6], small, atol=1e-5)
    np.testing.assert_allclose(back[:, 7:], 0, atol=1e-5)
    np.testing.assert_allclose(back[..., 6:], 0, atol=1e-5)


def test_takes_blocks_that_overlap_in_memory(kind) -> None:
    fourier = kind(16)
    n = fourier.length
    wide = pictures(n, 3 * n)
    view = np.lib.stride_tricks.sliding_window_view(wide, n, axis=1)[:, ::5].swapaxes(0, 1)
    back = fourier.irfft(fourier.rfft(view)) / fourier.gain
    np.testing.assert_allclose(back, view, atol=1e-5)


@pytest.mark.parametrize("least", LENGTHS)
@pytest.mark.parametrize("conjugate", [False, True])
def test_products_filter(kind, least: int, conjugate: bool) -> None:  # noqa: FBT001
    fourier = kind(least)
    n = fourier.length
    blocks, filters = pictures(3, 2, n, n), pictures(2, 5, 5, seed=1)
    spectra, kernels = fourier.rfft(blocks), fourier.rfft(filters)
    before = kernels.copy()
    fourier.multiply(spectra, kernels, conjugate=conjugate)
    np.testing.assert_array_equal(kernels, before)
    h = np.fft.rfft2(filters, (n, n))
    expected = filtered(blocks, h.conj() if conjugate else h)
    np.testing.assert_allclose(fourier.irfft(spectra) / fourier.gain, expected, atol=1e-3)


def test_a_product_with_itself_is_the_power(kind) -> None:
    fourier = kind(24)
    n = fourier.length
    block = pictures(1, n, n)
    spectrum = fourier.rfft(block)
    fourier.multiply(spectrum, spectrum, conjugate=True)
    expected = np.fft.irfft2(np.abs(np.fft.rfft2(block)) ** 2, (n, n))
    np.testing.assert_allclose(fourier.irfft(spectrum) / fourier.gain, expected, atol=1e-3)


@pytest.mark.parametrize("least", LENGTHS)
def test_weighs_by_power_and_by_direction(kind, least: int) -> None:
    fourier = kind(least)
    n = fourier.length
    rng = np.random.default_rng(2)
    half = rng.random(n // 2 + 1).astype(np.float32)
    down = half[np.minimum(np.arange(n), n - np.arange(n))]  # as of a real symmetric filter
    across = rng.random(n // 2 + 1).astype(np.float32)
    filters, blocks = pictures(2, 3, 3, seed=3), pictures(2, n, n)
    weights = fourier.power(fourier.rfft(filters)) + fourier.weights(down, across)
    spectra = fourier.rfft(blocks)
    fourier.weigh(spectra, weights)
    expected = np.abs(np.fft.rfft2(filters, (n, n))) ** 2 + down[:, None] + across
    back = fourier.irfft(spectra) / fourier.gain
    np.testing.assert_allclose(back, filtered(blocks, expected), atol=1e-4)


@pytest.mark.parametrize("least", LENGTHS)
def test_adds_the_spectrum_of_an_even_filter(kind, least: int) -> None:
    fourier = kind(least)
    n = fourier.length
    blocks, more = pictures(2, n, n), fourier.power(fourier.rfft(pictures(2, 3, 3, seed=3)))
    spectra, alone = fourier.rfft(blocks), fourier.rfft(np.zeros_like(blocks))
    for total in (spectra, alone):
        fourier.add(total, more)
    power = np.abs(np.fft.rfft2(pictures(2, 3, 3, seed=3), (n, n))) ** 2
    expected = np.fft.irfft2(power, (n, n))
    np.testing.assert_allclose(fourier.irfft(alone) / fourier.gain, expected, atol=1e-4)
    back = fourier.irfft(spectra) / fourier.gain
    np.testing.assert_allclose(back, blocks + expected, atol=1e-4)


@pytest.mark.parametrize("least", LENGTHS)
def test_differences_in_turn_weigh_by_their_squared_responses(kind, least: int) -> None:
    fourier = kind(least)
    n = fourier.length
    blocks = pictures(2, n, n)
    spectra = fourier.rfft(blocks)
    fourier.weigh(spectra, fourier.weights(*squared_responses(n, n)))
    expected = adjoint_differences(*differences(blocks))
    np.testing.assert_allclose(fourier.irfft(spectra) / fourier.gain, expected, atol=1e-4)


@pytest.mark.parametrize("least", [90, 101, 129, 152, 203])
def test_packed_lengths_have_small_prime_factors(least: int) -> None:
    length = PackedTransforms(least).length
    assert least <= length <= 1.1 * least
    for factor in (2, 3, 5, 7, 11):
        while length % factor == 0:
            length //= factor
    assert length == 1


def test_a_power_of_two_takes_least_time_with_opencv() -> None:
    blocks = {length: PackedTransforms(length) for length in (240, 256, 288, 512)}
    assert all(fourier.length == length for length, fourier in blocks.items())
    assert blocks[256].effort < 0.95 * blocks[240].effort * (256 / 240) ** 2
    assert blocks[288].effort == 288**2
    assert 4 * blocks[256].effort < blocks[512].effort < 512**2
    assert ComplexTransforms(256).effort == 256**2


def test_the_faster_library_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    for least, there, expected in (
        (300, True, PackedTransforms),
        (300, False, ComplexTransforms),
        (30, True, ComplexTransforms),
    ):
        monkeypatch.setattr(cv2.ipp, "useIPP", lambda there=there: there)
        transforms.cache_clear()
        assert isinstance(transforms(least), expected)
    transforms.cache_clear()
