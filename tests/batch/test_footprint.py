from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from deshake.batch.footprint import memory_needed, photo_memory, restoration_memory
from deshake.batch.plan import Job
from deshake.batch.work import Deblur, EstimateBlind, Fix
from deshake.deconvolution.methods import RestorationOptions
from deshake.io.picture_size import PictureSize
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


def test_larger_photos_in_colour_need_more(photo):
    grey, colour = (memory_needed(photo(mode), Deblur()) for mode in ("L", "RGB"))
    assert 0.25e9 < grey < colour < 0.6e9
    assert memory_needed(photo("RGB"), Fix(EstimateOptions())) >= colour


def test_what_takes_no_work_needs_little(photo, tmp_path):
    job = photo("RGB")
    skipped = Job(job.source, job.source, existing="skip")
    missing = Job(tmp_path / "missing.jpg", job.output)
    for other in (skipped, missing):
        assert memory_needed(other, Deblur()) == photo_memory(PictureSize(0, 1)) < 0.3e9


def test_stages_differ():
    size = PictureSize(24_000_000, 3)
    alone = restoration_memory(size, RestorationOptions())
    assert photo_memory(size) < EstimateBlind(EstimateOptions()).memory(size) < alone
    assert alone < restoration_memory(size, PairRestorationOptions())
