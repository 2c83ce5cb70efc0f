from __future__ import annotations

import importlib.util
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from deshake.formats.photo import read_photo


@pytest.fixture(scope="module")
def demo():
    path = Path(__file__).parents[2] / "scripts" / "demo.py"
    spec = importlib.util.spec_from_file_location("demo", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def picture():
    coarse = np.random.default_rng(3).random((20, 30, 3), np.float32)
    return np.clip(cv2.resize(coarse, (300, 200), interpolation=cv2.INTER_CUBIC), 0, 1)


def test_psnr_is_that_of_the_noise(demo, picture):
    noise = np.random.default_rng(4).normal(0, 0.01, picture.shape).astype(np.float32)
    assert demo.aligned_psnr(picture + noise, picture) == pytest.approx(40, abs=0.2)


def test_psnr_forgives_a_shift_and_a_turn_but_no_blur(demo, picture):
    motion = cv2.getRotationMatrix2D((150, 100), 0.8, 1)
    motion[:, 2] += (1.3, -2.6)
    moved = cv2.warpAffine(picture, motion, (300, 200), flags=cv2.INTER_CUBIC)
    assert demo.aligned_psnr(moved, picture) > 40
    assert demo.aligned_psnr(cv2.GaussianBlur(picture, (0, 0), 4), picture) < 32


def test_crops_show_detail_and_do_not_overlap(demo):
    picture = np.full((400, 600, 3), 0.5, np.float32)
    picture[230:390, 410:590] = np.random.default_rng(1).random((160, 180, 3))
    crops = demo.busiest_crops(picture, 3)
    assert len(crops) == 3
    x, y = crops[0]
    assert 360 < x <= 440
    assert 190 < y <= 240
    for i, (a, b) in enumerate(crops):
        for c, d in crops[i + 1 :]:
            assert abs(a - c) >= demo.CROP or abs(b - d) >= demo.CROP


def test_the_contact_sheet_shows_all_pictures(demo, picture, tmp_path):
    demo.contact_sheet({"before": picture * 0, "after": picture}, tmp_path / "sheet.png")
    with Image.open(tmp_path / "sheet.png") as sheet:
        codes = np.asarray(sheet)
    half = codes.shape[1] // 2
    assert (codes[60:, :half] == 0).mean() > 0.5
    assert (codes[60:, half:] == 0).mean() < 0.1


def test_small_pictures_have_a_sheet_too(demo, picture, tmp_path):
    demo.contact_sheet({"before": picture[:50, :60]}, tmp_path / "sheet.png")
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.width >= 60


@pytest.mark.parametrize("name", ["coffee", "flower"])
def test_shipped_photos_state_their_focal_length(demo, tmp_path, name):
    demo.save_with_lens(demo.shipped_photo(name), tmp_path / "a.png")
    photo = read_photo(tmp_path / "a.png")
    assert photo.metadata.tags().focal_35mm == demo.FILM_MM
    assert photo.shape[1] >= 600
