from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from deshake.blind.variational import scales
from deshake.blind.variational.coarse_to_fine import PyramidPlan
from deshake.blind.variational.scales import ScaleByScale
from deshake.blind.variational.settings import SETTINGS
from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur
from deshake.run import Run
from deshake.signal.poisson import poisson_image

SHAPE = 84, 110
CAMERA = Camera.from_focal(110.0, *SHAPE)


@pytest.fixture(scope="module")
def gradients(sharp: np.ndarray) -> np.ndarray:
    """Gradients, (2, h, w), of a photo turned by six grid steps about Y."""
    reduced = cv2.resize(sharp, SHAPE[::-1], interpolation=cv2.INTER_AREA)
    path = np.array([[0, -3, 0], [0, 3, 0]]) * grid_steps(CAMERA)
    blur = ShakeBlur(RotationKernel.from_path(path, CAMERA), kind="warps")
    photo = 256 * blur.forward(np.pad(reduced, blur.margin, mode="edge"))
    out = np.zeros((2, *SHAPE), np.float32)
    out[0, :, :-1] = np.diff(photo, axis=1)
    out[1, :-1] = np.diff(photo, axis=0)
    return out


def under_way(
    gradients: np.ndarray, blur_px: float, *, finest: bool = False, usable: np.ndarray | None = None
) -> ScaleByScale:
    return ScaleByScale(
        PyramidPlan(CAMERA, blur_px),
        gradients,
        np.ones(SHAPE, bool) if usable is None else usable,
        finest=finest,
        roll_rate=0.01,
        run=Run(1, lambda _share, _text: None),
    )


@pytest.fixture(scope="module")
def ended(gradients: np.ndarray) -> dict[str, ScaleByScale]:
    """Estimates of a blur that counts as wide: to the scale that is enough, and to the finest."""
    works = {
        "enough": under_way(gradients, 8),
        "finest": under_way(gradients, 8, finest=True),
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scales, "SETTINGS", replace(SETTINGS, enough_blur=5.0, iterations=3))
        for work in works.values():
            work.run()
    return works


def test_wide_blur_ends_at_a_coarser_scale_unless_the_finest_is_asked_for(
    ended: dict[str, ScaleByScale],
) -> None:
    widths = [ended[name].reports[-1].width for name in ("enough", "finest")]
    assert widths[0] < widths[1] == SHAPE[1]


def test_a_trial_stops_at_a_coarse_scale_and_goes_on_from_there(
    gradients: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scales, "SETTINGS", replace(SETTINGS, trial_side=60, iterations=1))
    work, straight = under_way(gradients, 6), under_way(gradients, 6)
    assert work.try_coarse() == work.outermost
    assert 60 <= work.reports[-1].width < 60 * 1.5
    kernel, confidence = work.run()
    expected, same = straight.run()
    np.testing.assert_array_equal(kernel.theta, expected.theta)
    np.testing.assert_array_equal(kernel.weights, expected.weights)
    assert confidence == same


def test_a_box_too_small_is_touched(
    gradients: np.ndarray, ended: dict[str, ScaleByScale], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scales, "SETTINGS", replace(SETTINGS, iterations=3))
    tight = under_way(gradients, 1)
    tight.run()
    assert tight.outermost > ended["finest"].outermost


def test_too_few_pixels_are_an_error(gradients: np.ndarray) -> None:
    usable = np.zeros(SHAPE, bool)
    usable[:4] = True
    with pytest.raises(EstimationError, match="too few pixels"):
        under_way(gradients, 8, usable=usable).run()


def test_the_latent_gradients_have_the_size_of_the_last_scale(
    gradients: np.ndarray, ended: dict[str, ScaleByScale]
) -> None:
    work = ended["enough"]
    latent = work.latent_gradients()
    assert latent.shape == (2, work.reports[-1].height, work.reports[-1].width)
    assert latent.shape[2] < SHAPE[1]
    contrasts = [poisson_image(*each, 0.0).std() for each in (latent, gradients)]
    assert contrasts[0] == pytest.approx(contrasts[1], rel=0.2)
