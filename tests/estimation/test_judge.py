from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.errors import EstimationError
from deshake.estimation.judge import Score, confidence, margin, score
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur

MARGIN = 20
PATHS = (
    ([-2.0, -6, -4], [0, -1, 0], [3, 1, 1], [1, 5, 5]),
    ([-5.0, 2, 3], [-1, 3, 0], [1, 0, 0], [6, -4, -3]),
)


@pytest.fixture(scope="module", params=[0, 1])
def case(request) -> tuple[np.ndarray, dict[str, RotationKernel]]:
    """A shaken photo and kernels: true, nearly, a wrong one, a long one, and none."""
    photo = (data.astronaut(), data.coffee()[:, 40:560])[request.param]
    grey = photo @ np.array([0.3, 0.59, 0.11]) / 255
    sharp = cv2.resize(grey, (340, 300), interpolation=cv2.INTER_AREA) ** 2.2
    camera = Camera.from_focal(320.0, 300 - 2 * MARGIN, 340 - 2 * MARGIN)
    steps = grid_steps(camera)
    path = np.array(PATHS[request.param]) * steps
    true = RotationKernel.from_path(path, camera).centred()
    blurred = ShakeBlur(true, margin=MARGIN, kind="warps").forward(sharp.astype(np.float32))
    noise = np.random.default_rng(0).normal(scale=0.004, size=blurred.shape)
    kernels = {
        "true": true,
        "near": RotationKernel.from_path(path * 0.85, camera).centred(),
        "short": RotationKernel.from_path(path * 0.5, camera).centred(),
        "still": RotationKernel.delta(camera),
        "long": RotationKernel.from_path(path * 1.7, camera).centred(),
        "wrong": RotationKernel.from_path(path * [-1, 1, 1], camera).centred(),
    }
    return (blurred + noise).astype(np.float32), kernels


def test_the_better_kernel_scores_less(case) -> None:
    grey, kernels = case
    found = {name: score(grey, kernel, threads=1) for name, kernel in kernels.items()}
    margins = {name: margin(one, found["still"]) for name, one in found.items()}
    assert margins["true"] > margins["short"] > margins["still"] == 0
    assert margins["near"] > margins["short"]
    assert margins["true"] > margins["long"]
    assert margins["true"] > margins["wrong"]
    assert margins["wrong"] < margins["near"]
    assert confidence(found["true"], found["still"]) > 0.9
    assert confidence(found["long"], found["still"]) < 0.5


def test_a_black_sky_is_no_sign_of_little_noise(case) -> None:
    grey, kernels = case
    night = grey.copy()
    night[:, : grey.shape[1] * 3 // 5] = 0
    true, still = (score(night, kernels[name], threads=1) for name in ("true", "still"))
    assert confidence(true, still) > 0.8


def test_exposure_and_threads_do_not_count(case) -> None:
    grey, kernels = case
    one = score(grey, kernels["near"], threads=1)
    assert score(grey, kernels["near"], threads=3) == one
    assert score(grey * np.float32(0.3), kernels["near"], threads=1) == pytest.approx(one, abs=3e-3)


def test_rotations_without_weight_do_not_count(case) -> None:
    grey, kernels = case
    near = kernels["near"]
    theta = np.concatenate([near.theta, near.theta * 5 + 0.01])
    weights = np.concatenate([near.weights, np.zeros(len(near.weights))])
    padded = RotationKernel(theta, weights, near.steps, near.camera)
    assert score(grey, padded, threads=1) == score(grey, near, threads=1)


def test_clipped_pixels_are_left_out(case) -> None:
    grey, kernels = case
    spoilt = grey.copy()
    spoilt[100:130, 100:160] = 1.0
    usable = np.ones(grey.shape, bool)
    usable[98:132, 98:162] = False
    scores = {
        name: score(spoilt, kernels[name], usable=usable, threads=1) for name in ("true", "still")
    }
    assert margin(scores["true"], scores["still"]) > 0


def test_pixels_that_no_kernel_explains_hardly_count(case) -> None:
    grey, kernels = case
    lit = grey.copy()
    lit[60:220:40, 60:260:40] += np.float32(grey.max())  # lights that were not shaken
    plain, spoilt = (
        margin(*(score(picture, kernels[name], threads=1) for name in ("true", "still")))
        for picture in (grey, lit)
    )
    assert plain > 0
    assert confidence(*(score(lit, kernels[name], threads=1) for name in ("true", "still"))) > 0.5
    assert spoilt > 0


@pytest.mark.parametrize("measure", ["energy", "sparsity"])
def test_confidence_rises_with_either_gain(measure: str) -> None:
    still = Score(-7.0, 0.0)
    gains = (-9, -0.04, 0, 0.1, 9)
    values = [
        confidence(still._replace(**{measure: getattr(still, measure) - gain}), still)
        for gain in gains
    ]
    assert values == sorted(values)
    assert values[2] == pytest.approx(confidence(still, still))
    assert values[2] < 0.1
    assert values[-1] > 1 - 1e-9
    assert confidence(Score(-7.04, 0.0), still) == pytest.approx(0.5)


def test_a_sparser_picture_outweighs_any_loss_of_energy() -> None:
    still = Score(-7.0, 0.0)
    assert margin(Score(-6.9, -0.4), still) == pytest.approx(margin(Score(-6.0, -0.4), still))
    assert confidence(Score(-6.0, -0.4), still) > 0.9
    assert confidence(Score(-6.0, 0.0), still) < 0.1
    assert margin(Score(-6.99, -0.4), still) > margin(Score(-6.9, -0.4), still)


def test_flat_photos_cannot_be_judged() -> None:
    camera = Camera.from_focal(60.0, 60, 60)
    with pytest.raises(EstimationError):
        score(np.ones((60, 60), np.float32), RotationKernel.delta(camera))
