from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image
from skimage import data

from deshake.blind.agreement import agreement
from deshake.blind.variational import scales
from deshake.blind.variational.settings import SETTINGS
from deshake.errors import EstimationError
from deshake.files.kernel_file import CameraFile
from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur
from deshake.run import Run
from deshake.stages.blind_estimate import estimate_blind
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.deblurring import deblur
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.methods import RestorationOptions, restore


def texture(height, width, seed=5):
    """Blobs with sharp edges, (height, width) from 0.1 to 0.9."""
    coarse = np.random.default_rng(seed).random((height // 8 + 2, width // 8 + 2)) > 0.5
    fine = np.kron(coarse, np.ones((8, 8)))[3 : height + 3, 5 : width + 5]
    return (0.1 + 0.8 * fine).astype(np.float32)


def pan(folder, scale=1):
    """A photo of 96 x 72 or larger, blurred by a pan, its kernel, and the sharp one; linear."""
    camera = Camera.from_focal(100 * scale, 72 * scale, 96 * scale)
    kernel = RotationKernel.from_path([(0, -0.02, 0), (0, 0.02, 0)], camera).centred()
    blur = ShakeBlur(kernel)
    sharp = texture(*blur.latent_shape)
    codes = np.rint(np.stack([blur.forward(sharp)] * 3, -1) * 255).astype(np.uint8)
    path = folder / "shaken.png"
    Image.fromarray(codes).save(path)
    inner = slice(blur.margin, -blur.margin)
    return read_photo(path, transfer="linear"), kernel, sharp[inner, inner]


@pytest.fixture
def shaken(tmp_path):
    return pan(tmp_path)


def test_the_estimate_finds_the_pan(tmp_path):
    photo, truth, _ = pan(tmp_path, 2)
    camera = CameraFile(truth.camera, "made up")
    estimate = estimate_blind(
        photo, EstimateOptions(camera=CameraChoice(file=camera), blur_size=12, preview=True)
    )
    kernel = estimate.content.kernel
    spread = np.sqrt(kernel.weights @ (kernel.theta - kernel.centroid) ** 2)
    assert spread[1] > 1.3 * spread[0]
    assert estimate.camera is camera
    assert estimate.content.provenance["camera"] == "made up"
    assert estimate.report()["rotations"] == len(kernel.weights)


def test_an_angle_bounds_the_blur_as_its_pixels_do(shaken):
    photo, truth, _ = shaken
    camera = CameraFile(truth.camera, "made up")
    angle = 4.0
    focal, half = 100, 95 / 2
    wide = np.radians(angle) * (focal**2 + half**2) / focal  # tilts, at the frame's edge
    same = [
        estimate_blind(
            photo,
            EstimateOptions(
                camera=CameraChoice(file=camera), uniform=True, estimator="edges", **bound
            ),
        ).content.kernel
        for bound in ({"max_angle": angle}, {"blur_size": wide})
    ]
    assert np.array_equal(same[0].weights, same[1].weights)


def test_an_assumed_lens_is_long_and_noted(shaken):
    photo, _, _ = shaken
    estimate = estimate_blind(photo, EstimateOptions(blur_size=3, uniform=True))
    assert estimate.camera.source == "assumed: 50 mm-equivalent"
    assert "50 mm-equivalent is assumed" in estimate.notes[0]
    assert estimate.content.provenance["notes"] == estimate.notes
    assert 1e-4 < estimate.report()["noise"] < 0.05


def test_a_camera_that_stood_still_leaves_the_photo_as_it_is(shaken):
    photo, truth, _ = shaken
    shares = []
    still = RotationKernel.delta(truth.camera)
    result = deblur(photo, still, run=Run(progress=lambda share, _: shares.append(share))).photo
    assert np.array_equal(result.pixels, photo.pixels)
    assert shares == [1]


def test_dark_halos_do_not_fall_to_black(shaken):
    photo, truth, _ = shaken
    long = RotationKernel(truth.theta * 2, truth.weights, truth.steps, truth.camera)
    result = deblur(photo, long).photo
    assert result.pixels.min() >= 0.095 * photo.pixels.min()
    assert restore(photo.pixels, long).pixels.min() < 0.1 * photo.pixels.min()


def test_what_cannot_be_estimated_names_the_photo(shaken):
    photo, _, _ = shaken
    flat = replace(photo, pixels=np.full_like(photo.pixels, 0.5))
    with pytest.raises(EstimationError, match="no detail") as caught:
        estimate_blind(flat, EstimateOptions(blur_size=3))
    assert caught.value.file == str(photo.source)


def test_clipped_pixels_are_left_out_of_the_estimate(shaken, monkeypatch):
    few = replace(SETTINGS, iterations=3)  # enough to compare estimates
    monkeypatch.setattr(scales, "SETTINGS", few)
    photo, truth, _ = shaken
    camera = CameraFile(truth.camera, "made up")
    options = EstimateOptions(
        camera=CameraChoice(file=camera), blur_size=3, estimator="variational"
    )
    mask = np.zeros(photo.shape, bool)
    mask[30:34, 40:44] = True
    burnt = photo.pixels.copy()
    burnt[mask] = 1
    kernels = [
        estimate_blind(replace(photo, pixels=pixels, clipped=mask), options).content.kernel
        for pixels in (photo.pixels, burnt)
    ]
    np.testing.assert_allclose(kernels[0].theta, kernels[1].theta, atol=1e-4)
    np.testing.assert_allclose(kernels[0].weights, kernels[1].weights, atol=1e-3)
    marked, unmarked = kernels[0].weights, estimate_blind(photo, options).content.kernel.weights
    assert marked.shape != unmarked.shape or not np.array_equal(marked, unmarked)


@pytest.mark.parametrize("method", [RestorationOptions(), RestorationOptions("rl", iterations=15)])
def test_deblurring_comes_nearer_to_the_sharp_photo(shaken, method):
    photo, truth, sharp = shaken
    report = []
    result = deblur(
        photo, truth, method, run=Run(progress=lambda share, _: report.append(share))
    ).photo
    before, after = (
        np.sqrt(np.mean((p.pixels[8:-8, 8:-8, 0] - sharp[8:-8, 8:-8]) ** 2))
        for p in (photo, result)
    )
    assert after < 0.75 * before
    assert result.source == photo.source
    assert result.encoding is photo.encoding
    assert report == sorted(report)


@pytest.fixture(scope="module")
def unknown(tmp_path_factory):
    """A photo of 320 x 240 through a 28 mm lens, without metadata, and its kernel."""
    camera = Camera.from_focal(0.65 * 400, 240, 320)
    path = np.array([[0.0, -10, -1], [4, -3, 0], [-1, 4, 1], [3, 12, 1]]) * grid_steps(camera)
    kernel = RotationKernel.from_path(path, camera).centred()
    blur = ShakeBlur(kernel)
    grey = cv2.resize(data.coffee(), blur.latent_shape[::-1], interpolation=cv2.INTER_AREA)[..., 1]
    codes = np.rint(np.stack([blur.forward((grey / 255).astype(np.float32))] * 3, -1) * 255)
    path = tmp_path_factory.mktemp("unknown") / "unknown.png"
    Image.fromarray(codes.astype(np.uint8)).save(path)
    return read_photo(path, transfer="linear"), kernel


@pytest.fixture(scope="module")
def focused(unknown):
    """The estimate for that photo."""
    return estimate_blind(unknown[0], EstimateOptions(preview=True))


@pytest.mark.long
def test_a_focal_length_that_no_one_knows_is_estimated_with_the_kernel(unknown, focused):
    photo, truth = unknown
    estimate = focused
    camera = estimate.content.kernel.camera
    assert camera.focal_px == pytest.approx(truth.camera.focal_px, rel=0.3)
    assert camera.focal_px == estimate.camera.camera.focal_px
    film = round(camera.focal_px * np.hypot(36, 24) / 400)
    assert estimate.camera.source == f"estimated with the kernel: {film} mm-equivalent"
    assert estimate.content.provenance["camera"] == estimate.camera.source
    [note] = [note for note in estimate.notes if "mm-equivalent" in note]
    assert note == (
        f"no focal length in its metadata; a {film} mm-equivalent suits the photo: --focal-35mm "
        "sets another"
    )
    known = estimate_blind(
        photo, EstimateOptions(camera=CameraChoice(focal_35mm=50.0), preview=True)
    )
    assert known.camera.source == "--focal-35mm 50"
    best = agreement(estimate.content.kernel, truth)
    assert best > agreement(known.content.kernel, truth)


@pytest.mark.long
def test_auto_ignores_the_metadata(unknown, focused, tmp_path):
    photo, _ = unknown
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 80  # FocalLengthIn35mmFilm
    tagged = tmp_path / "tagged.png"
    with Image.open(photo.source) as picture:
        picture.save(tagged, exif=exif)
    tagged = read_photo(tagged, transfer="linear")
    auto = EstimateOptions(camera=CameraChoice(focal="auto"), preview=True)
    chosen = estimate_blind(tagged, auto)
    kernel, same = (estimate.content.kernel for estimate in (chosen, focused))
    assert kernel.weights.tobytes() == same.weights.tobytes()
    assert kernel.theta.tobytes() == same.theta.tobytes()
    assert not any("mm-equivalent" in note for note in chosen.notes)
    assert chosen.content.provenance["options"]["focal"] == "auto"
