from __future__ import annotations

import io
import json
import pickle
import resource
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deshake.errors import KernelFileError, OutputError
from deshake.files.kernel_file import (
    CameraFile,
    KernelFile,
    read_camera,
    read_kernel,
    write_camera,
    write_kernel,
)
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel

CAMERA = Camera.from_focal(1200.0, 600, 800)
PATH = np.linspace([0, 0, 0], [0.004, -0.003, 0.01], 9)


def content() -> KernelFile:
    camera = CAMERA.with_lens(np.full(4, 0.01))
    kernel = RotationKernel.from_path(PATH, camera)
    return KernelFile(kernel, 0.75, {"version": "0.1", "options": {"seed": 3}})


def keys(**changes: Any) -> dict[str, Any]:
    """Return the keys of a good kernel file, as a user would make them with numpy alone."""
    good = {
        "format": 1,
        "theta": np.array([[0, 0, 0], [0, 0, 0.01]]),
        "weights": np.array([0.25, 0.75]),
        "steps": np.full(3, 0.001),
        "camera_matrix": np.array([[1200, 0, 399.5], [0, 1200, 299.5], [0, 0, 1]]),
        "image_size": np.array([600, 800]),
        "distortion": np.zeros(0),
        "confidence": 1.0,
        "provenance": "{}",
    }
    return {key: value for key, value in (good | changes).items() if value is not None}


def savez(path: Path, **changes: Any) -> Path:
    np.savez(path, **keys(**changes))
    return path


def test_a_kernel_survives_writing_and_reading(tmp_path: Path) -> None:
    path, again = tmp_path / "kernel.npz", tmp_path / "again.npz"
    write_kernel(path, content())
    read = read_kernel(path)
    for name in ("theta", "weights", "steps"):
        assert np.array_equal(getattr(read.kernel, name), getattr(content().kernel, name))
    assert np.array_equal(read.kernel.camera.matrix, CAMERA.matrix)
    assert read.kernel.camera.shape == (600, 800)
    assert (read.confidence, read.provenance) == (0.75, content().provenance)
    assert read.kernel.camera.distortion.tolist() == [0.01] * 4
    write_kernel(again, read)
    assert again.read_bytes() == path.read_bytes()


def test_a_camera_survives_writing_and_reading(tmp_path: Path) -> None:
    path = tmp_path / "camera.npz"
    write_camera(path, CameraFile(CAMERA, "EXIF FocalLengthIn35mmFilm = 35 mm"))
    read = read_camera(path)
    assert np.array_equal(read.camera.matrix, CAMERA.matrix)
    assert read.camera.shape == CAMERA.shape
    assert read.source == "EXIF FocalLengthIn35mmFilm = 35 mm"
    assert read.camera.distortion.shape == (0,)
    with pytest.raises(KernelFileError, match="'theta' is missing"):
        read_kernel(path)
    write_kernel(tmp_path / "kernel.npz", content())
    with pytest.raises(KernelFileError, match="'source' is missing"):
        read_camera(tmp_path / "kernel.npz")


def test_the_cameras_of_uniform_blur_and_of_crops_are_kept(tmp_path: Path) -> None:
    crop = CAMERA.cropped(700, 500, 64, 64)
    for name, camera in (("uniform", Camera.uniform(600, 800)), ("crop", crop)):
        write_kernel(tmp_path / name, KernelFile(RotationKernel.delta(camera)))
        read = read_kernel(tmp_path / name).kernel.camera
        assert np.array_equal(read.matrix, camera.matrix)


def test_numpy_alone_reads_and_writes_them(tmp_path: Path) -> None:
    read = read_kernel(savez(tmp_path / "kernel.npz", mine=np.zeros(3)))
    assert read.kernel.weights.tolist() == [0.25, 0.75]
    write_kernel(tmp_path / "out.npz", read)
    with np.load(tmp_path / "out.npz", allow_pickle=False) as file:
        assert sorted(file) == sorted(keys())
        for key, value in keys().items():
            assert np.array_equal(file[key], value)
            assert file[key].dtype.kind == np.asarray(value).dtype.kind


def test_overwriting_must_be_allowed(tmp_path: Path) -> None:
    path = savez(tmp_path / "kernel.npz")
    with pytest.raises(OutputError, match="exists already"):
        write_kernel(path, content())
    write_kernel(path, content(), overwrite=True)
    assert read_kernel(path).confidence == 0.75


def test_weights_are_scaled_to_sum_to_one(tmp_path: Path) -> None:
    weights = np.array([0.25, 0.75]) * (1 + 5e-7)
    read = read_kernel(savez(tmp_path / "kernel.npz", weights=weights)).kernel
    assert read.weights.sum() == pytest.approx(1, abs=1e-15)


BAD: list[tuple[dict[str, Any], str]] = [
    *[({key: None}, f"'{key}' is missing") for key in keys()],
    ({"format": 2}, "its format is 2; this version of deshake reads 1"),
    ({"format": 1.0}, "'format' is float64"),
    ({"theta": np.zeros((3, 3))}, "3 rotations in 'theta', 2 in 'weights'"),
    ({"theta": np.zeros((2, 2))}, "'theta' has shape"),
    ({"theta": np.zeros((0, 3)), "weights": np.zeros(0)}, "0 rotations"),
    ({"theta": np.array([[0, 0, 0], [0, 0, 3.2]])}, "more than pi"),
    ({"theta": np.array([[0, 0, 0], [3.0, 3, 3]])}, "more than pi"),
    ({"theta": np.array([[0, 0, 0], [1e300, 0, 0]])}, "more than pi"),
    ({"theta": np.full((2, 3), np.nan)}, "'theta' is not finite"),
    ({"theta": np.zeros((2, 3), object)}, "Python objects"),
    ({"weights": np.array([np.nan, 1])}, "'weights' is not finite"),
    ({"weights": np.array([np.inf, 1])}, "'weights' is not finite"),
    ({"weights": np.array([-0.5, 1.5])}, "negative weight"),
    ({"weights": np.array([0.5, 0.6])}, "sum to 1.1, not 1"),
    ({"weights": np.array([1e308, 1e308])}, "sum to inf"),
    ({"weights": np.zeros(2)}, "sum to 0"),
    ({"steps": np.array([0, 1e-3, 1e-3])}, "'steps' are not all"),
    ({"steps": np.array([4, 1e-3, 1e-3])}, "'steps' are not all"),
    ({"camera_matrix": np.eye(4)}, "'camera_matrix' has shape"),
    ({"camera_matrix": np.zeros((3, 3))}, "not of the form"),
    ({"camera_matrix": np.full((3, 3), np.nan)}, "not of the form"),
    ({"camera_matrix": np.diag([-1200.0, 1200, 1])}, "absurd focal length"),
    ({"camera_matrix": np.diag([1e-9, 1e-9, 1])}, "absurd focal length"),
    ({"camera_matrix": np.diag([1e12, 1e12, 1])}, "absurd focal length"),
    ({"camera_matrix": np.array([[1200, 0, 1e9], [0, 1200, 0], [0, 0, 1.0]])}, "principal point"),
    ({"image_size": np.array([0, 800])}, "'image_size' is 0 x 800"),
    ({"image_size": np.array([600, 10**12])}, "'image_size' is"),
    ({"image_size": np.array([600, 800, 3])}, "'image_size' has shape"),
    ({"distortion": np.zeros(3)}, "'distortion' is not"),
    ({"distortion": np.full(4, np.inf)}, "'distortion' is not"),
    ({"confidence": np.nan}, "'confidence' is not finite"),
    ({"confidence": 1.5}, "between 0 and 1"),
    ({"provenance": "[]"}, "not a JSON object"),
    ({"provenance": "{"}, "is not JSON"),
    ({"provenance": '{"a": NaN}'}, "is not JSON"),
    ({"provenance": '{"a":' * 200_000}, "is not JSON"),
    ({"provenance": '{"a": ' + "1" * 100_000 + "}"}, "is not JSON"),
    ({"provenance": 5}, "'provenance' is int64, not text"),
]


@pytest.mark.parametrize(("changes", "match"), BAD, ids=lambda value: str(value)[:40])
def test_anything_wrong_is_one_line_that_names_the_file_and_the_fault(
    tmp_path: Path, changes: dict[str, Any], match: str
) -> None:
    path = savez(tmp_path / "kernel.npz", **changes)
    begun = time.process_time()
    with pytest.raises(KernelFileError, match=match) as caught:
        read_kernel(path)
    assert time.process_time() - begun < 3
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert caught.value.hint is not None


def test_text_that_is_no_text(tmp_path: Path) -> None:
    stream = io.BytesIO()
    np.savez(stream, **keys(provenance="\U0010ffff{}"))
    path = tmp_path / "kernel.npz"
    raw = stream.getvalue()
    path.write_bytes(raw)
    with pytest.raises(KernelFileError, match="not JSON"):
        read_kernel(path)
    np.savez(path, **keys(source="two\nlines"))
    with pytest.raises(KernelFileError, match="not a line of text"):
        read_camera(path)


def test_files_that_are_no_npz_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "kernel.npz"
    good = savez(tmp_path / "good.npz").read_bytes()
    for data, match in (
        (b"", "is empty"),
        (pickle.dumps({"theta": 1}), "not an .npz file"),
        (b"text", "not an .npz file"),
        (good[: len(good) // 2], "damaged or cut short"),
        (good[:-1], "damaged or cut short"),
    ):
        path.write_bytes(data)
        with pytest.raises(KernelFileError, match=match):
            read_kernel(path)
    with pytest.raises(KernelFileError, match="no such file"):
        read_kernel(tmp_path / "none.npz")
    with pytest.raises(KernelFileError, match="is a folder"):
        read_kernel(tmp_path)


def test_a_billion_weights_cost_neither_time_nor_memory(tmp_path: Path) -> None:
    """A compressed file of 24 MB can hold 10^9 zeros: its header and its directory say so."""
    path = tmp_path / "bomb.npz"
    code = (
        "import io, sys, zipfile\n"
        "with zipfile.ZipFile(sys.argv[1], 'w', zipfile.ZIP_DEFLATED, compresslevel=1) as z:\n"
        "    import numpy as np\n"
        "    for key, value in {'format': np.int64(1), 'steps': np.ones(3),\n"
        "                       'confidence': 1.0, 'provenance': '{}',\n"
        "                       'camera_matrix': np.eye(3), 'image_size': np.array([6, 8]),\n"
        "                       'distortion': np.zeros(0), 'theta': np.zeros((1, 3))}.items():\n"
        "        b = io.BytesIO(); np.save(b, value); z.writestr(key + '.npy', b.getvalue())\n"
        "    b = io.BytesIO()\n"
        "    np.lib.format.write_array_header_1_0(\n"
        "        b, {'descr': '<f8', 'fortran_order': False, 'shape': (10**9,)})\n"
        "    with z.open('weights.npy', 'w', force_zip64=True) as m:\n"
        "        m.write(b.getvalue())\n"
        "        for _ in range(32): m.write(bytes(1 << 20))\n"
    )
    subprocess.run([sys.executable, "-c", code, str(path)], check=True)
    tracemalloc.start()
    begun = time.process_time()
    with pytest.raises(KernelFileError, match="'weights'"):
        read_kernel(path)
    assert time.process_time() - begun < 3
    assert tracemalloc.get_traced_memory()[1] < 20 << 20
    tracemalloc.stop()


def test_an_endless_file_is_not_read_to_its_end() -> None:
    if not Path("/dev/zero").exists():
        pytest.skip("no /dev/zero here")
    begun = time.process_time()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(KernelFileError, match="larger than"):
        read_kernel("/dev/zero")
    assert time.process_time() - begun < 3
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000  # kilobytes


def test_streams_carry_the_same_bytes(tmp_path: Path) -> None:
    path = tmp_path / "kernel.npz"
    write_kernel(path, content())
    code = (
        "from deshake.files.kernel_file import read_kernel, write_kernel\n"
        "write_kernel('-', read_kernel('-'))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=path.read_bytes(),
        capture_output=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    assert done.stdout == path.read_bytes()


def test_provenance_must_be_json(tmp_path: Path) -> None:
    kernel = content().kernel
    for bad in ({"a": float("nan")}, {"a": {1, 2}}):
        with pytest.raises((ValueError, TypeError)):
            write_kernel(tmp_path / "kernel.npz", KernelFile(kernel, 1.0, bad))
    assert not list(tmp_path.iterdir())
    assert json.dumps(content().provenance)


def test_the_documented_example_makes_a_good_file(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "kernel-files.md").read_text("utf-8")
    code = text.split("```python\n")[1].split("```")[0]
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert "[0.  0.  0.5]" in done.stdout
    kernel = read_kernel(tmp_path / "kernel.npz").kernel
    assert len(kernel.weights) == 23
    assert kernel.extent_px() == pytest.approx(np.radians(0.5) * 1999.5, rel=1e-3)


def test_the_documented_keys_are_the_ones_written(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "kernel-files.md").read_text("utf-8")
    write_camera(tmp_path / "camera.npz", CameraFile(CAMERA, "test"))
    write_kernel(tmp_path / "kernel.npz", content())
    for name in ("camera", "kernel"):
        section = text.split(f"## {name.capitalize()} files")[1].split("\n## ")[0]
        documented = {line.split("`")[1] for line in section.splitlines() if line.startswith("| `")}
        with np.load(tmp_path / f"{name}.npz") as file:
            assert set(file) == documented
