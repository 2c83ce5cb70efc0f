from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.blind.agreement import agreement
from deshake.blind.drawn_path import Drawing, drawing, energy, streak_misfit
from deshake.blind.estimate import STREAKS, estimate_kernel
from deshake.blind.settings import StreakFit
from deshake.blind.streak_light import SIDE, StreakLight, light_of
from deshake.blind.streaks import agreeing, find_streaks
from deshake.blind.trust import drawn_confidence
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.run import Run
from deshake.signal.pyramid import Pyramid
from tests.support.night import CAMERA, HEIGHT, LAMPS, PATH, WIDTH, kernel_of, night


def pyramid_of(g, clipped):
    height, width = g.shape
    return Pyramid(g, Camera.from_focal(1.25 * width, height, width), clipped)


@pytest.fixture(scope="module")
def shaken():
    kernel = kernel_of(PATH)
    return kernel, *night(kernel)


def test_the_path_of_the_lamps_is_recovered_with_its_roll(shaken) -> None:
    kernel, g, clipped = shaken
    drawn = drawing(pyramid_of(g, clipped))
    assert drawn is not None
    assert 3 <= len(drawn.boxes) <= len(LAMPS)
    for x, y, width, height in drawn.boxes:  # around one lamp at least
        assert any(x < c < x + width and y < r < y + height for r, c in LAMPS)
    assert drawn.misfit < 0.15
    assert agreement(drawn.kernel, kernel) > 0.9
    assert drawn.kernel.weights.sum() == pytest.approx(1)
    still = agreement(RotationKernel.delta(CAMERA), kernel)
    flat = drawing(pyramid_of(g, clipped), roll=False)
    assert still < 0.6
    assert flat is None or agreement(flat.kernel, kernel) < agreement(drawn.kernel, kernel)
    assert flat is None or flat.misfit > drawn.misfit
    assert flat is None or not np.ptp(flat.kernel.indices[:, 2])


@pytest.mark.parametrize("light", [60.0, 1500.0])
def test_weak_lamps_and_lamps_that_clip_their_whole_streak_show_the_path(light) -> None:
    kernel = kernel_of(PATH)
    g, clipped = night(kernel, light=light)
    drawn = drawing(pyramid_of(g, clipped))
    assert drawn is not None
    assert agreement(drawn.kernel, kernel) > 0.8


def test_a_path_of_many_bends_is_recovered() -> None:
    time = np.linspace(0, 1, 200)
    path = np.stack([9 * np.sin(19 * time), 10 * np.cos(15 * time), 2 * time], 1) / 500
    kernel = kernel_of(path)
    g, clipped = night(kernel)
    drawn = drawing(pyramid_of(g, clipped))
    assert drawn is not None
    assert drawn.misfit < 0.1
    assert agreement(drawn.kernel, kernel) > 0.9


def test_the_light_of_a_streak_is_that_of_its_square(shaken) -> None:
    _, g, clipped = shaken
    scale = pyramid_of(g, clipped).at(0)
    streaks = [streak for streak in find_streaks(scale) if light_of(streak, scale) is not None]
    assert len(streaks) >= 5
    for streak in streaks:
        seen = light_of(streak, scale)
        (left, top), (height, width) = seen.corner, seen.light.shape
        x, y = seen.square
        assert np.abs(np.add((x, y), SIDE / 2) - streak.centre).max() < SIDE / 4
        part = np.s_[top : top + height, left : left + width]
        assert seen.picture.shape == (SIDE, SIDE)
        assert seen.counted.shape == seen.clipped.shape == seen.light.shape
        assert seen.counted[seen.picture[part] > 0].all()  # the streak itself counts
        assert seen.picture.sum() == pytest.approx(seen.picture[part].sum())
        assert 10 < seen.area < seen.counted.sum()
        row, column = np.unravel_index(seen.light.argmax(), seen.light.shape)
        ground = 1 - seen.white
        near = g[max(y - 20, 0) : y + SIDE + 20, max(x - 20, 0) : x + SIDE + 20]
        assert seen.light[row, column] + ground == pytest.approx(near.max(), abs=0.01)
        assert np.abs(seen.light[seen.counted & ~seen.clipped]).max() <= 1


def test_moves_are_the_pixels_of_one_grid_step(shaken) -> None:
    _, g, clipped = shaken
    scale = pyramid_of(g, clipped).at(0)
    for streak in find_streaks(scale):
        moves = light_of(streak, scale).moves
        assert np.linalg.norm(moves[:, :2], axis=0) == pytest.approx(1, abs=0.3)
        away = np.array(streak.centre) - np.array([WIDTH, HEIGHT]) / 2
        assert abs(moves[:, 2] @ away) < 0.2 * np.linalg.norm(away)  # it moves around the middle


def a_streak(seed=0, height=30, width=40) -> StreakLight:
    rng = np.random.default_rng(seed)
    light = rng.uniform(0, 1, (height, width))
    counted = rng.uniform(size=light.shape) < 0.8
    return StreakLight(
        np.zeros((SIDE, SIDE), np.float32),
        (0, 0),
        (25, 30),
        light,
        counted,
        light > 0.8,
        0.9,
        np.array([[0.1, 1.0, 0.3], [-1.0, 0.05, -0.4]]) + rng.normal(0, 0.1, (2, 3)),
        is_whole=True,
    )


def slope_of(function, at, change=1e-5):
    """Return the gradient by central differences."""
    gradient = np.zeros_like(at)
    for place in np.ndindex(at.shape):
        step = np.zeros_like(at)
        step[place] = change
        gradient[place] = (function(at + step) - function(at - step)) / (2 * change)
    return gradient


def test_the_gradients_of_a_misfit_are_its_slopes() -> None:
    streak = a_streak()
    moved = np.random.default_rng(1).normal(0, 4, (12, 2))
    lamp = np.array([45.3, 44.6, np.log(90.0), np.log(1.2)])
    value, of_moved, of_lamp = streak_misfit(streak, moved, lamp, 0.3)
    assert 0 < value < 5
    by_place = slope_of(lambda at: streak_misfit(streak, at, lamp, 0.3)[0], moved)
    by_lamp = slope_of(lambda at: streak_misfit(streak, moved, at, 0.3)[0], lamp)
    assert of_moved == pytest.approx(by_place, rel=1e-5, abs=1e-9)
    assert of_lamp == pytest.approx(by_lamp, rel=1e-5, abs=1e-9)


def test_the_gradients_of_the_energy_are_its_slopes() -> None:
    rng = np.random.default_rng(2)
    streaks = [a_streak(seed) for seed in range(3)]
    basis = np.abs(rng.normal(size=(15, 6)))
    basis /= basis.sum(1, keepdims=True)
    controls = rng.normal(0, 4, (6, 3))
    lamps = np.array([45.3, 44.6, np.log(90.0), np.log(1.2)]) + rng.normal(0, 0.1, (3, 4))
    stage = StreakFit(0.3, 4.0, (5, 9), 10, 0.05)
    _, of_controls, of_lamps = energy(streaks, basis, controls, lamps, stage)
    by_path = slope_of(lambda at: energy(streaks, basis, at, lamps, stage)[0], controls)
    by_lamp = slope_of(lambda at: energy(streaks, basis, controls, at, stage)[0], lamps)
    assert of_controls == pytest.approx(by_path, rel=1e-5, abs=1e-9)
    assert of_lamps == pytest.approx(by_lamp, rel=1e-5, abs=1e-9)


def test_a_clipped_pixel_asks_only_for_enough_light() -> None:
    streak = a_streak()._replace(
        light=np.full((30, 40), 0.9),
        counted=np.ones((30, 40), bool),
        clipped=np.ones((30, 40), bool),
    )
    moved = np.zeros((1, 2))
    wide = np.log(60.0)  # the light is nearly even over the part
    bright = streak_misfit(streak, moved, np.array([45.0, 45, np.log(1e5), wide]), 0.2)
    dark = streak_misfit(streak, moved, np.array([45.0, 45, np.log(5e3), wide]), 0.2)
    assert bright[0] == 0
    assert not bright[1].any()
    assert not bright[2].any()
    assert dark[0] > 0.5
    assert dark[2][2] < 0  # more light, less misfit


def test_the_confidence_falls_with_the_misfit() -> None:
    confidences = [
        drawn_confidence(Drawing(kernel_of(PATH), misfit, np.zeros((5, 4))))
        for misfit in (0.05, 0.15, 0.3)
    ]
    assert confidences == sorted(confidences, reverse=True)
    assert confidences[0] > 0.95
    assert confidences[-1] > 0.5


def test_a_path_beyond_the_bound_is_not_drawn(shaken) -> None:
    _, g, clipped = shaken
    assert drawing(pyramid_of(g, clipped), bound=5.0) is None


def test_two_lamps_are_too_few() -> None:
    g, clipped = night(kernel_of(PATH), LAMPS[:2])
    assert len(find_streaks(pyramid_of(g, clipped).at(0))) == 2
    assert drawing(pyramid_of(g, clipped)) is None


@pytest.mark.parametrize("picture", ["astronaut", "coffee", "chelsea"])
def test_a_daylight_photo_draws_nothing(picture) -> None:
    rgb = getattr(data, picture)()[:HEIGHT, :WIDTH].astype(np.float32) / 255
    grey = (rgb @ np.array([0.21, 0.72, 0.07], np.float32)) ** 2.2
    g = cv2.filter2D(grey, -1, np.eye(9, dtype=np.float32) / 9)
    assert drawing(pyramid_of(np.ascontiguousarray(g), g >= 1)) is None


def test_lamps_of_different_shapes_draw_nothing() -> None:
    g = np.full((240, 320), 0.02, np.float32)
    g += np.random.default_rng(0).normal(0, 0.002, g.shape).astype(np.float32)
    cv2.line(g, (40, 40), (70, 42), 1.0, 3)
    cv2.ellipse(g, (150, 60), (16, 12), 0, 20, 320, 1.0, 3)
    cv2.line(g, (230, 30), (236, 62), 1.0, 3)
    cv2.line(g, (50, 190), (75, 160), 1.0, 3)
    cv2.line(g, (150, 160), (175, 190), 1.0, 3)
    cv2.circle(g, (250, 170), 14, 1.0, -1)
    g = np.clip(g, 0, 1)
    streaks = find_streaks(pyramid_of(g, g >= 1).at(0))
    assert len(streaks) == 5  # a filled disk is none
    assert agreeing(streaks) == []
    assert drawing(pyramid_of(g, g >= 1)) is None


def test_round_highlights_draw_nothing() -> None:
    g = np.full(CAMERA.shape, 0.05, np.float32)
    for y, x in LAMPS:
        cv2.circle(g, (x, y), 6, 1.0, -1, cv2.LINE_AA)
    assert find_streaks(pyramid_of(g, g >= 1).at(0)) == []


def test_the_streaks_give_the_estimate_at_once(shaken) -> None:
    kernel, g, clipped = shaken
    result = estimate_kernel(g, CAMERA, clipped=clipped, run=Run(1))
    assert result.name == STREAKS
    assert result.streaks.shape[1] == 4
    assert result.confidence > 0.9
    assert agreement(result.kernel.for_camera(CAMERA), kernel) > 0.85
