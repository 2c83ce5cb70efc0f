from __future__ import annotations

import pytest
from PIL import Image

from deshake.batch.estimate_work import Calibrate, EstimateKernel, kernel_origin
from deshake.batch.plan import Job
from deshake.errors import EstimationError
from deshake.files.kernel_file import read_camera
from deshake.run import Run
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.estimate_options import EstimateOptions


@pytest.fixture
def photo(tmp_path):
    path = tmp_path / "a.png"
    Image.new("RGB", (100, 80), "teal").save(path)
    return path


def did(work, job):
    return work(job, Run(1))


def test_calibrate_with_and_without_a_file(photo, tmp_path):
    camera = tmp_path / "c.npz"
    figures = did(Calibrate(camera=CameraChoice(focal_px=150)), Job(photo, camera))
    assert (figures["focal_px"], figures["width"], figures["height"]) == (150, 100, 80)
    assert read_camera(camera).camera.focal_px == 150
    assert did(Calibrate(camera=CameraChoice(focal_px=150)), Job(photo, None)) == figures


def test_a_flat_photo_has_no_kernel(photo, tmp_path):
    work = EstimateKernel(EstimateOptions(camera=CameraChoice(focal_35mm=40), blur_size=3))
    with pytest.raises(EstimationError):
        did(work, Job(photo, tmp_path / "k.npz"))
    assert not (tmp_path / "k.npz").exists()


@pytest.mark.parametrize(
    ("given", "camera"),
    [
        ({"focal_px": 800}, "--focal-px 800"),
        ({"focal_35mm": 40.5}, "--focal-35mm 40.5"),
        ({}, None),
    ],
)
def test_the_camera_counts_where_it_is_named(given, camera):
    origin = kernel_origin(EstimateOptions(camera=CameraChoice(**given), blur_size=3))
    assert origin.get("camera") == camera
    assert origin["options"]["blur_size"] == 3
