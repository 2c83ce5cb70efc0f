"""RAW files through the commands: the sensor's light in, TIFF, PNG or JPEG out."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image
from skimage import data

from deshake.files.kernel_file import KernelFile, read_kernel, write_kernel
from deshake.formats.photo import read_photo
from deshake.formats.transfer import SRGB
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.warps import Warps

EXIF = {0x920A: ("r", [35.0]), 0xA405: ("H", [46]), 0x829A: ("r", [0.5])}
QUIET = ("--threads", 1, "-q")
QUICK = ("--quality", "fast")
UNIFORM = ("--uniform",)


@pytest.fixture
def scene():
    """A picture of 140 x 100 in linear sRGB, seen by f = 150 px through a turn about Y."""
    camera, margin = Camera.from_focal(150.0, 100, 140), 15
    photo = cv2.resize(data.astronaut()[:370], (170, 130), interpolation=cv2.INTER_AREA)
    sharp = 0.9 * SRGB.to_linear(photo / 255).astype(np.float32)
    path = np.linspace([0, -2.5, 0], [0, 2.5, 0], 20) * grid_steps(camera)
    blurred = Warps(camera, path, margin=margin).blur(sharp, np.full(20, 1 / 20))
    turned = Warps(camera, np.array([[2, -2, 1]]) * grid_steps(camera), margin=margin)
    return sharp[margin:-margin, margin:-margin], blurred, turned.blur(sharp, [1.0])


@pytest.fixture
def raw(tmp_path, make_dng, scene):
    path = tmp_path / "a.dng"
    path.write_bytes(make_dng(scene[1], exif=EXIF))
    return path


@pytest.fixture
def kernel(tmp_path):
    """The kernel of the blurred RAW file's own turn."""
    camera = Camera.from_focal(150.0, 100, 140)
    step = grid_steps(camera)[1]
    path = RotationKernel.from_path([(0, -2.5 * step, 0), (0, 2.5 * step, 0)], camera)
    write_kernel(tmp_path / "k.npz", KernelFile(path))
    return tmp_path / "k.npz"


def error(result, truth, margin=10):
    """Root mean square of the difference in display values."""
    inner = slice(margin, -margin)
    want = SRGB.from_linear(np.clip(truth, 0, 1).astype(np.float32))
    return float(np.sqrt(np.mean(np.square((result - want)[inner, inner]))))


def test_the_focal_length_of_a_raw_file(deshake, raw):
    outcome = deshake("calibrate", raw, "--json")
    assert outcome.code == 0
    report = json.loads(outcome.out)
    assert report["focal_px"] == pytest.approx(46 * np.hypot(140, 100) / np.hypot(36, 24), rel=1e-3)
    assert "FocalLengthIn35mmFilm" in report["source"]


def test_deblur_writes_a_16_bit_tiff_beside_it(deshake, raw, kernel, scene, tmp_path):
    before = raw.read_bytes()
    outcome = deshake("deblur", raw, kernel)
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    out = tmp_path / "a.deshaken.tif"
    codes = tifffile.imread(out)
    assert (codes.dtype, codes.shape) == (np.uint16, (100, 140, 3))
    sharp, blurred, _ = scene
    blurred_error = error(SRGB.from_linear(blurred), sharp)
    assert error(codes / 65535, sharp) < 0.7 * blurred_error
    with Image.open(out) as result:
        assert result.info["icc_profile"]
        assert result.getexif().get_ifd(0x8769)[0xA405] == 46
    assert raw.read_bytes() == before
    png, jpeg = tmp_path / "o.png", tmp_path / "o.jpg"
    for path in (png, jpeg):
        assert deshake("deblur", raw, kernel, "-o", path, *QUIET).code == 0
    written = cv2.imread(str(png), cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert np.array_equal(written, codes)
    with Image.open(jpeg) as result:
        assert result.format == "JPEG"
        assert np.abs(np.asarray(result) / 255 - codes / 65535).mean() < 0.01


def test_linear_light_on_request(deshake, raw, kernel, tmp_path):
    plain, linear = tmp_path / "p.tif", tmp_path / "l.tif"
    assert deshake("deblur", raw, kernel, "-o", plain, *QUIET).code == 0
    assert deshake("deblur", raw, kernel, "-o", linear, "--linear", *QUIET).code == 0
    photo = read_photo(linear)
    assert photo.encoding.transfer.name == "linear"
    matrix = np.array(read_photo(raw).encoding.matrix)
    light = np.clip(photo.pixels @ matrix.T, 0, 1)
    assert np.abs(SRGB.from_linear(light) - tifffile.imread(plain) / 65535).max() < 2e-3


def test_fix_gives_the_bytes_of_its_stages(deshake, raw, tmp_path):
    out, kernels = tmp_path / "out.tif", tmp_path / "kernels"
    words = ("--blur-size", 8, "--estimator", "edges")
    args = (*words, *UNIFORM, *QUICK, "--linear", "-o", out, "--keep-kernels", kernels)
    assert deshake("fix", raw, *args, *QUIET).code == 0
    staged, kernel = tmp_path / "staged.tif", tmp_path / "k.npz"
    assert deshake("estimate-blind", raw, *words, *UNIFORM, "-o", kernel, *QUIET).code == 0
    args = ("--linear", *QUICK, "-o", staged)
    assert deshake("deblur", raw, kernel, *args, *QUIET).code == 0
    assert out.read_bytes() == staged.read_bytes()
    assert (kernels / "a.kernel.npz").read_bytes() == kernel.read_bytes()


def test_raw_files_in_a_folder_are_photos(deshake, scene, make_dng, tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "b.DNG").write_bytes(make_dng(scene[0], exif=EXIF))  # the sharp picture
    outcome = deshake(
        "fix", folder, "--blur-size", 4, "--estimator", "edges", *UNIFORM, *QUICK, *QUIET
    )
    assert outcome.code == 0
    assert sorted(path.name for path in folder.iterdir()) == ["b.DNG", "b.deshaken.tif"]


def test_a_pair_of_raw_files(deshake, make_dng, raw, scene, tmp_path):
    sharp, _, turned = scene
    noisy = turned / 4 + 0.004 * np.random.default_rng(0).normal(size=turned.shape)
    balance = {50728: ("r", (0.45, 1, 0.65))}  # the camera had another white balance
    dark = tmp_path / "dark.dng"
    dark.write_bytes(make_dng(noisy, exif=EXIF, extra=balance))
    out = tmp_path / "out.tif"
    lens = ("--focal-px", 150, "--search-angle", 4)
    words = (*lens, "--blur-size", 8, "-o", out, "--json")
    outcome = deshake("fix", raw, "--noisy", dark, *words, *QUIET)
    assert outcome.code == 0
    report = json.loads(outcome.out)
    assert report["scale"] == pytest.approx(4, rel=0.05)
    result = tifffile.imread(out) / 65535
    assert error(result, sharp) < 0.6 * error(SRGB.from_linear(scene[1]), sharp)


def test_a_sharp_raw_file_can_be_shaken(deshake, make_dng, scene, tmp_path):
    raw, out = tmp_path / "a.dng", tmp_path / "shaken.png"
    raw.write_bytes(make_dng(scene[0], exif=EXIF))
    words = ("--blur-size", 6, "-o", out, "--kernel", tmp_path / "true.npz")
    assert deshake("simulate", raw, *words, *QUIET).code == 0
    result = cv2.imread(str(out), cv2.IMREAD_UNCHANGED)
    assert result.dtype == np.uint16
    mean = SRGB.to_linear(result[..., ::-1] / 65535).mean((0, 1))
    assert np.abs(mean / scene[0].mean((0, 1)) - 1).max() < 0.1


def test_a_pair_of_raw_files_is_known_to_be_linear(deshake, make_dng, scene, tmp_path):
    _, blurred, turned = scene
    long, short = tmp_path / "long.dng", tmp_path / "short.dng"
    # so dark and noisy that tones alone could be taken for curves, as in a JPEG they are
    noisy = turned / 12 + 0.012 * np.random.default_rng(0).normal(size=turned.shape)
    long.write_bytes(make_dng(np.sqrt(np.maximum(blurred, 0)), exif=EXIF))
    short.write_bytes(make_dng(noisy, exif=EXIF))
    known, kernel = tmp_path / "r.npz", tmp_path / "k.npz"
    lens = ("--focal-px", 150, "--search-angle", 4)
    assert deshake("register", long, short, *lens, "-o", known, *QUIET).code == 0
    words = ("--registration", known, "--blur-size", 8, *UNIFORM, "-o", kernel)
    outcome = deshake("estimate-pair", long, short, *words, "--json", *QUIET)
    assert outcome.code == 0
    assert not any("tone curves" in note for note in json.loads(outcome.out)["warnings"])
    assert read_kernel(kernel).provenance["tone_curves"] is False
    words = ("--noisy", short, "--registration", known, *QUICK, "-v")
    assert deshake("deblur", long, kernel, *words).code == 0


@pytest.mark.parametrize(
    ("args", "what"),
    [
        (("-o", "out.dng"), "RAW files are read, but not written"),
        (("--transfer", "srgb"), "--transfer is not for RAW files, which are in linear light"),
    ],
)
def test_wrong_use(refused, raw, kernel, args, what):
    args = [raw.with_name(arg) if "." in arg else arg for arg in args]
    assert what in refused("deblur", raw, *args, kernel=kernel)


def test_linear_light_is_for_raw_files(refused, shaken):
    assert "--linear is for RAW files" in refused("deblur", shaken("a.jpg"), "--linear")


@pytest.mark.parametrize("keep", [20, 300, 5000])
def test_a_raw_file_cut_short(refused, raw, kernel, keep):
    raw.write_bytes(raw.read_bytes()[:keep])
    for command in ("calibrate", "deblur", "fix"):
        refused(command, raw, kernel=kernel)
