from __future__ import annotations

import numpy as np
import pytest

from deshake.operators.bilinear import (
    bilinear_taps,
    filter_taps,
    gather,
    gathering_matrix,
    splat,
    splat_on_raster,
    splat_taps,
)

LAGS = np.array([[[2.0, 1.0], [0.5, 0.0], [-1.0, -1.0], [0.0, 2.25]]])


def test_taps_are_bilinear_and_periodic() -> None:
    block = np.arange(30, dtype=np.float32)
    place, share = bilinear_taps(LAGS, (5, 6))
    assert place.shape == share.shape == (1, 4, 4)
    np.testing.assert_allclose(share.sum(-1), 1)
    np.testing.assert_allclose((block[place] * share).sum(-1), [[8, 0.5, 29, 13.5]])


def test_taps_of_whole_lags_are_single_pixels() -> None:
    place, share = bilinear_taps(np.array([[[-7.0, 11.0]]]), (5, 6))
    assert share.max() == 1
    assert place[share == 1] == [1 * 6 + 5]


def test_splat_is_the_adjoint_of_reading() -> None:
    rng = np.random.default_rng(0)
    lags = rng.uniform(-9, 9, (3, 20, 2))
    weights = rng.random(20)
    blocks = rng.random((3, 7, 8))
    filters = splat(lags, weights, (7, 8))
    assert filters.dtype == np.float32
    np.testing.assert_allclose(filters.sum((1, 2)), weights.sum(), rtol=1e-6)
    place, share = bilinear_taps(lags, (7, 8))
    for one, filter_, at, part in zip(blocks, filters, place, share, strict=True):
        read = (one.ravel()[at] * part).sum(-1)
        assert (one * filter_).sum() == pytest.approx(weights @ read, rel=1e-5)


def test_splat_keeps_the_centroid() -> None:
    lags = np.array([[[1.25, 2.5], [3.0, 1.75]]])
    [kernel] = splat(lags, np.array([0.25, 0.75]), (6, 8))
    rows, columns = np.indices(kernel.shape)
    assert (kernel * columns).sum() == pytest.approx(0.25 * 1.25 + 0.75 * 3.0)
    assert (kernel * rows).sum() == pytest.approx(0.25 * 2.5 + 0.75 * 1.75)


def test_a_raster_keeps_the_weights_and_their_centroid():
    places = np.array([[1.25, 2.5], [3.0, 0.0], [2.75, 1.5]])
    weights = np.array([0.5, 0.2, 0.3])
    raster = splat_on_raster(places, weights, (4, 5))
    y, x = np.mgrid[:4, :5]
    assert raster.sum() == pytest.approx(1)
    assert [(raster * x).sum(), (raster * y).sum()] == pytest.approx((weights @ places).tolist())
    assert raster[0, 3] == pytest.approx(0.2)


def test_what_lies_beyond_a_raster_goes_to_its_border():
    raster = splat_on_raster(np.array([[-3.0, 9.0]]), np.ones(1), (4, 5))
    assert raster[3, 0] == 1
    assert raster.sum() == 1


def test_a_filter_has_lag_zero_in_its_middle() -> None:
    place, share = filter_taps(np.array([[[0.0, 0.0], [-2.0, 1.5]]]), 3)
    assert place[0, 0, 0] == 3 * 7 + 3
    [filter_] = splat_taps(place.astype(np.int64), share.astype(np.float64), (7, 7))
    assert filter_[3, 3] == 1
    assert [filter_[4, 1], filter_[5, 1]] == [0.5, 0.5]
    assert filter_.sum() == 2


def test_a_matrix_gathers_what_taps_gather() -> None:
    rng = np.random.default_rng(1)
    moved = rng.uniform(-9, 9, (3, 20, 2))
    blocks = rng.random((3, 7, 8), np.float32)
    by_taps = gather(blocks, *bilinear_taps(moved, (7, 8)))
    by_matrix = gathering_matrix(moved, (7, 8)) @ blocks.ravel()
    np.testing.assert_allclose(by_taps, by_matrix, rtol=1e-5)
    filters = splat(moved, np.eye(20)[7], (7, 8))
    assert by_taps[7] == pytest.approx((filters * blocks).sum(), rel=1e-5)
