from __future__ import annotations

import importlib.util
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.io import savemat
from scipy.ndimage import correlate
from skimage import data

from deshake.geometry.camera import Camera
from deshake.operators.filter_flow import FilterFlow
from deshake.run import Run


@pytest.fixture(scope="module")
def figure6():
    path = Path(__file__).parents[2] / "scripts" / "figure6.py"
    spec = importlib.util.spec_from_file_location("figure6", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def sharp():
    small = cv2.resize(data.camera()[:400, 50:450], (200, 185), interpolation=cv2.INTER_AREA)
    return small.astype(np.float32) / 255


@pytest.fixture(scope="module")
def smear():
    """Return a kernel that every flip and turn changes, its centroid off the middle."""
    kernel = np.zeros((5, 7))
    kernel[0, 1:4], kernel[1:3, 4], kernel[3, 6] = (0.1, 0.2, 0.1), 0.2, 0.2
    return kernel


def moved(image, right, down):
    """Return an image whose pixel (x, y) shows what was at (x - right, y - down)."""
    move = np.array([[1.0, 0, right], [0, 1, down]])
    return cv2.warpAffine(image, move, image.shape[::-1], borderMode=cv2.BORDER_REFLECT)


def error_of(figure6, quarters):
    return figure6.Error(quarters, 2 * quarters)


def test_patterns_choose_cases(figure6, tmp_path):
    for name in ("im05_flit01", "im05_flit02", "im06_flit02", "other"):
        (tmp_path / f"{name}.mat").touch()

    def names(patterns):
        return [path.stem for path in figure6.matching_files(tmp_path, patterns)]

    assert names("*") == ["im05_flit01", "im05_flit02", "im06_flit02"]
    assert names("im06*, im05_flit01") == ["im05_flit01", "im06_flit02"]
    assert names("im06") == []


def test_the_true_kernel_correlates(figure6, sharp, smear):
    kernel = figure6.true_kernel(smear, Camera.uniform(*sharp.shape))
    flow = FilterFlow(kernel.camera, kernel.theta, run=Run(1))
    latent = np.pad(sharp, flow.margin, mode="reflect")
    blurred = flow.filters(kernel.weights).forward(latent[None])[0]
    expected = correlate(sharp, smear.astype(np.float32), mode="mirror")
    np.testing.assert_allclose(blurred, expected, atol=1e-3)


@pytest.mark.parametrize("shift", [(0, 0), (3, -2), (-20, 11)])
def test_whole_pixels_cost_nothing(figure6, sharp, shift):
    error = figure6.shifted_error(moved(sharp, *shift), sharp)
    assert error.whole == pytest.approx(0, abs=1e-10)
    assert error.quarters <= error.whole


@pytest.mark.parametrize("shift", [(0.25, 0), (-2.5, 1.75)])
def test_quarters_of_a_pixel_are_tried(figure6, sharp, shift):
    smooth = cv2.GaussianBlur(sharp, (0, 0), 2)
    error = figure6.shifted_error(moved(smooth, *shift), smooth)
    assert error.quarters < 0.1 * error.whole


def test_errors_are_of_the_interior(figure6, sharp):
    b = figure6.BORDER
    noise = np.random.default_rng(0).normal(0, 0.1, sharp.shape).astype(np.float32)
    assert figure6.shifted_error(sharp + noise, sharp).whole == pytest.approx(0.01, rel=0.1)
    noise[b:-b, b:-b] = 0
    assert figure6.shifted_error(sharp + noise, sharp).whole == pytest.approx(0, abs=1e-10)


def test_the_ratio_is_that_of_squared_errors(figure6):
    errors = [error_of(figure6, e) for e in (3e-3, 1e-3, 1e-2)]
    scored = figure6.Errors(*errors, "fine", 1.0)
    assert scored.ratio == pytest.approx(3)
    assert str(scored.true) == "30.00 (26.99)"


def test_the_table_counts_ratios(figure6):
    scores = {
        f"im05_flit0{i}": figure6.Errors(
            error_of(figure6, ratio * 1e-3), error_of(figure6, 1e-3), error_of(figure6, 1e-2),
            "fine", 2.0 * i,
        )
        for i, ratio in ((2, 2.5), (1, 1.0))
    }  # fmt: skip
    lines = figure6.table(scores, "edges").splitlines()
    assert {line.count("|") for line in lines} == {8}
    assert [line.split("|")[1].strip() for line in lines[2:]] == [*sorted(scores), "mean"]
    cells = [cell.strip() for cell in lines[-1].split("|")][1:-1]
    assert cells[1] == "28.01 (25.00)"  # half of 4 dB below the true kernel's
    assert cells[4] == "1 <= 2, 2 <= 3 of 2"
    assert cells[6] == "3.0"


def test_a_case_is_scored(figure6, sharp, smear, tmp_path, monkeypatch):
    monkeypatch.setattr(figure6, "BORDER", 16)
    sharp = cv2.resize(sharp, (140, 130), interpolation=cv2.INTER_AREA)
    blurred = correlate(sharp, smear.astype(np.float32), mode="mirror")
    path = tmp_path / "im01_flit01.mat"
    savemat(path, {"x": sharp, "y": blurred, "f": smear})
    scored = figure6.score(path, figure6.Way("edges"))
    assert scored.true.quarters < 0.5 * scored.blurred.quarters
    assert scored.estimated.quarters < scored.blurred.quarters
    assert "start " in scored.name
    assert scored.seconds > 0


def test_missing_cases_are_reported(figure6, tmp_path, capsys):
    assert figure6.main(["--data", str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"error: {tmp_path}: ")
    assert "--data names the folder" in err
