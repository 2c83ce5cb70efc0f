from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.errors import EstimationError
from deshake.estimation.edges import EdgeEstimate
from deshake.estimation.refinement import RefinementStep, refined, refined_once
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur

MARGIN = 16
NOTHING = np.zeros((2, 1, 1), np.float32)
PATH = np.array([[-1.0, -4, -3], [0, 0, -1], [2, 1, 1], [1, 4, 3]])


def shake(sharp: np.ndarray) -> tuple[np.ndarray, RotationKernel]:
    """Turn a sharp picture along the path, with a little noise; cut off what saw beyond it."""
    height, width = (side - 2 * MARGIN for side in sharp.shape)
    camera = Camera.from_focal(1.1 * width, height, width)
    kernel = RotationKernel.from_path(PATH * grid_steps(camera), camera).centred()
    grey = ShakeBlur(kernel, margin=MARGIN, kind="warps").forward(sharp)
    noise = np.random.default_rng(0).normal(scale=0.003, size=grey.shape)
    return (grey + noise).astype(np.float32), kernel


@pytest.fixture(scope="module")
def large() -> np.ndarray:
    """A face and what is around it, in linear light, (355, 700)."""
    grey = data.astronaut()[40:300] @ np.array([0.3, 0.59, 0.11]) / 255
    whole = cv2.resize(grey, (700, 355), interpolation=cv2.INTER_CUBIC)
    return (np.clip(whole, 0, 1) ** 2.2).astype(np.float32)


@pytest.fixture(scope="module")
def shaken(sharp) -> tuple[np.ndarray, RotationKernel]:
    return shake(sharp)


@pytest.fixture(scope="module")
def rough(shaken) -> RotationKernel:
    """The true kernel, but on a grid of twice its spacing."""
    true = shaken[1]
    return true.resampled(2 * true.steps).centred()


def misfit(found: RotationKernel, true: RotationKernel, sharp: np.ndarray) -> float:
    """How differently two kernels blur, in what the true one blurs; over small turns the least."""
    turns = [np.array([x, y, 0]) * true.steps / 2 for x in (-1, 0, 1) for y in (-1, 0, 1)]
    want = ShakeBlur(true, margin=MARGIN).forward(sharp)
    still = sharp[MARGIN:-MARGIN, MARGIN:-MARGIN]
    least = min(
        float(np.square(ShakeBlur(turned, margin=MARGIN).forward(sharp) - want).mean())
        for turned in (replace(found, theta=found.theta + turn) for turn in turns)
    )
    return float(np.sqrt(least / np.square(still - want).mean()))


def test_a_rough_kernel_comes_nearer_to_the_truth(large) -> None:
    grey, true = shake(large)
    rough = true.resampled(4 * true.steps).centred()
    found = EdgeEstimate(rough, NOTHING)
    fine = refined(grey, found, threads=1)
    assert fine is not found
    assert fine.kernel.camera is true.camera
    assert misfit(fine.kernel, true, large) < 0.6 * misfit(rough, true, large)
    np.testing.assert_allclose(fine.kernel.centroid, 0, atol=1e-2 * true.steps.max())
    assert fine.latent.shape[2] >= 640


def test_what_betters_nothing_is_not_taken(large) -> None:
    grey, true = shake(large)
    found = EdgeEstimate(true, NOTHING)
    assert refined(grey, found, steps=[RefinementStep(320, 1e-3)], threads=1) is found
    assert refined(grey, found, steps=[], threads=1) is found


def test_kernels_too_wide_to_be_known_are_left(large) -> None:
    grey, true = shake(large)
    wide = EdgeEstimate(replace(true, theta=10 * true.theta), NOTHING)
    assert refined(grey, wide, threads=1) is wide


def test_photos_without_more_pixels_are_left(shaken, rough) -> None:
    found = EdgeEstimate(rough, NOTHING)
    assert refined(shaken[0], found, threads=1) is found


def test_the_latent_picture_is_that_of_the_photo(shaken, rough) -> None:
    grey, true = shaken
    brighter = refined_once(2 * grey, rough, true.camera, 1e-3, threads=1)
    fine = refined_once(grey, rough, true.camera, 1e-3, threads=1)
    np.testing.assert_allclose(brighter.latent, 2 * fine.latent, atol=2e-3 * fine.latent.max())
    seen = np.stack([np.diff(grey, axis=1)[:-1], np.diff(grey, axis=0)[:, :-1]])
    inner = np.s_[:, 8:-8, 8:-8]
    latent = fine.latent[:, :-1, :-1]
    assert np.corrcoef(latent[inner].ravel(), seen[inner].ravel())[0, 1] > 0.3
    assert latent[inner].std() > seen[inner].std()


def test_threads_change_nothing_and_axes_are_kept(shaken, rough) -> None:
    grey, true = shaken
    axes = (True, True, False)
    level = RotationKernel.from_indices(
        rough.indices * [1, 1, 0], rough.weights, rough.steps, true.camera
    )
    one, two = (
        refined_once(grey, level, true.camera, 1e-3, axes=axes, threads=n).kernel for n in (1, 2)
    )
    np.testing.assert_array_equal(one.weights, two.weights)
    assert np.ptp(one.theta[:, 2]) < 0.1 * one.steps[2]


def test_progress_runs_to_one(large) -> None:
    told: list[float] = []
    grey, true = shake(large)
    steps = [RefinementStep(64, 1e-3), RefinementStep(80, 1e-3)]
    refined(
        grey,
        EdgeEstimate(true, NOTHING),
        steps=steps,
        threads=1,
        progress=lambda share, _text: told.append(share),
    )
    assert told == [0, 0.5, 1]


def test_flat_photos_are_refused(large) -> None:
    _, true = shake(large)
    with pytest.raises(EstimationError, match="texture"):
        refined(np.ones(true.camera.shape, np.float32), EdgeEstimate(true, NOTHING), threads=1)
