from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.pictures.comparison import before_and_after, comparison_name, comparison_sheet


@pytest.fixture
def photo(tmp_path):
    """A grey photo with detail in one corner."""
    codes = np.full((120, 160), 90, np.uint8)
    codes[70:, 90:] = np.random.default_rng(1).integers(0, 256, (50, 70))
    Image.fromarray(codes).save(tmp_path / "a.png")
    return read_photo(tmp_path / "a.png")


@pytest.fixture
def kernel():
    camera = Camera.from_focal(200, 120, 160)
    return RotationKernel.from_path([(0, -0.02, 0), (0, 0.02, 0)], camera)


def test_sheets_are_named_after_their_results():
    assert comparison_name(Path("out") / "a.deshaken.jpg") == "a.deshaken.compare.png"


def test_pictures_are_of_the_width_and_the_part_at_its_size(photo, kernel):
    result = photo.with_pixels(photo.pixels / 2)
    before, after, drawn, part, restored = before_and_after(photo, result, kernel, 80)
    assert before.shape == after.shape == (60, 80, 3)
    assert drawn.shape == (80, 80, 3)
    assert part.shape == restored.shape == (60, 80, 3)
    assert part.std() > 50  # the corner with the detail
    assert (restored <= part).all()
    assert restored.mean() < 0.8 * part.mean()


def test_a_sheet_holds_the_part_to_the_code(photo, kernel):
    result = photo.with_pixels(photo.pixels[::-1])
    data = comparison_sheet(photo, result, kernel)
    page = np.asarray(Image.open(io.BytesIO(data)).convert("L"))
    whole = np.asarray(Image.open(photo.source))
    for picture in (whole, whole[::-1]):
        row = np.lib.stride_tricks.sliding_window_view(page, 160, axis=1)
        assert (row == picture[100]).all(-1).any()
    assert comparison_sheet(photo, result, kernel) == data


def test_a_still_camera_has_a_sheet_too(photo, kernel):
    still = RotationKernel.delta(kernel.camera)
    assert comparison_sheet(photo, photo, still).startswith(b"\x89PNG")
