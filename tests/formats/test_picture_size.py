from __future__ import annotations

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from deshake.formats.picture_size import picture_size


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.webp", "a.tif"])
def test_colours(tmp_path, name):
    Image.fromarray(np.zeros((20, 30, 3), np.uint8)).save(tmp_path / name)
    assert picture_size(tmp_path / name) == (600, 3)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
def test_depths(tmp_path, dtype, channels):
    codes = np.zeros((20, 30, 3)[: 2 + (channels == 3)], dtype)
    tifffile.imwrite(tmp_path / "a.tif", codes)
    cv2.imwrite(str(tmp_path / "a.png"), codes)
    for name in ("a.tif", "a.png"):
        assert picture_size(tmp_path / name) == (600, channels)


def test_without_a_known_header_the_file_size_gives_an_estimate(tmp_path):
    path = tmp_path / "a.jpg"
    path.write_bytes(b"x" * 1000)
    assert picture_size(path) == (8000, 3)


def test_missing_files_have_no_size(tmp_path):
    (tmp_path / "empty").touch()
    assert picture_size(tmp_path / "empty") is None
    assert picture_size(tmp_path / "missing") is None
