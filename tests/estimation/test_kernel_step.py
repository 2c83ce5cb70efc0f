from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.optimize import nnls

from deshake.estimation.kernel_step import (
    NormalEquations,
    fitted_weights,
    nonnegative,
    normal_equations,
)
from deshake.geometry.camera import Camera
from deshake.geometry.rotations import grid_steps
from deshake.operators.filter_flow import reach
from deshake.operators.patch_solve import PatchFrame, PatchSolver

MARGIN = 20
SHAPE = (100, 120)
INDICES = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [-1, 1, 1], [2, -1, 0], [0, 1, -2]])


def cameras():
    return {"uniform": Camera.uniform(*SHAPE), "rotational": Camera.from_focal(130.0, *SHAPE)}


@pytest.fixture(scope="module", params=["uniform", "rotational"])
def fit(request, sharp):
    """Frame, indices, steps, edges and blurred gradients, and each rotation's blur of the edges."""
    camera = cameras()[request.param]
    indices = INDICES * ([1, 1, 0] if camera.is_uniform else [1, 1, 1])
    indices = np.unique(indices, axis=0)
    steps = grid_steps(camera)
    patch = None if camera.is_uniform else 48
    room = 2 * reach(camera, indices * steps) + 2
    frame = PatchFrame(camera, margin=MARGIN, room=room, patch=patch, threads=1)
    inside = np.zeros(frame.shape, np.float32)
    inside[MARGIN:-MARGIN, MARGIN:-MARGIN] = 1
    # smooth, for bilinear weights at fractions of a pixel to be all the same
    photo = cv2.GaussianBlur(sharp[: frame.shape[0], : frame.shape[1]], (0, 0), 1.5)
    edges = [(np.roll(photo, -1, axis) - photo) * inside for axis in (1, 0)]
    rng = np.random.default_rng(0)
    blurred = [rng.normal(size=frame.shape).astype(np.float32) * 0.1 for _ in edges]
    moved = [
        np.stack([PatchSolver(frame, one[None], [1.0]).forward(f) for f in edges])
        for one in indices * steps
    ]
    return frame, indices, steps, edges, blurred, np.array(moved, np.float64)


def test_right_side_is_the_slope_of_the_misfit(fit) -> None:
    frame, indices, steps, edges, blurred, moved = fit
    found = normal_equations(frame, indices, steps, tuple(edges), tuple(blurred))
    g = np.stack(blurred).astype(np.float64)
    step = 1e-4
    for k in range(len(indices)):
        misfit = [((g - sign * step * moved[k]) ** 2).sum() / 2 for sign in (1, -1)]
        slope = (misfit[1] - misfit[0]) / (2 * step)
        assert found.right[k] == pytest.approx(slope, abs=2e-4 * np.abs(found.right).max())


def test_gram_is_the_curvature_of_the_misfit(fit) -> None:
    frame, indices, steps, edges, blurred, moved = fit
    found = normal_equations(frame, indices, steps, tuple(edges), tuple(blurred))
    exact = np.einsum("kcij,lcij->kl", moved, moved)
    off = np.linalg.norm(found.gram - exact) / np.linalg.norm(exact)
    assert off < (1e-3 if frame.camera.is_uniform else 0.1)
    assert found.energy == pytest.approx(
        sum((f.astype(np.float64) ** 2).sum() for f in edges), 1e-2
    )
    np.testing.assert_array_equal(found.gram, found.gram.T)


def test_threads_change_no_byte(fit) -> None:
    frame, indices, steps, edges, blurred, _ = fit
    results = []
    for threads in (1, 3):
        frame.threads = threads
        found = normal_equations(frame, indices, steps, tuple(edges), tuple(blurred))
        results.append((found.gram.tobytes(), found.right.tobytes()))
    assert results[0] == results[1]


def test_nonnegative_finds_the_minimum() -> None:
    rng = np.random.default_rng(1)
    a = rng.normal(size=(60, 20))
    target = a @ np.maximum(rng.normal(size=20), 0) + rng.normal(size=60)
    gram = a.T @ a
    found = nonnegative(gram, a.T @ target, np.full(20, 0.1))
    np.testing.assert_allclose(found, nnls(a, target)[0], atol=1e-4)
    assert found.min() == 0


def test_nonnegative_of_nothing_is_nothing() -> None:
    np.testing.assert_array_equal(nonnegative(np.zeros((3, 3)), np.ones(3), np.ones(3)), 0)


def test_weak_weights_and_islands_are_dropped() -> None:
    indices = np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0], [7, 0, 0], [0, 3, 0]])
    right = np.array([0.5, 0.4, 0.3, 0.02, 0.005])
    fit = NormalEquations(np.eye(5), right, 1.0)
    found = fitted_weights(fit, indices, np.full(5, 0.2), cut=0.03)
    assert found[3] == 0  # an island
    assert found[4] == 0  # below the cut
    np.testing.assert_allclose(found[:3], right[:3] / 1.2, rtol=1e-6)


def test_weights_stay_where_there_are_no_edges() -> None:
    weights = np.array([0.3, 0.7])
    fit = NormalEquations(np.zeros((2, 2)), np.zeros(2), 0.0)
    assert fitted_weights(fit, INDICES[:2], weights, cut=0.05) is weights
