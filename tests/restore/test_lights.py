from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from deshake.operators.filter_flow import FilterFlow
from deshake.restore.lights import behind_lights, trust
from deshake.restore.richardson_lucy import latent_start
from deshake.run import Run


@pytest.fixture(scope="module")
def night(lab):
    """Make a night photo, its first estimate and its blur."""
    sharp, g, clipped, around = lab.lamps()
    kernel = lab.all_axes
    flow = FilterFlow(kernel.camera, kernel.theta, run=Run(1))
    blur = flow.filters(kernel.weights)
    f = latent_start(g, blur, clipped=clipped, iterations=6, run=Run(1, lambda *_: None))
    return sharp, g, clipped, around, blur, f, flow.margin


def test_clipped_pixels_and_what_lamps_reach_are_not_trusted(night):
    _, g, clipped, _, blur, f, _ = night
    m = trust(f, blur, clipped, 0.002**2)
    assert m.shape == g.shape
    assert 0 <= m.min() <= m.max() <= 1
    assert m[clipped].max() == 0
    spilt = blur.forward(np.where(f > 1.5, f, 0).astype(np.float32))[0]
    assert m[spilt > 0.1].max() < 0.1
    assert m[spilt < 1e-4].mean() > 0.9
    assert np.all(trust(f, blur, clipped, 0.02**2) >= m)


def test_without_lamps_all_is_trusted(night):
    _, _, clipped, _, blur, f, _ = night
    m = trust(np.minimum(f, 1), blur, np.zeros_like(clipped), 0.002**2)
    assert m.min() == 1


def test_the_scene_behind_lamps_is_restored(night, lab):
    sharp, g, clipped, around, blur, first, margin = night
    m = trust(first, blur, clipped, 0.002**2)
    f = first.copy()
    reports = []
    behind_lights(
        f,
        g[None],
        blur,
        m,
        iterations=6,
        run=Run(progress=lambda share, text: reports.append((share, text))),
    )

    def error(latent):
        frame = np.minimum(latent[0, margin:-margin, margin:-margin], 1)
        return np.mean(np.square(frame - lab.frame(sharp))[around])

    assert error(f) < 0.7 * error(first)
    lamps = first[0] > 1.5
    np.testing.assert_array_equal(f[0][lamps], first[0][lamps])
    assert f.min() >= 0
    assert [share for share, _ in reports] == pytest.approx(np.arange(1, 7) / 6)


def test_the_misfit_of_trusted_pixels_falls(night):
    _, g, clipped, _, blur, first, _ = night
    m = trust(first, blur, clipped, 0.002**2)

    def misfit(iterations):
        """Return the weighted divergence that Richardson-Lucy lowers."""
        f = first.copy()
        behind_lights(f, g[None], blur, m, iterations=iterations, run=Run())
        Af = np.maximum(blur.forward(f)[0], 1e-6)
        return float(np.sum(m * (Af - g * np.log(Af)), dtype=np.float64))

    values = [misfit(n) for n in (1, 2, 4, 8)]
    assert values == sorted(values, reverse=True)


def test_only_pixels_that_an_untrusted_pixel_shows_change(night):
    _, g, clipped, _, blur, first, margin = night
    m = trust(first, blur, clipped, 0.002**2)
    f = first.copy()
    behind_lights(f, g[None], blur, m, iterations=3, run=Run())
    untrusted = np.pad(m < 0.98, margin)
    wide = 2 * margin + 1
    shown = binary_dilation(untrusted, np.ones((wide, wide), bool))
    changed = f[0] != first[0]
    assert changed.mean() > 0.02
    assert not changed[~shown].any()


def test_patches_far_from_lights_are_not_needed(night):
    _, g, clipped, _, blur, first, _ = night

    class Whole:
        """The same blur on all patches."""

        forward, adjoint = blur.forward, blur.adjoint

        def near(self, marked):
            assert marked.shape == first.shape[1:]
            return self

    results = []
    for operator in (blur, Whole()):
        m = trust(first, operator, clipped, 0.002**2)
        f = first.copy()
        behind_lights(f, g[None], operator, m, iterations=3, run=Run())
        results.append((m, f))
    for near, whole in zip(*results, strict=True):
        np.testing.assert_allclose(near, whole, atol=1e-5)


def test_colours_behind_lamps_keep_their_shares(night, lab):
    sharp, g, clipped, around, blur, first, margin = night
    m = trust(first, blur, clipped, 0.002**2)
    shares = np.array([1, 0.6, 0.3], np.float32)[:, None, None]
    lamps = first[0] > 1.5
    before = np.where(lamps, first, shares * first)
    f = before.copy()
    behind_lights(f, shares * g, blur, m, iterations=6, run=Run())
    np.testing.assert_array_equal(f[:, lamps], before[:, lamps])
    np.testing.assert_allclose(f[:, ~lamps], (shares * f[0])[:, ~lamps], rtol=1e-3, atol=1e-5)

    def error(latent):
        frame = np.minimum(latent[:, margin:-margin, margin:-margin], shares)
        return np.mean(np.square(frame - shares * lab.frame(sharp))[:, around])

    assert error(f) < 0.7 * error(before)
