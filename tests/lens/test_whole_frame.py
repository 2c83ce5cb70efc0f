from __future__ import annotations

import pytest

from deshake.lens.whole_frame import whole_frame
from deshake.metadata.camera_tags import CameraTags


def of(taken: tuple[int, int] | None, width: int, height: int, **more: tuple[float, float]):
    return whole_frame(CameraTags(pixel_size=taken), height, width, **more)


@pytest.mark.parametrize("size", [(6000, 4000), (4000, 6000)])
def test_an_unchanged_picture_is_the_whole_frame(size: tuple[int, int]) -> None:
    frame = of((6000, 4000), *size)
    assert (frame.long, frame.short, frame.scale, frame.confidence) == (6000, 4000, 1, 1)
    assert frame.note == ""


@pytest.mark.parametrize(
    "size", [(1200, 800), (800, 1200), (1023, 682), (1024, 683), (9000, 6000), (100, 67)]
)
def test_a_resized_picture_is_whole(size: tuple[int, int]) -> None:
    frame = of((6000, 4000), *size)
    assert (frame.long, frame.short) == (max(size), min(size))
    assert frame.scale == pytest.approx(max(size) / 6000)
    assert (frame.confidence, frame.note) == (1, "")


@pytest.mark.parametrize("size", [(5940, 3940), (3940, 5940), (4000, 4000), (6000, 3375)])
def test_a_crop_belongs_to_the_whole_frame(size: tuple[int, int]) -> None:
    frame = of((6000, 4000), *size)
    assert (frame.long, frame.short, frame.scale) == (6000, 4000, 1)


def test_a_crop_is_detected_unless_it_is_a_sliver() -> None:
    assert of((6000, 4000), 5990, 3950).note == ""
    cropped = of((6000, 4000), 4000, 4000)
    assert "taken as 6000 x 4000 pixels, and has 4000 x 4000" in cropped.note
    assert cropped.confidence == 0.7


def test_a_small_picture_of_another_shape_was_resized_too() -> None:
    frame = of((6000, 4000), 1350, 1080)  # 5:4 out of 3:2 at most 5000 x 4000
    assert (frame.long, frame.short) == pytest.approx((1620, 1080))
    assert frame.scale == pytest.approx(0.27)
    assert frame.confidence == 0.4
    assert "a guess" in frame.note


def test_the_frame_of_an_enlarged_picture_is_a_guess() -> None:
    frame = of((1000, 800), 2000, 1000)
    assert (frame.long, frame.short, frame.confidence) == (2000, 1000, 0.4)
    assert "cropped and enlarged" in frame.note


@pytest.mark.parametrize(
    ("size", "confidence"), [((4000, 3000), 0.9), ((1000, 1000), 0.9), ((3000, 1000), 0.5)]
)
def test_without_a_size_the_shape_decides(size: tuple[int, int], confidence: float) -> None:
    frame = of(None, *size)
    assert (frame.long, frame.short, frame.scale) == (*size, 1)
    assert frame.confidence == confidence
    assert bool(frame.note) == (confidence < 0.9)


def test_the_sensor_shows_crops_whose_exif_was_rewritten() -> None:
    full = (6000.4, 4001.0)
    cropped = of((4000, 4000), 4000, 4000, full=full)
    assert (cropped.long, cropped.short, cropped.scale) == (6000, 4001, 1)
    resized = of((3000, 2000), 3000, 2000, full=full)
    assert (resized.long, resized.short) == (3000, 2000)
    assert resized.scale == pytest.approx(0.5, rel=1e-3)
    assert of((6000, 4000), 6000, 4000, full=(6030.0, 4020.0)).long == 6000
