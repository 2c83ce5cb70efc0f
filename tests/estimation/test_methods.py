from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from deshake.blind.kernel_faults import FILLED, SCATTERED, TOUCHING
from deshake.deconvolution.poisson import poisson_image
from deshake.deconvolution.richardson_lucy import richardson_lucy
from deshake.errors import EstimationError
from deshake.estimation.candidates import STILL
from deshake.estimation.methods import (
    Estimator,
    best_estimate,
    estimate_candidates,
    estimate_kernel,
)
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur

if TYPE_CHECKING:
    from deshake.blind.result import BlindEstimate

SHAPE = 120, 156
CAMERA = Camera.from_focal(156.0, *SHAPE)
ESTIMATORS: tuple[Estimator, ...] = ("auto", "edges", "variational")


@pytest.fixture(scope="module")
def truth(sharp: np.ndarray) -> np.ndarray:
    return cv2.resize(sharp, SHAPE[::-1], interpolation=cv2.INTER_AREA)


@pytest.fixture(scope="module")
def photo(truth: np.ndarray) -> np.ndarray:
    """Turn evenly by eight pixels about Y, with a little noise."""
    path = np.array([[0, -4, 0], [0, 4, 0]]) * grid_steps(CAMERA)
    blur = ShakeBlur(RotationKernel.from_path(path, CAMERA), kind="warps")
    shaken = blur.forward(np.pad(truth, blur.margin, mode="edge"))
    shaken += np.random.default_rng(0).normal(0, 0.002, SHAPE).astype(np.float32)
    return np.clip(shaken, 0, 1)


@pytest.fixture(scope="module")
def shares() -> dict[str, list[float]]:
    """Shares done, as each estimator told them."""
    return {name: [] for name in ESTIMATORS}


@pytest.fixture(scope="module")
def found(photo: np.ndarray, shares: dict[str, list[float]]) -> dict[str, BlindEstimate]:
    def run(name: Estimator) -> BlindEstimate:
        def told(share: float, _text: str) -> None:
            shares[name].append(share)

        return estimate_kernel(photo, CAMERA, estimator=name, blur_px=12, threads=2, progress=told)

    return {name: run(name) for name in ESTIMATORS}


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_betters_the_photo(
    found: dict[str, BlindEstimate], photo: np.ndarray, truth: np.ndarray, name: str
) -> None:
    restored = richardson_lucy(photo, found[name].kernel, threads=2).pixels
    inner = np.s_[14:-14, 14:-14]

    def error(picture: np.ndarray) -> float:
        shifts = [(dy, dx) for dy in range(-2, 3) for dx in range(-2, 3)]
        return min(
            float(((np.roll(picture, s, (0, 1)) - truth)[inner] ** 2).mean()) for s in shifts
        )

    assert error(restored) < 0.8 * error(photo)
    assert found[name].kernel.camera is CAMERA


def fine(picture: np.ndarray) -> np.ndarray:
    """What is finer than some pixels, away from the border."""
    return (picture - cv2.GaussianBlur(picture, (0, 0), 4))[14:-14, 14:-14]


@pytest.mark.parametrize(("name", "left"), [("edges", 0.95), ("variational", 0.6)])
def test_the_latent_picture_is_sharper_than_the_photo(
    found: dict[str, BlindEstimate], photo: np.ndarray, truth: np.ndarray, name: str, left: float
) -> None:
    latent = poisson_image(*found[name].latent, float(photo.mean()))
    before, after = (
        1 - np.corrcoef(fine(picture).ravel(), fine(truth).ravel())[0, 1]
        for picture in (photo, latent)
    )
    assert after < left * before
    assert latent.std() == pytest.approx(truth.std(), rel=0.1)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_the_kernel_blurs_the_latent_picture_to_the_photo(
    found: dict[str, BlindEstimate], photo: np.ndarray, name: str
) -> None:
    latent = poisson_image(*found[name].latent, float(photo.mean()))
    kernel = found[name].kernel

    def misfit(turn: tuple[float, float, float]) -> float:
        theta = kernel.theta + np.array(turn) * kernel.steps
        turned = RotationKernel(theta, kernel.weights, kernel.steps, CAMERA)
        blurred = ShakeBlur(turned, margin=14).forward(np.pad(latent, 14, mode="edge"))
        return float((blurred - photo)[14:-14, 14:-14].std())

    still = float((latent - photo)[14:-14, 14:-14].std())
    assert misfit((0, 0, 0)) < 0.6 * still
    aside = [(0.5, 0, 0), (-0.5, 0, 0), (0, 0.5, 0), (0, -0.5, 0)]
    assert misfit((0, 0, 0)) < min(misfit(turn) for turn in aside)


def test_auto_takes_one_of_the_candidates(found: dict[str, BlindEstimate]) -> None:
    kernel = found["auto"].kernel
    others = [found["edges"], found["variational"]]
    same = [o for o in others if np.array_equal(o.kernel.weights, kernel.weights)]
    assert [o.name for o in same] == [found["auto"].name]
    assert np.array_equal(same[0].latent, found["auto"].latent)
    assert found["auto"].confidence == same[0].confidence


def test_the_best_is_taken_whoever_estimated_it(
    found: dict[str, BlindEstimate], photo: np.ndarray
) -> None:
    good = found["edges"]
    kernel = good.kernel
    long = RotationKernel(kernel.theta * 2.5, kernel.weights, kernel.steps, CAMERA)
    candidates = {"variational": replace(good, kernel=long, name="variational"), good.name: good}
    best = best_estimate(photo, candidates, threads=2)
    assert best.name == good.name
    assert best.kernel is kernel
    worst = best_estimate(photo, {"variational": candidates["variational"]}, threads=2)
    assert worst.confidence < 0.5 < best.confidence
    assert any("doubtful" in note for note in worst.notes)
    assert not any("doubtful" in note for note in best.notes)


def test_where_no_kernel_will_do_the_photo_is_left_as_it_is(
    found: dict[str, BlindEstimate], photo: np.ndarray
) -> None:
    good = found["edges"]
    kernel = good.kernel
    long = RotationKernel(kernel.theta * 2.5, kernel.weights, kernel.steps, CAMERA)
    left = best_estimate(photo, {"long": replace(good, kernel=long, name="long")}, threads=2)
    assert left.kernel.weights.tolist() == [1]
    assert not left.kernel.theta.any()
    assert left.kernel.camera is CAMERA
    assert left.name == STILL
    assert len(left.notes) == 1
    assert "long" in left.notes[0]
    assert "left as it is" in left.notes[0]


def test_a_photo_at_rest_is_left_as_it_is(
    found: dict[str, BlindEstimate], truth: np.ndarray
) -> None:
    sharp = np.clip(2 * truth - cv2.GaussianBlur(truth, (0, 0), 1), 0, 1)
    point = RotationKernel.from_indices([[0, 0, 0], [0, 1, 0]], [3, 1], grid_steps(CAMERA), CAMERA)
    left = best_estimate(sharp, {"fine": replace(found["edges"], kernel=point)}, threads=2)
    assert not left.kernel.theta.any()
    assert left.confidence <= 0.1
    assert any("looks sharp" in note or "left as it is" in note for note in left.notes)


@pytest.mark.parametrize(
    ("coarser", "says"), [(1, "no shake was found"), (6, "wider than about 12")]
)
def test_how_small_a_shake_may_hide_is_said(
    found: dict[str, BlindEstimate], truth: np.ndarray, coarser: float, says: str
) -> None:
    sharp = np.kron(truth[::4, ::4], np.ones((4, 4), np.float32))
    steps = coarser * grid_steps(CAMERA)
    point = RotationKernel.from_indices([[0, 0, 0]], [1], steps, CAMERA)
    left = best_estimate(sharp, {"fine": replace(found["edges"], kernel=point)}, threads=2)
    assert left.notes[0].startswith("no shake")
    assert says in left.notes[0]
    assert "looks sharp" in left.notes[0]


def test_a_doubtful_kernel_that_is_scattered_leaves_the_photo_as_it_is(
    found: dict[str, BlindEstimate], photo: np.ndarray
) -> None:
    good = found["edges"]
    path = np.array([[0, -1, 0], [0, 1, 0]]) * grid_steps(CAMERA)
    doubtful = None
    for length in np.arange(1.0, 12, 0.5):  # too short or too long to be sure, not to be hoped
        kernel = RotationKernel.from_path(path * length, CAMERA).centred()
        one = best_estimate(photo, {"fine": replace(good, kernel=kernel, notes=[])}, threads=2)
        if one.name != STILL and one.confidence < 0.5:
            doubtful = replace(one, notes=[SCATTERED])
            break
    assert doubtful is not None
    left = best_estimate(photo, {"fine": doubtful}, threads=2)
    assert left.name == STILL
    assert left.confidence <= 0.1


def test_a_soft_photo_is_left_as_it_is(found: dict[str, BlindEstimate], truth: np.ndarray) -> None:
    soft = cv2.blur(truth, (1, 3))

    def best(length: int) -> BlindEstimate:
        path = np.array([[0, 0, 0], [length, 0, 0]]) * grid_steps(CAMERA)
        kernel = RotationKernel.from_path(path, CAMERA).centred()
        return best_estimate(soft, {"fine": replace(found["edges"], kernel=kernel)}, threads=2)

    left = best(3)
    assert left.name == STILL
    assert left.confidence <= 0.1
    assert len(left.notes) == 1
    assert "a little soft rather than shaken" in left.notes[0]
    assert not any("soft" in note for note in best(8).notes)
    # whatever a setting finds that finds a blur in any photo
    longer = best(8)
    path = np.array([[0, 0, 0], [3, 0, 0]]) * grid_steps(CAMERA)
    small = replace(longer, kernel=RotationKernel.from_path(path, CAMERA).centred())
    both = best_estimate(soft, {"fine": small, "display": longer}, threads=2)
    assert both.notes == left.notes


def test_half_of_the_candidates_tell_a_photo_out_of_focus(
    found: dict[str, BlindEstimate], photo: np.ndarray
) -> None:
    good = found["edges"]
    theta, weights = 2.5 * good.kernel.theta, good.kernel.weights
    worse = RotationKernel(theta, weights, good.kernel.steps, CAMERA)
    filled = replace(good, kernel=worse, notes=[FILLED])
    half = best_estimate(photo, {"good": good, "one": filled}, threads=2)
    assert half.kernel is good.kernel
    assert FILLED in half.notes
    other = replace(filled, notes=[])
    fewer = best_estimate(photo, {"good": good, "one": filled, "two": other}, threads=2)
    assert FILLED not in fewer.notes


def test_what_is_wrong_with_a_kernel_is_noted(photo: np.ndarray) -> None:
    narrow = estimate_candidates(photo, CAMERA, estimator="edges", blur_px=2, threads=2)
    assert any(TOUCHING in found.notes for found in narrow.values())


def test_the_confidence_speaks_for_a_real_shake_and_against_none(
    found: dict[str, BlindEstimate], truth: np.ndarray
) -> None:
    assert found["auto"].confidence > 0.9
    still = estimate_kernel(truth, CAMERA, estimator="edges", blur_px=12, threads=2)
    assert still.confidence < found["auto"].confidence
    assert any("as it is" in note for note in still.notes) == (still.confidence <= 0.1)


def test_uniform_kernels_do_not_roll(photo: np.ndarray) -> None:
    found = estimate_kernel(photo, CAMERA, estimator="edges", blur_px=12, uniform=True, threads=2)
    assert found.kernel.camera.is_uniform
    assert np.ptp(found.kernel.theta[:, 2]) < 1e-9


@pytest.mark.parametrize("name", ESTIMATORS)
def test_small_and_flat_photos_are_errors(name: Estimator) -> None:
    with pytest.raises(EstimationError, match="too few"):
        estimate_kernel(np.ones((20, 30), np.float32), CAMERA, estimator=name)
    with pytest.raises(EstimationError, match="texture"):
        estimate_kernel(np.full(SHAPE, 0.5, np.float32), CAMERA, estimator=name)


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.usefixtures("found")
def test_progress_rises_to_one(shares: dict[str, list[float]], name: str) -> None:
    assert shares[name] == sorted(shares[name])
    assert shares[name][-1] == 1
