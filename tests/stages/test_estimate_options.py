from __future__ import annotations

import pytest

from deshake.blind.bounds import blur_bound
from deshake.files.kernel_file import CameraFile
from deshake.geometry.camera import Camera
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.estimate_options import EstimateOptions, largest_blur

CAMERA = Camera.from_focal(100, 60, 80)


def test_the_largest_blur_is_given_or_an_angle_or_unknown():
    assert largest_blur(CAMERA, EstimateOptions()) is None
    assert largest_blur(CAMERA, EstimateOptions(blur_size=7)) == 7
    assert largest_blur(CAMERA, EstimateOptions(blur_size=7, max_angle=45)) == 7
    bound = largest_blur(CAMERA, EstimateOptions(max_angle=1))
    assert bound == pytest.approx(blur_bound(CAMERA, 0.0174533), rel=1e-4)


def test_provenance_has_what_differs_from_the_default():
    plain = EstimateOptions().provenance()
    assert plain == {
        "transfer": None,
        "blur_size": None,
        "max_angle": None,
        "region": None,
        "uniform": False,
        "estimator": "edges",
    }
    known = EstimateOptions(camera=CameraChoice(focal_px=9, file=CameraFile(CAMERA, "given")))
    assert known.provenance() == plain  # the camera has an entry of its own
    assert EstimateOptions(camera=CameraChoice(focal="auto")).provenance() == plain | {
        "focal": "auto"
    }
    assert EstimateOptions(camera=CameraChoice(lens=True)).provenance() == plain | {"lens": True}
    assert EstimateOptions(camera=CameraChoice(lens_model="X")).provenance() == plain | {
        "lens": "X"
    }
    assert EstimateOptions(least_confidence=0.0).provenance() == plain | {"least_confidence": 0}
    assert EstimateOptions(preview=True).provenance() == plain | {"preview": True}
