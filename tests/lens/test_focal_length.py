from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING

import pytest

from deshake.errors import CalibrationError
from deshake.lens import lens_profiles
from deshake.lens.focal_length import FULL_FRAME_DIAGONAL, assumed_focal_length, focal_length
from deshake.metadata.metadata import Metadata

if TYPE_CHECKING:
    from collections.abc import Callable

IXUS_70 = {0xA20E: 11520.0, 0xA20F: 11502.96, 0xA210: 2, 0xA002: 2592, 0xA003: 1944}


def equivalent(pixels: float, height: int, width: int) -> float:
    return pixels * 43.2666 / math.hypot(height, width)


def test_the_focal_plane_of_the_ixus_70(make_exif: Callable[..., bytes]) -> None:
    focal = focal_length(Metadata(exif=make_exif(below=IXUS_70)), 1944, 2592)
    assert equivalent(focal.pixels, 1944, 2592) == pytest.approx(35.1, abs=0.05)
    assert focal.source == "EXIF FocalLength = 5.8 mm at 453.5 pixels/mm (FocalPlaneXResolution)"


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave deshake without lensfunpy."""
    lens_profiles._database.cache_clear()
    monkeypatch.setitem(sys.modules, "lensfunpy", None)


@pytest.mark.usefixtures("alone")
def test_the_sensor_table_agrees_with_the_focal_plane(make_exif: Callable[..., bytes]) -> None:
    focal = focal_length(Metadata(exif=make_exif()), 1944, 2592)
    assert "5.76 x 4.29 mm sensor of Canon DIGITAL IXUS 70" in focal.source
    assert equivalent(focal.pixels, 1944, 2592) == pytest.approx(35.1, rel=0.01)


def test_the_order_of_the_sources(make_exif: Callable[..., bytes]) -> None:
    metadata = Metadata(exif=make_exif(below=IXUS_70 | {0xA405: 37}))
    by_px = focal_length(metadata, 1944, 2592, focal_px=3000, focal_35mm=50)
    by_35 = focal_length(metadata, 1944, 2592, focal_35mm=50)
    by_tag = focal_length(metadata, 1944, 2592)
    assert (by_px.pixels, by_px.source) == (3000, "--focal-px 3000")
    assert by_35.pixels == pytest.approx(50 / FULL_FRAME_DIAGONAL * 3240)
    assert by_35.source == "--focal-35mm 50"
    assert by_tag.pixels == pytest.approx(37 / FULL_FRAME_DIAGONAL * 3240)
    assert by_tag.source == "EXIF FocalLengthIn35mmFilm = 37 mm"


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


@pytest.mark.usefixtures("alone")
def test_a_frame_of_another_shape_uses_one_side_of_the_sensor(
    make_exif: Callable[..., bytes],
) -> None:
    metadata = Metadata(exif=make_exif())
    wide = focal_length(metadata, 1456, 2592).pixels
    square = focal_length(metadata, 1944, 1944).pixels
    assert wide == pytest.approx(5.8 * 2592 / 5.76)
    assert square == pytest.approx(5.8 * 1944 / 4.29)


@pytest.mark.parametrize("value", [0, 60000])
def test_absurd_tags_are_ignored(make_exif: Callable[..., bytes], value: int) -> None:
    focal = focal_length(Metadata(exif=make_exif(below=IXUS_70 | {0xA405: value})), 1944, 2592)
    assert "FocalPlaneXResolution" in focal.source


@pytest.mark.parametrize("value", [0.0, -5.0, math.nan, math.inf, 1e9, 1.0])
@pytest.mark.parametrize("option", ["focal_px", "focal_35mm"])
def test_absurd_options_are_refused(option: str, value: float) -> None:
    with pytest.raises(CalibrationError, match="--focal-"):
        focal_length(Metadata(), 1944, 2592, **{option: value})


@pytest.mark.usefixtures("alone")
def test_without_any_source_there_is_a_hint(make_exif: Callable[..., bytes]) -> None:
    with pytest.raises(CalibrationError, match="no focal length") as caught:
        focal_length(Metadata(), 100, 100)
    assert "--focal-35mm" in str(caught.value.hint)
    for make, model in (("Canon", "Canon DIGITAL IXUS 700"), ("Other", "Canon EOS 5D")):
        metadata = Metadata(exif=make_exif(make=make, model=model))
        with pytest.raises(CalibrationError, match="but the size of the sensor"):
            focal_length(metadata, 1944, 2592)


def test_the_assumption_is_fifty_millimetres() -> None:
    focal = assumed_focal_length(1944, 2592)
    assert equivalent(focal.pixels, 1944, 2592) == pytest.approx(50, abs=1e-3)
    assert focal.source == "assumed: 50 mm-equivalent"


def test_lensfun_knows_crop_factors(make_exif: Callable[..., bytes]) -> None:
    pytest.importorskip("lensfunpy")
    focal = focal_length(Metadata(exif=make_exif()), 1944, 2592)
    assert "crop factor 6.05 of Canon DIGITAL IXUS 70 (lensfun)" in focal.source
    assert equivalent(focal.pixels, 1944, 2592) == pytest.approx(5.8 * 6.05, abs=0.01)
    assert focal.confidence == pytest.approx(0.95 * 0.9)


def test_a_coarse_equivalent_is_made_finer(make_exif: Callable[..., bytes]) -> None:
    focal = focal_length(Metadata(exif=make_exif(below=IXUS_70 | {0xA405: 35})), 1944, 2592)
    plane = focal_length(Metadata(exif=make_exif(below=IXUS_70)), 1944, 2592)
    assert focal.pixels == plane.pixels
    assert focal.source == "EXIF FocalLengthIn35mmFilm = 35 mm, finer by FocalPlaneXResolution"
    assert focal.confidence == 0.95
    assert len(focal.considered) == 4


def test_contradictions_are_noted(make_exif: Callable[..., bytes]) -> None:
    focal = focal_length(Metadata(exif=make_exif(below=IXUS_70 | {0xA405: 70})), 1944, 2592)
    assert focal.source == "EXIF FocalLengthIn35mmFilm = 70 mm"
    assert focal.confidence == pytest.approx(0.54)
    [note] = focal.notes
    assert "its metadata contradict each other" in note


def test_a_digital_zoom_makes_the_focal_length_longer(make_exif: Callable[..., bytes]) -> None:
    plain = focal_length(Metadata(exif=make_exif(below=IXUS_70)), 1944, 2592)
    zoomed = focal_length(Metadata(exif=make_exif(below=IXUS_70 | {0xA404: 2.0})), 1944, 2592)
    assert zoomed.pixels == pytest.approx(2 * plain.pixels)
    assert zoomed.confidence == pytest.approx(0.8 * plain.confidence)


@pytest.mark.parametrize("stated", [35, 70])
def test_the_sensor_decides_whether_equivalents_include_the_zoom(
    make_exif: Callable[..., bytes], stated: int
) -> None:
    tags = {0xA404: 2.0, 0xA405: stated, 0xA002: 2592, 0xA003: 1944}
    focal = focal_length(Metadata(exif=make_exif(below=tags)), 1944, 2592)
    assert equivalent(focal.pixels, 1944, 2592) == pytest.approx(70, abs=1e-3)


def test_a_phone_counts_its_digital_zoom_in(make_exif: Callable[..., bytes]) -> None:
    exif = make_exif(make="Apple", model="iPhone 15", below={0xA404: 2.0, 0xA405: 52})
    focal = focal_length(Metadata(exif=exif), 3024, 4032)
    assert equivalent(focal.pixels, 3024, 4032) == pytest.approx(52, abs=1e-3)


@pytest.mark.parametrize(
    "below", [{0xA20E: 11520.0, 0xA20F: 8640.0, 0xA210: 2}, {0xA434: "SIRUI 50mm Anamorphic 1.33x"}]
)
def test_squeezed_pictures_are_refused(make_exif: Callable[..., bytes], below: dict) -> None:
    metadata = Metadata(exif=make_exif(below=below | {0xA405: 50}))
    with pytest.raises(CalibrationError, match="squeezed") as caught:
        focal_length(metadata, 1944, 2592)
    assert "--focal-px" in str(caught.value.hint)
    assert focal_length(metadata, 1944, 2592, focal_px=3000).pixels == 3000
