from __future__ import annotations

import cv2
import figure7
import numpy as np
import pytest
from PIL import Image
from skimage import data

from deshake.formats.photo import read_photo


@pytest.fixture
def pair(tmp_path):
    """Write a photo blurred by five pixels, and a noisy one at a third of its light."""
    light = cv2.resize(data.coffee()[:, 60:540], (128, 106), interpolation=cv2.INTER_AREA) / 255.0
    noisy = light[:, 4:-4] / 3 + np.random.default_rng(0).normal(0, 0.01, (106, 120, 3))
    for name, picture in (("blurred", cv2.blur(light, (5, 1))[:, 4:-4]), ("noisy", noisy)):
        codes = np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8)
        Image.fromarray(codes).save(tmp_path / f"{name}.png")
    return tmp_path / "blurred.png", tmp_path / "noisy.png"


def run(*args):
    return figure7.main([str(arg) for arg in args])


def test_a_sheet_of_a_pair(pair, tmp_path):
    output = tmp_path / "sheet.png"
    args = ("--focal-35mm", 40, "--blur-size", 7, "--beside", pair[1], "--width", 120)
    assert run(*pair, *args, "-o", output) == 0
    with Image.open(output) as page:
        assert page.width == 5 * (120 + 8) + 8
        assert page.height > 300


def test_yellow_lines_are_painted_over(tmp_path):
    codes = np.full((60, 80, 3), (70, 90, 60), np.uint8)
    codes[:, 60:] = (90, 85, 30)  # a dull yellow, part of the scene
    sharp = codes.copy()
    cv2.rectangle(codes, (20, 20), (50, 45), (183, 178, 0), 1)
    Image.fromarray(codes).save(tmp_path / "a.png")
    picture = figure7.shown(figure7.without_boxes(read_photo(tmp_path / "a.png")))
    assert np.abs(picture.astype(int) - sharp).max() <= 3


def test_another_picture_is_brought_to_the_size(pair):
    assert figure7.others(pair[0], (53, 60, 3)).shape == (53, 60, 3)
    assert figure7.others(pair[0], (106, 120, 3)).shape == (106, 120, 3)


def test_another_scene_is_an_error(pair, tmp_path, capsys):
    other = cv2.resize(data.astronaut(), (120, 106), interpolation=cv2.INTER_AREA)
    Image.fromarray(other).save(tmp_path / "other.png")
    assert run(pair[0], tmp_path / "other.png", "-o", tmp_path / "sheet.png") == 1
    assert "do not show the same scene" in capsys.readouterr().err
    assert not (tmp_path / "sheet.png").exists()


@pytest.mark.parametrize("output", ["sheet.gif", "noisy.png"])
def test_the_sheet_is_a_picture_of_its_own(pair, tmp_path, capsys, output):
    before = pair[1].read_bytes()
    assert run(*pair, "-o", tmp_path / output) == 1
    assert capsys.readouterr().err.startswith("error: ")
    assert pair[1].read_bytes() == before


@pytest.mark.parametrize(
    "args", [(), ("a.png",), ("--case", "coffee 20 px, 0.06"), ("--case", "no such")]
)
def test_a_pair_must_be_named(args, tmp_path):
    with pytest.raises(SystemExit) as stop:
        run(*args, "-o", tmp_path / "sheet.png")
    assert stop.value.code == 2


def test_missing_logs_are_reported(tmp_path, capsys):
    case = next(iter(figure7.PAIRS))
    assert run("--case", case, "--data", tmp_path, "-o", tmp_path / "s.png") == 1
    assert "no orientation logs" in capsys.readouterr().err
