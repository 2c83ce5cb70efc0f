from __future__ import annotations

import pickle

import pytest

from deshake.batch.inspect_work import Inspect
from deshake.batch.plan import Job
from deshake.errors import PhotoError
from deshake.files.kernel_file import CameraFile, write_camera
from deshake.formats.picture_size import PictureSize
from deshake.geometry.camera import Camera
from deshake.run import Run


def test_the_work_is_that_of_the_stage(tmp_path):
    write_camera(tmp_path / "c.npz", CameraFile(Camera.from_focal(300.0, 40, 60), "EXIF"))
    work, job = pickle.loads(pickle.dumps((Inspect(), Job(tmp_path / "c.npz", None))))  # noqa: S301
    work.check(job)
    assert work(job, Run(1))["kind"] == "camera"
    assert work.origin(job) == {}


def test_memory_grows_with_the_photo(tmp_path):
    needs = [
        Inspect().memory(Job(tmp_path / "a.jpg", None), PictureSize(n, 3), 1)
        for n in (10**6, 10**8)
    ]
    assert needs[1] > needs[0] + 10**9


def test_a_missing_file_is_seen_before_the_work(tmp_path):
    with pytest.raises(PhotoError):
        Inspect().check(Job(tmp_path / "none.jpg", None))
