from __future__ import annotations

import numpy as np
import pytest

from deshake.estimation.candidates import (
    ESTIMATE_SIDE,
    STILL,
    choose,
    edge_candidates,
    reduced,
)
from deshake.estimation.edges import EdgeSetting
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur

MARGIN = 16


@pytest.fixture(scope="module")
def shaken(sharp) -> tuple[np.ndarray, RotationKernel]:
    camera = Camera.from_focal(240.0, 200 - 2 * MARGIN, 260 - 2 * MARGIN)
    path = np.array([[-1.0, -4, -2], [0, 0, 0], [2, 1, 0], [1, 4, 3]]) * grid_steps(camera)
    kernel = RotationKernel.from_path(path, camera).centred()
    return ShakeBlur(kernel, margin=MARGIN, kind="warps").forward(sharp), kernel


def test_the_best_candidate_is_chosen(shaken) -> None:
    grey, true = shaken
    short = RotationKernel(true.theta * 0.4, true.weights, true.steps, true.camera)
    choice = choose(grey, {"short": short, "true": true}, threads=1)
    assert choice.name == "true"
    assert choice.kernel is true
    assert set(choice.scores) == {STILL, "short", "true"}
    assert choice.scores["true"].total == min(s.total for s in choice.scores.values())
    assert choice.confidence > 0.9


def test_a_kernel_that_spoils_the_photo_is_not_trusted(sharp, shaken) -> None:
    _, true = shaken
    grey = sharp[MARGIN:-MARGIN, MARGIN:-MARGIN]  # which is sharp already
    choice = choose(grey, {"blur": true}, threads=1)
    assert choice.name == "blur"
    assert choice.confidence < 0.1


def test_no_candidates_are_an_error(sharp) -> None:
    with pytest.raises(ValueError, match="no kernel"):
        choose(sharp, {})


def test_one_kernel_for_each_setting(shaken) -> None:
    grey, true = shaken
    settings = [EdgeSetting("a", 4e-2, 5e-3, 3), EdgeSetting("b", 8e-2, 2e-2, 4)]
    seen: list[float] = []
    estimates = edge_candidates(
        grey,
        true.camera,
        settings=settings,
        blur_px=12,
        threads=1,
        progress=lambda share, _: seen.append(share),
    )
    assert list(estimates) == ["a", "b"]
    kernels = {name: found.kernel for name, found in estimates.items()}
    assert all(kernel.camera is true.camera for kernel in kernels.values())
    assert seen == sorted(seen)
    assert seen[-1] == 1
    assert choose(grey, kernels, threads=1).confidence > 0.5


def test_settings_without_roll_turn_about_two_axes(shaken) -> None:
    grey, true = shaken
    settings = [
        EdgeSetting("free", 8e-2, 2e-2, 3),
        EdgeSetting("level", 8e-2, 2e-2, 3, roll=False),
    ]
    ranges = {
        name: np.ptp(found.kernel.theta, axis=0)
        for name, found in edge_candidates(
            grey, true.camera, settings=settings, blur_px=8, threads=1
        ).items()
    }
    assert ranges["free"][2] >= true.steps[2]
    assert ranges["level"][2] < 1e-2 * true.steps[2]
    assert (ranges["level"][:2] > 0).any()
    level_only = edge_candidates(
        grey, true.camera, settings=settings, axes=(True, True, False), blur_px=8, threads=1
    )
    assert list(level_only) == ["free"]  # the other would be the same


def test_large_photos_are_reduced() -> None:
    camera = Camera.from_focal(900.0, 500, 1000)
    grey = np.random.default_rng(0).random((500, 1000)).astype(np.float32)
    usable = np.ones(grey.shape, bool)
    usable[100:120, 300:320] = False
    small, smaller, known = reduced(grey, camera, usable, ESTIMATE_SIDE)
    assert small.shape == known.shape == smaller.shape == (320, 640)
    assert smaller.focal_px == pytest.approx(900 * 0.64)
    assert not known[66:75, 194:203].any()
    assert known[:60].all()
    same, kept, _ = reduced(small, smaller, None, ESTIMATE_SIDE)
    assert same is small
    assert kept is smaller
