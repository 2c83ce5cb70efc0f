from __future__ import annotations

import inspect
import pickle

import pytest

from deshake.batch.estimate_work import Calibrate, EstimateKernel, Register
from deshake.batch.restoration_work import Deblur, Fix
from deshake.batch.work import Work
from deshake.stages.estimate_options import EstimateOptions

OPTIONS = EstimateOptions()
WORKS = [Calibrate(), EstimateKernel(OPTIONS), Register(OPTIONS), Fix(OPTIONS), Deblur()]


@pytest.mark.parametrize("work", WORKS, ids=lambda work: type(work).__name__)
@pytest.mark.parametrize("name", ["__call__", "memory", "origin"])
def test_every_work_takes_what_the_frame_gives(work, name):
    given = list(inspect.signature(getattr(Work, name)).parameters)
    assert list(inspect.signature(getattr(type(work), name)).parameters) == given


@pytest.mark.parametrize("work", WORKS, ids=lambda work: type(work).__name__)
def test_works_can_be_sent_to_another_process(work):
    assert pickle.loads(pickle.dumps(work)) == work  # noqa: S301
