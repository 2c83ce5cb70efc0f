from __future__ import annotations

import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.restore.dark_halos import without_dark_halos

CAMERA = Camera.from_focal(100.0, 60, 80)


def pan(length: int) -> RotationKernel:
    """Turn evenly about Y by so many pixels."""
    indices = np.zeros((length + 1, 3), int)
    indices[:, 1] = np.arange(length + 1) - length // 2
    return RotationKernel.from_indices(indices, np.ones(length + 1), grid_steps(CAMERA), CAMERA)


def test_a_black_halo_on_an_even_ground_is_lifted() -> None:
    photo = np.full((*CAMERA.shape, 3), 0.5, np.float32)
    restored = photo.copy()
    restored[20:24, 30:34] = 0
    lifted = without_dark_halos(restored, photo, pan(8))
    assert lifted[20:24, 30:34] == pytest.approx(0.05)
    restored[20:24, 30:34] = lifted[20:24, 30:34]
    assert np.array_equal(lifted, restored)


def test_what_is_dark_within_the_reach_may_be_black() -> None:
    photo = np.full(CAMERA.shape, 0.5, np.float32)
    photo[:, 40:] = 0
    black = np.zeros_like(photo)
    narrow, wide = (without_dark_halos(black, photo, pan(length)) for length in (4, 16))
    assert narrow[30, 32] == pytest.approx(0.05)
    assert wide[30, 32] < 0.03
    assert not wide[:, 40:].any()
    assert (wide <= narrow + 1e-6).all()


def test_the_ground_beside_a_lamp_keeps_most_of_its_light() -> None:
    photo = np.full((*CAMERA.shape, 3), 0.02, np.float32)
    photo[25:35, 20:26] = 0.8
    restored = photo.copy()
    restored[25:35, 26:29] = 0  # a rim beside the lamp
    restored[25:35, 60:63] = 0  # a halo far from it
    lifted = without_dark_halos(restored, photo, pan(8))
    assert lifted[25:35, 28] == pytest.approx(0.018)
    assert lifted[25:35, 60:63] == pytest.approx(0.002)
    lamp = np.s_[25:35, 20:26]
    assert np.array_equal(lifted[lamp], restored[lamp])


def test_a_faint_lamp_raises_the_bound_less() -> None:
    lifted = []
    for light in (0.1, 0.2, 0.3, 0.5, 0.9):
        photo = np.full(CAMERA.shape, 0.02, np.float32)
        photo[25:35, 20:26] = light
        lifted.append(without_dark_halos(np.zeros_like(photo), photo, pan(4))[30, 27])
    assert lifted[0] == pytest.approx(0.002)
    assert 0.003 < lifted[1] < lifted[2] < 0.017
    assert lifted[3] < lifted[4] == pytest.approx(0.018)


def test_the_reach_along_each_axis_is_that_of_the_blur() -> None:
    photo = np.full(CAMERA.shape, 0.5, np.float32)
    photo[40:] = 0
    lifted = without_dark_halos(np.zeros_like(photo), photo, pan(16))  # along x
    assert lifted[:36] == pytest.approx(0.05)


def test_channels_do_not_mix_and_nothing_gets_darker() -> None:
    rng = np.random.default_rng(0)
    photo = rng.random((*CAMERA.shape, 3)).astype(np.float32)
    photo[..., 2] = 0
    restored = rng.random(photo.shape).astype(np.float32) - np.float32(0.2)
    lifted = without_dark_halos(restored, photo, pan(3))
    assert (lifted >= restored).all()
    for c in range(3):
        alone = without_dark_halos(restored[..., c], photo[..., c], pan(3))
        assert np.array_equal(lifted[..., c], alone)
    assert np.array_equal(lifted[..., 2], np.maximum(restored[..., 2], 0))


def test_a_photo_is_left_as_it_is() -> None:
    photo = np.random.default_rng(1).random(CAMERA.shape).astype(np.float32)
    assert np.array_equal(without_dark_halos(photo, photo, pan(6)), photo)
