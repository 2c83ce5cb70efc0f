from __future__ import annotations

import argparse

import cv2
import numpy as np
import pytest
from bench.errors import MissingDataError
from bench.tables.replayed_results import narrow_means, results_in, run, score, sharp_scene
from skimage import data


@pytest.fixture(scope="module")
def scene() -> np.ndarray:
    return cv2.resize(data.astronaut()[..., ::-1], (256, 256), interpolation=cv2.INTER_AREA)


def moved(picture: np.ndarray, x: float, y: float, brighter: float = 1.0) -> np.ndarray:
    shift = np.float32([[1, 0, x], [0, 1, y]])
    size = picture.shape[1::-1]
    other = cv2.warpAffine(picture, shift, size, borderMode=cv2.BORDER_REPLICATE)
    return np.rint(other * brighter).astype(np.uint8)


def test_motion_and_brightness_do_not_count(scene) -> None:
    assert score(moved(scene, 3, -2, 0.9), scene) > 38
    soft = cv2.GaussianBlur(scene, (0, 0), 1.5)
    assert score(soft, scene) < 30


def test_the_truth_is_the_mean_of_other_narrow_shakes(scene) -> None:
    wrong = np.full_like(scene, 7)
    results = {1: [scene, moved(scene, 2, 1)], 2: [wrong, wrong], 8: [wrong, wrong]}
    sharp = sharp_scene(narrow_means(results), 2)
    assert score(sharp, scene) > 35
    with pytest.raises(MissingDataError, match="no other narrow shake"):
        narrow_means({2: [scene], 8: [scene]})


def test_results_of_programs_are_scored_side_by_side(tmp_path, capsys, scene) -> None:
    for name, sigma in (("sharper", 0.6), ("softer", 2.0)):
        (tmp_path / name).mkdir()
        for shake in (1, 2, 8):
            result = cv2.GaussianBlur(scene, (0, 0), sigma if shake == 8 else 0.4 + sigma / 9)
            cv2.imwrite(str(tmp_path / name / f"Blurry1_{shake}.{name}.png"), result)
        (tmp_path / name / "Blurry1_1.kernel.npz").write_bytes(b"")
    folders = [tmp_path / name for name in ("sharper", "softer")]
    assert sorted(results_in(folders[0])) == [(1, 1), (1, 2), (1, 8)]
    assert run(argparse.Namespace(results=folders)) == 0
    lines = [line.strip("| ").split(" | ") for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == ["photo", "sharper", "softer"]
    assert [line[0] for line in lines[2:]] == ["1_1", "1_2", "1_8", "mean"]
    better, worse = map(float, lines[4][1:])
    assert better > worse + 5


def test_folders_without_results_are_named(tmp_path) -> None:
    with pytest.raises(MissingDataError, match="--results names a folder of results"):
        results_in(tmp_path)
    (tmp_path / "Blurry1_1.png").write_bytes(b"no picture")
    with pytest.raises(MissingDataError, match="is no picture"):
        run(argparse.Namespace(results=[tmp_path]))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "Blurry1_2.png").write_bytes(b"")
    with pytest.raises(MissingDataError, match="no photo has a result in all folders"):
        run(argparse.Namespace(results=[tmp_path, tmp_path / "other"]))
