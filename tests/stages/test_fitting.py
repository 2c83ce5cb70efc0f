from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deshake.errors import KernelFileError, PhotoError
from deshake.files.kernel_file import CameraFile, KernelFile
from deshake.formats.encoding import Encoding
from deshake.formats.photo import Photo
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.metadata.metadata import Metadata
from deshake.stages.fitting import check_region, check_registration, fitting_camera, fitting_kernel

FILE = Path("k.npz")


def photo(height, width):
    pixels = np.zeros((height, width), np.float32)
    return Photo(pixels, pixels > 1, None, Encoding("PNG"), Metadata(), Path("a.png"))


def kernel(height, width, turn=0.01):
    camera = Camera.from_focal(1.2 * max(height, width), height, width)
    path = [(-turn, 0, turn), (turn, 0, -turn)]
    return KernelFile(RotationKernel.from_path(path, camera))


def test_a_kernel_for_this_size_is_handed_on_as_it_is():
    content = kernel(300, 400)
    assert fitting_kernel(content, photo(300, 400), FILE) is content.kernel


@pytest.mark.parametrize("size", [(600, 800), (150, 200), (75, 101), (76, 100), (1499, 2000)])
def test_a_kernel_fits_the_photo_resized(size):
    content = kernel(300, 400)
    fitted = fitting_kernel(content, photo(*size), FILE)
    assert fitted.camera.shape == size
    assert np.array_equal(fitted.theta, content.kernel.theta)
    assert fitted.extent_px() == pytest.approx(content.kernel.extent_px() * size[1] / 400, rel=0.03)


@pytest.mark.parametrize("size", [(297, 400), (300, 404), (600, 796), (3000, 4020)])
def test_a_kernel_does_not_fit_a_crop(size):
    with pytest.raises(KernelFileError, match="400 x 300 pixels, and") as caught:
        fitting_kernel(kernel(300, 400), photo(*size), FILE)
    assert "cropped" in caught.value.hint
    assert caught.value.file == "k.npz"


def test_a_kernel_does_not_fit_the_photo_turned():
    with pytest.raises(KernelFileError) as caught:
        fitting_kernel(kernel(300, 400), photo(800, 600), FILE)
    assert "turned" in caught.value.hint


@pytest.mark.parametrize("turn", [0.2, 0.5, 1.5])
def test_a_blur_over_half_the_frame_is_absurd(turn):
    fitting_kernel(kernel(300, 400, 0.1), photo(300, 400), FILE)
    with pytest.raises(KernelFileError, match="half of the frame"):
        fitting_kernel(kernel(300, 400, turn), photo(300, 400), FILE)


def test_where_the_camera_pointed_does_not_matter():
    content = kernel(300, 400)
    away = replace(content.kernel, theta=content.kernel.theta + np.array((0.5, 0, 0)))
    assert fitting_kernel(KernelFile(away), photo(300, 400), FILE) is away


def test_a_camera_fits_the_photo_resized():
    content = CameraFile(Camera.from_focal(500, 300, 400), "made up")
    assert fitting_camera(content, photo(300, 400)) is content
    fitted = fitting_camera(content, photo(600, 800))
    assert fitted.camera.shape == (600, 800)
    assert fitted.camera.focal_px == pytest.approx(1000)
    assert fitted.source == "made up"
    with pytest.raises(KernelFileError, match="the camera is for pictures of 400 x 300"):
        fitting_camera(content, photo(400, 400))


def test_a_region_lies_within_the_photo():
    check_region(photo(300, 400), None)
    check_region(photo(300, 400), (0, 0, 400, 300))
    for region in ((1, 0, 400, 300), (0, 1, 400, 300), (400, 0, 1, 1)):
        with pytest.raises(PhotoError, match="reaches beyond its 400 x 300 pixels"):
            check_region(photo(300, 400), region)


def test_a_registration_fits_photos_of_its_size_only():
    camera = Camera.from_focal(400.0, 300, 400)
    check_registration(camera, photo(300, 400))
    with pytest.raises(
        KernelFileError, match=r"400 x 300 pixels, and a\.png has 800 x 600"
    ) as caught:
        check_registration(camera, photo(600, 800), FILE)
    assert caught.value.file == str(FILE)
