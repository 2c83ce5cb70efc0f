from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.blind.variational.coarse_to_fine import turn
from deshake.geometry.camera import Camera
from deshake.pair.alignment import align, likeness, seen_in_frame, smooth
from deshake.pair.rotation_search import distance_px

CAMERA = Camera.from_focal(120, 90, 128)
THETA = np.radians([2.0, -3.0, 1.5])


def scene(seed=0):
    rng = np.random.default_rng(seed)
    spots = cv2.GaussianBlur(rng.random(CAMERA.shape, np.float32), (0, 0), 1.5)
    return 0.3 + 3 * (spots - 0.5) + 0.1 * cv2.GaussianBlur(spots, (0, 0), 9)


@pytest.fixture
def pair():
    """A scene, and what a turned camera saw of it: ``a(x) = b(H^-1 x)``."""
    a = scene()
    return a, turn(a[None], CAMERA, THETA)[0]


@pytest.mark.parametrize("off", [(0, 0, 0), (1, 0, 0), (0, -1.2, 0), (0, 0, 1), (0.8, 0.8, -0.8)])
def test_shifts_of_a_pixel_or_two_are_right_to_a_tenth(pair, off):
    theta, score = align(*pair, CAMERA, THETA + np.radians(off))
    assert distance_px(CAMERA, theta, THETA) < 0.1
    assert score > 0.97


def test_a_little_gain_does_not_matter(pair):
    a, b = pair
    start = THETA + np.radians([0.5, 0.5, 0])
    one, other = align(a, b, CAMERA, start)[0], align(1.2 * a, b, CAMERA, start)[0]
    assert distance_px(CAMERA, one, other) < 0.05


def test_alignment_finds_the_centroid_of_a_blur_not_its_heavy_end(pair):
    a, b = pair
    weights = np.zeros((1, 9), np.float32)
    weights[0, :3] = 0.28
    weights[0, 3:] = 0.16 / 6
    centroid = float((weights @ np.arange(9))[0]) - 4
    blurred = cv2.filter2D(a, -1, weights)  # blurred(x) = a(x + centroid), about
    theta, _ = align(blurred, b, CAMERA, THETA)
    shift = np.array([0, centroid / CAMERA.focal_px, 0])
    true = THETA - shift
    assert distance_px(CAMERA, theta, true) < 0.35
    assert distance_px(CAMERA, THETA, true) > 1.5


def test_likeness_distinguishes_right_from_wrong(pair):
    a, b = pair
    assert likeness(a, b, CAMERA, THETA) > 0.9
    assert likeness(a, b, CAMERA, THETA + np.radians([0, 4, 0])) < 0.3
    assert likeness(a, scene(1), CAMERA, np.zeros(3)) < 0.3


def test_one_thing_in_common_is_not_enough():
    a, b = scene(1), scene(2)
    for image in (a, b):
        image[30:60, 40:60] += 3
    whole = np.corrcoef(smooth(a, 1, 8).ravel(), smooth(b, 1, 8).ravel())[0, 1]
    assert whole > 0.7
    assert likeness(a, b, CAMERA, np.zeros(3)) < 0.55


def test_photos_of_other_places_share_nothing(pair):
    far = np.radians([0, 80, 0])
    assert likeness(*pair, CAMERA, far) == 0
    theta, score = align(*pair, CAMERA, far)
    assert score == -1
    assert np.array_equal(theta, far)


def test_pixels_without_the_other_photo_are_filled(pair):
    a, b = pair
    moved_b, mask = seen_in_frame(a, b, CAMERA, THETA)
    assert 0.5 < mask.mean() < 1
    assert np.array_equal(moved_b[~mask], a[~mask])
    assert np.abs(moved_b - a)[mask].mean() < 0.1 * a.std()
