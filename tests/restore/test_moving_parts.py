from __future__ import annotations

import numpy as np
import pytest
from skimage import data

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.operators.shake_blur import ShakeBlur
from deshake.restore.moving_parts import moving_share
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run

HEIGHT, WIDTH = 200, 240
CAMERA = Camera.from_focal(400.0, HEIGHT, WIDTH)
KERNEL = RotationKernel.from_path(
    [(-0.008, -0.014, 0), (0.006, 0.0, 0.01), (-0.002, 0.014, 0)], CAMERA
).centred()
OBJECT = np.s_[50:150, 30:110]
FAR = np.s_[:, 170:]


@pytest.fixture(scope="module")
def shaken():
    """A shaken photo without noise to speak of, and its sharp scene; linear light, colours."""
    light = (data.astronaut()[:300, 60:360].astype(np.float32) / 255) ** 2.2
    blur = ShakeBlur(KERNEL)
    m = blur.margin
    scene = light[20 : 20 + HEIGHT + 2 * m, 20 : 20 + WIDTH + 2 * m]
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 2e-3, (HEIGHT, WIDTH, 3)).astype(np.float32)
    sharp = np.ascontiguousarray(scene[m:-m, m:-m])
    return blur.forward(np.ascontiguousarray(scene)) + noise, sharp


@pytest.fixture(scope="module")
def followed(shaken):
    """The same photo with an object that the camera followed: it alone is sharp."""
    g, _ = shaken
    thing = (data.coffee()[100:300, 150:390].astype(np.float32) / 255) ** 2.2
    g = g.copy()
    g[OBJECT] = thing[OBJECT]
    return g, sparse_gradients(g, KERNEL, run=Run(1)).pixels, thing[OBJECT]


def error(one, other):
    return float(np.square(np.sqrt(np.clip(one, 0, 1)) - np.sqrt(np.clip(other, 0, 1))).mean())


def test_an_object_that_the_camera_followed_keeps_the_photo(followed) -> None:
    g, f, thing = followed
    share = moving_share(g, f, KERNEL)
    assert share.shape == (HEIGHT, WIDTH)
    assert share.dtype == np.float32
    assert share[OBJECT].mean() > 0.5
    assert share[FAR].max() < 0.02
    mixed = f + share[..., None] * (g - f)
    assert error(mixed[OBJECT], thing) < 0.25 * error(f[OBJECT], thing)


def test_a_still_scene_is_restored_everywhere(shaken) -> None:
    g, sharp = shaken
    f = sparse_gradients(g, KERNEL, run=Run(1)).pixels
    assert error(f, sharp) < 0.5 * error(g, sharp)
    assert moving_share(g, f, KERNEL).max() < 0.02


def test_grey_photos_and_any_number_of_threads(followed) -> None:
    g, f, _ = followed
    grey = [np.ascontiguousarray(image[..., 1]) for image in (g, f)]
    one, three = (moving_share(*grey, KERNEL, run=Run(threads)) for threads in (1, 3))
    assert np.array_equal(one, three)
    assert one[OBJECT].mean() > 0.3
    assert one[FAR].max() < 0.02


def test_a_large_photo_is_looked_at_in_a_reduced_one(followed, monkeypatch) -> None:
    g, f, _ = followed
    monkeypatch.setattr("deshake.restore.moving_parts._MOST", HEIGHT * WIDTH / 2)
    share = moving_share(g, f, KERNEL)
    assert share.shape == (HEIGHT, WIDTH)
    assert share[OBJECT].mean() > 0.3
    assert share[FAR].max() < 0.02


def test_lamps_that_clip_are_no_moving_parts(shaken) -> None:
    _, sharp = shaken
    blur = ShakeBlur(KERNEL)
    scene = np.pad(0.3 * sharp, [(blur.margin,) * 2] * 2 + [(0, 0)], mode="edge")
    for y, x in ((60, 60), (120, 180), (160, 90)):
        scene[y + blur.margin, x + blur.margin] = 200
    g = np.minimum(blur.forward(scene), 1)
    clipped = (g >= 1).any(-1)
    f = sparse_gradients(g, KERNEL, clipped=clipped, run=Run(1)).pixels
    share = moving_share(g, f, KERNEL, clipped=clipped)
    assert clipped.sum() > 50
    assert share.mean() < 0.02
