from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.errors import DeshakeError
from deshake.formats.encoding import Encoding
from deshake.formats.photo import Photo
from deshake.geometry.camera import Camera
from deshake.geometry.distortion import pinhole
from deshake.lens.lens_warp import LensWarp
from deshake.metadata.metadata import Metadata
from deshake.operators.shake_blur import ShakeBlur
from deshake.run import Run
from deshake.simulation.shake_path import CameraPath, random_path
from deshake.simulation.shaken_photo import shake, shake_photo


@pytest.fixture(scope="module")
def photo():
    """A real photo in linear light, 200 x 300."""
    codes = data.chelsea()[50:250, 80:380].astype(np.float32) / 255
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4).astype("f4")


@pytest.fixture(scope="module")
def camera():
    return Camera.from_focal(330, 200, 300)


@pytest.mark.parametrize("blur_px", [6, 12, 25])
def test_the_true_kernel_explains_the_photo(photo, camera, blur_px):
    shaken = shake(photo, camera, random_path(camera, blur_px, seed=blur_px))
    top, left = shaken.offset
    blur = ShakeBlur(shaken.kernel, margin=top)
    again = blur.forward(photo)
    assert top == left
    assert again.shape == shaken.pixels.shape
    assert np.sqrt(np.mean(np.square(again - shaken.pixels))) < 2e-3
    assert np.sqrt(np.mean(np.square(shaken.sharp - shaken.pixels))) > 1e-2


def test_the_kernel_belongs_to_the_cropped_photo(photo, camera):
    shaken = shake(photo, camera, random_path(camera, 12, seed=3))
    top, left = shaken.offset
    height, width = shaken.pixels.shape[:2]
    assert shaken.kernel.camera.shape == (height, width)
    assert (height + 2 * top, width + 2 * left) == camera.shape
    assert shaken.kernel.camera.focal_px == camera.focal_px
    np.testing.assert_allclose(
        shaken.kernel.camera.matrix[:2, 2], ((width - 1) / 2, (height - 1) / 2)
    )
    assert np.abs(shaken.kernel.centroid).max() < 1e-9
    assert shaken.kernel.extent_px() == pytest.approx(12, abs=2)
    np.testing.assert_array_equal(shaken.sharp, photo[top:-top, left:-left])


def test_a_photo_that_keeps_its_size_is_continued_by_its_edges(photo, camera):
    path = random_path(camera, 12, seed=3)
    whole, cropped = (shake(photo, camera, path, crop=crop) for crop in (False, True))
    assert whole.pixels.shape == photo.shape
    assert whole.offset == (0, 0)
    margin = cropped.offset[0]
    inside = whole.pixels[margin:-margin, margin:-margin]
    np.testing.assert_allclose(inside, cropped.pixels, atol=2e-4)
    assert whole.pixels.min() > 0.5 * photo.min()  # nothing dark comes in from outside


def test_a_still_camera_blurs_nothing(photo, camera):
    shaken = shake(photo, camera, CameraPath(np.full((1, 3), 0.2)))
    np.testing.assert_allclose(shaken.pixels, shaken.sharp, atol=1e-5)
    assert len(shaken.kernel.weights) == 1


def test_grey_photos_stay_grey(photo, camera):
    shaken = shake(photo[..., 1], camera, random_path(camera, 6, seed=1))
    colour = shake(photo, camera, random_path(camera, 6, seed=1))
    np.testing.assert_allclose(shaken.pixels, colour.pixels[..., 1], atol=1e-6)


def test_seeds_decide_the_noise(photo, camera):
    path = random_path(camera, 6, seed=1)
    one, same, other = (
        shake(photo, camera, path, noise_sigma=0.01, photons=1000, seed=s).pixels for s in (4, 4, 5)
    )
    assert one.tobytes() == same.tobytes()
    assert not np.array_equal(one, other)


def test_gain_clips_lights(photo, camera):
    path = random_path(camera, 6, seed=1)
    shaken = shake(photo, camera, path, gain=3)
    plain = shake(photo, camera, path)
    assert shaken.pixels.max() == 1
    assert 0.01 < (shaken.pixels == 1).mean() < 0.9
    np.testing.assert_allclose(shaken.pixels, np.minimum(3 * plain.pixels, 1), atol=1e-6)
    assert shaken.sharp.max() > 1


def test_progress_is_reported(photo, camera):
    shares = []
    shake(
        photo, camera, random_path(camera, 4), run=Run(progress=lambda part, _: shares.append(part))
    )
    assert shares == sorted(shares)
    assert len(shares) > 4
    assert 0 < shares[0] < shares[-1] <= 1


def test_refuses_what_does_not_fit(photo, camera):
    with pytest.raises(ValueError, match="fit"):
        shake(photo[1:], camera, random_path(camera, 4))
    small = Camera.from_focal(60, 40, 50)
    with pytest.raises(DeshakeError, match="leaves nothing"):
        shake(photo[:40, :50], small, random_path(small, 25))


def test_a_lens_bends_after_the_shake(photo, camera):
    lens = camera.with_lens(np.array([-0.15, 0, 0, 0]))
    path = random_path(camera, 8, seed=3)
    plain, bent = shake(photo, camera, path), shake(photo, lens, path)
    assert bent.pixels.shape == plain.pixels.shape
    there = bent.kernel.camera
    assert there.distortion.tolist() == [-0.15, 0, 0, 0]
    assert there.focal_px > camera.focal_px
    np.testing.assert_array_equal(bent.kernel.theta, plain.kernel.theta)
    straight_camera = pinhole(there)
    straight = LensWarp(there, straight_camera).straighten(bent.pixels)
    # the same picture through a longer lens
    zoom = straight_camera.focal_px / camera.focal_px
    height, width = plain.pixels.shape[:2]
    y, x = np.mgrid[20 : height - 20, 20 : width - 20].astype(np.float32)
    middle = (width - 1) / 2, (height - 1) / 2
    x0, y0 = (x - middle[0]) / zoom + middle[0], (y - middle[1]) / zoom + middle[1]
    expected = cv2.remap(plain.pixels, x0.astype("f4"), y0.astype("f4"), cv2.INTER_CUBIC)
    np.testing.assert_allclose(straight[20 : height - 20, 20 : width - 20], expected, atol=0.02)


def test_a_photo_is_shaken_with_its_opacity_and_its_own_clipping(photo, camera):
    alpha = np.arange(200 * 300, dtype=np.uint16).reshape(200, 300)
    nowhere = np.zeros(photo.shape[:2], bool)
    encoding = Encoding("PNG", depth=16)
    whole = Photo(photo, nowhere, alpha, encoding, Metadata(), Path("a.png"), sha256="0" * 64)
    path = random_path(camera, 8, seed=2)
    plain = shake(photo, camera, path, gain=2)
    shaken = shake_photo(whole, camera, path, gain=2)
    assert np.array_equal(shaken.photo.pixels, plain.pixels)
    assert np.array_equal(shaken.sharp.pixels, plain.sharp)
    top = plain.offset[0]
    assert np.array_equal(shaken.photo.alpha, alpha[top:-top, top:-top])
    assert np.array_equal(shaken.photo.clipped, (plain.pixels >= 1).any(-1))
    assert np.array_equal(shaken.sharp.clipped, (plain.sharp >= 1).any(-1))
    assert shaken.photo.sha256 is None  # no file has these pixels
