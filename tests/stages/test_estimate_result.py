from __future__ import annotations

import numpy as np
import pytest

from deshake.files.kernel_file import CameraFile, KernelFile
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.pair.registration import Registration
from deshake.stages.estimate_result import Estimate

CAMERA = Camera.from_focal(100, 64, 80)
CONTENT = KernelFile(RotationKernel.delta(CAMERA), 0.4)
GIVEN = CameraFile(CAMERA, "given")
COMMON = ["rotations", "extent_px", "confidence"]
LAST = ["notes", "focal_px", "camera_source"]


def test_a_blind_estimate_reports_the_noise():
    report = Estimate(CONTENT, GIVEN, ["a note"], noise=0.0123456).report()
    assert list(report) == [*COMMON, "noise", *LAST]
    assert report["noise"] == pytest.approx(0.01235)
    assert report["notes"] == ["a note"]


def test_a_pair_reports_its_registration():
    lies = Registration(np.zeros(3), 4.0, 0.9, CAMERA)
    result = Estimate(CONTENT, GIVEN, [], registration=lies, scale=4.1)
    report = result.report()
    assert list(report) == [*COMMON, "trusted", "scale", "registration_confidence", *LAST]
    assert not report["trusted"]
    assert (report["scale"], report["registration_confidence"]) == (4.1, 0.9)
