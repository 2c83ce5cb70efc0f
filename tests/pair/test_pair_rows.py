from __future__ import annotations

import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.rotations import grid_steps
from deshake.operators.warps import Warps
from deshake.pair.pair_rows import ROW_BLOCK, PairRows
from deshake.run import Run

SHAPE = (60, 80)
CAMERA = Camera.from_focal(90.0, *SHAPE)
MARGIN = 8


def rotations(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.integers(-4, 5, (count, 3)) * grid_steps(CAMERA)


def pictures(count, seed=0):
    return np.random.default_rng(seed).normal(size=(count, *SHAPE)).astype(np.float32)


def places(count=2 * ROW_BLOCK, seed=0):
    """Pixels that see the frame only, whatever the rotation."""
    height, width = SHAPE
    inside = np.zeros(SHAPE, bool)
    inside[12 : height - 12, 12 : width - 12] = True
    chosen = np.random.default_rng(seed).choice(np.flatnonzero(inside), count, replace=False)
    return np.stack([chosen % width, chosen // width], 1)


def exact_columns(theta, f, at):
    """B at the pixels, (C n, K), by exact warps of the whole frame."""
    warps = Warps(CAMERA, theta, margin=0)
    columns = []
    for unit in np.eye(len(theta)):
        blurred = [warps.blur(plane, unit)[at[:, 1], at[:, 0]] for plane in f]
        columns.append(np.concatenate(blurred))
    return np.stack(columns, 1).astype(np.float64)


@pytest.mark.parametrize("twins", [0, 1, 2, 3])
def test_all_parts_are_those_of_exact_warps(twins):
    theta, at = rotations(7), places()
    f, g = pictures(2, 1), pictures(2, 2)
    noise = [0.3 * pictures(2, 10 + t) for t in range(twins)]
    rows = PairRows(CAMERA, theta, f, g, at, noise=noise, run=Run(1))
    b = exact_columns(theta, f, at)
    gram = b.T @ b
    for e in noise:
        columns = exact_columns(theta, e, at)
        gram -= columns.T @ columns / twins
    gram /= len(at)
    target = g[:, at[:, 1], at[:, 0]].ravel()
    right = b.T @ target / len(at)
    w = np.random.default_rng(3).dirichlet(np.ones(7))
    w[[1, 4]] = 0
    tight = {"rtol": 1e-4, "atol": 1e-4 * np.abs(gram).max()}
    np.testing.assert_allclose(rows.right, right, **tight)
    np.testing.assert_allclose(rows.gram(np.arange(7)), gram, **tight)
    np.testing.assert_allclose(rows.gram(np.array([5, 2])), gram[np.ix_([5, 2], [5, 2])], **tight)
    np.testing.assert_allclose(rows.slope(w), gram @ w - right, **tight)
    energy, left, _ = rows.misfits(w)
    assert energy == pytest.approx(target @ target / len(at), rel=1e-5)
    assert left == pytest.approx(energy - 2 * right @ w + w @ gram @ w, rel=1e-3)
    assert rows.scale(w) == pytest.approx(right @ w / (w @ gram @ w), rel=1e-3)


def test_slope_is_that_of_the_misfit():
    theta, at = rotations(6), places()
    rows = PairRows(
        CAMERA, theta, pictures(2, 1), pictures(2, 2), at, noise=[pictures(2, 3)], run=Run(1)
    )
    rng = np.random.default_rng(0)
    w, direction = rng.dirichlet(np.ones(6)), rng.normal(size=6)
    step = 1e-2
    up, down = (rows.misfits(w + sign * step * direction)[1] / 2 for sign in (1, -1))
    assert rows.slope(w) @ direction == pytest.approx((up - down) / (2 * step), rel=2e-3)


def test_bands_and_threads_change_nothing(monkeypatch):
    theta, at = rotations(30), places(8 * ROW_BLOCK)
    f, g, noise = pictures(2, 1), pictures(2, 2), [pictures(2, 3), pictures(2, 4)]
    w = np.random.default_rng(3).dirichlet(np.ones(30))
    results = []
    for entries, threads in ((4_000_000, 1), (20_000, 1), (20_000, 3)):
        monkeypatch.setattr("deshake.pair.pair_rows._ENTRIES", entries)
        rows = PairRows(CAMERA, theta, f, g, at, noise=noise, run=Run(threads))
        results.append((rows.right, rows.gram(np.arange(30)), rows.slope(w)))
    for one, other in zip(results[0], results[1], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-5)
    for one, other in zip(results[1], results[2], strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_noise_twin_takes_off_the_bias():
    """Over many draws the mean of G is the noiseless one; without a twin its diagonal is not."""
    theta, at = rotations(5), places()
    f, g = pictures(2, 1), pictures(2, 2)
    chosen = np.arange(5)
    clean = PairRows(CAMERA, theta, f, g, at, run=Run(1))
    exact, right = clean.gram(chosen), clean.right
    draws, plain, rights = [], [], []
    for seed in range(40):
        noisy = f + 0.8 * pictures(2, 1000 + seed)
        twins = [0.8 * pictures(2, 5000 + 2 * seed + t) for t in range(2)]
        rows = PairRows(CAMERA, theta, noisy, g, at, noise=twins, run=Run(1))
        draws.append(rows.gram(chosen))
        rights.append(rows.right)
        plain.append(PairRows(CAMERA, theta, noisy, g, at, run=Run(1)).gram(chosen))
    error = np.std(draws, axis=0) / np.sqrt(len(draws))
    assert np.all(np.abs(np.mean(draws, axis=0) - exact) < 4.5 * error)
    error = np.std(rights, axis=0) / np.sqrt(len(rights))
    assert np.all(np.abs(np.mean(rights, axis=0) - right) < 4.5 * error)
    biased = np.diagonal(np.mean(plain, axis=0) - exact)
    assert np.all(biased > 10 * np.std(plain, axis=0).max() / np.sqrt(len(plain)))


@pytest.mark.parametrize("count", [0, ROW_BLOCK + 1])
def test_pixels_come_in_blocks(count):
    with pytest.raises(ValueError, match="no blocks"):
        PairRows(CAMERA, rotations(2), pictures(1), pictures(1), places()[:count])
