"""Files that are no kernels are refused in one line, at once, and with little memory."""

from __future__ import annotations

import io
import os
import pickle
import subprocess
import sys
import time
import zipfile

import numpy as np
import pytest
from PIL import Image


def arrays(**changes):
    """The arrays of a good kernel file, with changes; None takes one out."""
    good = {
        "format": np.int64(1),
        "theta": np.zeros((2, 3)),
        "weights": np.full(2, 0.5),
        "steps": np.full(3, 0.01),
        "camera_matrix": np.array([[120.0, 0, 49.5], [0, 120, 39.5], [0, 0, 1]]),
        "image_size": np.array([80, 100]),
        "distortion": np.zeros(0),
        "confidence": np.float64(1),
        "provenance": np.array("{}"),
    }
    return {key: value for key, value in (good | changes).items() if value is not None}


def npz(**changes):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays(**changes))
    return stream.getvalue()


def huge():
    """A file that says it holds 10^9 weights, which take some kilobytes."""
    stream = io.BytesIO(npz(weights=None))
    with zipfile.ZipFile(stream, "a", zipfile.ZIP_DEFLATED) as archive:
        head = io.BytesIO()
        shape = {"descr": "<f8", "fortran_order": False, "shape": (10**9,)}
        np.lib.format.write_array_header_1_0(head, shape)
        archive.writestr("weights.npy", head.getvalue() + bytes(10**6))
    return stream.getvalue()


def pickled():
    stream = io.BytesIO(npz(weights=None))
    with zipfile.ZipFile(stream, "a") as archive:
        inner = io.BytesIO()
        np.save(inner, np.array([{"a": 1}], dtype=object), allow_pickle=True)
        archive.writestr("weights.npy", inner.getvalue())
    return stream.getvalue()


def unclosed():
    """A file in which the header of an array has a bracket that does not close."""
    stream = io.BytesIO(npz(weights=None))
    with zipfile.ZipFile(stream, "a") as archive:
        inner = io.BytesIO()
        np.save(inner, np.full(2, 0.5))
        archive.writestr("weights.npy", inner.getvalue().replace(b"(2,)", b"((2,"))
    return stream.getvalue()


KERNELS = {
    "no theta": (lambda: npz(theta=None), "'theta'"),
    "no format": (lambda: npz(format=None), "'format'"),
    "flat theta": (lambda: npz(theta=np.zeros(6)), "'theta'"),
    "one weight": (lambda: npz(weights=np.ones(1)), "2 rotations in 'theta', 1 in 'weights'"),
    "no weights": (lambda: npz(theta=np.zeros((0, 3)), weights=np.zeros(0)), "0 rotations"),
    "nan": (lambda: npz(weights=np.array([np.nan, 1])), "'weights' is not finite"),
    "nan angle": (lambda: npz(theta=np.full((2, 3), np.nan)), "'theta' is not finite"),
    "negative": (lambda: npz(weights=np.array([-0.5, 1.5])), "negative weight"),
    "sum": (lambda: npz(weights=np.array([0.5, 0.6])), "sum to 1.1, not 1"),
    "version": (lambda: npz(format=np.int64(2)), "its format is 2"),
    "truncated": (lambda: npz()[:-30], ""),
    "pickle": (lambda: pickle.dumps({"weights": [1.0]}), ""),
    "pickle within": (pickled, "'weights'"),
    "huge": (huge, "'weights'"),
    "unclosed": (unclosed, "is damaged"),
    "empty": (bytes, ""),
    "text": (lambda: b"half of it here, half of it there\n", ""),
    "wide": (
        lambda: npz(theta=np.array([[0, -1.5, 0], [0, 1.5, 0]])),
        "wider than half of the frame",
    ),
    "photo": (lambda: b"\xff\xd8\xff\xe0 and so on", ""),
}
"""Files that are no kernels, and their errors."""


@pytest.mark.parametrize("name", KERNELS)
def test_what_is_no_kernel(refused, shaken, tmp_path, name):
    make, what = KERNELS[name]
    path = tmp_path / "k.npz"
    path.write_bytes(make())
    photo = shaken("a.jpg")
    start = time.process_time()
    error = refused("deblur", photo, "-o", tmp_path / "out.jpg", kernel=path)
    assert time.process_time() - start < 3
    assert error.startswith(f"error: {path}: ")
    assert what in error


def test_a_good_kernel_like_those_is_taken(deshake, shaken, tmp_path):
    path = tmp_path / "k.npz"
    path.write_bytes(npz())
    assert deshake("deblur", shaken("a.jpg"), path, "--iterations", 1).code == 0


def test_a_kernel_that_is_a_folder_or_missing(deshake, shaken, tmp_path):
    for path, named in ((tmp_path, tmp_path / "a.kernel.npz"), (tmp_path / "k", tmp_path / "k")):
        outcome = deshake("deblur", shaken("a.jpg"), path)
        assert outcome.code == 1
        assert outcome.err.startswith(f"error: {named}: no such file\n")


@pytest.mark.skipif(os.name == "nt", reason="needs RLIMIT_AS")
def test_a_huge_kernel_eats_no_memory(shaken, tmp_path):
    path = tmp_path / "k.npz"
    path.write_bytes(huge())
    code = (
        "import resource, sys, time\n"
        "import deshake.stages.fixing\n"
        "from deshake.cli.main import main\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "start = time.process_time()\n"
        f"code = main(['deblur', {str(shaken('a.jpg'))!r}, {str(path)!r}])\n"
        "grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before\n"
        "print(code, grown, time.process_time() - start)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    code, grown, took = done.stdout.split()
    assert int(code) == 1
    assert int(grown) < 100_000 * (1024 if sys.platform == "darwin" else 1)
    assert float(took) < 3


def test_a_photo_that_is_stored_turned_is_reported(deshake, shaken, pan, tmp_path):
    photo, mask = shaken("a.jpg"), tmp_path / "mask.png"
    with Image.open(photo) as picture:
        turned = picture.getexif()
        turned[274] = 6
        picture.save(photo, exif=turned)
        Image.new("L", picture.size).save(mask)
    upright = f"{photo} has 80 x 100 pixels upright (it is stored turned)"
    kernel = deshake("deblur", photo, pan)
    assert kernel.code == 1
    assert f"the kernel is for pictures of 100 x 80 pixels, and {upright}\n" in kernel.err
    assert "hint: photos count upright: make the kernel from the photo as it is now" in kernel.err
    masked = deshake("fix", photo, "--mask", mask)
    assert masked.code == 1
    assert f"the mask has 100 x 80 pixels, and {upright}\n" in masked.err
    region = deshake("estimate-blind", photo, "--region", "0,0,100,80")
    assert "beyond its 80 x 100 pixels upright (it is stored turned)\n" in region.err
