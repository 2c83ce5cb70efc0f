"""HEIC, AVIF and JPEG 2000 through the commands."""

from __future__ import annotations

import io
import json

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image
from support.heic_writer import heic

from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel

QUIET = ("--threads", 1, "-q")


def texture(height, width, depth=8):
    rng = np.random.default_rng(5)
    rough = rng.random((height // 8, width // 8, 3)).astype(np.float32)
    smooth = cv2.resize(rough, (width // 2, height // 2), interpolation=cv2.INTER_CUBIC)
    squares = np.clip(0.5 + 2 * (smooth - 0.5), 0.05, 0.95)
    codes = np.rint(squares * ((1 << depth) - 1)).astype(int)
    return np.kron(codes, np.ones((2, 2, 1), int))


@pytest.fixture
def kernel(tmp_path):
    def write(height, width):
        path = tmp_path / "k.npz"
        turn = RotationKernel.from_path(
            [(-0.01, -0.01, 0), (0.01, 0.01, 0)], Camera.from_focal(120, height, width)
        )
        write_kernel(path, KernelFile(turn))
        return path

    return write


def exif_block():
    exif = Image.Exif()
    exif[271], exif[274] = "a telephone", 6
    exif._ifds[0x8769] = {0xA405: 26}
    return exif.tobytes().removeprefix(b"Exif\0\0")


def test_a_heic_becomes_a_jpeg_and_says_so(deshake, tmp_path, kernel):
    path = tmp_path / "a.heic"
    path.write_bytes(heic(texture(48, 64), exif=exif_block(), turns=3))
    outcome = deshake("calibrate", path, "--json")
    assert "FocalLengthIn35mmFilm" in json.loads(outcome.out)["source"]
    outcome = deshake("deblur", path, kernel(64, 48), "--iterations", 1)
    assert outcome.code == 0
    assert outcome.err == (
        f"warning: {path}: a HEIC, written as a JPEG of quality 95 (-o NAME.tif loses nothing)\n"
    )
    with Image.open(tmp_path / "a.deshaken.jpg") as image:
        assert (image.format, image.size) == ("JPEG", (48, 64))
        assert image.getexif()[271] == "a telephone"
        assert image.getexif()[274] == 1


def test_ten_bits_of_a_heic_go_to_a_tiff(deshake, tmp_path, kernel):
    path, out = tmp_path / "a.hif", tmp_path / "out.tif"
    path.write_bytes(heic(texture(48, 64, 10), depth=10))
    outcome = deshake("deblur", path, kernel(48, 64), "-o", out, "--iterations", 1)
    assert (outcome.code, outcome.err) == (0, "")
    codes = tifffile.imread(out)
    assert codes.dtype == np.uint16
    assert len(np.unique(codes & 0xFF)) > 100  # not eight bits in disguise


@pytest.mark.parametrize("suffix", [".avif", ".jp2"])
def test_others_keep_their_format(deshake, tmp_path, kernel, suffix):
    path = tmp_path / f"a{suffix}"
    stream = io.BytesIO()
    form = {".avif": "AVIF", ".jp2": "JPEG2000"}[suffix]
    Image.fromarray(texture(64, 80).astype(np.uint8)).save(stream, form)
    path.write_bytes(stream.getvalue())
    assert deshake("deblur", path, kernel(64, 80), "--iterations", 1, *QUIET).code == 0
    with Image.open(tmp_path / f"a.deshaken{suffix}") as image:
        assert (image.format, image.size) == (form, (80, 64))


def test_a_ten_bit_avif_stays_one(deshake, tmp_path, kernel):
    path = tmp_path / "a.avif"
    codes = texture(64, 80, 10).astype(np.uint16)
    options = [cv2.IMWRITE_AVIF_DEPTH, 10, cv2.IMWRITE_AVIF_QUALITY, 100]
    path.write_bytes(cv2.imencode(".avif", codes, options)[1].tobytes())
    assert deshake("deblur", path, kernel(64, 80), "--iterations", 1, *QUIET).code == 0
    result = cv2.imread(str(tmp_path / "a.deshaken.avif"), cv2.IMREAD_UNCHANGED)
    assert result.dtype == np.uint16
    assert 256 < result.max() < 1024


@pytest.mark.parametrize("suffix", [".heic", ".avif", ".jp2"])
@pytest.mark.parametrize("command", ["calibrate", "deblur", "fix"])
def test_what_is_cut_short(refused, tmp_path, command, suffix):
    path = tmp_path / f"a{suffix}"
    if suffix == ".heic":
        data = heic(texture(48, 64))
    else:
        stream = io.BytesIO()
        form = {".avif": "AVIF", ".jp2": "JPEG2000"}[suffix]
        Image.fromarray(texture(64, 80).astype(np.uint8)).save(stream, form)
        data = stream.getvalue()
    path.write_bytes(data[: len(data) * 2 // 3])
    assert "damaged or cut short" in refused(command, path)


def test_a_heic_cannot_be_written(refused, shaken):
    photo = shaken("a.jpg")
    error = refused("deblur", photo, "-o", photo.with_suffix(".heic"))
    assert error.endswith("HEIF files are read, but not written")
