from __future__ import annotations

import numpy as np
import pytest
from bench.cases.rendering import disk
from bench.cases.shipped import SHIPPED
from bench.errors import MissingDataError
from bench.tables.sharp import CASES, Change, Result, line, prepare
from PIL import Image

from deshake.formats.transfer import Srgb, encode


@pytest.mark.parametrize("across", [3, 4.5, 10, 15])
def test_disks_are_round_and_keep_the_light(across):
    kernel = disk(across / 2)
    assert kernel.sum() == pytest.approx(1)
    assert np.array_equal(kernel, kernel.T)
    assert np.array_equal(kernel, kernel[::-1])
    assert 1 / kernel.max() == pytest.approx(np.pi * across**2 / 4, rel=0.02)


def test_sharp_photos_have_the_codes_of_their_truth(tmp_path):
    path, truth = prepare(CASES["text"], None, tmp_path / "a")
    codes = np.asarray(Image.open(path))
    assert np.array_equal(codes, SHIPPED["text"]())
    assert np.array_equal(encode(truth, Srgb(), 8), codes)
    path, truth = prepare(Change("text", 85, part=(0, 0.5, 0.5, 1)), None, tmp_path / "b")
    with Image.open(path) as part:
        assert part.size == truth.shape[::-1] == (224, 86)
        assert part.format == "JPEG"


def test_photos_out_of_focus_are_blurred_and_noisy(tmp_path):
    path, truth = prepare(Change("text", sigma=0.02, disk=9), None, tmp_path / "a")
    stored, sharp = np.asarray(Image.open(path), float), encode(truth, Srgb(), 8).astype(float)
    assert np.abs(np.diff(stored)).max() < 0.6 * np.abs(np.diff(sharp)).max()
    assert np.std(np.diff(stored)) > 1.3 * 0.02 * 255
    assert stored.mean() == pytest.approx(sharp.mean(), rel=0.02)


@pytest.mark.parametrize(
    ("name", "result", "passed"),
    [
        ("text", Result(0.004, 0, 0, 0.6, 1, [], left=False), "yes"),
        ("text", Result(0.006, 0, 0, 0.6, 1, [], left=False), "NO"),
        ("text", Result(0.0, 0, 0, 0.1, 1, ["left as it is"], left=True), "yes"),
        ("coffee disk 7", Result(0.03, 24, 23.95, 0.6, 1, [], left=False), "yes"),
        ("coffee disk 7", Result(0.001, 24, 23.8, 0.6, 1, [], left=False), "NO"),
    ],
)
def test_a_line_says_whether_the_photo_became_worse(name, result, passed):
    cells = [cell.strip() for cell in line(name, result).strip("|").split("|")]
    assert cells[0] == name
    assert cells[6] == passed


def test_a_missing_photo_is_an_error(tmp_path):
    for folder in (None, tmp_path):
        with pytest.raises(MissingDataError, match=r"no houses.jpg; --data names its folder"):
            prepare(CASES["houses"], folder, tmp_path / "a")
