from __future__ import annotations

import resource
import sys
from functools import cache

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.geometry.rotations import homographies
from deshake.pair.registration import MAX_ANGLE, Registration, register, registered
from deshake.pair.rotation_search import distance_px
from deshake.run import Run
from deshake.simulation.shake_path import random_path

pytestmark = pytest.mark.long

HEIGHT, WIDTH, MARGIN = 240, 320, 90
CAMERA = Camera.from_focal(320, HEIGHT, WIDTH)
NEAR = np.radians(4)  # a narrow search is quick


@cache
def light(name="coffee"):
    """A photograph in linear light, larger than the frame."""
    photo = getattr(data, name)()
    photo = photo if photo.ndim == 2 else photo.mean(-1)
    size = (WIDTH + 2 * MARGIN, HEIGHT + 2 * MARGIN)
    small = cv2.resize(photo.astype(np.float32) / 255, size, interpolation=cv2.INTER_AREA)
    return small**2.2


def exposure_at(scene, theta, camera=CAMERA):
    [h] = homographies(camera, np.asarray(theta, float)[None])
    into = np.array([[1, 0, MARGIN], [0, 1, MARGIN], [0, 0, 1.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpPerspective(scene, into @ h, (WIDTH, HEIGHT), flags=flags)


def shaken(scene, blur_px, seed=1):
    path = random_path(CAMERA, blur_px, seed=seed).centred(CAMERA)
    theta, weights = path.pieces(CAMERA)
    return sum(
        np.float32(w) * exposure_at(scene, t) for t, w in zip(theta[::3], weights[::3], strict=True)
    ) / np.float32(weights[::3].sum())


def short(scene, theta, ratio, sigma, seed=2):
    """A short exposure as 8 bits of sRGB hold it."""
    rng = np.random.default_rng(seed)
    exposed = exposure_at(scene, theta) + rng.normal(0, sigma, (HEIGHT, WIDTH))
    codes = np.rint(255 * np.clip(exposed / ratio, 0, 1) ** (1 / 2.2))
    return ((codes / 255) ** 2.2).astype(np.float32)


@pytest.mark.parametrize(
    ("degrees", "ratio", "sigma", "blur", "within"),
    [
        ((0.5, -1, 0.5), 8, 0.05, 12, NEAR / 2),
        ((-9, 3, 2), 2, 0.03, 8, MAX_ANGLE),
        ((3, 9, -4), 16, 0.1, 18, MAX_ANGLE),
        ((-2, 1, 9.5), 64, 0.05, 12, MAX_ANGLE),
        ((1, 1, 1), 4, 0.316, 18, NEAR / 2),
    ],
)
def test_the_rotation_and_the_exposure_are_estimated(*, degrees, ratio, sigma, blur, within):
    scene, theta = light(), np.radians(degrees)
    pair = shaken(scene, blur), short(scene, theta, ratio, sigma)
    registration = register(*pair, CAMERA, max_angle=within, run=Run(1))
    assert distance_px(CAMERA, registration.theta, theta) < max(0.08 * blur, 0.8)
    assert registration.scale == pytest.approx(ratio, rel=0.25 if sigma > 0.2 else 0.08)
    assert registration.confidence > 0.9


def test_the_registered_photo_matches_the_blurred_one():
    scene, theta = light("astronaut"), np.radians([2, -4, 3])
    noisy = short(scene, theta, 8, 0.02)
    registration = register(shaken(scene, 10), noisy, CAMERA, max_angle=NEAR, run=Run(1))
    f_reg, valid = registered(noisy, registration)
    inside = cv2.erode(valid, np.ones((9, 9))) > 0
    error = (registration.scale * f_reg - exposure_at(scene, np.zeros(3)))[inside]
    assert np.sqrt(np.mean(error**2)) < 0.05
    before = (8 * noisy - exposure_at(scene, np.zeros(3)))[inside]
    assert np.sqrt(np.mean(before**2)) > 0.15


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_focal_length_wrong_by_a_fifth_does_little_harm(factor):
    scene, theta = light(), np.radians([2, -3, 2])
    wrong = Camera.from_focal(320 * factor, HEIGHT, WIDTH)
    pair = shaken(scene, 14), short(scene, theta, 8, 0.05)
    registration = register(*pair, wrong, max_angle=NEAR, run=Run(1))
    middle = np.array([[(WIDTH - 1) / 2, (HEIGHT - 1) / 2, 1.0]]).T
    places = []
    for camera, turned in ((CAMERA, theta), (wrong, registration.theta)):
        x = homographies(camera, -turned) @ middle
        places.append(x[:2, 0] / x[2, 0])
    assert np.hypot(*(places[0] - places[1])) < 3


@pytest.mark.parametrize(("turns", "size"), [(1, 0.5), (3, 1.5)])
def test_a_photo_turned_and_resized_is_registered(turns, size):
    scene, theta = light("astronaut"), np.radians([1, -2, 1])
    upright = short(scene, theta, 4, 0.02)
    resized = cv2.resize(upright, None, fx=size, fy=size, interpolation=cv2.INTER_AREA)
    stored = np.ascontiguousarray(np.rot90(resized, -turns))
    registration = register(shaken(scene, 8), stored, CAMERA, max_angle=NEAR, run=Run(1))
    assert abs(abs(np.degrees(registration.theta[2])) - 90) < 3
    f_reg, valid = registered(stored, registration)
    inside = cv2.erode(valid, np.ones((9, 9))) > 0
    assert inside.mean() > 0.8
    truth = exposure_at(scene, np.zeros(3))[inside]
    assert np.corrcoef(f_reg[inside], truth)[0, 1] > 0.97


@pytest.mark.parametrize(("one", "other"), [("coffee", "astronaut"), ("astronaut", "camera")])
def test_photos_of_different_scenes_are_refused(one, other):
    noisy = short(light(other), np.radians([1, 2, 1]), 8, 0.05)
    with pytest.raises(EstimationError, match="do not show the same scene"):
        register(shaken(light(one), 12), noisy, CAMERA, max_angle=NEAR, run=Run(1))


def test_a_mirrored_photo_of_a_symmetric_scene_is_refused():
    scene = light()
    scene = 0.65 * scene + 0.35 * scene[:, ::-1]
    g, f_N = shaken(scene, 10), short(scene, np.zeros(3), 8, 0.03)
    assert register(g, f_N, CAMERA, max_angle=NEAR / 2, run=Run(1)).confidence > 0.9
    with pytest.raises(EstimationError, match="one of the two photos is mirrored"):
        register(g, f_N[:, ::-1], CAMERA, max_angle=NEAR / 2, run=Run(1))


def test_a_scene_beyond_the_range_needs_a_wider_range():
    scene, theta = light(), np.radians([0, 9, 0])
    pair = shaken(scene, 10), short(scene, theta, 8, 0.03)
    with pytest.raises(EstimationError, match="same scene"):
        register(*pair, CAMERA, max_angle=NEAR / 2, run=Run(1))
    registration = register(*pair, CAMERA, run=Run(1))
    assert distance_px(CAMERA, registration.theta, theta) < 2


def test_black_photos_and_wrong_cameras_are_refused():
    g = shaken(light(), 8)
    with pytest.raises(EstimationError, match="shows nothing"):
        register(g, np.zeros_like(g), CAMERA, run=Run(1))
    with pytest.raises(ValueError, match="does not fit"):
        register(g, g, Camera.from_focal(320, WIDTH, HEIGHT), run=Run(1))


def test_threads_change_nothing_and_progress_is_reported():
    scene, shares = light(), []
    pair = shaken(scene, 8), short(scene, np.radians([1, 1, 1]), 8, 0.05)
    one, other = (
        register(
            *pair, CAMERA, max_angle=NEAR / 2, run=Run(n, lambda share, _: shares.append(share))
        )
        for n in (1, 3)
    )
    assert np.array_equal(one.theta, other.theta)
    assert one.scale == other.scale
    assert max(shares) == 1


def still(camera=CAMERA):
    return Registration(np.zeros(3), 1.0, 1.0, camera)


def test_no_rotation_leaves_a_photo_as_it_is():
    photo = np.random.default_rng(0).random((HEIGHT, WIDTH, 3), np.float32)
    f_reg, valid = registered(photo, still())
    assert np.abs(f_reg - photo).max() < 1e-5
    assert valid.min() == 1
    assert f_reg.dtype == valid.dtype == np.float32


def test_it_is_linear_and_the_same_in_every_tile():
    theta = np.radians([1, -2, 3])
    camera = Camera.from_focal(500, 300, 600)
    where = Registration(theta, 1.0, 1.0, camera)
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 300, 600)).astype(np.float32)
    one, other = registered(a, where)[0], registered(b, where)[0]
    both = registered(np.stack([a, b], -1), where)[0]
    assert np.array_equal(both, np.stack([one, other], -1))
    assert np.abs(registered(a - 2 * b, where)[0] - (one - 2 * other)).max() < 1e-4
    y, x = np.mgrid[:300, :600].astype(np.float32)
    f_reg, valid = registered(x, where)  # reads where each pixel comes from
    [h] = homographies(camera, -theta[None])
    place = (h[0, 0] * x + h[0, 1] * y + h[0, 2]) / (h[2, 0] * x + h[2, 1] * y + h[2, 2])
    inside = cv2.erode(valid, np.ones((7, 7))) > 0
    assert np.abs(f_reg - place)[inside].max() < 0.05
    assert 0.7 < valid.mean() < 0.99


def test_detail_survives_the_resampling():
    scene, theta = light(), np.radians([1, 2, 3])
    where = Registration(theta, 1.0, 1.0, CAMERA)
    f_reg, valid = registered(exposure_at(scene, theta), where)
    inside = cv2.erode(valid, np.ones((9, 9))) > 0
    error = (f_reg - exposure_at(scene, np.zeros(3)))[inside]
    assert np.sqrt(np.mean(error**2)) < 0.03


@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss is in kilobytes here")
def test_memory_is_that_of_the_photos():
    photo = np.zeros((2000, 3000), np.float32)
    camera = Camera.from_focal(3000, *photo.shape)
    where = Registration(np.radians([1, 1, 1]), 1.0, 1.0, camera)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    registered(photo, where)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 4 * photo.nbytes / 1024
