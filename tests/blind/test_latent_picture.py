from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.blind.latent_picture import latent_gradients
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.signal.gradients import differences
from deshake.signal.pyramid import Pyramid

INNER = np.s_[..., 10:-10, 10:-10]


def gradients(picture: np.ndarray) -> np.ndarray:
    return np.stack(differences(picture))


@pytest.fixture(scope="module")
def estimated(shaken, pyramid) -> np.ndarray:
    return latent_gradients(pyramid, shaken.kernel)


def test_it_is_as_large_as_the_photo(estimated, shaken) -> None:
    assert estimated.shape == (2, *shaken.camera.shape)
    assert estimated.dtype == np.float32


def test_it_is_nearer_the_sharp_picture_than_the_photo_is(estimated, shaken) -> None:
    true, photo = gradients(shaken.still)[INNER], gradients(shaken.grey)[INNER]
    alike, before = (
        np.corrcoef(picture.ravel(), true.ravel())[0, 1] for picture in (estimated[INNER], photo)
    )
    assert alike > before + 0.1
    assert estimated[INNER].std() == pytest.approx(true.std(), rel=0.3)


def test_tiles_meet_without_a_seam(estimated, shaken) -> None:
    true = gradients(shaken.still)
    off = np.abs(estimated - true)[INNER].mean((0, 1))
    assert off.max() < 5 * np.median(off)


def test_it_is_in_the_light_of_the_photo(estimated, shaken) -> None:
    brighter = Pyramid(shaken.grey * 2, shaken.camera)
    np.testing.assert_allclose(
        latent_gradients(brighter, shaken.kernel), 2 * estimated, atol=2e-3 * estimated.max()
    )


def test_a_still_camera_leaves_the_edges_of_the_photo(still, shaken) -> None:
    latent = latent_gradients(still, RotationKernel.delta(shaken.camera))
    true = gradients(shaken.still)
    strong = np.abs(true) > np.quantile(np.abs(true), 0.95)
    strong[:, :10] = strong[:, -10:] = strong[..., :10] = strong[..., -10:] = False
    off = np.linalg.norm((latent - true)[strong]) / np.linalg.norm(true[strong])
    assert off < 0.2
    weak = np.abs(latent - true)[INNER].mean()
    assert weak < 0.5 * np.abs(true[INNER]).mean()


def test_of_a_large_photo_a_smaller_picture_is_made() -> None:
    squares = np.random.default_rng(0).random((44, 60))
    grey = np.kron(squares, np.ones((15, 15))).astype(np.float32)
    camera = Camera.from_focal(900.0, *grey.shape)
    path = np.array([[0.0, -3, 0], [0, 3, 0]]) * grid_steps(camera)
    kernel = RotationKernel.from_path(path, camera)
    latent = latent_gradients(Pyramid(grey, camera), kernel)
    assert latent[0].size < grey.size
    assert latent.shape[1] / latent.shape[2] == pytest.approx(660 / 900, rel=0.01)
    small = cv2.resize(grey, latent.shape[:0:-1], interpolation=cv2.INTER_AREA)
    assert latent.std() == pytest.approx(gradients(small).std(), rel=0.4)


def test_of_a_wide_shake_a_smaller_picture_is_made(pyramid, shaken) -> None:
    path = np.array([[0.0, -30, 0], [0, 30, 0]]) * grid_steps(shaken.camera)
    wide = RotationKernel.from_path(path, shaken.camera)
    assert latent_gradients(pyramid, wide).shape[1] < shaken.camera.height
