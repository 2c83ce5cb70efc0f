"""What the paths along a kernel are worth: the price of the breadth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from deshake.blind.camera_path import SmoothPath
from deshake.blind.judge import Judge
from deshake.blind.path_worth import PathWorth, log_breadth
from deshake.blind.settings import SETTINGS
from deshake.blind.spectral_match import SpectralMatch, match_of_path, mean_match
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.run import Run

CAMERA = Camera.from_focal(420.0, 300, 420)
LEAST = SETTINGS.path_worth.least_breadth


def cross(*halves: float) -> RotationKernel:
    """Six rotations, two about each axis, at distances in grid steps."""
    theta = np.concatenate([np.diag(halves), -np.diag(halves)]) * grid_steps(CAMERA)
    return RotationKernel(theta, np.full(6, 1 / 6), grid_steps(CAMERA), CAMERA)


def expected(*halves: float) -> float:
    """Return the logarithm of the product of the two smaller standard deviations."""
    variances = sorted(half**2 / 3 for half in halves)[:2]
    return sum(math.log(variance + LEAST**2) / 2 for variance in variances)


@pytest.mark.parametrize("halves", [(9, 3, 1), (1, 9, 3), (3, 1, 9), (9, 9, 9), (9, 3, 0)])
def test_the_breadth_is_that_of_the_two_narrower_axes(halves) -> None:
    assert log_breadth(cross(*halves)) == pytest.approx(expected(*halves))


def test_neither_the_length_nor_the_direction_nor_the_place_is_breadth() -> None:
    kernel = cross(9, 3, 1)
    breadth = log_breadth(kernel)
    assert log_breadth(cross(18, 3, 1)) == pytest.approx(breadth)
    assert log_breadth(cross(9, 6, 2)) > breadth + 1
    places = (kernel.theta / kernel.steps)[:, [1, 2, 0]] + [3, -2, 5]
    turned = replace(kernel, theta=places * kernel.steps)
    assert log_breadth(turned) == pytest.approx(breadth)


def test_weights_count() -> None:
    kernel = cross(9, 3, 1)
    heavy = replace(kernel, weights=np.array([0.1, 0.3, 0.1, 0.1, 0.3, 0.1]))
    assert log_breadth(heavy) > log_breadth(kernel)


def test_all_scales_are_alike_but_no_detail_within_a_step_counts() -> None:
    twice = log_breadth(cross(400, 80, 40)) - log_breadth(cross(200, 40, 20))
    assert twice == pytest.approx(2 * math.log(2), abs=1e-3)
    assert log_breadth(cross(9, 0, 0)) == pytest.approx(2 * math.log(LEAST))
    assert log_breadth(cross(9, 0.2, 0)) - log_breadth(cross(9, 0.1, 0)) < 0.03


@pytest.mark.parametrize("price", [0.0, 0.3])
def test_the_price_counts_in_full_and_near_a_path(shake, monkeypatch, price) -> None:
    photo = shake(CAMERA, path=np.array([[0.0, -9, 0], [3, 0, 0], [-2, 9, 0]]))
    judges = Judge.batches(photo.pyramid, 0, photo.kernel)
    spectra = [SpectralMatch(photo.pyramid, 0, "fitted")]
    worth = PathWorth(judges, spectra, 0.5, photo.camera, Run(1))
    priced = replace(SETTINGS.path_worth, price_of_breadth=price)
    monkeypatch.setattr("deshake.blind.path_worth._S", priced)
    path = SmoothPath.through(photo.kernel, photo.camera)[0]
    kernel = path.kernel(photo.camera)
    cost = price * log_breadth(kernel)
    match = 0.5 * mean_match(spectra, kernel)
    margin = float(np.mean([judge.margin(kernel) for judge in judges]))
    assert worth.of(kernel) == pytest.approx(margin + match - cost)
    assert len(judges) > 1
    near = judges[1].margin(kernel) + 0.5 * match_of_path(spectra, path)[0] - cost
    assert worth.around(1, path)(path) == pytest.approx(near)
