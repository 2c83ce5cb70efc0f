from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.warps import Warps
from deshake.pair.kernel_estimate import estimate_pair_kernel
from deshake.pair.kernel_settings import SETTINGS
from deshake.run import Run

pytestmark = pytest.mark.long

SHAPE = (160, 220)
MARGIN = 20
RATIO = 6.0
PATH = np.array([[0, -4, -2], [2, 0, 0], [1, 3, 3], [-3, 4, 2]])  # in grid steps


def shaken(sharp, camera, path=PATH, *, sigma=0.0, offset=(0, 0, 0), seed=0):
    """Blur a photo along a path; expose it briefly, turned by an offset in steps, with noise."""
    steps = grid_steps(camera)
    nodes = path * steps
    ends = np.linspace(0, len(nodes) - 1, 80)
    theta = np.stack([np.interp(ends, np.arange(len(nodes)), axis) for axis in nodes.T], 1)
    g = Warps(camera, theta, margin=MARGIN).blur(sharp, np.full(80, 1 / 80))
    turned = Warps(camera, -np.array([offset]) * steps, margin=MARGIN).blur(sharp, [1.0])
    rng = np.random.default_rng(seed)
    f_reg, *twins = (
        ((picture + sigma * rng.normal(size=SHAPE)) / RATIO).astype(np.float32)
        for picture in (turned, 0, 0)
    )
    return g, f_reg, twins, RotationKernel.from_path(nodes + np.array(offset) * steps, camera)


def estimate(g, f_reg, camera, **choices):
    choices = {"blur_size": 14, "run": Run(1)} | choices
    return estimate_pair_kernel(g, f_reg, np.ones(SHAPE, np.float32), camera, **choices)


def local_filters(kernel):
    """Local filters at nine points of the frame, smoothed by a pixel."""
    out = np.zeros((9, 101, 101), np.float32)
    moved = kernel.displacements(kernel.camera.corners)
    for canvas, places in zip(out, np.rint(moved).astype(int) + 50, strict=True):
        np.add.at(canvas, (places[:, 1], places[:, 0]), kernel.weights)
    return np.stack([cv2.GaussianBlur(canvas, (0, 0), 1.5) for canvas in out])


def likeness(one, other):
    """Cosine between the local filters of two kernels, in the same frame."""
    a, b = local_filters(one).ravel(), local_filters(other).ravel()
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))


@pytest.fixture(scope="module")
def photo(sharp):
    height, width = SHAPE[0] + 2 * MARGIN, SHAPE[1] + 2 * MARGIN
    return np.ascontiguousarray(sharp[:height, :width])


@pytest.fixture(scope="module")
def camera():
    return Camera.from_focal(200.0, *SHAPE)


@pytest.fixture(scope="module")
def known(photo, camera):
    """Make a pair with noise of a strength, and estimate its kernel, once."""

    @cache
    def make(sigma):
        g, f_reg, twins, truth = shaken(photo, camera, sigma=sigma)
        return (g, f_reg, twins, truth), estimate(g, f_reg, camera, noise=twins)

    return make


@pytest.mark.parametrize(("sigma", "least"), [(0.03, 0.96), (0.08, 0.93)])
def test_a_known_kernel_is_recovered(known, camera, sigma, least):
    (*_, truth), result = known(sigma)
    assert likeness(result.kernel, truth) > least
    assert likeness(RotationKernel.delta(camera), truth) < 0.7
    assert result.scale == pytest.approx(RATIO, rel=0.01)
    assert result.confidence > 0.9
    assert result.explained > 0.9
    assert result.notes == []


def test_what_registration_left_is_in_the_kernel(photo, camera):
    g, f_reg, twins, truth = shaken(photo, camera, sigma=0.02, offset=(2, -1.5, 1))
    result = estimate(g, f_reg, camera, noise=twins)
    assert likeness(result.kernel, truth) > 0.96
    off = (result.kernel.centroid - truth.centroid) / grid_steps(camera)
    assert np.abs(off).max() < 0.4


def test_uniform_blur_by_translations(photo):
    camera = Camera.uniform(*SHAPE)
    g, f_reg, twins, truth = shaken(photo, camera, PATH * [1, 1, 0], sigma=0.03)
    result = estimate(g, f_reg, Camera.from_focal(200.0, *SHAPE), uniform=True, noise=twins)
    assert result.kernel.camera.is_uniform
    assert np.all(result.kernel.theta[:, 2] == 0)
    assert likeness(result.kernel, truth) > 0.97


def test_noise_spreads_the_kernel_unless_its_twin_is_taken_off(known, camera):
    (g, f_reg, _, truth), with_twins = known(0.08)
    without = estimate(g, f_reg, camera)
    assert likeness(with_twins.kernel, truth) > likeness(without.kernel, truth) + 0.01


def test_colours_clipped_lights_and_unknown_parts(photo, camera):
    g, f_reg, twins, truth = shaken(photo, camera, sigma=0.02)
    g, f_reg = np.stack([g, 0.8 * g, g], -1), np.stack([f_reg, 0.8 * f_reg, f_reg], -1)
    g[60:80, 100:130] = 1
    valid = np.ones(SHAPE, bool)
    valid[:, :30] = False
    f_reg[:, :30] = 0.5
    result = estimate_pair_kernel(g, f_reg, valid, camera, blur_size=14, noise=twins, run=Run(1))
    assert likeness(result.kernel, truth) > 0.95
    assert result.scale == pytest.approx(RATIO, rel=0.02)


def test_the_size_of_the_blur_need_not_be_known(photo, camera):
    g, f_reg, twins, truth = shaken(photo, camera, sigma=0.02)
    result = estimate(g, f_reg, camera, noise=twins, blur_size=None)
    assert likeness(result.kernel, truth) > 0.95


def test_a_bound_that_is_too_small_is_reported(photo, camera):
    g, f_reg, twins, _ = shaken(photo, camera, 3 * PATH, sigma=0.0)
    result = estimate(g, f_reg, camera, noise=twins, blur_size=3)
    assert (
        "the shake may be wider than what was looked for: try a larger --blur-size" in result.notes
    )


def test_a_camera_that_stood_still(photo, camera):
    g, f_reg, twins, _ = shaken(photo, camera, 0 * PATH, sigma=0.02)
    result = estimate(g, f_reg, camera, noise=twins)
    assert result.kernel.extent_px() < 2.5
    assert "no shake was found: there is nothing to undo" in result.notes


def test_photos_of_two_scenes_are_not_trusted(photo, camera):
    g, _, _, _ = shaken(photo, camera)
    _, f_reg, twins, _ = shaken(np.ascontiguousarray(photo[::-1, ::-1]), camera, sigma=0.02)
    result = estimate(g, f_reg, camera, noise=twins)
    assert result.confidence < 0.2
    assert result.unexplained > 0.4


def test_threads_change_no_byte_and_progress_rises(known, camera):
    (g, f_reg, twins, _), alone = known(0.03)
    shares = []
    result = estimate(
        g,
        f_reg,
        camera,
        noise=twins,
        run=Run(3, lambda share, _text: shares.append(share)),
    )
    assert result.kernel.weights.tobytes() == alone.kernel.weights.tobytes()
    assert result.scale == alone.scale
    assert shares == sorted(shares)
    assert shares[0] == 0
    assert shares[-1] == 1


def test_large_photos_are_worked_on_where_the_blur_is_wide_enough(photo, camera, monkeypatch):
    early = replace(SETTINGS, enough_blur=12.0, fine_side=50)
    monkeypatch.setattr("deshake.pair.kernel_estimate.SETTINGS", early)
    g, f_reg, twins, truth = shaken(photo, camera, 2 * PATH, sigma=0.02)
    result = estimate(g, f_reg, camera, noise=twins, blur_size=30)
    assert (result.scales[-1].height, result.scales[-1].width) < SHAPE
    assert result.kernel.camera.shape == SHAPE
    assert likeness(result.kernel, truth) > 0.85


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"g": np.full(SHAPE, 0.5, np.float32)}, "no detail"),
        ({"valid": np.zeros(SHAPE)}, "too few pixels are left"),
        ({"g": np.ones(SHAPE, np.float32)}, "too few pixels are left"),
        ({"blur_size": 81.0}, "a blur of 81 px does not fit"),
    ],
)
def test_what_cannot_be_estimated_is_reported(photo, camera, change, what):
    g, f_reg, _, _ = shaken(photo, camera)
    case = {"g": g, "f_reg": f_reg, "valid": np.ones(SHAPE), "camera": camera} | change
    with pytest.raises(EstimationError, match=what):
        estimate_pair_kernel(**case)


def test_narrow_photos_have_bounds_that_fit(photo):
    narrow = Camera.from_focal(200.0, 48, 220)
    g, f_reg, _, _ = shaken(photo, Camera.from_focal(200.0, *SHAPE), 0 * PATH)
    rows = slice(50, 98)
    wide = [np.tile(picture[rows], (1, 2)) for picture in (g, f_reg)]
    camera = narrow.cropped(-110, 0, 440, 48)
    result = estimate_pair_kernel(*wide, np.ones((48, 440)), camera, run=Run(1))
    assert result.kernel.extent_px() < 3


def test_a_black_noisy_photo_is_no_pair(photo, camera):
    g, f_reg, _, _ = shaken(photo, camera)
    with pytest.raises(EstimationError, match="the noisy photo is black"):
        estimate(g, 0 * f_reg, camera)


def test_sizes_must_agree(photo, camera):
    g, f_reg, _, _ = shaken(photo, camera)
    with pytest.raises(ValueError, match="not one size"):
        estimate_pair_kernel(g, f_reg[1:], np.ones(SHAPE), camera)
    small = Camera.from_focal(50.0, 40, 60)
    with pytest.raises(EstimationError, match="60x40 pixels are too few"):
        estimate_pair_kernel(g[:40, :60], f_reg[:40, :60], np.ones((40, 60)), small)


def test_the_frame_is_that_of_the_registered_photo(photo, camera):
    """The kernel applied to f_reg gives g, pixel by pixel."""
    g, f_reg, _, _ = shaken(photo, camera, offset=(1, 2, -1))
    result = estimate(g, f_reg, camera)
    used = result.kernel
    model = Warps(camera, used.theta, margin=0).blur(f_reg, used.weights) * result.scale
    inside = np.s_[16:-16, 16:-16]
    before = np.square(f_reg * result.scale - g)[inside].mean()
    assert np.square(model - g)[inside].mean() < 0.01 * before
