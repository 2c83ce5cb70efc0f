from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.entry import Entry
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.tones import _less_variation, suits_display_values
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.signal.pyramid import Pyramid


@pytest.mark.parametrize("displayed", [False, True])
def test_the_kernel_tells_the_tones_in_which_the_photo_was_blurred(shaken, displayed) -> None:
    blurred = np.clip(shaken.grey, 0, 1)
    light = np.square(blurred) if displayed else blurred
    assert suits_display_values(light, shaken.kernel) == displayed


@pytest.mark.parametrize("displayed", [False, True])
def test_the_restored_picture_varies_less_in_the_right_tones(photo, displayed) -> None:
    blurred = np.clip(photo.grey, 0, 1)
    light = Pyramid(np.square(blurred) if displayed else blurred, photo.camera)
    entry = Entry("kernel", 0, 0, photo.kernel)
    gain = _less_variation(Comparison(light), Comparison(light.displayed()), entry)
    assert gain > 0.1 if displayed else gain < 0


def test_clipped_pixels_do_not_count(shaken) -> None:
    light = np.square(np.clip(shaken.grey, 0, 1))
    rng = np.random.default_rng(0)
    clipped = np.zeros(light.shape, bool)
    for y, x in rng.integers(0, (130, 160), (12, 2)):
        clipped[y : y + 12, x : x + 12] = True
    flashed = np.where(clipped, 1, light).astype(np.float32)
    assert suits_display_values(flashed, shaken.kernel, clipped)


def test_without_evidence_it_is_light(shaken) -> None:
    still = RotationKernel.delta(shaken.camera)
    assert not suits_display_values(np.square(shaken.grey), still)
    flat = np.full(shaken.grey.shape, 0.5, np.float32)
    assert not suits_display_values(flat, shaken.kernel)
    small = Camera.from_focal(30.0, 20, 30)
    assert not suits_display_values(shaken.grey[:20, :30], shaken.kernel.for_camera(small))
