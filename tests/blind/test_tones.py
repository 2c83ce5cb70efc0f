from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.entry import Entry
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.tones import _less_variation, suited_light, suited_tones
from deshake.formats.camera_curve import light_before, light_behind
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.signal.pyramid import Pyramid, ToneName


def tones_of(light, kernel, clipped=None) -> ToneName:
    return suited_tones(light.astype(np.float32), kernel, clipped, before_curve=light_before)


@pytest.mark.parametrize("displayed", [False, True])
def test_the_kernel_tells_the_tones_in_which_the_photo_was_blurred(shaken, displayed) -> None:
    blurred = np.clip(shaken.grey, 0, 1)
    light = np.square(blurred) if displayed else blurred
    assert tones_of(light, shaken.kernel) == ("display values" if displayed else "linear light")


def test_the_kernel_tells_that_a_camera_applied_a_tone_curve(photo) -> None:
    blurred = np.clip(photo.grey, 0, 1)
    assert tones_of(blurred, photo.kernel) == "linear light"
    assert tones_of(light_behind(blurred), photo.kernel) == "light before a tone curve"


@pytest.mark.parametrize("curved", [False, True])
def test_the_kernel_of_a_race_tells_in_which_light_it_goes_on(photo, curved) -> None:
    light = np.clip(photo.grey, 0, 1)
    pyramid = Pyramid(light_behind(light) if curved else light, photo.camera)
    half, whole = (
        pyramid.in_tones(lambda light, strength=strength: light_before(light, strength))
        for strength in (0.5, 1.0)
    )
    lights = [Comparison(one) for one in (pyramid, half, whole)]
    entry = Entry("kernel", 0, 0, photo.kernel)
    assert suited_light(lights, entry) is lights[2 if curved else 0]
    doubtful = [lights[0], Comparison(half), lights[0]]
    assert suited_light(doubtful, entry) is doubtful[1]


def test_a_match_that_rises_alone_shows_no_tone_curve(shaken) -> None:
    light = Pyramid(np.clip(shaken.grey, 0, 1), shaken.camera)
    entry = Entry("kernel", 0, 0, shaken.kernel)
    plain, before = Comparison(light), Comparison(light.in_tones(light_before))
    assert before.match(entry) > plain.match(entry) + 0.02  # a photo of few tiles
    assert before.finer_margin(entry) < plain.finer_margin(entry)
    assert tones_of(light.at(0).picture, shaken.kernel) == "linear light"


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
    assert tones_of(flashed, shaken.kernel, clipped) == "display values"


def test_without_evidence_it_is_light(shaken) -> None:
    still = RotationKernel.delta(shaken.camera)
    assert tones_of(np.square(shaken.grey), still) == "linear light"
    flat = np.full(shaken.grey.shape, 0.5, np.float32)
    assert tones_of(flat, shaken.kernel) == "linear light"
    small = Camera.from_focal(30.0, 20, 30)
    kernel = shaken.kernel.for_camera(small)
    assert tones_of(shaken.grey[:20, :30], kernel) == "linear light"
