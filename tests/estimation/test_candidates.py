from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from deshake.blind.kernel_faults import is_point
from deshake.estimation.candidates import (
    STILL,
    choose,
    edge_candidates,
    is_at_rest,
    reduced,
)
from deshake.estimation.edge_settings import EAGER
from deshake.estimation.edges import EdgeSetting
from deshake.estimation.judge import margin
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
    margins = {name: margin(one, choice.scores[STILL]) for name, one in choice.scores.items()}
    assert margins["true"] == max(margins.values())
    assert choice.confidence > 0.9


def test_a_kernel_that_spoils_the_photo_is_not_trusted(sharp, shaken) -> None:
    _, true = shaken
    grey = sharp[MARGIN:-MARGIN, MARGIN:-MARGIN]  # which is sharp already
    choice = choose(grey, {"blur": true}, threads=1)
    assert choice.name == "blur"
    assert choice.confidence < 0.1


def test_a_mere_point_must_be_better_by_a_margin(sharp, shaken) -> None:
    _, true = shaken
    grey = sharp[MARGIN:-MARGIN, MARGIN:-MARGIN]  # the less of any shake, the better
    indices = 2 * true.indices
    away = np.abs(indices).max(1) > 1

    def kernel(rest: float) -> RotationKernel:
        shares = np.append(true.weights[away] / true.weights[away].sum() * (1 - rest), rest)
        places = np.concatenate([indices[away], [[0, 0, 0]]])
        return RotationKernel.from_indices(places, shares, true.steps, true.camera)

    point, path = kernel(0.905), kernel(0.895)
    assert is_point(point)
    assert not is_point(path)
    choice = choose(grey, {"point": point, "path": path}, threads=1)
    still = choice.scores[STILL]
    ahead = margin(choice.scores["point"], still) - margin(choice.scores["path"], still)
    assert 0 < ahead < 0.01
    assert choice.name == "path"
    assert choose(grey, {"point": point, "worse": kernel(0.5)}, threads=1).name == "point"


def test_a_photo_is_at_rest_if_it_is_sharp_and_most_kernels_are_points(sharp, shaken) -> None:
    grey, true = shaken
    still = sharp[MARGIN:-MARGIN, MARGIN:-MARGIN]
    point = RotationKernel.delta(true.camera)
    mostly = {"a": point, "b": point, "c": true}
    assert is_at_rest(still, mostly)
    assert not is_at_rest(still, {"a": point, "b": true, "c": true})
    eager = dict.fromkeys(EAGER, true)
    assert is_at_rest(still, mostly | eager)
    assert not is_at_rest(still, {"c": true} | dict.fromkeys(EAGER, point))
    assert is_at_rest(still, dict.fromkeys(EAGER, point))  # where there is no other
    surely = cv2.addWeighted(still, 1.5, cv2.GaussianBlur(still, (0, 0), 1), -0.5, 0)
    assert is_at_rest(surely, {"a": true, "b": true})
    soft = cv2.GaussianBlur(still, (0, 0), 0.53)
    assert is_at_rest(soft, {"a": point, "b": point})
    assert not is_at_rest(soft, mostly)
    assert not is_at_rest(grey, mostly)


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


def test_translations_are_taken_for_turns_that_blur_as_they_do(sharp) -> None:
    camera = Camera.from_focal(240.0, 200 - 2 * MARGIN, 260 - 2 * MARGIN)
    path = np.array([[-1.0, -4, 0], [0, 0, 0], [2, 1, 0], [1, 4, 0]]) * grid_steps(camera)
    kernel = RotationKernel.from_path(path, camera).centred()
    grey = ShakeBlur(kernel, margin=MARGIN, kind="warps").forward(sharp)
    settings = [EdgeSetting("u", 8e-2, 2e-3, 3, uniform=True), EdgeSetting("v", 8e-2, 2e-3, 3)]
    how = {"settings": settings, "blur_px": 12, "threads": 1}
    turned = edge_candidates(grey, camera, **how)["u"].kernel
    assert turned.camera is camera
    assert np.ptp(turned.theta[:, 2]) == 0
    same = edge_candidates(grey, Camera.uniform(*grey.shape), axes=(True, True, False), **how)
    assert list(same) == ["u"]  # the other would be the same
    points = np.array([[x, y] for x in (8, 61, 114, 166, 219) for y in (8, 84, 159)])
    moved, shifted = (
        np.sqrt(((found.displacements(points) ** 2).sum(-1) @ found.weights).mean())
        for found in (turned, same["u"].kernel)
    )
    assert moved == pytest.approx(shifted, rel=0.05)
    blurred = ShakeBlur(turned, margin=MARGIN).forward(sharp)
    still = sharp[MARGIN:-MARGIN, MARGIN:-MARGIN]
    assert np.square(blurred - grey).mean() < 0.15 * np.square(still - grey).mean()


def test_settings_work_at_their_own_size_and_tones(shaken) -> None:
    grey, true = shaken
    setting = EdgeSetting("a", 8e-2, 5e-3, 3, roll=False)
    settings = [
        setting,
        replace(setting, name="small", side=grey.shape[1] // 2),
        replace(setting, name="tones", gamma=2.2),
        replace(setting, name="same"),
    ]
    axes = (True, True, False)
    found = edge_candidates(grey, true.camera, settings=settings, axes=axes, blur_px=12, threads=1)
    assert list(found) == ["a", "small", "tones"]
    assert found["a"].latent.shape[1:] == grey.shape
    assert found["small"].latent.shape[2] == grey.shape[1] // 2
    assert found["small"].kernel.camera is true.camera
    light, tones = found["a"].latent, found["tones"].latent
    assert not np.array_equal(found["tones"].kernel.theta, found["a"].kernel.theta)
    assert np.std(tones) == pytest.approx(np.std(light), rel=0.3)  # both in linear light


def test_large_photos_are_reduced() -> None:
    camera = Camera.from_focal(900.0, 500, 1000)
    grey = np.random.default_rng(0).random((500, 1000)).astype(np.float32)
    usable = np.ones(grey.shape, bool)
    usable[100:120, 300:320] = False
    small, smaller, known = reduced(grey, camera, usable, 640)
    assert small.shape == known.shape == smaller.shape == (320, 640)
    assert smaller.focal_px == pytest.approx(900 * 0.64)
    assert not known[66:75, 194:203].any()
    assert known[:60].all()
    same, kept, _ = reduced(small, smaller, None, 640)
    assert same is small
    assert kept is smaller
