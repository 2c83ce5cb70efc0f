from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.blind.agreement import agreement
from deshake.blind.drawn_path import drawing
from deshake.blind.estimate import estimate_kernel
from deshake.blind.streaks import agreeing, find_streaks
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.operators.shake_blur import ShakeBlur
from deshake.run import Run
from deshake.signal.pyramid import Pyramid

HEIGHT, WIDTH = 150, 200
CAMERA = Camera.from_focal(1.25 * WIDTH, HEIGHT, WIDTH)
PATH = np.array([(-12, -6, -3), (-2, 2, -1), (4, -4, 1), (10, 9, 3)]) / 500  # radians
LAMPS = [(25, 31), (31, 156), (75, 94), (112, 38), (119, 169), (69, 138), (125, 100)]


def kernel_of(path) -> RotationKernel:
    return RotationKernel.from_path(path, CAMERA).centred()


def night(kernel, lamps=LAMPS, light=150.0, seed=0):
    """Render a dark scene with lamps, shaken, clipped and noisy; return it and what clipped."""
    blur = ShakeBlur(kernel)
    m = blur.margin
    grey = data.camera()[100 : 100 + HEIGHT + 2 * m, 100 : 100 + WIDTH + 2 * m]
    scene = 0.15 * (grey.astype(np.float32) / 255) ** 2.2
    points = np.zeros_like(scene)
    for number, (y, x) in enumerate(lamps):
        points[y + m, x + m] = light * (1 + number % 3)
    scene = scene + cv2.GaussianBlur(points, (0, 0), 0.8)
    noise = np.random.default_rng(seed).normal(0, 2e-3, CAMERA.shape)
    g = np.clip(blur.forward(scene.astype(np.float32)) + noise, 0, 1).astype(np.float32)
    return g, g >= 1


def pyramid_of(g, clipped):
    height, width = g.shape
    return Pyramid(g, Camera.from_focal(1.25 * width, height, width), ~clipped)


@pytest.fixture(scope="module")
def shaken():
    kernel = kernel_of(PATH)
    return kernel, *night(kernel)


def test_the_path_of_the_lamps_is_recovered_with_its_roll(shaken) -> None:
    kernel, g, clipped = shaken
    drawn = drawing(pyramid_of(g, clipped))
    assert drawn is not None
    assert drawn.explained > 0.75
    assert agreement(drawn.kernel, kernel) > 0.85
    assert drawn.kernel.weights.sum() == pytest.approx(1)
    still = agreement(RotationKernel.delta(CAMERA), kernel)
    flat = drawing(pyramid_of(g, clipped), roll=False)
    assert still < 0.6
    assert flat is None or agreement(flat.kernel, kernel) < agreement(drawn.kernel, kernel)
    assert flat is None or not np.ptp(flat.kernel.indices[:, 2])


def test_the_surroundings_of_the_lamps_are_hidden_and_nothing_else(shaken) -> None:
    _, g, clipped = shaken
    pyramid = pyramid_of(g, clipped)
    drawn = drawing(pyramid)
    assert drawn is not None
    usable = drawn.pyramid.at(0).usable
    assert usable is not None
    assert not usable[clipped].any()
    assert 0.3 < usable.mean() < 0.98
    assert np.array_equal(drawn.pyramid.at(0).picture, pyramid.at(0).picture)


def test_a_path_beyond_the_bound_is_no_start(shaken) -> None:
    _, g, clipped = shaken
    assert drawing(pyramid_of(g, clipped), bound=5.0) is None


def test_a_photo_that_is_mostly_lamps_keeps_its_pixels() -> None:
    lamps = [(y, x) for y in range(20, 140, 20) for x in range(20, 190, 22)]
    g, clipped = night(kernel_of(PATH), lamps)
    assert drawing(pyramid_of(g, clipped)) is None


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
    assert agreeing(streaks)[0] == []
    assert drawing(pyramid_of(g, g >= 1)) is None


def test_round_highlights_draw_nothing() -> None:
    g = np.full(CAMERA.shape, 0.05, np.float32)
    for y, x in LAMPS:
        cv2.circle(g, (x, y), 6, 1.0, -1, cv2.LINE_AA)
    assert find_streaks(pyramid_of(g, g >= 1).at(0)) == []


def test_the_streaks_start_the_estimate(shaken) -> None:
    kernel, g, clipped = shaken
    result = estimate_kernel(g, CAMERA, clipped=clipped, run=Run(1))
    assert result.confidence > 0.5
    assert agreement(result.kernel.for_camera(CAMERA), kernel) > 0.8
