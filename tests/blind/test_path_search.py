"""The search for the path of a camera along a kernel that is nearly right."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.path_search import searched
from deshake.blind.settings import SETTINGS
from deshake.blind.spectral_match import SpectralMatch
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.blind.camera_path import SmoothPath

FINE = 0.06  # share of the kernel's spread: smoothing of a strict agreement
THERE_AND_BACK = np.array(
    [[0.2, -9.4, 0], [1.3, 0, 0], [2.4, 9.1, 0], [-2.2, 7.8, 0], [-3.4, 1.1, 0]]
)
"""Grid steps, with no two places at equal distances: there rounding would decide."""


@pytest.fixture(scope="module")
def folded(shake):
    """A photo of a camera that went there and back."""
    return shake(Camera.from_focal(420.0, 300, 420), path=THERE_AND_BACK)


@pytest.fixture(scope="module")
def band(folded, widened) -> RotationKernel:
    """Its kernel, so wide that the two strokes are one band."""
    return widened(folded.kernel, 1.5)


@pytest.fixture(scope="module")
def scales(folded) -> list[SpectralMatch]:
    return [SpectralMatch(folded.pyramid, 0, "fitted")]


def nearness(kernel: RotationKernel, truth: RotationKernel) -> float:
    return agreement(kernel, truth, smoothing=FINE)


def never(_number: int, _middle: SmoothPath) -> Callable[[SmoothPath], float]:
    """Measure no generation, because there is none."""
    raise AssertionError


def along(folded, band, scales, run=Run()) -> RotationKernel:
    """Search for a path that is as near to the true kernel as possible."""

    def worth(kernel: RotationKernel) -> float:
        return nearness(kernel, folded.kernel)

    def around(_number: int, middle: SmoothPath) -> Callable[[SmoothPath], float]:
        assert nearness(middle.kernel(band.camera), folded.kernel) > 0.5
        return lambda path: worth(path.kernel(band.camera))

    path = searched(band, scales, worth=worth, around=around, least=-math.inf, run=run)
    assert path is not None
    return path


def test_a_path_that_goes_there_and_back_is_found_in_a_band(folded, band, scales) -> None:
    path = along(folded, band, scales)
    assert path.camera is band.camera
    np.testing.assert_allclose(path.steps, grid_steps(folded.camera))
    assert np.ptp(path.theta[:, 2]) == 0  # the band has no roll
    assert nearness(path, folded.kernel) > nearness(band, folded.kernel) + 0.05
    assert nearness(path, folded.kernel) > 0.97


def test_without_folds_and_evolution_it_ends_farther(folded, band, scales, monkeypatch) -> None:
    whole = along(folded, band, scales)
    usual = SETTINGS.path_search
    ends = []
    for changed in (replace(usual, shares=()), replace(usual, evaluations=1)):
        monkeypatch.setattr("deshake.blind.path_search._S", changed)
        ends.append(nearness(along(folded, band, scales), folded.kernel))
    assert max(ends) < nearness(whole, folded.kernel) - 0.002


def test_folded_paths_take_part(folded, widened, scales, monkeypatch) -> None:
    """Two ends, three lengths of the part that is passed twice, and two sides.

    In a narrower band, rounding may decide which of the paths comes nearest.
    """
    monkeypatch.setattr(
        "deshake.blind.path_search._S", replace(SETTINGS.path_search, evaluations=1)
    )
    seen: list[RotationKernel] = []
    searched(
        widened(folded.kernel, 2.0),
        scales,
        worth=lambda kernel: float(seen.append(kernel) or 0),
        around=lambda *_: lambda _path: 0.0,
        least=-math.inf,
        run=Run(1),
    )
    near = [nearness(kernel, folded.kernel) for kernel in seen[:13]]
    assert max(near[1:]) > near[0] + 0.005


def test_there_is_no_path_along_a_point(folded, scales) -> None:
    point = RotationKernel.delta(folded.camera)
    measures = {"worth": lambda _: 0.0, "around": never, "least": -math.inf}
    assert searched(point, scales, **measures, run=Run()) is None


def test_there_is_no_evolution_without_hope(folded, band, scales, monkeypatch) -> None:
    """The best of the paths that are ranked counts, with which it would begin."""
    monkeypatch.setattr(
        "deshake.blind.path_search._S", replace(SETTINGS.path_search, evaluations=1)
    )
    ranked: list[float] = []

    def worth(kernel: RotationKernel) -> float:
        ranked.append(nearness(kernel, folded.kernel))
        return ranked[-1]

    def ended(least: float, around: Callable[..., Callable[[SmoothPath], float]]) -> object:
        return searched(band, scales, worth=worth, around=around, least=least, run=Run(1))

    assert ended(math.inf, never) is None
    best = max(ranked)
    assert ended(best + 1e-6, never) is None
    assert ended(best - 1e-6, lambda *_: lambda _path: 0.0) is not None


def test_the_result_does_not_depend_on_the_threads(folded, band, scales, monkeypatch) -> None:
    monkeypatch.setattr(
        "deshake.blind.path_search._S", replace(SETTINGS.path_search, evaluations=30)
    )
    one, two = (along(folded, band, scales, Run(threads)) for threads in (1, 2))
    np.testing.assert_array_equal(one.theta, two.theta)
    np.testing.assert_array_equal(one.weights, two.weights)
