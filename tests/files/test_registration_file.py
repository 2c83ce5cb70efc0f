from __future__ import annotations

import io
import pickle
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deshake.errors import KernelFileError, OutputError
from deshake.files.registration_file import RegistrationFile, read_registration, write_registration
from deshake.geometry.camera import Camera

CAMERA = Camera.from_focal(1200.0, 600, 800)


def content() -> RegistrationFile:
    return RegistrationFile(np.array([0.01, -0.02, 1.5]), 7.5, CAMERA, 0.75, {"options": {"a": 1}})


def keys(**changes: Any) -> dict[str, Any]:
    """Return the keys of a good registration file, as a user would make them with numpy alone."""
    good = {
        "format": 1,
        "theta": np.array([0.01, -0.02, 1.5]),
        "scale": 7.5,
        "camera_matrix": np.array([[1200, 0, 399.5], [0, 1200, 299.5], [0, 0, 1]]),
        "image_size": np.array([600, 800]),
        "distortion": np.zeros(0),
        "confidence": 0.75,
        "provenance": "{}",
    }
    return {key: value for key, value in (good | changes).items() if value is not None}


def savez(path: Path, **changes: Any) -> Path:
    np.savez(path, **keys(**changes))
    return path


def test_a_registration_survives_writing_and_reading(tmp_path: Path) -> None:
    path, again = tmp_path / "r.npz", tmp_path / "again.npz"
    write_registration(path, content())
    read = read_registration(path)
    assert np.array_equal(read.theta, content().theta)
    assert np.array_equal(read.camera.matrix, CAMERA.matrix)
    assert read.camera.shape == (600, 800)
    assert (read.scale, read.confidence) == (7.5, 0.75)
    assert read.provenance == {"options": {"a": 1}}
    write_registration(again, read)
    assert again.read_bytes() == path.read_bytes()


def test_numpy_alone_reads_and_writes_them(tmp_path: Path) -> None:
    read = read_registration(savez(tmp_path / "r.npz", mine=np.zeros(3)))
    write_registration(tmp_path / "out.npz", read)
    with np.load(tmp_path / "out.npz", allow_pickle=False) as file:
        assert sorted(file) == sorted(keys())
        for key, value in keys().items():
            assert np.array_equal(file[key], value)


BAD: list[tuple[dict[str, Any], str]] = [
    *[({key: None}, f"'{key}' is missing") for key in keys()],
    ({"format": 2}, "its format is 2; this version of deshake reads 1"),
    ({"theta": np.zeros((1, 3))}, "'theta' has shape"),
    ({"theta": np.zeros(3, np.float32)}, "'theta' is float32"),
    ({"theta": np.array([0, np.nan, 0])}, "'theta' is not finite"),
    ({"theta": np.array([3.0, 3, 3])}, "more than pi"),
    ({"theta": np.array([1e300, 0, 0])}, "more than pi"),
    ({"theta": np.zeros(3, object)}, "Python objects"),
    ({"scale": 0.0}, "'scale' is 0"),
    ({"scale": -2.0}, "'scale' is -2"),
    ({"scale": 1e9}, "'scale' is 1e"),
    ({"scale": np.inf}, "'scale' is not finite"),
    ({"scale": np.ones(2)}, "'scale' has shape"),
    ({"confidence": 1.01}, "between 0 and 1"),
    ({"confidence": np.nan}, "'confidence' is not finite"),
    ({"camera_matrix": np.eye(3)}, "absurd focal length"),
    ({"image_size": np.array([0, 8])}, "'image_size' is 0 x 8"),
    ({"provenance": "{"}, "is not JSON"),
    ({"provenance": 5}, "'provenance' is int64, not text"),
]


@pytest.mark.parametrize(("changes", "match"), BAD, ids=lambda value: str(value)[:40])
def test_anything_wrong_is_one_line_that_names_the_file_and_the_fault(
    tmp_path: Path, changes: dict[str, Any], match: str
) -> None:
    path = savez(tmp_path / "r.npz", **changes)
    with pytest.raises(KernelFileError, match=match) as caught:
        read_registration(path)
    assert str(caught.value).startswith(f"{path}: no usable registration file: ")
    assert "\n" not in str(caught.value)
    assert caught.value.hint is not None


def test_files_that_are_no_npz_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "r.npz"
    good = savez(tmp_path / "good.npz").read_bytes()
    for data in (b"", pickle.dumps({"theta": 1}), b"text", good[:-1]):
        path.write_bytes(data)
        with pytest.raises(KernelFileError, match="no usable registration file"):
            read_registration(path)
    with pytest.raises(KernelFileError, match="no such file"):
        read_registration(tmp_path / "none.npz")


def test_a_billion_angles_cost_nothing(tmp_path: Path) -> None:
    path = savez(tmp_path / "r.npz", theta=None)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        head = io.BytesIO()
        shape = {"descr": "<f8", "fortran_order": False, "shape": (10**9,)}
        np.lib.format.write_array_header_1_0(head, shape)
        archive.writestr("theta.npy", head.getvalue() + bytes(10**6))
    begun = time.process_time()
    with pytest.raises(KernelFileError, match="'theta'"):
        read_registration(path)
    assert time.process_time() - begun < 3


def test_overwriting_must_be_allowed(tmp_path: Path) -> None:
    path = savez(tmp_path / "r.npz")
    with pytest.raises(OutputError, match="exists already"):
        write_registration(path, content())
    write_registration(path, content(), overwrite=True)
    assert read_registration(path).provenance == content().provenance


def test_streams_carry_the_same_bytes(tmp_path: Path) -> None:
    path = tmp_path / "r.npz"
    write_registration(path, content())
    code = (
        "from deshake.files.registration_file import read_registration, write_registration\n"
        "write_registration('-', read_registration('-'))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=path.read_bytes(),
        capture_output=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    assert done.stdout == path.read_bytes()


def test_the_documented_keys_are_the_ones_written(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "kernel-files.md").read_text("utf-8")
    section = text.split("## Registration files")[1].split("\n## ")[0]
    documented = {line.split("`")[1] for line in section.splitlines() if line.startswith("| `")}
    write_registration(tmp_path / "r.npz", content())
    with np.load(tmp_path / "r.npz") as file:
        assert set(file) == documented
