from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.optimize import nnls

from deshake.blind.agreement import agreement
from deshake.blind.kernel_step import (
    NormalEquations,
    RotationGrid,
    fitted_weights,
    nonnegative,
)
from deshake.blind.tiles import Tiles
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps, reach
from deshake.operators.warps import Warps
from deshake.signal.gradients import differences
from deshake.signal.pyramid import Scale

SIZE = 48
CORNERS = [(20, 20), (76, 140), (130, 60), (140, 180)]
CAMERAS = {
    "uniform": Camera.uniform(200, 240),
    "long lens": Camera.from_focal(960.0, 200, 240),
    "lens": Camera.from_focal(240.0, 200, 240),
}
# Relative errors of G, of its product with weights, and of b. Where every rotation is a translation
# of whole pixels there are none; else they are those of one filter a tile, and for G of bilinear
# weights at one displacement, not at two (measured: .016, .010, .008 and .047, .026, .009).
ACCURACY = {
    "uniform": (1e-5, 1e-5, 1e-5),
    "long lens": (0.022, 0.015, 0.012),
    "lens": (0.06, 0.035, 0.015),
}


@pytest.fixture(scope="module", params=list(CAMERAS))
def fit(request, shake):
    """A grid, edges within the tiles' middles, and the exact G and b of both."""
    camera = CAMERAS[request.param]
    path = np.array([[-2.0, -3, -1], [1, 0, 0], [3, 2, 1]])
    shaken = shake(camera, path * [1, 1, not camera.is_uniform])
    rolls = (0,) if camera.is_uniform else (-1, 0, 1)
    indices = np.array([[x, y, z] for x in (-2, 3) for y in (-3, 1, 2) for z in rolls])
    steps = grid_steps(camera)
    far = reach(camera, indices * steps)
    tiles = Tiles(Scale(shaken.grey, camera, None, 1.0), CORNERS, SIZE, far)
    # smooth, for bilinear weights at fractions of a pixel to be all the same
    soft = cv2.GaussianBlur(shaken.still, (0, 0), 2.0)
    steps_of = np.arange(tiles.block) - tiles.first
    count = SIZE - 2 * (far // 4) - 8
    first = (tiles.block - count) // 2
    window = np.zeros(tiles.block, np.float32)
    window[first : first + count] = np.hanning(count + 2)[1:-1]
    edges = tuple(
        np.stack(
            [
                slope[np.ix_(np.clip(y + steps_of, 0, 199), np.clip(x + steps_of, 0, 239))]
                for y, x in CORNERS
            ]
        )
        * np.outer(window, window)
        for slope in differences(soft)
    )
    warps = Warps(camera, indices * steps)
    right, gram = np.zeros(len(indices)), np.zeros((len(indices), len(indices)))
    for edge, slope in zip(edges, differences(shaken.grey), strict=True):
        latent = np.zeros(warps.latent_shape, np.float32)
        inner = np.s_[first : first + count]
        for block, (y, x) in zip(edge, CORNERS, strict=True):
            top, left = (at + warps.margin + first - tiles.first for at in (y, x))
            latent[top : top + count, left : left + count] += block[inner, inner]
        right += warps.kernel_adjoint(latent, slope)
        gram += warps.gram(latent)
    grid = RotationGrid(tiles, indices, steps)
    return grid.equations(edges), gram, right, ACCURACY[request.param], edges


def test_the_gram_matrix_is_that_of_the_exact_warps(fit) -> None:
    equations, gram, _, (off, off_product, _), _ = fit
    assert np.linalg.norm(equations.gram - gram) < off * np.linalg.norm(gram)
    for seed in range(3):
        w = np.random.default_rng(seed).random(len(gram))
        assert np.linalg.norm((equations.gram - gram) @ w) < off_product * np.linalg.norm(gram @ w)
    np.testing.assert_array_equal(equations.gram, equations.gram.T)


def test_parts_of_the_rotations_have_the_same_bytes(shaken, monkeypatch) -> None:
    room = shaken.kernel.resampled(shaken.kernel.steps).dilated()
    tiles = Tiles(shaken.pyramid.at(0), CORNERS, SIZE, reach(shaken.camera, room.theta))
    edges = differences(tiles.g)
    whole = RotationGrid(tiles, room.indices, room.steps).equations(edges)
    for count in (1, 7):
        monkeypatch.setattr("deshake.operators.bilinear._AT_ONCE", count)
        parts = RotationGrid(tiles, room.indices, room.steps).equations(edges)
        np.testing.assert_array_equal(parts.gram, whole.gram)
        np.testing.assert_array_equal(parts.right, whole.right)


def test_the_right_side_is_that_of_the_exact_warps(fit) -> None:
    equations, _, right, (*_, off), _ = fit
    assert np.linalg.norm(equations.right - right) < off * np.linalg.norm(right)


def test_the_energy_is_that_of_the_edges(fit) -> None:
    equations, _, _, _, edges = fit
    energy = sum(float((edge.astype(np.float64) ** 2).sum()) for edge in edges)
    assert equations.energy == pytest.approx(energy, rel=1e-4)
    assert equations.gram.diagonal() == pytest.approx(equations.energy, rel=1e-6)


def test_true_edges_give_the_true_kernel(shaken) -> None:
    room = shaken.kernel.resampled(shaken.kernel.steps).dilated().dilated()
    far = reach(shaken.camera, room.theta)
    corners = [(y, x) for y in (0, 50, 100, 152) for x in (0, 48, 96, 144, 192)]
    scales = [Scale(p, shaken.camera, None, 1.0) for p in (shaken.grey, shaken.still)]
    tiles, sharp = (Tiles(scale, corners, SIZE, far) for scale in scales)
    grid = RotationGrid(tiles, room.indices, room.steps)
    even = np.full(len(room.weights), 1 / len(room.weights))
    fit = grid.equations(differences(sharp.g))
    weights = fitted_weights(fit, room.indices, even, cut=0.03)
    assert weights.sum() == pytest.approx(1)
    assert weights.min() == 0
    assert agreement(replace(room, weights=weights), shaken.kernel) > 0.95


@pytest.fixture(scope="module")
def translations(shaken) -> tuple[RotationGrid, tuple[np.ndarray, ...]]:
    """A grid of whole pixels on tiles with a still camera, and edges."""
    camera = CAMERAS["uniform"]
    indices = np.array([[x, y, 0] for x in (-2, 0, 1) for y in (-1, 0, 3)])
    steps = grid_steps(camera)
    tiles = Tiles(Scale(shaken.grey, camera, None, 1.0), CORNERS, SIZE, 8)
    tiles.bind(RotationKernel.delta(camera))
    return RotationGrid(tiles, indices, steps), differences(tiles.g)


@pytest.mark.parametrize("noise", [0.003, 0.01, 0.1])
def test_what_a_still_camera_leaves_open_is_white(translations, noise) -> None:
    grid, edges = translations
    more = grid.equations(edges, noise).gram - grid.equations(edges).gram
    pixels = grid.tiles.middle.sum((1, 2))
    squares = sum((edge**2 * grid.tiles.middle).sum((1, 2)) for edge in edges)
    texture, error = 0.3 * squares / (2 * pixels), 2 * 8 * noise**2
    wanted = float((2 * pixels * texture * error / (texture + error)).sum())
    np.testing.assert_allclose(more, wanted * np.eye(len(more)), atol=2e-3 * wanted)


def test_what_a_blur_leaves_open_holds_the_kernel_to_its_zeros(translations) -> None:
    grid, edges = translations
    pan = RotationKernel.from_indices(
        [[0, y, 0] for y in range(4)],
        np.ones(4),
        grid_steps(CAMERAS["uniform"]),
        CAMERAS["uniform"],
    )
    grid.tiles.bind(pan)
    more = grid.equations(edges, 0.003).gram - grid.equations(edges).gram
    assert np.linalg.eigvalsh(more).min() > -1e-3 * more.max()
    assert more[0, 0] == pytest.approx(more.max(), rel=1e-4)
    grid.tiles.bind(RotationKernel.delta(CAMERAS["uniform"]))
    sharp = grid.equations(edges, 0.003).gram - grid.equations(edges).gram
    assert more[0, 0] > 2 * sharp[0, 0]  # a blur leaves more open than none


def problem(seed: int, rows: int = 80, columns: int = 30):
    """Least squares that has about half of its weights at zero."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(rows, columns))
    return a, a @ np.maximum(rng.normal(size=columns), 0) + rng.normal(size=rows)


def cost(gram: np.ndarray, right: np.ndarray, w: np.ndarray) -> float:
    return float(w @ gram @ w / 2 - right @ w)


@pytest.mark.parametrize("seed", range(5))
def test_nonnegative_finds_the_minimum(seed) -> None:
    a, target = problem(seed)
    start = np.random.default_rng(seed).random(30)
    solution = nonnegative(a.T @ a, a.T @ target, start)
    np.testing.assert_allclose(solution, nnls(a, target)[0], atol=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_at_the_minimum_no_weight_wants_to_move(seed) -> None:
    a, target = problem(seed)
    gram, right = a.T @ a, a.T @ target
    before = gram.copy()
    solution = nonnegative(gram, right, np.full(30, 1 / 30))
    np.testing.assert_array_equal(gram, before)
    slope = gram @ solution - right
    slack = 1e-8 * np.abs(right).max()
    assert solution.min() == 0
    assert np.abs(slope[solution > 0]).max() < slack
    assert slope[solution == 0].min() > -slack


def test_nonnegative_descends_from_wherever_it_starts() -> None:
    rng = np.random.default_rng(0)
    a, target = problem(0, rows=20, columns=60)  # more weights than data
    gram, right = a.T @ a, a.T @ target
    for start in (np.zeros(60), np.full(60, 1 / 60), 5 * rng.random(60)):
        before = start.copy()
        solution = nonnegative(gram, right, start)
        np.testing.assert_array_equal(start, before)
        assert cost(gram, right, solution) < cost(gram, right, start)
        least = cost(gram, right, nnls(a, target)[0])
        assert cost(gram, right, solution) < least + 1e-6 * abs(least)


@pytest.mark.parametrize("seed", range(3))
def test_nonnegative_finds_the_minimum_where_neighbours_are_alike(seed) -> None:
    rng = np.random.default_rng(seed)
    places = np.arange(60)
    a = np.exp(-(((places[:, None] - places) / 2.0) ** 2))  # each explains most of the next
    true = np.where(rng.random(60) > 0.8, rng.random(60), 0)
    target = a @ true + 0.05 * rng.normal(size=60)
    gram = a.T @ a + 0.02 * np.eye(60)
    best = nnls(np.vstack([a, np.sqrt(0.02) * np.eye(60)]), np.append(target, np.zeros(60)))[0]
    far = np.zeros(60)
    far[0] = 30.0  # from where all others vanish at first
    for start in (far, np.full(60, 1 / 60)):
        solution = nonnegative(gram, a.T @ target, start)
        least = cost(gram, a.T @ target, best)
        assert cost(gram, a.T @ target, solution) < least + 1e-6 * abs(least)


def test_nonnegative_bears_slightly_negative_eigenvalues() -> None:
    a, target = problem(0, rows=20, columns=30)
    gram = a.T @ a
    spoilt = gram - 1e-2 * gram.diagonal().max() * np.eye(30)
    assert np.linalg.eigvalsh(spoilt).min() < 0
    before = spoilt.copy()
    solution = nonnegative(spoilt, a.T @ target, np.full(30, 1 / 30))
    np.testing.assert_array_equal(spoilt, before)
    least = cost(gram, a.T @ target, nnls(a, target)[0])
    assert cost(gram, a.T @ target, solution) < 0.95 * least


def test_nonnegative_of_nothing_is_nothing() -> None:
    np.testing.assert_array_equal(nonnegative(np.zeros((3, 3)), np.ones(3), np.ones(3)), 0)


def test_weak_weights_and_islands_are_dropped() -> None:
    indices = np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0], [7, 0, 0], [0, 3, 0]])
    fit = NormalEquations(np.eye(5), np.array([0.5, 0.4, 0.3, 0.02, 0.005]), 1.0)
    solution = fitted_weights(fit, indices, np.full(5, 0.2), cut=0.03)
    assert solution[3] == 0  # an island
    assert solution[4] == 0  # below the cut
    np.testing.assert_allclose(solution[:3], np.array([5, 4, 3]) / 12, rtol=1e-6)


def test_a_kernel_all_in_pieces_stays_whole() -> None:
    indices = np.array([[5 * i, 0, 0] for i in range(50)])
    fit = NormalEquations(np.eye(50), np.full(50, 0.02), 1.0)
    solution = fitted_weights(fit, indices, np.full(50, 0.02), cut=0.01)
    np.testing.assert_allclose(solution, 0.02, rtol=1e-6)


def test_the_farther_a_roll_the_less_weight_it_gets() -> None:
    indices = np.array([[0, 0, z] for z in range(-3, 4)])
    fit = NormalEquations(np.eye(7), np.ones(7), 1.0)
    solution = fitted_weights(fit, indices, np.full(7, 1 / 7), cut=0.03)
    assert (np.diff(solution[:4]) > 0).all()
    assert (np.diff(solution[3:]) < 0).all()


@pytest.mark.parametrize(
    "fit",
    [
        NormalEquations(np.zeros((2, 2)), np.zeros(2), 0.0),
        NormalEquations(np.eye(2), -np.ones(2), 1.0),
    ],
    ids=["no edges", "edges that explain nothing"],
)
def test_weights_stay_without_edges(fit) -> None:
    weights = np.array([0.3, 0.7])
    indices = np.array([[0, 0, 0], [1, 0, 0]])
    assert fitted_weights(fit, indices, weights, cut=0.05) is weights
