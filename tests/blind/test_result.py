from __future__ import annotations

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from deshake.blind.result import BlindEstimate
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

CAMERA = Camera.from_focal(130.0, 90, 120)


@pytest.fixture
def result() -> BlindEstimate:
    kernel = RotationKernel.delta(CAMERA, steps=grid_steps(CAMERA))
    return BlindEstimate(kernel, 0.5, [], [], np.zeros((2, 90, 120), np.float32))


def test_a_result_cannot_be_changed(result: BlindEstimate) -> None:
    with pytest.raises(FrozenInstanceError):
        result.confidence = 1.0


def test_a_copy_may_differ_and_the_result_stays(result: BlindEstimate) -> None:
    other = replace(result, confidence=0.9, name="edges")
    assert (other.confidence, other.name) == (0.9, "edges")
    assert (result.confidence, result.name) == (0.5, "variational")
    assert other.kernel is result.kernel
    assert other != result
