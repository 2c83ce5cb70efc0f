from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from deshake.batch.estimate_work import Calibrate
from deshake.batch.footprint import (
    estimate_memory,
    memory_needed,
    photo_memory,
    restoration_memory,
)
from deshake.batch.plan import Job
from deshake.batch.work import Deblur, Fix
from deshake.deconvolution.methods import RestorationOptions
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.io.kernel_file import KernelFile, write_kernel
from deshake.io.picture_size import PictureSize
from deshake.pipelines.finishing import Finish
from deshake.pipelines.pair_deblurring import PairRestorationOptions
from deshake.pipelines.stages import EstimateOptions


@pytest.fixture
def photo(tmp_path):
    def save(mode):
        path = tmp_path / f"{mode}.png"
        shape = (1000, 1500) if mode == "L" else (1000, 1500, 3)
        Image.fromarray(np.zeros(shape, np.uint8)).save(path)
        return Job(path, tmp_path / "out.png")

    return save


def test_larger_photos_in_colour_and_wider_blurs_need_more(photo):
    fix = Fix(EstimateOptions())
    grey, colour = (memory_needed(photo(mode), fix, 1) for mode in ("L", "RGB"))
    assert 0.25e9 < grey < colour < 0.6e9
    wide = memory_needed(photo("RGB"), Fix(EstimateOptions(blur_size=200)), 1)
    assert wide > 1.2e9
    assert memory_needed(photo("RGB"), fix, 4) > colour + 0.1e9
    small = memory_needed(photo("RGB"), Fix(EstimateOptions(), finish=Finish(preview=True)), 1)
    assert small < colour


def test_the_kernel_tells_the_blur(photo, tmp_path):
    job = photo("RGB")
    camera = Camera.from_focal(1500, 1000, 1500)
    needs = []
    for number, angle in enumerate((0.001, 0.06)):
        kernel = tmp_path / f"{number}.npz"
        path = [(0, -angle, 0), (0, angle, 0)]
        write_kernel(kernel, KernelFile(RotationKernel.from_path(path, camera)))
        needs.append(memory_needed(replace(job, needs={"kernel": kernel}), Deblur(), 1))
    assert needs[1] > needs[0] + 0.5e9
    unknown = memory_needed(replace(job, needs={"kernel": job.source}), Deblur(), 1)
    assert needs[0] < unknown < needs[1]


def test_what_takes_no_work_needs_little(photo, tmp_path):
    job = photo("RGB")
    skipped = Job(job.source, job.source, existing="skip")
    missing = Job(tmp_path / "missing.jpg", job.output)
    for other in (skipped, missing):
        assert memory_needed(other, Calibrate(), 1) == photo_memory(PictureSize(0, 1)) < 0.3e9


def test_stages_differ():
    size = PictureSize(24_000_000, 3)
    alone = restoration_memory(size, RestorationOptions(), 1)
    assert photo_memory(size) < estimate_memory(size, 1) < alone
    assert alone < restoration_memory(size, PairRestorationOptions(), 1)
    assert 2.8e9 < restoration_memory(size, RestorationOptions(), 1, 30) < 3.2e9  # measured: 2.8
    assert 3.3e9 < restoration_memory(size, RestorationOptions(), 1, 120) < 3.7e9  # 3.3
