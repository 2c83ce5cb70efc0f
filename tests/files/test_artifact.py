from __future__ import annotations

import numpy as np
import pytest

from deshake.errors import KernelFileError
from deshake.files.artifact import is_artifact, read_artifact
from deshake.files.kernel_file import CameraFile, KernelFile, write_camera, write_kernel
from deshake.files.registration_file import RegistrationFile, write_registration
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel

CAMERA = Camera.from_focal(300.0, 40, 60)
WRITERS = {
    "kernel": (write_kernel, KernelFile(RotationKernel.delta(CAMERA), 0.5)),
    "camera": (write_camera, CameraFile(CAMERA, "EXIF")),
    "registration": (write_registration, RegistrationFile(np.zeros(3), 2.0, CAMERA)),
}


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("name", ["a.npz", "no ending"])
def test_each_kind_is_distinguished_whatever_its_name(tmp_path, kind, name):
    write, content = WRITERS[kind]
    write(tmp_path / name, content)
    assert is_artifact(tmp_path / name)
    assert type(read_artifact(tmp_path / name)) is type(content)


def test_what_is_no_artifact(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff")
    (tmp_path / "b.npz").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    for name, is_one in {"a.jpg": False, "b.npz": True, "folder": False, "none": False}.items():
        assert is_artifact(tmp_path / name) is is_one


@pytest.mark.parametrize("data", [b"", b"PK", b"PK\x03\x04 and no zip", b"text"])
def test_damaged_files_say_what_is_wrong(tmp_path, data):
    path = tmp_path / "a.npz"
    path.write_bytes(data)
    with pytest.raises(KernelFileError, match="no usable kernel file"):
        read_artifact(path)


def test_missing_and_other_files_say_so(tmp_path):
    with pytest.raises(KernelFileError, match="no such file"):
        read_artifact(tmp_path / "none.npz")
    np.savez(tmp_path / "other.npz", format=1, mine=np.zeros(3))
    with pytest.raises(KernelFileError, match="no kernel, camera or registration file"):
        read_artifact(tmp_path / "other.npz")
    write_kernel(tmp_path / "k.npz", WRITERS["kernel"][1])
    data = (tmp_path / "k.npz").read_bytes()
    (tmp_path / "k.npz").write_bytes(data.replace(b"theta.npy", b"other.npy"))
    with pytest.raises(KernelFileError, match="'theta' is missing"):
        read_artifact(tmp_path / "k.npz")
