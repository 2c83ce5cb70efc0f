from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from deshake.errors import CalibrationError
from deshake.io.metadata import Metadata
from deshake.io.sensors import FULL_FRAME_DIAGONAL, assumed_focal_length, focal_length

if TYPE_CHECKING:
    from collections.abc import Callable

IXUS_70 = {0xA20E: 11520.0, 0xA20F: 11502.96, 0xA210: 2, 0xA002: 2592, 0xA003: 1944}


def equivalent(pixels: float, height: int, width: int) -> float:
    return pixels * 43.2666 / math.hypot(height, width)


def test_the_focal_plane_of_the_ixus_70(make_exif: Callable[..., bytes]) -> None:
    found = focal_length(Metadata(exif=make_exif(below=IXUS_70)), 1944, 2592)
    assert equivalent(found.pixels, 1944, 2592) == pytest.approx(35.1, abs=0.05)
    assert found.source == "EXIF FocalLength = 5.8 mm at 453.5 pixels/mm (FocalPlaneXResolution)"


def test_the_sensor_table_agrees_with_the_focal_plane(make_exif: Callable[..., bytes]) -> None:
    found = focal_length(Metadata(exif=make_exif()), 1944, 2592)
    assert "5.76 x 4.29 mm sensor of Canon DIGITAL IXUS 70" in found.source
    assert equivalent(found.pixels, 1944, 2592) == pytest.approx(35.1, rel=0.01)


def test_the_order_of_the_sources(make_exif: Callable[..., bytes]) -> None:
    metadata = Metadata(exif=make_exif(below=IXUS_70 | {0xA405: 36}))
    by_px = focal_length(metadata, 1944, 2592, focal_px=3000, focal_35mm=50)
    by_35 = focal_length(metadata, 1944, 2592, focal_35mm=50)
    by_tag = focal_length(metadata, 1944, 2592)
    assert (by_px.pixels, by_px.source) == (3000, "--focal-px 3000")
    assert by_35.pixels == pytest.approx(50 / FULL_FRAME_DIAGONAL * 3240)
    assert by_35.source == "--focal-35mm 50"
    assert by_tag.pixels == pytest.approx(36 / FULL_FRAME_DIAGONAL * 3240)
    assert by_tag.source == "EXIF FocalLengthIn35mmFilm = 36 mm"


@pytest.mark.parametrize("extra", [{}, {0xA405: 35}, IXUS_70])
def test_a_turned_or_resized_photo_has_the_same_angle(
    make_exif: Callable[..., bytes], extra: dict[int, float]
) -> None:
    metadata = Metadata(exif=make_exif(below=extra))
    full = focal_length(metadata, 1944, 2592).pixels
    assert focal_length(metadata, 2592, 1944).pixels == pytest.approx(full)
    assert focal_length(metadata, 972, 1296).pixels == pytest.approx(full / 2)


@pytest.mark.parametrize("extra", [{0xA405: 35}, IXUS_70, {}])
def test_a_crop_keeps_the_focal_length(
    make_exif: Callable[..., bytes], extra: dict[int, float]
) -> None:
    metadata = Metadata(exif=make_exif(below={0xA002: 2592, 0xA003: 1944} | extra))
    full = focal_length(metadata, 1944, 2592).pixels
    assert focal_length(metadata, 1000, 2000).pixels == pytest.approx(full)


def test_a_frame_of_another_shape_uses_one_side_of_the_sensor(
    make_exif: Callable[..., bytes],
) -> None:
    metadata = Metadata(exif=make_exif())
    wide = focal_length(metadata, 1456, 2592).pixels
    square = focal_length(metadata, 1944, 1944).pixels
    assert wide == pytest.approx(5.8 * 2592 / 5.76)
    assert square == pytest.approx(5.8 * 1944 / 4.29)


@pytest.mark.parametrize("value", [0, 60000])
def test_absurd_tags_are_passed_over(make_exif: Callable[..., bytes], value: int) -> None:
    found = focal_length(Metadata(exif=make_exif(below=IXUS_70 | {0xA405: value})), 1944, 2592)
    assert "FocalPlaneXResolution" in found.source


@pytest.mark.parametrize("value", [0.0, -5.0, math.nan, math.inf, 1e9, 1.0])
@pytest.mark.parametrize("option", ["focal_px", "focal_35mm"])
def test_absurd_options_are_refused(option: str, value: float) -> None:
    with pytest.raises(CalibrationError, match="--focal-"):
        focal_length(Metadata(), 1944, 2592, **{option: value})


def test_without_anything_to_go_by_there_is_a_hint(make_exif: Callable[..., bytes]) -> None:
    with pytest.raises(CalibrationError, match="no focal length") as caught:
        focal_length(Metadata(), 100, 100)
    assert "--focal-35mm" in str(caught.value.hint)
    for make, model in (("Canon", "Canon DIGITAL IXUS 700"), ("Other", "Canon EOS 5D")):
        metadata = Metadata(exif=make_exif(make=make, model=model))
        with pytest.raises(CalibrationError, match="but the size of the sensor"):
            focal_length(metadata, 1944, 2592)


def test_the_assumption_is_fifty_millimetres() -> None:
    found = assumed_focal_length(1944, 2592)
    assert equivalent(found.pixels, 1944, 2592) == pytest.approx(50, abs=1e-3)
    assert found.source == "assumed: 50 mm-equivalent"
