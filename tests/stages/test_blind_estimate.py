from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from deshake.blind.variational import scales
from deshake.blind.variational.settings import SETTINGS
from deshake.errors import EstimationError
from deshake.files.kernel_file import CameraFile
from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.operators.shake_blur import ShakeBlur
from deshake.run import Run
from deshake.stages import blind_estimate
from deshake.stages.blind_estimate import FOCAL_LENGTHS, estimate_blind
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


def test_the_focal_length_that_explains_the_photo_best_is_kept(shaken, monkeypatch):
    photo, _, _ = shaken
    monkeypatch.setattr(blind_estimate, "FOCAL_LENGTHS", FOCAL_LENGTHS[::3])
    options = EstimateOptions(blur_size=3, estimator="edges", region=(0, 0, 64, 56))
    shares = []
    auto = estimate_blind(
        photo,
        replace(options, camera=CameraChoice(focal="auto")),
        run=Run(1, lambda share, _: shares.append(share)),
    )
    each = [
        estimate_blind(photo, replace(options, camera=CameraChoice(focal_35mm=film)), run=Run(1))
        for film in blind_estimate.FOCAL_LENGTHS
    ]
    best = max(each, key=lambda estimate: estimate.content.confidence)
    np.testing.assert_array_equal(auto.content.kernel.weights, best.content.kernel.weights)
    assert auto.content.kernel.camera.focal_px == best.content.kernel.camera.focal_px
    film = best.camera.source.removeprefix("--focal-35mm ")
    assert auto.camera.source == f"--focal auto, {film} mm-equivalent"
    assert auto.content.provenance["camera"] == auto.camera.source
    assert auto.content.provenance["options"]["focal"] == "auto"
    assert shares == sorted(shares)
    assert each[0].content.confidence != each[1].content.confidence
