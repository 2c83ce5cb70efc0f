"""What holds for each method that restores one photo of any shake."""

from __future__ import annotations

import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.restore.richardson_lucy import richardson_lucy, richardson_lucy_tv
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run

METHODS = {
    "rl": richardson_lucy,
    "rl-tv": richardson_lucy_tv,
    "sparse": sparse_gradients,
}


@pytest.fixture(params=METHODS)
def method(request):
    return METHODS[request.param]


@pytest.mark.parametrize("name", ["uniform", "all"])
def test_keeps_the_brightness_of_every_colour(method, name, lab):
    sharp = lab.colours() * np.array([1, 0.5, 0.2], np.float32)
    g = lab.noisy(lab.shaken(lab.kernels[name], sharp), 0.003)
    f = method(g, lab.kernels[name]).pixels
    before, after = (x.mean((0, 1), dtype=float) for x in (g, f))
    np.testing.assert_allclose(after, before, rtol=2e-3)


@pytest.mark.parametrize(("name", "most"), [("rl", 3), ("sparse", 3.5)])
def test_the_border_is_nearly_as_good_as_the_middle(name, most, lab):
    sharp = lab.scene(3)
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.003)
    error = np.square(METHODS[name](g, lab.all_axes).pixels - lab.frame(sharp))
    middle = np.zeros(error.shape, bool)
    middle[16:-16, 16:-16] = True
    assert 10 * np.log10(error[~middle].mean() / error[middle].mean()) < most


@pytest.mark.parametrize(
    ("name", "options", "most"), [("rl", {"iterations": 15}, 0.75), ("sparse", {}, 0.8)]
)
def test_clipped_lamps_shine_again_and_do_not_ring(name, options, most, lab):
    sharp, g, clipped, around = lab.lamps()
    seen, unseen = (
        METHODS[name](g, lab.all_axes, clipped=mask, **options).pixels for mask in (clipped, None)
    )
    assert seen.max() > 3
    errors = [
        np.mean(np.square(np.minimum(f, 1) - lab.frame(sharp))[around]) for f in (seen, unseen)
    ]
    assert errors[0] < most * errors[1]


@pytest.mark.parametrize("level", [0.0, 0.25, 1.0])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_a_constant_photo_stays_constant(method, level, channels):
    shape = (40, 50)
    camera = Camera.from_focal(60.0, *shape)
    kernel = RotationKernel.from_path([(-0.03, -0.04, -0.04), (0.02, 0.05, 0.04)], camera)
    g = np.full((*shape, *channels), level, np.float32)
    if method is sparse_gradients:
        f = np.minimum(method(g, kernel, clipped=np.full(shape, level == 1)).pixels, 1)
        off = 0.01
    else:
        f, off = method(g, kernel, iterations=8).pixels, 1e-4
    assert f.shape == g.shape
    np.testing.assert_allclose(f, level, atol=off)


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (7, 5)])
def test_the_smallest_photos_pass(method, shape):
    g = np.full(shape, 0.5, np.float32)
    kernel = RotationKernel.delta(Camera.from_focal(50, *shape))
    np.testing.assert_allclose(method(g, kernel).pixels, g, atol=1e-3)


def test_grey_and_colour_agree_and_the_photo_is_left_alone(method, lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.003)
    before = g.copy()
    g.setflags(write=False)
    grey = method(g, lab.all_axes, iterations=3).pixels
    colour = method(np.stack([g, g, g], -1), lab.all_axes, iterations=3).pixels
    assert grey.shape == g.shape
    np.testing.assert_allclose(colour, colour[..., :1].repeat(3, -1), atol=1e-5)
    if method is richardson_lucy:  # the others weigh the colours together
        np.testing.assert_allclose(colour[..., 0], grey, atol=1e-5)
    np.testing.assert_array_equal(g, before)


def test_threads_do_not_change_a_byte(method, lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.colours()), 0.003)
    one, four = (
        method(g, lab.all_axes, clipped=g[..., 0] > 0.7, iterations=2, run=Run(n)) for n in (1, 4)
    )
    assert one.pixels.tobytes() == four.pixels.tobytes()
    assert one.iterations == four.iterations


def test_refuses_what_does_not_fit(method, lab):
    g = np.full(lab.shape, 0.5, np.float32)
    broken = g.copy()
    broken[3, 4] = np.nan
    for wrong, options in (
        (g, {"iterations": 0}),
        (g[1:], {}),
        (g[:, :, None, None], {}),
        (g, {"clipped": np.zeros((lab.shape[0], lab.shape[1] - 1), bool)}),
        (broken, {}),
    ):
        with pytest.raises(ValueError, match=r"photo|iteration"):
            method(wrong, lab.all_axes, **options)
