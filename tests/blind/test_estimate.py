from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.blur_kind import measured
from deshake.blind.camera_path import filled_path
from deshake.blind.course import first_scales
from deshake.blind.entry import Entry
from deshake.blind.estimate import STILL, _concluded, estimate_kernel
from deshake.blind.finish import Finish
from deshake.blind.kernel_faults import SCATTERED
from deshake.blind.sharpness import looks_sharp
from deshake.blind.spot import is_spot
from deshake.blind.trust import confidence, two_digits
from deshake.errors import EstimationError
from deshake.formats.camera_curve import CameraCurve, light_before, light_behind
from deshake.formats.transfer import LINEAR, display_values
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.run import Run
from deshake.signal.pyramid import Pyramid

if TYPE_CHECKING:
    from deshake.blind.result import BlindEstimate


@dataclass
class Reports:
    """The progress that an estimate reports."""

    shares: list[float] = field(default_factory=list)

    def __call__(self, share: float, text: str) -> None:
        assert text
        self.shares.append(share)


@pytest.fixture(scope="module")
def progress() -> Reports:
    return Reports()


@pytest.fixture(scope="module")
def result(shaken, progress) -> BlindEstimate:
    return estimate_kernel(shaken.grey, shaken.camera, quick=True, run=Run(1, progress))


def test_a_known_shake_is_estimated_and_trusted(result, shaken) -> None:
    assert agreement(result.kernel, shaken.kernel) > 0.88
    assert result.kernel.camera is shaken.camera
    assert result.confidence > 0.5
    assert result.name
    assert result.name != STILL


def test_a_soft_photo_needs_only_the_first_starts(soft, ran) -> None:
    assert measured(soft).hardly_shaken
    result = estimate_kernel(soft.at(0).picture, soft.camera)
    assert result.name == STILL
    assert ran == first_scales(soft.coarsest)[:2]


def test_the_kernel_is_centred_and_fine(result) -> None:
    kernel = result.kernel
    np.testing.assert_allclose(kernel.centroid, 0, atol=0.05 * kernel.steps.min())
    assert kernel.weights.sum() == pytest.approx(1)
    assert filled_path(kernel) is kernel


def test_the_latent_picture_is_the_photos(result, shaken) -> None:
    assert result.latent.shape == (2, *shaken.grey.shape)
    true = np.diff(shaken.still, axis=1)[10:-10, 10:-10]
    latent = result.latent[0, :, :-1][10:-10, 10:-10]
    photo = np.diff(shaken.grey, axis=1)[10:-10, 10:-10]
    # the estimate may point a pixel aside
    alike = max(
        np.corrcoef(np.roll(latent, (y, x), (0, 1)).ravel(), true.ravel())[0, 1]
        for y in (-1, 0, 1)
        for x in (-1, 0, 1)
    )
    assert alike > np.corrcoef(photo.ravel(), true.ravel())[0, 1]


def test_progress_rises_from_nothing_to_one(result, progress) -> None:
    assert result.kernel is not None
    assert progress.shares[0] == 0
    assert progress.shares[-1] == 1
    assert progress.shares == sorted(progress.shares)
    assert len(set(progress.shares)) >= 5


def test_a_part_of_the_photo_gives_the_kernel_of_the_whole(shaken) -> None:
    spoilt = shaken.grey.copy()
    spoilt[:, 150:] = np.random.default_rng(0).random((150, 30))
    part = estimate_kernel(spoilt, shaken.camera, region=(6, 4, 140, 142), quick=True, run=Run(1))
    assert part.kernel.camera is shaken.camera
    assert agreement(part.kernel, shaken.kernel) > 0.85
    assert part.latent.shape == (2, 142, 140)


def test_clipped_pixels_are_ignored(shake) -> None:
    shaken = shake(Camera.from_focal(210.0, 175, 210))
    most = np.quantile(shaken.grey, 0.98)
    result = estimate_kernel(
        np.minimum(shaken.grey, most).astype(np.float32),
        shaken.camera,
        clipped=shaken.grey >= most,
        quick=True,
        run=Run(1),
    )
    assert agreement(result.kernel, shaken.kernel) > 0.85


def test_uniform_kernels_do_not_roll(shake) -> None:
    camera = Camera.uniform(150, 180)
    shaken = shake(camera, np.array([[-1.0, -4, 0], [0, 0, 0], [2, 1, 0], [1, 4, 0]]))
    lens = Camera.from_focal(180.0, 150, 180)
    result = estimate_kernel(shaken.grey, lens, uniform=True, quick=True, run=Run(1))
    assert result.kernel.camera.is_uniform
    assert not result.kernel.theta[:, 2].any()
    assert agreement(result.kernel, shaken.kernel) > 0.9


def test_a_sharp_photo_is_left_as_it_is(shaken) -> None:
    result = estimate_kernel(np.ascontiguousarray(shaken.still), shaken.camera, run=Run(1))
    assert result.name == STILL
    assert result.kernel.weights.tolist() == [1]
    assert not result.kernel.theta.any()
    assert result.kernel.camera is shaken.camera
    assert result.confidence <= 0.1
    assert len(result.notes) == 1
    assert "left as it is" in result.notes[0]
    assert result.latent.shape == (2, *shaken.grey.shape)


def test_the_user_says_how_sure_a_kernel_must_be(shaken) -> None:
    sharp = np.ascontiguousarray(shaken.still)
    given = [
        estimate_kernel(sharp, shaken.camera, least_confidence=least, quick=True, run=Run(1))
        for least in (0.0, 0.4)
    ]
    assert [result.name == STILL for result in given] == [False, True]
    assert 0 < given[0].confidence < 0.4
    assert given[0].kernel.extent_px() > 2
    assert "doubtful" in given[0].notes[-1]
    [note] = given[1].notes
    assert f"(best confidence {two_digits(given[0].confidence)})" in note
    assert "left as it is; --least-confidence 0 deblurs it all the same" in note


def test_a_point_never_deblurs_a_photo(shaken) -> None:
    pyramid = Pyramid(shaken.grey, shaken.camera)
    spot = RotationKernel.from_path(np.diag(0.6 * grid_steps(shaken.camera)), shaken.camera)
    point = RotationKernel.delta(shaken.camera)
    assert is_spot(spot)
    for kernel, least, left in ((spot, None, True), (spot, 0.0, False), (point, 0.0, True)):
        found = Finish(Entry("start 1", 1, 0, kernel), 0.1, 0.22, 0.95, at_rest=False)
        result = _concluded(pyramid, shaken.camera, found, None, least)
        assert (result.name == STILL) == left


def test_a_doubtful_kernel_never_deblurs_a_photo_with_the_edges_of_a_sharp_one(shaken) -> None:
    found = Finish(Entry("start 1", 1, 0, shaken.kernel), 0.0, 0.22, 0.95, at_rest=False)
    assert 0.5 < confidence(found) < 0.8
    for grey, name in ((shaken.grey, "start 1"), (shaken.still, STILL)):
        pyramid = Pyramid(np.ascontiguousarray(grey), shaken.camera)
        assert looks_sharp(pyramid) == (name == STILL)
        result = _concluded(pyramid, shaken.camera, found, None)
        assert result.name == name
        assert len(result.notes) == 1
    sure = found._replace(margin=0.12, match=0.4)
    assert _concluded(pyramid, shaken.camera, sure, None).name == "start 1"


def test_a_kernel_that_a_still_camera_beats_is_doubtful(shaken) -> None:
    entry = Entry("start 1", 1, 0, shaken.kernel)
    sure, unlikely = (Finish(entry, n, 0.4, 0.999, at_rest=False) for n in (-0.04, -0.06))
    assert confidence(sure) == confidence(unlikely) > 0.9
    result = _concluded(shaken.pyramid, shaken.camera, sure, None)
    assert result.confidence > 0.9
    assert result.notes == []
    result = _concluded(shaken.pyramid, shaken.camera, unlikely, None)
    assert result.confidence == 0.79
    assert "doubtful" in result.notes[0]


def test_only_a_doubtful_kernel_is_called_scattered(shaken) -> None:
    steps = grid_steps(shaken.camera)
    specks = np.random.default_rng(0).integers(-20, 21, (30, 3)) * (1, 1, 0)
    kernel = RotationKernel.from_indices(specks, np.ones(30), steps, shaken.camera).centred()
    entry = Entry("start 1", 1, 0, kernel)
    doubtful, sure = (Finish(entry, margin, 0.3, 0.99, at_rest=False) for margin in (-0.06, 0.3))
    result = _concluded(shaken.pyramid, shaken.camera, doubtful, None)
    assert SCATTERED in result.notes
    assert "doubtful" in result.notes[-1]
    result = _concluded(shaken.pyramid, shaken.camera, sure, None)
    assert result.confidence > 0.8
    assert result.notes == []


@pytest.mark.parametrize("before_curve", [None, light_before])
def test_an_estimate_in_display_values_says_so(photo, before_curve) -> None:
    light, toned = np.square(np.clip(photo.grey, 0, 1)), before_curve is not None
    result = estimate_kernel(light, photo.camera, before_curve=before_curve, quick=True, run=Run(1))
    assert result.tones == ("display values" if toned else "linear light")
    assert not toned or agreement(result.kernel, photo.kernel) > 0.9


def test_the_starts_look_at_the_light_before_half_of_a_tone_curve(shaken) -> None:
    light = np.clip(shaken.grey, 0, 1)
    plain = estimate_kernel(light, shaken.camera, quick=True, run=Run(1))
    half = display_values(light, CameraCurve(LINEAR, 0.5))
    found, of_whole = (
        estimate_kernel(bent, shaken.camera, before_curve=light_before, quick=True, run=Run(1))
        for bent in (half, light_behind(light))
    )
    assert found.tones == of_whole.tones == "light before a tone curve"
    assert agreement(found.kernel, plain.kernel) > 0.99
    assert agreement(found.kernel, shaken.kernel) > 0.9
    assert agreement(of_whole.kernel, shaken.kernel) > 0.9


@pytest.mark.parametrize("estimator", ["edges", "variational"])
@pytest.mark.parametrize(
    ("grey", "how", "says"),
    [
        (np.full((100, 120), 0.5, np.float32), {}, "no detail"),
        (np.ones((40, 300), np.float32), {}, "too few"),
        (np.ones((100, 120), np.float32), {"region": (10, 10, 100, 30)}, "too few"),
        (np.ones((100, 120), np.float32), {"blur_px": 80.0}, "does not fit"),
    ],
    ids=["flat", "small", "small region", "wide"],
)
def test_photos_without_detail_are_errors_with_a_hint(estimator, grey, how, says) -> None:
    camera = Camera.from_focal(200.0, *grey.shape)
    with pytest.raises(EstimationError, match=says) as error:
        estimate_kernel(grey, camera, estimator=estimator, **how)
    assert error.value.hint


def test_the_kernel_of_a_large_photo_does_not_contain_its_softness() -> None:
    squares = np.random.default_rng(7).random((60, 65)).astype(np.float32)
    grey = squares.repeat(40, 0).repeat(40, 1)
    camera = Camera.from_focal(3000.0, *grey.shape)
    steps = grid_steps(camera)
    places = [(x, y, 0) for x in range(-8, 9) for y in range(-3, 4)]
    weights = np.exp(-0.5 * (np.array(places)[:, 1] / 1.2) ** 2)
    weights /= weights.sum()
    band = replace(
        RotationKernel.delta(camera, steps=steps), theta=np.array(places) * steps, weights=weights
    )
    found = Finish(Entry("start 1", 1, 0, band), 0.4, 0.4, 0.999, at_rest=False)
    result = _concluded(Pyramid(grey, camera), camera, found, None)
    assert result.name == "start 1"
    across = [kernel.weights @ kernel.theta[:, 1] ** 2 for kernel in (band, result.kernel)]
    assert across[1] < 0.25 * across[0]
