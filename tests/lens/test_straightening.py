from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from skimage import data

from deshake.errors import CalibrationError
from deshake.formats.encoding import Encoding
from deshake.formats.photo import Photo
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.lens.lens_warp import LensWarp
from deshake.lens.straightening import (
    bent,
    bent_kernel,
    camera_at,
    straight_kernel,
    straight_pair,
    straight_region,
    straightened,
)
from deshake.metadata.metadata import Metadata
from deshake.run import Run
from deshake.simulation.shake_path import random_path
from deshake.simulation.shaken_photo import shake
from deshake.stages.deblurring import deblur
from deshake.stages.methods import RestorationOptions

FAST = RestorationOptions(quality="fast")
BARREL = np.array([-0.25, 0.03, 0, 0, 0])


def photo_of(pixels: np.ndarray, tmp_path) -> Photo:
    path = tmp_path / "a.png"
    path.write_bytes(b"a photo")
    shape = pixels.shape[:2]
    return Photo(
        pixels,
        np.zeros(shape, bool),
        None,
        Encoding("PNG", grey=pixels.ndim == 2),
        Metadata(),
        path,
    )


@pytest.fixture
def scene():
    codes = data.stereo_motorcycle()[0][100:340, 200:560, 1].astype(np.float32) / 255
    return codes**2.2


@pytest.fixture
def shaken(scene, tmp_path):
    """A photo with a shake of 18 px and a barrel distortion, and the simulation that made it."""
    camera = Camera.from_focal(250.0, *scene.shape).with_lens(BARREL)
    simulated = shake(scene, camera, random_path(camera, 18, seed=2), noise_sigma=0.002)
    return photo_of(simulated.pixels, tmp_path), simulated


def psnr_of_corners(light: np.ndarray, sharp: np.ndarray) -> float:
    height, width = sharp.shape
    y, x = np.mgrid[0:height, 0:width]
    far = np.hypot(x - (width - 1) / 2, y - (height - 1) / 2) > 0.4 * np.hypot(width, height)
    far[:8], far[-8:], far[:, :8], far[:, -8:] = False, False, False, False
    error = np.clip(light, 0, 1) ** (1 / 2.2) - np.clip(sharp, 0, 1) ** (1 / 2.2)
    return float(-10 * np.log10(np.square(error)[far].mean()))


def test_removing_the_distortion_improves_the_corners_by_a_decibel(shaken):
    photo, simulated = shaken
    kernel = simulated.kernel
    camera = kernel.camera
    plain = kernel.for_camera(Camera(camera.matrix, camera.height, camera.width))
    without = deblur(photo, plain, FAST, run=Run(1)).photo.pixels
    kept = deblur(photo, kernel, FAST, keep_geometry=True, run=Run(1)).photo.pixels
    assert kept.shape == photo.pixels.shape
    blurred, first, second = (
        psnr_of_corners(light, simulated.sharp) for light in (photo.pixels, without, kept)
    )
    assert first > blurred + 1
    assert second > first + 1
    straight = deblur(photo, kernel, FAST, run=Run(1)).photo
    sharp, _ = straightened(photo.with_pixels(simulated.sharp), camera)
    assert straight.shape == photo.shape
    assert psnr_of_corners(straight.pixels, sharp.pixels) > first + 0.8


def test_a_pinhole_changes_nothing(scene, tmp_path):
    photo = photo_of(scene, tmp_path)
    camera = Camera.from_focal(250.0, *scene.shape)
    kernel = RotationKernel.delta(camera)
    assert straightened(photo, camera) == (photo, camera)
    assert bent(photo, photo, camera) is photo
    assert straight_pair(photo, photo, camera) == (photo, photo, camera)
    assert straight_kernel(kernel, camera, camera) is kernel
    assert bent_kernel(kernel, camera, camera) is kernel
    assert straight_region((1, 2, 3, 4), camera, camera) == (1, 2, 3, 4)


def test_a_still_camera_leaves_the_photo_but_for_its_lens(scene, tmp_path):
    photo = photo_of(scene, tmp_path)
    camera = Camera.from_focal(250.0, *scene.shape).with_lens(BARREL)
    still = RotationKernel.delta(camera)
    assert deblur(photo, still, keep_geometry=True).photo is photo
    np.testing.assert_array_equal(
        deblur(photo, still).photo.pixels, straightened(photo, camera)[0].pixels
    )


def test_clipped_pixels_and_opacity_follow(scene, tmp_path):
    photo = photo_of(scene, tmp_path)
    clipped = photo.clipped.copy()
    clipped[20, 30] = True
    alpha = np.full(photo.shape, 255, np.uint8)
    camera = Camera.from_focal(250.0, *scene.shape).with_lens(BARREL)
    straight, straight_camera = straightened(replace(photo, clipped=clipped, alpha=alpha), camera)
    [y], [x] = (np.unique(np.rint(axis.mean())).astype(int) for axis in straight.clipped.nonzero())
    assert straight_region((30, 20, 1, 1), camera, straight_camera)[:2] == pytest.approx(
        (x, y), abs=1.5
    )
    assert (straight.alpha == 255).all()


def test_a_straight_region_contains_all_of_the_region():
    camera = Camera.from_focal(250.0, 240, 360).with_lens(BARREL)
    warp = LensWarp(camera, straightened_camera := _straight_camera(camera))
    part = np.zeros((240, 360), bool)
    part[40:60, 200:260] = True
    inside = warp.straighten(part.astype(np.float32)) > 0.9
    x, y, width, height = straight_region((200, 40, 60, 20), camera, straightened_camera)
    covered = np.zeros((240, 360), bool)
    covered[y : y + height, x : x + width] = True
    assert covered[inside].all()
    assert covered.sum() < 1.5 * inside.sum()
    assert straight_region((0, 0, 360, 240), camera, straightened_camera) == (0, 0, 360, 240)
    assert straight_region(None, camera, straightened_camera) is None


def _straight_camera(camera: Camera) -> Camera:
    blank = Photo(
        np.zeros(camera.shape, np.float32), np.zeros(camera.shape, bool), None,
        Encoding("PNG", grey=True), Metadata(), "a.png",
    )  # fmt: skip
    return straightened(blank, camera)[1]


def test_bending_a_kernel_is_undone():
    camera = Camera.from_focal(250.0, 240, 360).with_lens(BARREL)
    straight_camera = _straight_camera(camera)
    turn = RotationKernel.from_path([(0, -0.02, 0.01), (0.01, 0.02, 0)], straight_camera)
    stored = bent_kernel(turn, camera, straight_camera)
    assert stored.camera is camera
    again = straight_kernel(stored, camera, straight_camera)
    np.testing.assert_array_equal(again.theta, turn.theta)
    assert again.camera is straight_camera


def test_shifts_of_the_uniform_model_keep_their_pixels():
    camera = Camera.from_focal(250.0, 240, 360).with_lens(BARREL)
    straight_camera = _straight_camera(camera)
    uniform = Camera.uniform(240, 360)
    pan = RotationKernel.from_path([(0, 0, 0), (0, 7 / uniform.focal_px, 0)], uniform)
    stored = bent_kernel(pan, camera, straight_camera)
    assert stored.camera.is_uniform
    assert not stored.camera.is_pinhole
    again = straight_kernel(stored, stored.camera, _straight_camera(stored.camera))
    assert again.extent_px() == pytest.approx(pan.extent_px(), rel=1e-6)


def test_a_photo_on_its_side_has_a_camera_on_its_side():
    camera = Camera.from_focal(250.0, 240, 360).with_lens(BARREL)
    assert camera_at(camera, (120, 180)).focal_px == pytest.approx(125)
    turned = camera_at(camera, (180, 120))
    assert turned.shape == (180, 120)
    assert turned.focal_px == pytest.approx(125)
    assert turned.matrix[:2, 2].tolist() == [59.5, 89.5]
    assert turned.distortion.tolist() == BARREL.tolist()


def test_a_distortion_that_folds_is_refused(scene, tmp_path):
    photo = photo_of(scene, tmp_path)
    camera = Camera.from_focal(250.0, *scene.shape).with_lens(np.array([-3.0, 0, 0, 0]))
    with pytest.raises(CalibrationError, match="cannot be straightened") as caught:
        straightened(photo, camera, whole=True)
    assert caught.value.file == str(photo.source)
