from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.deconvolution.richardson_lucy import richardson_lucy
from deshake.deconvolution.sparse_gradients import sparse_gradients
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur

HEIGHT, WIDTH = 150, 190
BEYOND = 24  # pixels of the scene around the frame
CAMERA = Camera.from_focal(1.2 * WIDTH, HEIGHT, WIDTH)
UNIFORM = Camera.uniform(HEIGHT, WIDTH)


def turn(ends, camera=CAMERA):
    """Make the kernel of a path through points in pixels at the edge of the frame, centred."""
    return RotationKernel.from_path(np.array(ends) * grid_steps(camera), camera).centred()


KERNELS = {
    "uniform": turn([(0, 0, 0), (6, 2, 0), (8, 7, 0)], UNIFORM),
    "pan": turn([(0, 0, 0), (2, 9, 0)]),
    "roll": turn([(0, 0, -7), (0, 0, 7)]),
    "all": turn([(0, 0, 0), (5, 3, 4), (2, 8, 9)]),
}
ALL = KERNELS["all"]


def scene(seed=5):
    """Discs and bars of many sizes and greys on a ramp, .1 to .8, float32."""
    rng = np.random.default_rng(seed)
    height, width = HEIGHT + 2 * BEYOND, WIDTH + 2 * BEYOND
    out = np.tile(np.linspace(0.2, 0.5, width, dtype=np.float32), (height, 1))
    for _ in range(90):
        x, y = int(rng.integers(width)), int(rng.integers(height))
        dx, dy = (int(d) for d in rng.integers(-15, 16, 2))
        level = float(rng.uniform(0.1, 0.8))
        if rng.random() < 0.5:
            cv2.circle(out, (x, y), int(rng.integers(2, 12)), level, -1, cv2.LINE_AA)
        else:
            cv2.line(out, (x, y), (x + dx, y + dy), level, int(rng.integers(1, 4)), cv2.LINE_AA)
    return out


def frame(image):
    return image[BEYOND:-BEYOND, BEYOND:-BEYOND]


def shaken(kernel, sharp):
    """Blur a scene exactly."""
    blur = ShakeBlur(kernel, margin=BEYOND, kind="warps")
    return blur.forward(sharp)


def noisy(image, sigma, seed=1):
    rng = np.random.default_rng(seed)
    return np.clip(image + rng.normal(0, sigma, image.shape), 0, 1).astype(np.float32)


def psnr(a, b):
    return float(-10 * np.log10(np.mean(np.square(a.astype(np.float64) - b))))


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("sigma", [0.003, 0.02])
def test_recovers_a_scene_better_than_richardson_lucy(name, sigma):
    sharp = scene()
    g = noisy(shaken(KERNELS[name], sharp), sigma)
    restored = sparse_gradients(g, KERNELS[name])
    other = richardson_lucy(g, KERNELS[name])
    assert psnr(restored.pixels, frame(sharp)) > psnr(other.pixels, frame(sharp)) + 0.5
    assert psnr(restored.pixels, frame(sharp)) > psnr(g, frame(sharp)) + 2
    assert restored.pixels.dtype == np.float32
    assert restored.pixels.min() >= 0
    assert 0.5 * sigma < restored.residual < 3 * sigma


def test_keeps_its_head_with_a_wrong_kernel():
    rng = np.random.default_rng(3)
    sharp = scene()
    g = noisy(shaken(ALL, sharp), 0.01)
    weights = ALL.weights * np.exp(rng.normal(0, 0.5, len(ALL.weights)))
    wrong = RotationKernel(ALL.theta, weights / weights.sum(), ALL.steps, CAMERA).above(0.2)
    f = sparse_gradients(g, wrong).pixels
    assert psnr(f, frame(sharp)) > psnr(g, frame(sharp)) + 1


@pytest.mark.parametrize("name", KERNELS)
def test_keeps_the_brightness_of_every_colour(name):
    sharp = np.stack([scene(s) for s in (5, 6, 7)], -1) * np.array([1, 0.5, 0.2], np.float32)
    g = noisy(shaken(KERNELS[name], sharp), 0.003)
    f = sparse_gradients(g, KERNELS[name]).pixels
    before, after = (x.mean((0, 1), dtype=float) for x in (g, f))
    np.testing.assert_allclose(after, before, rtol=2e-3)


def test_the_border_is_nearly_as_good_as_the_middle():
    sharp = scene(3)
    f = sparse_gradients(noisy(shaken(ALL, sharp), 0.003), ALL).pixels
    error = np.square(f - frame(sharp))
    middle = np.zeros(error.shape, bool)
    middle[16:-16, 16:-16] = True
    assert 10 * np.log10(error[~middle].mean() / error[middle].mean()) < 3


def test_clipped_lamps_do_not_ring():
    sharp = scene(4) * 0.3
    for x, y in ((70, 60), (150, 90), (110, 130), (180, 50)):
        cv2.circle(sharp, (x, y), 4, 8.0, -1, cv2.LINE_AA)
    g = noisy(shaken(ALL, sharp), 0.002)
    clipped = g >= 0.99
    around = cv2.dilate(clipped.astype(np.uint8), np.ones((25, 25))) > 0
    around &= frame(sharp) < 0.5
    errors = {}
    for name, mask in (("told", clipped), ("not told", None)):
        f = sparse_gradients(g, ALL, clipped=mask).pixels
        errors[name] = np.mean(np.square(np.minimum(f, 1) - frame(sharp))[around])
        if name == "told":
            assert f.max() > 3  # lamps shine again
    assert errors["told"] < 0.8 * errors["not told"]


@pytest.mark.parametrize("level", [0.0, 0.25, 1.0])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_a_constant_photo_stays_constant(level, channels):
    g = np.full((HEIGHT, WIDTH, *channels), level, np.float32)
    clipped = np.full((HEIGHT, WIDTH), level == 1)
    f = sparse_gradients(g, ALL, clipped=clipped).pixels
    assert f.shape == g.shape
    np.testing.assert_allclose(np.minimum(f, 1), level, atol=0.01)


def test_a_still_camera_changes_little():
    g = np.ascontiguousarray(frame(scene()))
    f = sparse_gradients(g, RotationKernel.delta(CAMERA)).pixels
    assert psnr(f, g) > 40


def test_the_smallest_photos_pass():
    for shape in ((1, 1), (1, 40), (7, 5)):
        g = np.full(shape, 0.5, np.float32)
        kernel = RotationKernel.delta(Camera.from_focal(50, *shape))
        np.testing.assert_allclose(sparse_gradients(g, kernel).pixels, g, atol=1e-3)


def test_grey_photos_stay_grey():
    g = noisy(shaken(ALL, scene()), 0.003)
    colour = sparse_gradients(np.stack([g, g, g], -1), ALL).pixels
    np.testing.assert_allclose(colour, colour[..., :1].repeat(3, -1), atol=1e-5)


def test_more_stages_explain_more():
    g = noisy(shaken(ALL, scene()), 0.003)
    one, seven = (sparse_gradients(g, ALL, iterations=n) for n in (1, 7))
    assert (one.iterations, seven.iterations) == (1, 7)
    assert seven.residual < one.residual


def test_threads_do_not_change_a_byte():
    sharp = np.stack([scene(s) for s in (5, 6, 7)], -1)
    g = noisy(shaken(ALL, sharp), 0.003)
    one, four = (sparse_gradients(g, ALL, clipped=g[..., 0] > 0.7, threads=t) for t in (1, 4))
    assert one.pixels.tobytes() == four.pixels.tobytes()


def test_bands_do_not_show(monkeypatch):
    g = noisy(shaken(ALL, scene()), 0.003)
    module = "deshake.deconvolution.sparse_gradients"
    whole = sparse_gradients(g, ALL).pixels
    monkeypatch.setattr(f"{module}._BAND_PIXELS", 1)
    np.testing.assert_allclose(sparse_gradients(g, ALL).pixels, whole, atol=1e-4)


def test_the_photo_is_left_alone():
    g = shaken(ALL, scene())
    before = g.copy()
    g.setflags(write=False)
    sparse_gradients(g, ALL, iterations=1)
    np.testing.assert_array_equal(g, before)


def test_tells_how_far_it_is():
    told = []
    g = noisy(shaken(ALL, scene()), 0.003)
    sparse_gradients(g, ALL, progress=lambda part, text: told.append((part, text)))
    parts = [part for part, _ in told]
    assert parts == sorted(parts)
    assert 0 < parts[0] < 0.2
    assert parts[-1] == 1
    assert parts.count(1) == 1
    assert told[-1][1] == "deblurring, stage 4"


def test_refuses_what_does_not_fit():
    g = np.full((HEIGHT, WIDTH), 0.5, np.float32)
    broken = g.copy()
    broken[3, 4] = np.nan
    for wrong, options in (
        (g, {"iterations": 0}),
        (g[1:], {}),
        (g, {"clipped": np.zeros((HEIGHT, WIDTH - 1), bool)}),
        (broken, {}),
    ):
        with pytest.raises(ValueError, match=r"photo|iteration"):
            sparse_gradients(wrong, ALL, **options)
