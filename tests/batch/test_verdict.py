from __future__ import annotations

import pytest

from deshake.batch.verdict import blur_words, confidence_words, summary_words, verdict_figures
from deshake.blind.estimate import SHARP, SOFT
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel

CAMERA = Camera.from_focal(100, 40, 60)
PAN = RotationKernel.from_path([(0, -0.02, 0), (0, 0.02, 0)], CAMERA)
STILL = RotationKernel.delta(CAMERA)


def test_a_trusted_kernel_improves_and_another_is_doubtful():
    assert verdict_figures(PAN, 0.8, ["a note"]) == {"verdict": "improved"}
    assert verdict_figures(PAN, 0.49, []) == {"verdict": "doubtful"}


@pytest.mark.parametrize(
    ("notes", "reason"),
    [
        ([SHARP], "the photo looks sharp"),
        ([SOFT], "the photo is a little soft rather than shaken"),
        (["no focal length: 50 mm is assumed", SHARP], "the photo looks sharp"),
        (
            ["no estimate improves it (best confidence 0.05): the photo is left as it is; or so"],
            "no estimate improves it (best confidence 0.05)",
        ),
        ([], "by its kernel, the camera stood still"),
        (None, "by its kernel, the camera stood still"),
        ("left as it is", "by its kernel, the camera stood still"),
        ([3, {}], "by its kernel, the camera stood still"),
    ],
)
def test_a_camera_that_stood_still_leaves_the_photo_for_a_reason(notes, reason):
    assert verdict_figures(STILL, 0.9, notes) == {"verdict": "left", "reason": reason}


def test_words_for_the_confidence():
    words = [confidence_words(each) for each in (1.0, 0.9, 0.85, 0.8, 0.79, 0.0)]
    expected = ["confident", "confident", "fairly confident", "fairly confident"]
    assert words == [*expected, "doubtful", "doubtful"]


def test_what_was_done_in_a_line():
    figures = {"verdict": "improved", "extent_px": 23.4, "confidence": 0.95}
    assert summary_words(figures) == "shake of 23 px, confident"
    figures = {"verdict": "doubtful", "extent_px": 3.44, "confidence": 0.2}
    assert summary_words(figures) == "shake of 3.4 px, doubtful"
    figures = {"verdict": "left", "reason": "the photo looks sharp"}
    assert summary_words(figures) == "left as it is: the photo looks sharp"
    assert summary_words({"verdict": "unshaken", "reason": "soft"}) == "passed over: soft"


def test_what_blurs_a_photo_in_words():
    figures = {"verdict": "out of focus", "certain": True}
    assert blur_words(figures) == "out of focus"
    assert blur_words(figures | {"certain": False}) == "perhaps out of focus"
    figures = {"verdict": "unclear", "certain": False}
    assert blur_words(figures) == "unclear: too little detail"
    figures = {"verdict": "shaken", "certain": True, "width_px": 23.4, "direction": 12.3}
    assert blur_words(figures) == "shaken, about 23 px at 12 degrees"
    figures |= {"certain": False, "width_px": 4.56}
    assert blur_words(figures) == "perhaps shaken, about 4.6 px at 12 degrees"
