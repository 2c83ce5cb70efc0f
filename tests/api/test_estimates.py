from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deshake as library
from deshake.api.estimates import estimate_blind, estimate_pair, register
from deshake.errors import DeshakeError, EstimationError, KernelFileError, PhotoError


def same(one: library.RotationKernel, other: library.RotationKernel) -> bool:
    pairs = ((getattr(one, name), getattr(other, name)) for name in ("theta", "weights", "steps"))
    return all(np.array_equal(*pair) for pair in pairs)


def test_the_command_gives_the_same_kernel(tmp_path, deshake):
    sharp = np.random.default_rng(0).random((12, 15)).repeat(10, 0).repeat(10, 1)
    camera = library.Camera.from_focal(150.0, *sharp.shape)
    shaken = library.simulate(sharp, camera, blur_px=6, seed=1)
    library.write_photo(tmp_path / "a.png", shaken.blurred)
    result = deshake(
        *("estimate-blind", tmp_path / "a.png", "-o", tmp_path / "k.npz", "--focal-px", "150"),
        *("--blur-size", "8", "--region", "10,10,90,80", "--uniform"),
    )
    assert result.code == 0, result.err
    content = library.read_kernel(tmp_path / "k.npz")
    photo = library.read_photo(tmp_path / "a.png")
    camera = library.calibrate(photo, focal_px=150)
    region = (10, 10, 90, 80)
    blur = estimate_blind(photo, camera, blur_size=8, region=region, uniform=True)
    assert same(blur.kernel, content.kernel)
    assert blur.confidence == content.confidence
    assert blur.notes == content.provenance["notes"]
    library.write_kernel(tmp_path / "l.npz", blur)
    assert library.read_kernel(tmp_path / "l.npz").provenance["input_sha256"] == photo.sha256


def test_the_commands_give_the_same_registration_and_kernel(shaken, noisy, tmp_path, deshake):
    library.write_photo(tmp_path / "g.png", shaken.blurred)
    library.write_photo(tmp_path / "n.png", noisy)
    pair = (tmp_path / "g.png", tmp_path / "n.png")
    result = deshake(
        *("estimate-pair", *pair, "-o", tmp_path / "k.npz"),
        *("--focal-px", "120", "--blur-size", "8", "--search-angle", "2"),
    )
    assert result.code == 0, result.err
    content = library.read_kernel(tmp_path / "k.npz")
    photos = [library.read_photo(path) for path in pair]
    camera = library.calibrate(photos[0], focal_px=120)
    blur = estimate_pair(*photos, camera, blur_size=8, search_angle=2)
    assert same(blur.kernel, content.kernel)
    assert blur.confidence == content.confidence
    match = register(*photos, camera, search_angle=2)
    assert np.array_equal(match.theta, blur.registration.theta)
    assert content.provenance["registration"] == match.report()
    known = estimate_pair(*photos, registration=match, blur_size=8)
    assert same(known.kernel, blur.kernel)


def test_a_photo_and_its_array_give_the_same(shaken, noisy):
    camera = shaken.kernel.camera
    match = register(shaken.blurred, noisy, camera, search_angle=2)
    assert match.scale == pytest.approx(4, rel=0.02)
    assert match.camera.shape == shaken.blurred.shape
    again = register(shaken.blurred.astype(np.float64), noisy, camera, search_angle=2)
    assert np.array_equal(match.theta, again.theta)


def test_a_sharp_array_is_left_as_it_is_and_noted():
    sharp = np.random.default_rng(0).random((12, 16)).repeat(8, 0).repeat(8, 1)
    blur = estimate_blind(sharp)
    assert not blur.kernel.theta.any()
    assert any("50 mm-equivalent is assumed" in note for note in blur.notes)
    assert any("looks sharp" in note for note in blur.notes)


def test_wrong_pictures_are_refused(scene, camera):
    for estimate in (estimate_blind, lambda g, c: register(g, scene, c)):
        with pytest.raises(PhotoError, match="the array: has the type uint8"):
            estimate((255 * scene).astype(np.uint8), camera)
        with pytest.raises(PhotoError, match="the array: has the shape"):
            estimate(scene[0], camera)
        with pytest.raises(PhotoError, match="the array: has pixels that are not finite"):
            estimate(scene * np.inf, camera)
    for pair in (register, estimate_pair):
        with pytest.raises(PhotoError, match="the noisy array: has the type int64"):
            pair(scene, scene.astype(int), camera)
        with pytest.raises(EstimationError, match="proportions"):
            pair(scene, scene[:40], camera)
    with pytest.raises(EstimationError, match=r"the array: .*clipped"):
        estimate_blind(100 * scene + 1, camera)
    with pytest.raises(EstimationError, match="the array: 128x40 pixels are too few"):
        estimate_blind(scene[:40])


def test_a_camera_of_other_proportions_is_refused(scene, camera):
    wrong = replace(camera, height=50)
    for estimate in (estimate_blind, lambda g, c: register(g, scene, c)):
        with pytest.raises(KernelFileError, match="the camera is for pictures of 128 x 50"):
            estimate(scene, wrong)
        with pytest.raises(DeshakeError, match="not a Camera: float"):
            estimate(scene, 120.0)


def test_a_registration_of_another_size_or_with_a_camera_is_refused(scene, camera):
    other = library.Registration(np.zeros(3), 1.0, 0.9, camera.scaled(48, 64))
    with pytest.raises(KernelFileError, match="the registration is for pictures of 64 x 48"):
        estimate_pair(scene, scene, registration=other)
    with pytest.raises(ValueError, match="leave the camera out"):
        estimate_pair(scene, scene, camera, registration=other)
    with pytest.raises(DeshakeError, match="not a Registration: Camera"):
        estimate_pair(scene, scene, registration=camera)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"estimator": "magic"}, "no estimator 'magic': edges or variational"),
        ({"blur_size": -3}, "blur_size is -3"),
        ({"max_angle": 60}, "max_angle is 60: .* at most 45"),
        ({"blur_size": 5, "max_angle": 1}, "cannot both be given"),
        ({"least_confidence": 1.5}, "least_confidence is 1.5: it must be from 0 to 1"),
        ({"least_confidence": 0, "estimator": "variational"}, "needs the estimator 'edges'"),
        ({"region": (0, 0, 50)}, "a region is x, y, width and height"),
        ({"region": (-1, 0, 50, 50)}, "a region is x, y, width and height"),
        ({"region": (0, 0, 50.5, 50)}, "a region is x, y, width and height"),
    ],
)
def test_wrong_options_are_refused(scene, camera, options, said):
    with pytest.raises(ValueError, match=said):
        estimate_blind(scene, camera, **options)


def test_a_region_or_a_blur_that_does_not_fit_is_refused(scene, camera):
    with pytest.raises(PhotoError, match="reaches beyond its 128 x 96 pixels"):
        estimate_blind(scene, camera, region=(0, 0, 129, 96))
    with pytest.raises(EstimationError, match="a blur of 90 px does not fit"):
        estimate_blind(scene, camera, blur_size=90)


def test_search_angles_are_in_range(scene, camera):
    for pair in (register, estimate_pair):
        with pytest.raises(ValueError, match="search_angle is 0"):
            pair(scene, scene, camera, search_angle=0)


def test_warnings_say_what_is_assumed(shaken, noisy, caplog):
    register(shaken.blurred, noisy, search_angle=2)
    assert "the array: " in caplog.text
    assert "50 mm-equivalent is assumed" in caplog.text
