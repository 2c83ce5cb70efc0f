from __future__ import annotations

import io
import pickle

import numpy as np
import pytest
from PIL import Image

from deshake.batch.estimate_work import EstimateKernel
from deshake.batch.plan import Job
from deshake.batch.restoration_work import Deblur, Fix
from deshake.files.kernel_file import CameraFile, KernelFile, read_kernel, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.run import Run
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.estimate_options import EstimateOptions

CAMERA = Camera.from_focal(120, 80, 100)
OPTIONS = EstimateOptions(
    camera=CameraChoice(file=CameraFile(CAMERA, "given")),
    blur_size=3,
    uniform=True,
    estimator="edges",
)


@pytest.fixture
def photo(tmp_path):
    path = tmp_path / "a.png"
    codes = np.random.default_rng(5).integers(0, 256, (8, 10, 3), np.uint8)
    Image.fromarray(codes).resize((100, 80), Image.Resampling.BICUBIC).save(path)
    return path


def did(work, job):
    """Do the work as another process would: on copies."""
    work, job = pickle.loads(pickle.dumps((work, job)))  # noqa: S301 - our own bytes
    return work(job, Run(1))


def test_fix_is_estimate_and_deblur(photo, tmp_path):
    sharp, kernel, again, other = (tmp_path / name for name in ("s.png", "k.npz", "t.png", "l.npz"))
    figures = did(Fix(OPTIONS), Job(photo, sharp, {"kernel": kernel}))
    assert figures["camera_source"] == "given"
    verdict = {name: figures.pop(name) for name in ("verdict", "reason") if name in figures}
    assert did(EstimateKernel(OPTIONS), Job(photo, other)) == figures
    assert other.read_bytes() == kernel.read_bytes()
    figures = did(Deblur(), Job(photo, again, needs={"kernel": kernel}))
    assert figures["extent_px"] == round(read_kernel(kernel).kernel.extent_px(), 2)
    assert {name: figures[name] for name in verdict} == verdict
    assert again.read_bytes() == sharp.read_bytes()


def test_existing_outputs_follow_the_job(photo, tmp_path):
    kernel, out = tmp_path / "k.npz", tmp_path / "o.png"
    write_kernel(kernel, KernelFile(RotationKernel.delta(CAMERA)))
    out.touch()
    did(Deblur(), Job(photo, out, needs={"kernel": kernel}, existing="replace"))
    assert out.stat().st_size > 0


def test_a_report_has_pictures_of_the_photo_and_the_result(photo, tmp_path):
    kernel, out = tmp_path / "k.npz", tmp_path / "o.png"
    turn = RotationKernel.from_path([(-0.01, -0.01, 0), (0.01, 0.01, 0)], CAMERA)
    write_kernel(kernel, KernelFile(turn, 0.3))
    job = Job(photo, out, needs={"kernel": kernel}, existing="replace")
    figures = did(Deblur(room=50_000), job)
    assert figures["verdict"] == "doubtful"
    pictures = figures["pictures"]
    for encoded, path in ((pictures.part, photo), (pictures.part_after, out)):
        shown = np.asarray(Image.open(io.BytesIO(encoded.data)), float)
        with Image.open(path) as image:
            assert np.abs(shown - np.asarray(image, float)).mean() < 8
    assert "pictures" not in did(Deblur(), job)


def test_a_result_needs_its_place(photo):
    with pytest.raises(ValueError, match="has a result"):
        did(Fix(OPTIONS), Job(photo, None))
