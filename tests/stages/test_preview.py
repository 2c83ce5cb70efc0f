from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from deshake.errors import PhotoError
from deshake.formats.photo import Photo, read_photo
from deshake.formats.photo_writing import encode_photo
from deshake.run import Run
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.preview import preview_estimate, preview_options, preview_photo


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    """A photo of 2720 x 1360 with opacity: blocks of 4 x 4, of which some clip."""
    rng = np.random.default_rng(3)
    codes = rng.integers(20, 256, (340, 680, 4)).astype(np.uint8)
    path = tmp_path_factory.mktemp("photo") / "a.png"
    Image.fromarray(np.kron(codes, np.ones((4, 4, 1), np.uint8))).save(path, compress_level=0)
    return read_photo(path)


def test_is_a_quarter_of_the_size(photo):
    small = preview_photo(photo)
    assert small.shape == (340, 680)
    assert np.abs(small.pixels - photo.pixels[::4, ::4]).max() < 1e-6
    assert np.array_equal(small.clipped, photo.clipped[::4, ::4])
    assert np.array_equal(small.alpha, photo.alpha[::4, ::4])
    assert Image.open(io.BytesIO(encode_photo(small))).size == (680, 340)


def test_small_photos_are_reduced_less_or_not_at_all(photo):
    assert preview_photo(preview_photo(photo)).shape == (320, 640)
    least = preview_photo(preview_photo(photo))
    assert preview_photo(least) is least


def test_what_is_in_pixels_is_scaled(photo):
    small = preview_photo(photo)
    given = EstimateOptions(
        camera=CameraChoice(focal_px=2000), blur_size=40, region=(101, 200, 398, 401)
    )
    reduced = preview_options(given, photo, small)
    assert (reduced.camera.focal_px, reduced.blur_size) == (500, 10)
    assert reduced.region == (25, 50, 100, 101)
    assert reduced.estimator == "edges"
    assert reduced.preview
    assert reduced.provenance()["preview"]
    given = EstimateOptions(
        camera=CameraChoice(focal_35mm=30), max_angle=2, estimator="variational", blur_size=2
    )
    reduced = preview_options(given, photo, small)
    assert (reduced.camera.focal_35mm, reduced.max_angle, reduced.region) == (30, 2, None)
    assert (reduced.blur_size, reduced.estimator) == (1, "variational")


def test_a_region_beyond_the_photo_is_reported_in_its_pixels(photo):
    with pytest.raises(PhotoError, match="2720 x 1360"):
        preview_options(EstimateOptions(region=(0, 0, 3000, 10)), photo, preview_photo(photo))


def test_the_kernel_is_that_of_the_reduced_photo(tmp_path):
    rows = np.arange(96)[:, None]
    picture = 120 + 60 * np.sign(np.sin(rows / 5) + np.cos(np.arange(128) / 6))
    blurred = (picture + np.roll(picture, 1, 1) + np.roll(picture, 2, 1)) / 3
    Image.fromarray(blurred.astype(np.uint8)).resize((680, 510)).save(tmp_path / "b.png")
    photo = read_photo(tmp_path / "b.png")
    small = preview_photo(photo)
    options = EstimateOptions(
        camera=CameraChoice(focal_35mm=40), blur_size=20, uniform=True, region=(170, 85, 255, 204)
    )
    estimate = preview_estimate(photo, small, options, run=Run(1))
    assert estimate.content.kernel.camera.shape == small.shape == (480, 640)
    assert estimate.camera.camera.shape == small.shape
    assert estimate.camera.camera.focal_px == pytest.approx(40 / 43.267 * 800, rel=1e-3)
    assert estimate.content.provenance["options"]["preview"] is True


def sharp_photo(path, size) -> Photo:
    """A photo of blocks with edges one pixel wide."""
    codes = np.random.default_rng(5).integers(20, 230, (size[1] // 20, size[0] // 20))
    Image.fromarray(np.kron(codes, np.ones((20, 20))).astype(np.uint8)).save(path)
    return read_photo(path)


def test_a_photo_that_looks_sharp_when_small_has_a_note_that_says_so(tmp_path):
    photo = sharp_photo(tmp_path / "a.png", (2720, 1360))
    small = preview_photo(photo)
    estimate = preview_estimate(photo, small, EstimateOptions(), run=Run(1))
    assert len(estimate.kernel.weights) == 1
    assert estimate.kernel.camera.shape == small.shape
    (note,) = estimate.notes
    assert note.startswith(
        "no shake is visible at the size of a preview: the photo is left as it is"
    )


def test_a_small_photo_has_the_note_of_its_estimate(tmp_path):
    photo = sharp_photo(tmp_path / "a.png", (600, 400))
    estimate = preview_estimate(photo, preview_photo(photo), EstimateOptions(), run=Run(1))
    assert estimate.notes[-1] == "the photo looks sharp: it is left as it is"
