"""The commands find the tones that a blur suits; a stated transfer curve decides itself."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.warps import Warps

pytestmark = pytest.mark.long

SAYS = "the blur suits display values"


def written(folder, values):
    """Write a shaken photo, with `values` of its light, and its kernel; return the sharp one."""
    camera, margin = Camera.from_focal(400.0, 300, 400), 20
    path = np.array([[0.0, -8, -3], [3, -2, 0], [-1, 3, 1], [2, 9, 3]]) * grid_steps(camera)
    kernel = RotationKernel.from_path(path, camera).centred()
    scene = cv2.resize(data.coffee(), (440, 340), interpolation=cv2.INTER_AREA)[..., ::-1]
    sharp = ((scene / 255) ** 1.5).astype(np.float32)
    blurred = Warps(camera, kernel.theta, margin=margin).blur(sharp, kernel.weights)
    grain = np.random.default_rng(0).normal(0, 0.003, blurred.shape)
    codes = np.rint(255 * values(np.clip(blurred + grain, 0, 1))).astype(np.uint8)
    cv2.imwrite(str(folder / "a.png"), codes)
    write_kernel(folder / "k.npz", KernelFile(kernel))
    inner = sharp[margin:-margin, margin:-margin]
    return folder / "a.png", folder / "k.npz", np.rint(255 * values(inner))


@pytest.fixture
def linear(tmp_path):
    """A photo whose values stand for light, which its file does not say, and its kernel."""
    return written(tmp_path, np.asarray)


@pytest.fixture
def toned(tmp_path):
    """A photo to which a camera applied a tone curve, and its kernel.

    The curve is not the one that deshake assumes: it is steeper, and brightens less.
    """

    def values(light):
        shown = light ** (0.95 / 2.2)
        return 0.3 * shown + 0.7 * shown**2 * (3 - 2 * shown)

    return written(tmp_path, values)


def error(path, sharp):
    difference = cv2.imread(str(path)).astype(float) - sharp
    return float(np.sqrt(np.square(difference[20:-20, 20:-20]).mean()))


def test_deblur_finds_that_the_values_of_a_file_are_light(deshake, linear, tmp_path):
    photo, kernel, sharp = linear
    errors = {}
    for name, way, found in (
        ("own", (), True),
        ("light", ("--transfer", "srgb"), False),
        ("values", ("--transfer", "linear"), False),
    ):
        out = tmp_path / f"{name}.png"
        result = deshake("-v", "deblur", photo, kernel, "-o", out, *way)
        assert result.code == 0, result.err
        assert (SAYS in result.err) == found
        errors[name] = error(out, sharp)
    assert errors["own"] == pytest.approx(errors["values"], rel=0.01)
    assert errors["own"] < 0.95 * errors["light"]
    assert errors["own"] < 0.6 * error(photo, sharp)


def test_deblur_undoes_the_tone_curve_of_a_camera(deshake, toned, tmp_path):
    photo, kernel, sharp = toned
    errors = {}
    for name, way in (("own", ()), ("light", ("--transfer", "srgb"))):
        out = tmp_path / f"{name}.png"
        result = deshake("-v", "deblur", photo, kernel, "-o", out, *way)
        assert result.code == 0, result.err
        assert ("the blur suits light before a tone curve" in result.err) == (name == "own")
        errors[name] = error(out, sharp)
    assert errors["own"] < 0.9 * errors["light"]
    assert errors["own"] < 0.6 * error(photo, sharp)


def test_fix_estimates_and_deblurs_in_display_values(deshake, linear, tmp_path):
    photo, _, sharp = linear
    out = tmp_path / "out.png"
    kept = tmp_path / "kernels"
    by = ("--focal-px", 400, "--keep-kernels", kept)
    result = deshake("-v", "fix", photo, "-o", out, *by)
    assert result.code == 0, result.err
    assert SAYS in result.err
    with np.load(kept / "a.kernel.npz") as file:
        assert '"tones": "display values"' in str(file["provenance"])
    assert error(out, sharp) < 0.8 * error(photo, sharp)
