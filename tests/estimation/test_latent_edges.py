from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.errors import EstimationError
from deshake.estimation.latent_edges import (
    Observation,
    contrast_scaled,
    differences,
    edge_gradients,
    l0_picture,
    noise_level,
    shocked,
    strong_gradients,
)
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.patch_solve import PatchFrame, PatchSolver

MARGIN = 16
LAM = 1e-3


def l0_energy(solver: PatchSolver, picture: np.ndarray, g: np.ndarray) -> float:
    across, down = differences(picture)
    inside = np.s_[MARGIN:-MARGIN, MARGIN:-MARGIN]
    misfit = (solver.forward(picture) - g)[inside]
    edges = (across**2 + down**2)[inside] > LAM / 16
    return float((misfit**2).sum() + LAM * edges.sum())


def test_contrast_no_longer_depends_on_exposure(sharp) -> None:
    bright, scale = contrast_scaled(sharp)
    dim, more = contrast_scaled(sharp * np.float32(0.1))
    np.testing.assert_allclose(bright, dim, rtol=1e-4)
    assert more == pytest.approx(10 * scale, rel=1e-4)
    assert contrast_scaled(bright)[1] == pytest.approx(1, rel=1e-4)


def test_flat_pictures_are_refused() -> None:
    with pytest.raises(EstimationError, match="no texture"):
        contrast_scaled(np.full((60, 80), 0.5, np.float32))


@pytest.mark.parametrize("uniform", [False, True])
def test_l0_picture_lowers_its_energy(sharp, uniform: bool) -> None:  # noqa: FBT001
    picture, _ = contrast_scaled(sharp)
    camera = Camera.uniform(*sharp.shape) if uniform else Camera.from_focal(260.0, *sharp.shape)
    path = np.outer(np.linspace(-3, 3, 7), [0.5, 1, 0]) * grid_steps(camera)
    kernel = RotationKernel.from_path(path, camera)
    frame = PatchFrame(camera, margin=MARGIN, room=10, patch=None if uniform else 64, threads=1)
    solver = PatchSolver(frame, kernel.theta, kernel.weights)
    truth = Observation.of(picture, MARGIN).picture
    g = solver.forward(truth)
    found, across, down = l0_picture(solver, g, LAM, beta_max=16)
    assert l0_energy(solver, found, g) < 0.8 * l0_energy(solver, g, g)
    kept = across**2 + down**2 > 0
    assert 0.01 < kept.mean() < 0.5
    errors = [np.mean((image - truth)[MARGIN:-MARGIN, MARGIN:-MARGIN] ** 2) for image in (found, g)]
    assert errors[0] < 0.8 * errors[1]


def test_a_higher_price_leaves_fewer_edges(sharp) -> None:
    camera = Camera.from_focal(260.0, *sharp.shape)
    frame = PatchFrame(camera, margin=MARGIN, room=6, patch=64, threads=1)
    solver = PatchSolver(frame, np.zeros((1, 3)), [1.0])
    g = Observation.of(contrast_scaled(sharp)[0], MARGIN).picture
    counts = [np.count_nonzero(l0_picture(solver, g, lam, beta_max=16)[1]) for lam in (1e-3, 1e-2)]
    assert counts[1] < 0.7 * counts[0]


def test_shock_filter_steepens_edges_and_keeps_flats() -> None:
    step = np.zeros((40, 40), np.float32)
    step[:, 20:] = 1
    soft = cv2.GaussianBlur(step, (0, 0), 2.0)
    sharpened = shocked(soft)
    assert np.abs(np.diff(sharpened)).max() > 1.2 * np.abs(np.diff(soft)).max()
    np.testing.assert_allclose(sharpened[:, 2:8], 0, atol=1e-3)
    assert sharpened[5:-5, 5:-5].min() > -1e-3
    assert sharpened[5:-5, 5:-5].max() < 1 + 1e-3
    across, down = edge_gradients(soft, 0.04)
    assert np.count_nonzero(across[20, 5:-5]) < 6
    assert not down[10:-10, 10:-10].any()


def test_the_unknown_is_filled_with_what_the_estimate_says() -> None:
    grey = np.random.default_rng(0).random((30, 40)).astype(np.float32)
    usable = np.ones(grey.shape, bool)
    usable[10:12, 5:9] = False
    seen = Observation.of(grey, 8, usable)
    assert seen.picture.shape == (46, 56)
    np.testing.assert_allclose(seen.picture[8:-8, 8:-8], grey - grey.mean(), atol=1e-6)
    filled = seen.filled(np.full(seen.picture.shape, 7, np.float32))
    np.testing.assert_array_equal(filled[18:20, 13:17], 7)
    np.testing.assert_array_equal(filled[8:18, 8:-8], seen.picture[8:18, 8:-8])
    assert 0 < filled[0, 30] < 0.1  # in the margin it fades


def test_noise_is_told_from_edges(sharp) -> None:
    noise = np.random.default_rng(0).normal(scale=0.02, size=sharp.shape).astype(np.float32)
    soft = cv2.GaussianBlur(sharp, (0, 0), 2.0)
    assert noise_level(soft + noise) == pytest.approx(0.02, rel=0.1)
    assert noise_level(soft) < 0.002


def test_strong_gradients_are_those_worth_their_price(sharp) -> None:
    across, down = differences(sharp)
    x, y = strong_gradients(sharp, 0.01)
    kept = across**2 + down**2 >= np.float32(0.01)
    assert 0 < kept.mean() < 0.5
    np.testing.assert_array_equal(x, across * kept)
    np.testing.assert_array_equal(y, down * kept)
