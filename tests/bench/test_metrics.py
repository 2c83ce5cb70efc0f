from __future__ import annotations

import cv2
import numpy as np
import pytest
from bench.metrics import Score, aligned, aligned_psnr, decibels, projected, psnr, ssim
from skimage import data

SIZE = (240, 180)


@pytest.fixture(scope="module")
def picture():
    small = cv2.resize(data.astronaut(), SIZE, interpolation=cv2.INTER_AREA)
    return small.astype(np.float32) / 255


def turned(picture, degrees, shift):
    motion = cv2.getRotationMatrix2D((120, 90), degrees, 1)
    motion[:, 2] += shift
    border = cv2.BORDER_REFLECT
    return cv2.warpAffine(picture, motion, SIZE, flags=cv2.INTER_CUBIC, borderMode=border)


def test_decibels():
    assert decibels(1e-3) == pytest.approx(30)
    assert decibels(255**2 / 100, peak=255) == pytest.approx(20)


def test_scores_are_of_the_chosen_pixels(picture):
    wrong = picture.copy()
    wrong[:20] += 0.1
    where = np.zeros(picture.shape[:2], bool)
    where[:20] = True
    assert psnr(wrong, picture, where) == pytest.approx(20, abs=1e-3)
    assert psnr(wrong, picture) == pytest.approx(20 + 10 * np.log10(9), abs=1e-3)
    where[:20], where[100:] = False, True
    assert ssim(wrong, picture, where) == pytest.approx(1)
    assert str(Score.of(wrong, picture)).startswith("29.54/0.9")


def test_a_turn_and_a_shift_are_forgiven_but_no_blur(picture):
    moved = turned(picture, 0.7, (1.4, -2.2))
    assert psnr(moved, picture) < 25
    assert aligned_psnr(moved, picture, 12) > 35
    assert aligned_psnr(cv2.GaussianBlur(picture, (0, 0), 3), picture, 12) < 27


def test_a_flat_picture_is_not_aligned(picture):
    flat = np.full_like(picture, 0.5)
    assert aligned(flat, picture) is flat


def test_a_homography_is_forgiven(picture):
    codes = np.rint(255 * picture).astype(np.uint8)
    corners = np.float32([[0, 0], [239, 0], [239, 179], [0, 179]])
    way = cv2.getPerspectiveTransform(
        corners, corners + np.float32([[3, 1], [2, 4], [6, 3], [4, 5]])
    )
    moved = cv2.warpPerspective(codes, way, SIZE, flags=cv2.INTER_CUBIC, borderMode=2)
    inner = np.s_[12:-12, 12:-12]
    error = np.square(projected(moved, codes)[inner] - codes[inner]).mean()
    assert error < 0.05 * np.square(moved[inner].astype(float) - codes[inner]).mean()
