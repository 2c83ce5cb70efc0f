from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deshake as library
from deshake.api.deblurred import deblur
from deshake.errors import DeshakeError, KernelFileError, PhotoError
from deshake.geometry.kernel import RotationKernel


def error(one: np.ndarray, other: np.ndarray) -> float:
    return float(abs(one - other).mean())


def test_the_command_gives_the_same_picture(shaken, tmp_path, deshake):
    library.write_photo(tmp_path / "a.png", shaken.blurred)
    library.write_kernel(tmp_path / "k.npz", shaken.kernel)
    result = deshake("deblur", tmp_path / "a.png", tmp_path / "k.npz", "-o", tmp_path / "b.png")
    assert result.code == 0, result.err
    photo = library.read_photo(tmp_path / "a.png")
    sharp = deblur(photo, library.read_kernel(tmp_path / "k.npz").kernel)
    library.write_photo(tmp_path / "c.png", sharp)
    one, other = (library.read_photo(tmp_path / name).pixels for name in ("b.png", "c.png"))
    assert np.array_equal(one, other)
    assert error(one, shaken.sharp) < error(photo.pixels, shaken.sharp) / 2


def test_the_command_gives_the_same_picture_with_a_noisy_photo(shaken, noisy, tmp_path, deshake):
    library.write_photo(tmp_path / "g.png", shaken.blurred)
    library.write_photo(tmp_path / "n.png", noisy)
    library.write_kernel(tmp_path / "k.npz", shaken.kernel)
    result = deshake(
        *("deblur", tmp_path / "g.png", tmp_path / "k.npz", "-o", tmp_path / "b.png"),
        *("--noisy", tmp_path / "n.png", "--search-angle", "2"),
    )
    assert result.code == 0, result.err
    photo, other = (library.read_photo(tmp_path / name) for name in ("g.png", "n.png"))
    sharp = deblur(photo, shaken.kernel, noisy=other, search_angle=2)
    library.write_photo(tmp_path / "c.png", sharp)
    one, other = (library.read_photo(tmp_path / name).pixels for name in ("b.png", "c.png"))
    assert np.array_equal(one, other)


def test_a_photo_and_its_array_give_the_same(shaken, tmp_path):
    library.write_photo(tmp_path / "a.png", np.minimum(shaken.blurred, 0.95))
    photo = library.read_photo(tmp_path / "a.png")
    whole, bare = (deblur(item, shaken.kernel) for item in (photo, photo.pixels))
    assert isinstance(whole, library.Photo)
    assert isinstance(bare, np.ndarray)
    assert np.array_equal(whole.pixels, bare)


def test_colours_and_doubles_are_taken(shaken):
    colour = np.stack([shaken.blurred, 0.5 * shaken.blurred, 0.8 * shaken.blurred], -1)
    sharp = deblur(colour.astype(np.float64), shaken.kernel, quality="fast")
    assert sharp.dtype == np.float32
    assert sharp.shape == colour.shape


def test_a_camera_that_stood_still_leaves_a_copy(shaken):
    still = RotationKernel.delta(shaken.kernel.camera)
    result = deblur(shaken.blurred, still)
    assert np.array_equal(result, shaken.blurred)
    assert not np.shares_memory(result, shaken.blurred)


def test_a_kernel_for_the_photo_at_another_size_is_scaled(shaken):
    height, width = shaken.blurred.shape
    double = shaken.kernel.at_size(2 * height, 2 * width)
    one, other = (deblur(shaken.blurred, kernel) for kernel in (shaken.kernel, double))
    assert np.allclose(one, other, atol=1e-4)


@pytest.mark.parametrize("method", ["rl", "rl-accelerated", "rl-tv"])
def test_every_method_of_one_photo_runs(shaken, method):
    sharp = deblur(shaken.blurred, shaken.kernel, method=method, iterations=3)
    assert error(sharp, shaken.sharp) < error(shaken.blurred, shaken.sharp)


def test_a_noisy_array_helps(shaken, noisy):
    camera = shaken.kernel.camera
    match = library.register(shaken.blurred, noisy, camera, search_angle=2)
    for method in ("fusion", "residual"):
        sharp = deblur(
            shaken.blurred, shaken.kernel, noisy=noisy, registration=match, method=method
        )
        assert error(sharp, shaken.sharp) < error(shaken.blurred, shaken.sharp) / 2


def test_wrong_pictures_are_refused(shaken):
    with pytest.raises(PhotoError, match="the array: has the type uint8"):
        deblur((255 * shaken.blurred).astype(np.uint8), shaken.kernel)
    with pytest.raises(PhotoError, match="the array: has pixels that are not finite"):
        deblur(np.where(shaken.blurred > 0.5, np.nan, shaken.blurred), shaken.kernel)
    with pytest.raises(PhotoError, match="the noisy array: has the shape"):
        deblur(shaken.blurred, shaken.kernel, noisy=np.zeros(5))


def test_a_kernel_of_other_proportions_is_refused(shaken):
    with pytest.raises(KernelFileError, match=r"the kernel is for pictures of .* the array has"):
        deblur(shaken.blurred[:40], shaken.kernel)
    with pytest.raises(DeshakeError, match="not a RotationKernel: KernelFile"):
        deblur(shaken.blurred, library.KernelFile(shaken.kernel))
    wide = replace(shaken.kernel, theta=shaken.kernel.theta * 100)
    with pytest.raises(KernelFileError, match="its kernel is wider than half of the frame"):
        deblur(shaken.blurred, wide)


def test_a_registration_of_another_size_or_without_its_photo_is_refused(shaken, noisy, camera):
    other = library.Registration(np.zeros(3), 4.0, 0.9, camera)
    with pytest.raises(KernelFileError, match="the registration is for pictures of 128 x 96"):
        deblur(shaken.blurred, shaken.kernel, noisy=noisy, registration=other)
    own = replace(other, camera=shaken.kernel.camera)
    with pytest.raises(ValueError, match="needs the noisy photo"):
        deblur(shaken.blurred, shaken.kernel, registration=own)
    with pytest.raises(DeshakeError, match="not a Registration: int"):
        deblur(shaken.blurred, shaken.kernel, noisy=noisy, registration=4)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"method": "magic"}, "no method 'magic'"),
        ({"quality": "best"}, "of quality 'best'"),
        ({"iterations": 0}, "iterations is 0: it must be at least 1"),
        ({"method": "rl", "quality": "high"}, "rl has one quality only"),
        ({"method": "fusion"}, "fusion needs a noisy photo"),
        ({"search_angle": 50}, "search_angle is 50: .* at most 45"),
    ],
)
def test_wrong_options_are_refused(shaken, options, said):
    with pytest.raises(ValueError, match=said):
        deblur(shaken.blurred, shaken.kernel, **options)


def test_a_method_for_uniform_blur_says_so(shaken):
    with pytest.raises(DeshakeError, match="the same blur all over"):
        deblur(shaken.blurred, shaken.kernel, method="wiener")


def test_a_lens_that_bends_is_undone_in_arrays(shaken):
    bent = shaken.kernel.camera.with_lens(np.array([-0.05, 0.0, 0.0, 0.0]))
    kernel = shaken.kernel.for_camera(bent)
    assert deblur(shaken.blurred, kernel, keep_geometry=True).shape == shaken.blurred.shape
    assert deblur(shaken.blurred, kernel).ndim == 2
