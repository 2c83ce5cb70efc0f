from __future__ import annotations

import hashlib
import subprocess
import sys

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from deshake.files.kernel_file import KernelFile, read_kernel, write_kernel
from deshake.files.registration_file import RegistrationFile, write_registration
from deshake.formats.transfer import Srgb, decode, encode
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.metadata.provenance import read_provenance
from deshake.operators.warps import Warps
from deshake.version import __version__


@pytest.fixture
def kernel(tmp_path):
    """A pan along a slant, for photos of 100 x 80."""
    path = tmp_path / "pan.npz"
    turn = RotationKernel.from_path(
        [(-0.012, -0.012, 0), (0.012, 0.012, 0)], Camera.from_focal(120, 80, 100)
    )
    write_kernel(path, KernelFile(turn))
    return path


def contrast(path):
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).astype(float)
    return np.abs(np.diff(grey[10:-10, 10:-10], axis=1)).mean()


def test_makes_a_sharper_photo_beside_the_first(deshake, shaken, kernel, tmp_path):
    photo = shaken("a.jpg")
    outcome = deshake("deblur", photo, kernel)
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    out = tmp_path / "a.deshaken.jpg"
    assert contrast(out) > 1.05 * contrast(photo)
    with Image.open(out) as image:
        assert (image.format, image.mode, image.size) == ("JPEG", "RGB", (100, 80))


def test_depth_and_opacity_stay(deshake, kernel, tmp_path):
    path, out = tmp_path / "a.png", tmp_path / "out.png"
    codes = np.random.default_rng(1).integers(0, 65536, (80, 100, 4)).astype(np.uint16)
    path.write_bytes(cv2.imencode(".png", codes)[1].tobytes())
    assert deshake("deblur", path, kernel, "-o", out, "--iterations", 2).code == 0
    result = cv2.imread(str(out), cv2.IMREAD_UNCHANGED)
    assert result.dtype == np.uint16
    assert np.array_equal(result[..., 3], codes[..., 3])
    assert not np.array_equal(result[..., :3], codes[..., :3])


def test_metadata_stay(deshake, shaken, kernel, tmp_path):
    photo = shaken("a.jpg")
    exif = Image.Exif()
    exif[0x010F] = "a camera"
    with Image.open(photo) as image:
        image.load()
        image.save(photo, exif=exif, icc_profile=b"x" * 200)
    assert deshake("deblur", photo, kernel, "--iterations", 1).code == 0
    with Image.open(tmp_path / "a.deshaken.jpg") as image:
        assert image.getexif()[0x010F] == "a camera"
        assert image.info["icc_profile"] == b"x" * 200


@pytest.mark.parametrize("ending", ["jpg", "png", "tif", "webp"])
def test_the_result_has_its_provenance(deshake, shaken, kernel, tmp_path, ending):
    photo = shaken(f"a.{ending}")
    how = ("--method", "rl", "--iterations", 1)
    assert deshake("deblur", photo, kernel, *how).code == 0
    out = tmp_path / f"a.deshaken.{ending}"
    provenance = read_provenance(out)
    assert provenance["options"] == {
        "transfer": None,
        "method": "rl",
        "quality": "default",
        "iterations": 1,
    }
    assert provenance["input_sha256"] == hashlib.sha256(photo.read_bytes()).hexdigest()
    assert str(tmp_path).encode() not in out.read_bytes()
    with Image.open(out) as image:
        assert image.getexif()[305] == f"deshake {__version__}"
    assert deshake("deblur", photo, kernel, *how, "--overwrite", "--no-provenance").code == 0
    assert b"deshake" not in out.read_bytes()
    with Image.open(out) as image:
        assert not image.getexif().get(305)
        assert not image.info.get("xmp")


def test_a_folder_takes_the_default_name(deshake, shaken, kernel, tmp_path):
    (tmp_path / "sharp").mkdir()
    args = ("--iterations", 1, "-o", tmp_path / "sharp")
    assert deshake("deblur", shaken("a.jpg"), kernel, *args).code == 0
    assert (tmp_path / "sharp" / "a.deshaken.jpg").exists()


def test_the_kernel_fits_the_photo_at_another_size(deshake, shaken, kernel, tmp_path):
    big = tmp_path / "big.jpg"
    with Image.open(shaken("a.jpg")) as image:
        image.resize((199, 160), Image.Resampling.BICUBIC).save(big)
    assert deshake("deblur", big, kernel, "--iterations", 4).code == 0
    assert contrast(tmp_path / "big.deshaken.jpg") > 1.02 * contrast(big)


@pytest.mark.parametrize(
    ("size", "hint"),
    [((100, 90), "must not be cropped"), ((80, 100), "turned"), ((1, 9), "must not be cropped")],
)
def test_another_shape_is_an_error(deshake, kernel, tmp_path, size, hint):
    photo = tmp_path / "other.png"
    Image.new("RGB", size, "teal").save(photo)
    outcome = deshake("deblur", photo, kernel)
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {kernel}: the kernel is for pictures of 100 x 80")
    assert hint in outcome.err
    assert not (tmp_path / "other.deshaken.png").exists()


def test_method_iterations_and_transfer_shape_the_result(deshake, shaken, kernel, tmp_path):
    photo = shaken("a.png")
    results = set()
    for args in (
        ("--iterations", 2),
        ("--iterations", 5),
        ("--iterations", 2, "--transfer=linear"),
        ("--iterations", 2, "--method=rl"),
        ("--method=rl",),
        ("--method=rl-accelerated",),
        ("--method=rl-tv",),
        ("--quality=fast",),
        ("--quality=high",),
    ):
        assert deshake("deblur", photo, kernel, "--overwrite", *args).code == 0
        results.add((tmp_path / "a.deshaken.png").read_bytes())
    assert len(results) == 9


def test_the_default_is_sparse(deshake, shaken, kernel, tmp_path):
    photo, results = shaken("a.png"), set()
    for args in ((), ("--method", "sparse")):
        assert deshake("deblur", photo, kernel, "--overwrite", *args).code == 0
        results.add((tmp_path / "a.deshaken.png").read_bytes())
    assert len(results) == 1
    assert "'median' is not one of" in deshake("deblur", photo, kernel, "--method", "median").err


@pytest.mark.parametrize(
    "args",
    [
        ("--quality=high", "--method=rl"),
        ("--method=rl-tv", "--quality=fast"),
        ("--iterations=3", "--method=wiener"),
    ],
)
def test_what_does_not_go_with_a_method_is_wrong_use(deshake, shaken, kernel, tmp_path, args):
    outcome = deshake("deblur", shaken("a.png"), kernel, *args)
    assert outcome.code == 2
    assert "does not go with --method" in outcome.err
    assert not (tmp_path / "a.deshaken.png").exists()


def test_wiener_is_for_uniform_blur(deshake, shaken, kernel, tmp_path):
    photo = shaken("a.png")
    outcome = deshake("deblur", photo, kernel, "--method", "wiener")
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {photo}: ")
    assert "--method" in outcome.err
    assert not (tmp_path / "a.deshaken.png").exists()


def test_says_the_iterations_when_asked(deshake, shaken, kernel):
    assert (
        "deblurred in 3 iterations"
        in deshake("-v", "deblur", shaken("a.jpg"), kernel, "--iterations", 3).err
    )


@pytest.mark.parametrize("method", ["sparse", "rl"])
def test_threads_do_not_change_a_byte(deshake, shaken, kernel, tmp_path, method):
    photo, results = shaken("a.png", 16), set()
    for threads in (1, 3):
        args = ("--overwrite", "--method", method, "--threads", threads)
        assert deshake("deblur", photo, kernel, *args).code == 0
        results.add((tmp_path / "a.deshaken.png").read_bytes())
    assert len(results) == 1


def test_the_kernel_comes_from_standard_input_too(deshake, shaken, kernel, tmp_path):
    photo, other = shaken("a.png"), tmp_path / "other.png"
    assert deshake("deblur", photo, kernel, "--iterations", 2).code == 0
    args = ["deblur", photo, "-", "--iterations", "2", "-o", other]
    subprocess.run([sys.executable, "-m", "deshake", *args], input=kernel.read_bytes(), check=True)
    assert other.read_bytes() == (tmp_path / "a.deshaken.png").read_bytes()


def test_photos_do_not_go_to_standard_output(deshake, shaken, kernel):
    outcome = deshake("deblur", shaken("a.jpg"), kernel, "-o", "-")
    assert outcome.code == 2
    assert "standard output" in outcome.err


def test_the_kernel_is_never_the_output(deshake, shaken, kernel):
    before = kernel.read_bytes()
    outcome = deshake("deblur", shaken("a.jpg"), kernel, "-o", kernel, "--overwrite")
    assert outcome.code == 1
    assert "never touches" in outcome.err
    assert kernel.read_bytes() == before


def test_another_ending_is_another_format(deshake, shaken, kernel, tmp_path):
    out = tmp_path / "out.tif"
    assert deshake("deblur", shaken("a.jpg"), kernel, "-o", out, "--iterations", 1).code == 0
    with Image.open(out) as image:
        assert image.format == "TIFF"
    for name, what in (("out.bmp", "no photo format ends in '.bmp'"), ("out", "no ending")):
        outcome = deshake("deblur", shaken("a.jpg"), kernel, "-o", tmp_path / name)
        assert outcome.code == 1
        assert what in outcome.err


def test_what_a_format_cannot_hold_is_reported_before_the_work(deshake, kernel, tmp_path):
    photo = tmp_path / "a.png"
    Image.new("RGBA", (100, 80), (9, 99, 9, 99)).save(photo)
    outcome = deshake("-v", "deblur", photo, kernel, "-o", tmp_path / "a.jpg")
    assert outcome.code == 1
    assert "a JPEG cannot hold transparency" in outcome.err
    assert "iterations" not in outcome.err


@pytest.fixture
def pair(kernel, tmp_path):
    """A blurred photo, a noisy one of the same scene and their registration."""
    blurred, noisy = tmp_path / "a.png", tmp_path / "noisy.png"
    turn = read_kernel(kernel).kernel
    blocks = np.random.default_rng(5).random((9, 11, 3), np.float32)
    scene = decode(np.rint(255 * blocks).astype(np.uint8).repeat(10, 0).repeat(10, 1), Srgb())
    light = Warps(turn.camera, turn.theta, margin=5).blur(scene, turn.weights)
    sharp = scene[5:-5, 5:-5]
    noise = np.random.default_rng(6).normal(0, 0.05, sharp.shape)
    for path, seen in ((tmp_path / "sharp.png", sharp), (noisy, sharp + noise), (blurred, light)):
        Image.fromarray(encode(seen.clip(0, 1).astype(np.float32), Srgb(), 8)).save(path)
    registration = tmp_path / "r.npz"
    write_registration(
        registration, RegistrationFile(np.zeros(3), 1.0, Camera.from_focal(120, 80, 100))
    )
    return blurred, noisy, registration


def test_a_noisy_photo_helps(deshake, pair, kernel, tmp_path):
    blurred, noisy, registration = pair
    results = {}
    for args in ((), ("--method=fusion",), ("--method=residual",), ("--quality=fast",)):
        options = ("--noisy", noisy, "--registration", registration, "--overwrite", *args)
        outcome = deshake("deblur", blurred, kernel, *options)
        assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
        results[args] = (tmp_path / "a.deshaken.png").read_bytes()
    assert results[()] == results[("--method=fusion",)]
    assert len(set(results.values())) == 3
    result, *others = (
        np.square(
            cv2.imread(str(path)) - cv2.imread(str(tmp_path / "sharp.png")).astype(float)
        ).mean()
        for path in (tmp_path / "a.deshaken.png", blurred, noisy)
    )
    assert result < 0.7 * min(others)


def test_a_registration_of_its_own_is_recorded_and_compared(deshake, pair, kernel, tmp_path):
    blurred, noisy, registration = pair
    out = tmp_path / "out.png"
    args = (blurred, kernel, "--noisy", noisy, "-o", out, "--iterations", 1)
    given = ("--registration", registration)
    assert deshake("deblur", *args, *given).code == 0
    recorded = read_provenance(out)["registration"]
    assert recorded == {"theta": [0, 0, 0], "scale": 1, "confidence": 1}
    assert "another" not in deshake("deblur", *args, *given, "--skip-existing").err
    assert "with another registration" in deshake("deblur", *args, "--skip-existing").err


@pytest.mark.parametrize(
    ("args", "what"),
    [
        (("--method", "fusion"), "needs --noisy"),
        (("--method", "residual"), "needs --noisy"),
        (("--registration", "r.npz"), "needs --noisy"),
        (("--noisy", "n.png", "--method", "rl"), "does not go with --method rl"),
        (("--noisy", "n.png", "--method", "residual", "--quality", "high"), "does not go with"),
    ],
)
def test_methods_go_with_the_photos_they_need(deshake, shaken, kernel, args, what):
    outcome = deshake("deblur", shaken("a.png"), kernel, *args)
    assert outcome.code == 2
    assert what in outcome.err


def test_light_beyond_white_stays_in_a_floating_point_tiff(deshake, kernel, tmp_path):
    y, x = np.mgrid[:80, :100]
    light = (4 + 3 * np.sin(x / 5) * np.cos(y / 7)).astype(np.float32)
    path, png = tmp_path / "a.tif", tmp_path / "out.png"
    tifffile.imwrite(path, np.stack([light] * 3, -1), photometric="rgb", metadata=None)
    outcome = deshake("deblur", path, kernel)
    assert (outcome.code, outcome.err) == (0, "")
    result = tifffile.imread(tmp_path / "a.deshaken.tif")
    assert result.dtype == np.float32
    assert 6.5 < result.max() < 8
    outcome = deshake("deblur", path, kernel, "-o", png)
    assert "warning: " in outcome.err
    assert "beyond white is cut off" in outcome.err
