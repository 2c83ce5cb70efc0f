from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from deshake.batch.estimate_work import EstimateKernel
from deshake.batch.plan import Job
from deshake.batch.restoration_work import Deblur, Fix
from deshake.batch.resume import differences, doubt
from deshake.batch.task import run_job
from deshake.run import Run
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.finishing import FinishingOptions
from deshake.stages.methods import RestorationOptions

OPTIONS = EstimateOptions(
    camera=CameraChoice(focal_35mm=40), blur_size=3, uniform=True, estimator="edges"
)
FIX = Fix(OPTIONS)


def job_in(folder):
    outputs = folder / "out.jpg", folder / "a.kernel.npz"
    return Job(folder / "a.png", outputs[0], {"kernel": outputs[1]}, existing="skip")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Make a folder with a photo and all that the work makes of it."""
    folder = tmp_path_factory.mktemp("finished")
    codes = np.random.default_rng(5).integers(0, 256, (8, 10, 3), np.uint8)
    Image.fromarray(codes).resize((100, 80), Image.Resampling.BICUBIC).save(folder / "a.png")
    assert run_job(job_in(folder), FIX, run=Run(1)).status == "done"
    return folder


@pytest.fixture
def job(finished, tmp_path):
    """Copy the photo and its results; return the job that made them."""
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    return job_in(tmp_path)


def test_what_this_work_made_is_not_doubted(job):
    kernel = job.others["kernel"]
    assert doubt(job, FIX) is None
    assert doubt(replace(job, needs={"kernel": kernel}), Deblur()) is None
    assert doubt(replace(job, output=kernel), EstimateKernel(OPTIONS)) is None


@pytest.mark.parametrize(
    ("work", "words"),
    [
        (replace(FIX, options=replace(OPTIONS, blur_size=5)), "blur_size 3, now 5"),
        (replace(FIX, options=replace(OPTIONS, blur_size=None)), "blur_size 3, now by default"),
        (
            replace(FIX, options=replace(OPTIONS, camera=CameraChoice(focal_35mm=50))),
            "--focal-35mm 40, now --focal",
        ),
        (replace(FIX, restoration=RestorationOptions("rl")), "method sparse, now rl"),
        (replace(FIX, finish=FinishingOptions(0.5)), "strength by default, now 0.5"),
        (replace(FIX, finish=FinishingOptions(linear=True)), "linear by default, now True"),
    ],
)
def test_other_options_are_reported(job, work, words):
    reason = doubt(job, work)
    assert f"{job.output} exists already, but was made with other options (" in reason
    assert words in reason
    before = job.output.read_bytes()
    result = run_job(job, work)
    assert result.status == "skipped"
    assert words in result.warnings[0]
    assert job.output.read_bytes() == before


def test_another_input_and_another_kernel_are_reported(job, tmp_path):
    kernel = job.others["kernel"]
    Image.new("L", (100, 80), 99).save(job.source)
    assert "made from another input" in doubt(job, FIX)
    assert "options" not in doubt(job, FIX)
    other = tmp_path / "other.npz"
    again = replace(job, output=other, others={})
    EstimateKernel(replace(OPTIONS, blur_size=4))(replace(again, source=job.output), Run(1))
    reason = doubt(replace(job, needs={"kernel": other}), Deblur())
    assert "from another input and with other options (blur_size 3, now 4)" in reason
    assert doubt(replace(job, output=kernel), EstimateKernel(OPTIONS)).endswith("another input")


def test_a_result_without_provenance_is_not_doubted(job):
    Image.new("L", (100, 80), 99).save(job.output)
    assert doubt(job, FIX) is None
    job.others["kernel"].write_bytes(b"damaged")
    assert doubt(replace(job, output=job.others["kernel"]), EstimateKernel(OPTIONS)) is None


def test_options_left_out_are_by_default():
    origin = {"options": {"mask_sha256": "x", "a": [1, 2]}, "more": 1}
    assert differences(origin, {"options": {"a": (1, 2)}}) == ["with another mask"]
    assert differences(origin, {}) == []
    assert differences({}, {"options": {"a": None}, "input_sha256": "x"}) == ["from another input"]
