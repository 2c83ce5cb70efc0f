from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.blind.edge_spread import edge_spread
from deshake.geometry.camera import Camera
from deshake.signal.pyramid import Pyramid


def of(grey: np.ndarray, clipped: np.ndarray | None = None) -> Pyramid:
    camera = Camera.from_focal(600.0, *grey.shape)
    return Pyramid(np.ascontiguousarray(grey, np.float32), camera, clipped)


@pytest.fixture(scope="module")
def polygons() -> np.ndarray:
    """Large shapes with straight edges in all directions; four pixels are one pixel's light."""
    rng = np.random.default_rng(3)
    fine = np.full((1200, 1200), 0.3, np.float32)
    for _ in range(40):
        angle = rng.uniform(0, 360)
        box = cv2.boxPoints((rng.uniform(0, 1200, 2), rng.uniform(160, 400, 2), angle))
        cv2.fillPoly(fine, [box.astype(np.int32)], float(rng.uniform(0.05, 0.9)))
    return cv2.resize(fine, (600, 600), interpolation=cv2.INTER_AREA)


@pytest.mark.parametrize("sigma", [1.0, 2.0])
def test_measures_a_round_blur(polygons, sigma) -> None:
    blurred = np.square(cv2.GaussianBlur(np.sqrt(polygons), (0, 0), sigma))
    spread = edge_spread(of(blurred))
    assert spread.longer == pytest.approx(sigma, rel=0.25)
    assert spread.shorter == pytest.approx(sigma, rel=0.25)


def test_a_motion_spreads_edges_along_it(polygons) -> None:
    spread = edge_spread(of(cv2.blur(polygons, (7, 1))))
    assert 1.5 < spread.longer < 3  # its standard deviation is 2; Gaussians alone are exact
    assert spread.shorter < 0.5 * spread.longer


def test_sharp_edges_have_no_spread(polygons) -> None:
    assert edge_spread(of(polygons)).longer < 0.7


def test_a_photo_without_edges_has_no_spread(polygons) -> None:
    noise = 0.3 + 0.02 * np.random.default_rng(0).normal(size=(200, 200))
    assert edge_spread(of(noise)) is None
    assert edge_spread(of(polygons, np.ones(polygons.shape, bool))) is None
