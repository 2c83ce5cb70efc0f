from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.deconvolution.richardson_lucy import richardson_lucy
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
def test_recovers_a_scene(name):
    sharp = scene()
    g = noisy(shaken(KERNELS[name], sharp), 0.003)
    restored = richardson_lucy(g, KERNELS[name])
    assert psnr(restored.pixels, frame(sharp)) > psnr(g, frame(sharp)) + 2
    assert restored.pixels.dtype == np.float32
    assert restored.pixels.min() >= 0
    assert 2 <= restored.iterations <= 40
    assert 0.5 * 0.003 < restored.residual < 3 * 0.003


@pytest.mark.parametrize(("sigma", "within"), [(0.0005, 1.0), (0.003, 1.0), (0.02, 0.7)])
def test_stops_near_the_best_iteration(sigma, within):
    sharp = scene(8)
    g = noisy(shaken(ALL, sharp), sigma)
    counts = (1, 2, 3, 4, 6, 8, 10, 12, 15, 19, 24, 30)
    gains = [psnr(richardson_lucy(g, ALL, iterations=n).pixels, frame(sharp)) for n in counts]
    stopped = richardson_lucy(g, ALL)
    assert psnr(stopped.pixels, frame(sharp)) > max(gains) - within
    same = richardson_lucy(g, ALL, iterations=stopped.iterations)
    np.testing.assert_array_equal(stopped.pixels, same.pixels)


def test_more_noise_means_fewer_iterations():
    blurred = shaken(ALL, scene())
    counts = [richardson_lucy(noisy(blurred, s), ALL).iterations for s in (0.001, 0.01, 0.05)]
    assert counts[0] > counts[1] > counts[2]


@pytest.mark.parametrize("name", ["uniform", "all"])
def test_plain_iterations_never_lower_the_likelihood(name):
    kernel = KERNELS[name]
    rng = np.random.default_rng(2)
    photons = 500
    g = (rng.poisson(shaken(kernel, scene()) * photons) / photons).astype(np.float32)
    # all of the scene that the frame saw is needed to blur it again: look where it is known
    r = 20
    inner = kernel.camera.cropped(r, r, WIDTH - 2 * r, HEIGHT - 2 * r)
    blur = ShakeBlur(kernel.for_camera(inner), margin=r)
    seen = g[r:-r, r:-r].astype(np.float64)
    likelihood = []
    for n in range(1, 15):
        f = richardson_lucy(g, kernel, iterations=n, accelerated=False).pixels
        model = blur.forward(f).astype(np.float64)
        likelihood.append(np.sum(seen * np.log(model) - model))
    assert np.all(np.diff(likelihood) > 0)


def test_acceleration_arrives_sooner():
    g = shaken(ALL, scene())
    quick = richardson_lucy(g, ALL, iterations=10)
    slow = richardson_lucy(g, ALL, iterations=10, accelerated=False)
    slower = richardson_lucy(g, ALL, iterations=20, accelerated=False)
    assert quick.residual < slower.residual < slow.residual


@pytest.mark.parametrize("name", KERNELS)
def test_keeps_the_brightness(name):
    sharp = np.stack([scene(s) for s in (5, 6, 7)], -1)
    g = noisy(shaken(KERNELS[name], sharp), 0.003)
    f = richardson_lucy(g, KERNELS[name]).pixels
    before, after = (x.mean((0, 1), dtype=float) for x in (g, f))
    np.testing.assert_allclose(after, before, rtol=2e-3)


def test_the_border_is_nearly_as_good_as_the_middle():
    sharp = scene(3)
    f = richardson_lucy(noisy(shaken(ALL, sharp), 0.003), ALL).pixels
    error = np.square(f - frame(sharp))
    middle = np.zeros(error.shape, bool)
    middle[16:-16, 16:-16] = True
    assert 10 * np.log10(error[~middle].mean() / error[middle].mean()) < 3


def lamps():
    """A dim scene with lamps of eight times the clip level."""
    sharp = scene(4) * 0.3
    for x, y in ((70, 60), (150, 90), (110, 130), (180, 50)):
        cv2.circle(sharp, (x, y), 4, 8.0, -1, cv2.LINE_AA)
    g = noisy(shaken(ALL, sharp), 0.002)
    return sharp, g, g >= 0.99


def test_clipped_lamps_do_not_ring():
    sharp, g, clipped = lamps()
    around = cv2.dilate(clipped.astype(np.uint8), np.ones((25, 25))) > 0
    around &= frame(sharp) < 0.5
    errors = {}
    for name, mask in (("response", clipped), ("none", None)):
        f = richardson_lucy(g, ALL, clipped=mask, iterations=15).pixels
        errors[name] = np.mean(np.square(np.minimum(f, 1) - frame(sharp))[around])
        if name == "response":
            assert f.max() > 3  # lamps shine again
    assert errors["response"] < 0.75 * errors["none"]


def test_photos_without_clipping_get_the_plain_iteration():
    g = shaken(ALL, scene())
    plain = richardson_lucy(g, ALL, iterations=4)
    none = richardson_lucy(g, ALL, iterations=4, clipped=np.zeros(g.shape, bool))
    np.testing.assert_array_equal(plain.pixels, none.pixels)


def test_one_plain_iteration_is_equation_11():
    kernel = KERNELS["pan"]
    g = shaken(kernel, scene())
    one = richardson_lucy(g, kernel, iterations=1, accelerated=False).pixels
    two = richardson_lucy(g, kernel, iterations=2, accelerated=False).pixels
    r = 20  # beyond the reach, twice: away from what the frame does not show
    blur = ShakeBlur(kernel, kind="warps", margin=0)
    ratio = g / np.maximum(blur.forward(one), 1e-6)
    ratio[:r], ratio[-r:], ratio[:, :r], ratio[:, -r:] = 1, 1, 1, 1
    expected = one * blur.adjoint(ratio) / np.maximum(blur.adjoint(np.ones_like(g)), 1e-6)
    inside = slice(2 * r, -2 * r), slice(2 * r, -2 * r)
    np.testing.assert_allclose(two[inside], expected[inside], atol=2e-3)
    assert np.abs(two - one)[inside].max() > 0.02


@pytest.mark.parametrize("level", [0.0, 0.25, 1.0])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_a_constant_photo_stays_constant(level, channels):
    g = np.full((HEIGHT, WIDTH, *channels), level, np.float32)
    f = richardson_lucy(g, ALL, iterations=8).pixels
    assert f.shape == g.shape
    np.testing.assert_allclose(f, level, atol=1e-4 if level else 0)


def test_a_white_photo_stays_white():
    g = np.ones((HEIGHT, WIDTH), np.float32)
    f = richardson_lucy(g, ALL, clipped=g > 0).pixels
    assert f.min() > 0.98
    assert np.isfinite(f).all()


def test_a_still_camera_changes_nothing():
    g = np.ascontiguousarray(frame(scene()))
    f = richardson_lucy(g, RotationKernel.delta(CAMERA)).pixels
    np.testing.assert_allclose(f, g, atol=1e-5)


def test_grey_and_colour_agree():
    g = noisy(shaken(ALL, scene()), 0.003)
    grey = richardson_lucy(g, ALL, iterations=5).pixels
    colour = richardson_lucy(np.stack([g, g, g], -1), ALL, iterations=5).pixels
    assert grey.shape == g.shape
    np.testing.assert_allclose(colour, np.stack([grey] * 3, -1), atol=1e-5)


def test_threads_do_not_change_a_byte():
    sharp = np.stack([scene(s) for s in (5, 6, 7)], -1)
    g = noisy(shaken(ALL, sharp), 0.003)
    one, four = (richardson_lucy(g, ALL, clipped=g[..., 0] > 0.7, threads=t) for t in (1, 4))
    assert one.pixels.tobytes() == four.pixels.tobytes()
    assert one.iterations == four.iterations


def test_the_kernel_need_not_be_centred():
    g = shaken(ALL, scene())
    turned = ALL.shifted((4, -3, 2))
    f = richardson_lucy(g, ALL, iterations=6).pixels
    difference = richardson_lucy(g, turned, iterations=6).pixels - f
    # pixels are cut elsewhere by fractions; a picture shifted by four pixels would differ by .1
    assert np.sqrt(np.mean(np.square(difference))) < 0.02


def test_the_photo_is_left_alone():
    g = shaken(ALL, scene())
    before = g.copy()
    g.setflags(write=False)
    richardson_lucy(g, ALL, iterations=2)
    np.testing.assert_array_equal(g, before)


@pytest.mark.parametrize("iterations", [None, 5])
def test_tells_how_far_it_is(iterations):
    told = []
    g = noisy(shaken(ALL, scene()), 0.003)
    done = richardson_lucy(
        g, ALL, iterations=iterations, progress=lambda part, text: told.append((part, text))
    )
    parts = [part for part, _ in told]
    assert len(parts) == done.iterations
    assert all(0 < part <= 1 for part in parts)
    assert parts[-1] == 1
    assert parts.count(1) == 1
    assert told[-1][1].endswith(str(done.iterations))


def test_refuses_what_does_not_fit():
    g = np.full((HEIGHT, WIDTH), 0.5, np.float32)
    broken = g.copy()
    broken[3, 4] = np.nan
    for wrong, options in (
        (g, {"iterations": 0}),
        (g[1:], {}),
        (g[:, :, None, None], {}),
        (g, {"clipped": np.zeros((HEIGHT, WIDTH - 1), bool)}),
        (broken, {}),
    ):
        with pytest.raises(ValueError, match=r"photo|iteration"):
            richardson_lucy(wrong, ALL, **options)
