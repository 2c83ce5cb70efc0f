from __future__ import annotations

import pickle

import pytest

from deshake.batch.estimate_work import Calibrate, EstimateKernel, Register
from deshake.batch.restoration_work import Deblur, Fix
from deshake.stages.estimate_options import EstimateOptions

OPTIONS = EstimateOptions()
WORKS = [Calibrate(), EstimateKernel(OPTIONS), Register(OPTIONS), Fix(OPTIONS), Deblur()]


@pytest.mark.parametrize("work", WORKS, ids=lambda work: type(work).__name__)
def test_works_can_be_sent_to_another_process(work):
    assert pickle.loads(pickle.dumps(work)) == work  # noqa: S301
