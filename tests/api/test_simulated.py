from __future__ import annotations

import numpy as np
import pytest

import deshake as library
from deshake.api.simulated import simulate
from deshake.errors import DeshakeError, KernelFileError, PhotoError


def test_the_command_gives_the_same_picture_and_kernel(scene, tmp_path, deshake):
    library.write_photo(tmp_path / "a.png", scene)
    result = deshake(
        *("simulate", tmp_path / "a.png", "-o", tmp_path / "b.png", "--kernel"),
        *(tmp_path / "k.npz", "--focal-px", "120", "--blur-size", "5", "--seed", "3"),
        *("--gain", "1.5", "--photons", "3000", "--noise", "0.01", "--sharp", tmp_path / "c.png"),
    )
    assert result.code == 0, result.err
    photo = library.read_photo(tmp_path / "a.png")
    shaken = simulate(
        photo,
        library.calibrate(photo, focal_px=120),
        blur_px=5,
        seed=3,
        gain=1.5,
        photons=3000,
        noise_sigma=0.01,
    )
    kernel = library.read_kernel(tmp_path / "k.npz").kernel
    assert np.array_equal(kernel.theta, shaken.kernel.theta)
    assert np.array_equal(kernel.weights, shaken.kernel.weights)
    for name, kept in (("b.png", shaken.blurred), ("c.png", shaken.sharp)):
        library.write_photo(tmp_path / f"own-{name}", kept)
        assert (tmp_path / f"own-{name}").read_bytes() == (tmp_path / name).read_bytes()


def test_an_array_gives_arrays_of_a_frame(scene, camera):
    shaken = simulate(scene, camera, blur_px=4, seed=1)
    assert shaken.blurred.dtype == shaken.sharp.dtype == np.float32
    assert shaken.blurred.shape == shaken.sharp.shape == shaken.kernel.camera.shape
    assert shaken.blurred.shape < scene.shape
    whole = simulate(scene, camera, blur_px=4, seed=1, crop=False)
    assert whole.blurred.shape == scene.shape


def test_what_clips_is_marked_in_a_photo(scene, camera, tmp_path):
    library.write_photo(tmp_path / "a.png", scene)
    photo = library.read_photo(tmp_path / "a.png")
    shaken = simulate(photo, camera, blur_px=4, gain=3)
    assert 0 < shaken.blurred.clipped.mean() < 1
    assert np.array_equal(shaken.blurred.clipped, shaken.blurred.pixels >= 1)
    assert shaken.blurred.sha256 is None


def test_a_path_is_taken(scene, camera):
    still = simulate(scene, camera, path=[(0, 0, 0)])
    assert np.allclose(still.blurred, still.sharp, atol=1e-6)
    turn = simulate(scene, camera, path=[(0, -0.02, 0), (0, 0.02, 0)])
    assert turn.kernel.extent_px() > 4


def test_an_assumed_camera_is_a_warning(scene, caplog):
    shaken = simulate(scene, path=[(0, 0, 0)])
    assert "the array: " in caplog.text
    assert "50 mm-equivalent is assumed" in caplog.text
    assert shaken.kernel.camera.focal_px == pytest.approx(160 / 43.2666 * 50, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"blur_px": 0}, "blur_px is 0"),
        ({"gain": np.nan}, "gain is nan"),
        ({"photons": -1}, "photons is -1"),
        ({"noise_sigma": 2}, "noise_sigma is 2: it must be from 0 to 1"),
        ({"noise_sigma": np.nan}, "noise_sigma is nan"),
        ({"seed": -1}, "seed is -1"),
        ({"path": [(0, 1)]}, r"a \(T, 3\) array"),
        ({"path": [(0, np.nan, 0)]}, "finite"),
    ],
)
def test_wrong_options_are_refused(scene, camera, options, said):
    with pytest.raises(ValueError, match=said):
        simulate(scene, camera, **options)


def test_wrong_input_is_refused(scene, camera):
    with pytest.raises(PhotoError, match="the array: has the type int64"):
        simulate(scene.astype(int), camera)
    with pytest.raises(KernelFileError, match="the camera is for pictures of 128 x 96 pixels"):
        simulate(scene[:50], camera)
    with pytest.raises(DeshakeError, match="the array: a shake of 99 pixels"):
        simulate(scene, camera, blur_px=99)
