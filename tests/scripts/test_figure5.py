from __future__ import annotations

import importlib.util
from argparse import ArgumentTypeError
from pathlib import Path

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.geometry.camera import Camera
from deshake.geometry.rotations import grid_steps, homographies


@pytest.fixture(scope="module")
def figure5():
    path = Path(__file__).parents[2] / "scripts" / "figure5.py"
    spec = importlib.util.spec_from_file_location("figure5", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def sharp():
    small = cv2.resize(data.camera()[60:444], (160, 120), interpolation=cv2.INTER_AREA)
    return small.astype(np.float32)


def test_cells_are_read(figure5):
    assert figure5.parse_cells("Y10s0, Z30s5") == [("Y", 10, 0), ("Z", 30, 5)]
    assert ",".join(map(str, figure5.parse_cells("Y10s0,Z30s5"))) == "Y10s0,Z30s5"
    for text in ("X10s0", "Y10", "", "Y10s0;Z10s0"):
        with pytest.raises(ArgumentTypeError):
            figure5.parse_cells(text)


def test_all_cells_are_the_papers(figure5):
    named = {(cell.axis, cell.sigma, model) for cell in figure5.CELLS for model in figure5.MODELS}
    assert named == set(figure5.PAPER)
    assert len(figure5.CELLS) == 18


@pytest.mark.parametrize("axis", ["Y", "Z"])
def test_the_blur_is_as_wide_as_asked(figure5, sharp, axis):
    photo, true = figure5.shaken(sharp, figure5.Cell(axis, 20, 0), 0)
    other = "YZ".index(axis) ^ 1
    assert np.all(true.theta[:, 0] == 0)
    assert np.all(true.theta[:, 1 + other] == 0)
    assert true.camera.focal_px == 160
    farthest = np.linalg.norm(true.displacements([[0, 0], [159, 60]]), axis=-1)
    assert 2 * farthest.max() == pytest.approx(20, abs=1.5)
    inner = true.weights[2:-2]
    np.testing.assert_allclose(inner, inner.mean(), rtol=0.1)  # uniform speed
    assert photo.dtype == np.float32
    np.testing.assert_array_equal(photo, np.round(photo))


def test_noise_is_seeded_and_clipped(figure5, sharp):
    cell = figure5.Cell("Z", 10, 10)
    photo, _ = figure5.shaken(sharp, cell, 3)
    again, _ = figure5.shaken(sharp, cell, 3)
    other, _ = figure5.shaken(sharp, cell, 4)
    clean, _ = figure5.shaken(sharp, figure5.Cell("Z", 10, 0), 3)
    np.testing.assert_array_equal(photo, again)
    middle = (clean > 50) & (clean < 200)
    assert np.std((photo - clean)[middle]) == pytest.approx(10, rel=0.05)
    assert np.std((photo - other)[middle]) == pytest.approx(14, rel=0.05)
    assert photo.min() >= 0
    assert photo.max() <= 255


@pytest.mark.parametrize("angles", [(2.5, -3.0, 1.5), (-0.4, 0.3, -3.0), (0.0, 0.0, 0.0)])
def test_errors_forgive_a_turn_but_no_noise(figure5, sharp, angles):
    camera = Camera.from_focal(160, 120, 160)
    h = homographies(camera, np.array(angles) * grid_steps(camera))
    turned = cv2.warpPerspective(
        sharp, h, (160, 120), flags=cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    noise = np.random.default_rng(0).normal(0, 20, sharp.shape).astype(np.float32)
    assert figure5.aligned_rms(turned, sharp) < 1
    assert figure5.aligned_rms(turned + noise, sharp) == pytest.approx(20, rel=0.03)


def test_the_table_stands_beside_the_papers(figure5):
    scores = {(figure5.Cell("Z", 20, 5), "R"): figure5.Errors(24.0, 20.0, 30.0, 1.0)}
    lines = figure5.table(scores, "R").splitlines()
    assert len(lines) == 2 + 6
    assert {line.count("|") for line in lines} == {8}
    row = [cell.strip() for cell in lines[6].split("|")]
    assert row[1:-1] == [
        "Z, sigma 5",
        "",
        "17.4 (1.2)",
        "24.0 (1.20)",
        "23.2 (1.2)",
        "",
        "30.6 (1.3)",
    ]


def test_a_cell_is_scored(figure5, sharp):
    small = cv2.resize(sharp, (104, 78), interpolation=cv2.INTER_AREA)
    scored = figure5.score(small, figure5.Cell("Y", 5, 0), "R", 0)
    assert scored.true < scored.blurred
    assert scored.true < scored.estimated < scored.blurred


@pytest.mark.parametrize("content", [None, b"not a photo"])
def test_a_missing_photo_is_reported(figure5, tmp_path, capsys, content):
    if content:
        (tmp_path / "houses.jpg").write_bytes(content)
    assert figure5.main(["--data", str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"error: {tmp_path / 'houses.jpg'}: ")
    assert err.endswith("--data names the folder of houses.jpg\n")


def test_the_photo_must_be_named(figure5, capsys):
    with pytest.raises(SystemExit) as caught:
        figure5.main([])
    assert caught.value.code == 2
    assert "--data" in capsys.readouterr().err
