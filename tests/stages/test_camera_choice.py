from __future__ import annotations

import pytest

from deshake.files.kernel_file import CameraFile
from deshake.geometry.camera import Camera
from deshake.stages.camera_choice import CameraChoice

PINHOLE = Camera.from_focal(100, 60, 80)
BENT = CameraFile(PINHOLE.with_lens([-0.1, 0, 0, 0, 0]), "a chessboard")
STRAIGHT = CameraFile(PINHOLE, "given")


@pytest.mark.parametrize(
    ("choice", "source", "named", "undoes"),
    [
        (CameraChoice(), None, False, False),
        (CameraChoice(focal_px=800), "--focal-px 800", True, False),
        (CameraChoice(focal_35mm=40.5), "--focal-35mm 40.5", True, False),
        (CameraChoice(focal_35mm=40, lens=True), None, True, True),
        (CameraChoice(lens_model="X"), None, False, True),
        (CameraChoice(file=STRAIGHT), "given", True, False),
        (CameraChoice(file=BENT), "a chessboard", True, True),
        (CameraChoice(focal="auto"), None, False, False),
    ],
)
def test_what_is_known_before_the_photo_is_read(choice, source, named, undoes):
    assert (choice.source, choice.has_focal_length, choice.undoes_lens) == (source, named, undoes)


def test_provenance_has_what_is_unusual():
    assert CameraChoice(focal_px=9, file=STRAIGHT).provenance() == {}
    assert CameraChoice(focal="auto").provenance() == {"focal": "auto"}
    assert CameraChoice(lens=True).provenance() == {"lens": True}
    assert CameraChoice(lens_model="X").provenance() == {"lens": "X"}
