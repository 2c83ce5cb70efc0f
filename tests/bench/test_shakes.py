from __future__ import annotations

from bench.cases.shakes import CASES
from bench.tables.shakes import camera_of

from deshake.stages.camera_choice import CameraChoice

JPEG, SIXTEEN_BIT = (next(c for c in CASES["tune"] if c.name == name) for name in ("O01", "L07"))


def test_the_focal_length_is_true_or_estimated_or_wrong():
    assert camera_of(JPEG, "true") == CameraChoice()  # its metadata have it
    assert camera_of(SIXTEEN_BIT, "true") == CameraChoice(focal_35mm=28.0)
    for case in (JPEG, SIXTEEN_BIT):
        assert camera_of(case, "auto") == CameraChoice(focal="auto")
        assert camera_of(case, "100") == CameraChoice(focal_35mm=100.0)
