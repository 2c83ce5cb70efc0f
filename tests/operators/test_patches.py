from __future__ import annotations

import numpy as np
import pytest

from deshake.operators.patches import PatchGrid
from deshake.run import Run


def grid_of(
    shape: tuple[int, int],
    *,
    radius: int = 5,
    hop: int = 12,
    margin: int = 5,
    ramp: int | None = None,
) -> PatchGrid:
    return PatchGrid(shape, radius, hop, margin, ramp=ramp, run=Run(2))


@pytest.mark.parametrize("ramp", [None, 1, 5, 12])
@pytest.mark.parametrize("shape", [(50, 70), (12, 12), (1, 1), (13, 200)])
def test_windows_sum_to_one(shape: tuple[int, int], ramp: int | None) -> None:
    grid = grid_of(shape, ramp=ramp)
    total = np.zeros((1, *shape), np.float32)
    for strip in grid.strips:
        ones = np.ones((1, strip.count, grid.patch, grid.patch), np.float32)
        canvas = grid.canvas(1, strip, grid.patch)
        grid.overlap_add(ones, canvas, window=grid.window * grid.transforms.gain)
        grid.add_observed(total, strip, canvas)
    np.testing.assert_allclose(total, 1, atol=1e-6)


def test_windows_are_triangles_or_have_a_flat_middle() -> None:
    def across(ramp: int | None) -> np.ndarray:
        grid = grid_of((50, 70), hop=4, ramp=ramp)
        return (grid.window * grid.transforms.gain).sum(0) / 4  # the other side sums to the hop

    np.testing.assert_allclose(across(None) * 8, [1, 3, 5, 7, 7, 5, 3, 1], rtol=1e-6)
    np.testing.assert_allclose(across(2) * 4, [1, 3, 4, 4, 3, 1], rtol=1e-6)


@pytest.mark.parametrize("ramp", [4, 5, 12])
def test_centres_are_those_of_the_patches(ramp: int) -> None:
    grid = grid_of((90, 130), ramp=ramp)
    strip = grid.strips[2]
    y, x = np.mgrid[0:90, 0:130].astype(np.float32)
    patches = grid.patches(np.stack([x, y]), strip)[:, 1:-2]  # within the frame
    np.testing.assert_allclose(patches.mean((2, 3)).T, grid.centres(strip)[1:-2], rtol=1e-5)


@pytest.mark.parametrize("windowed", [False, True])
def test_pieces_are_added_at_every_hop(windowed: bool) -> None:  # noqa: FBT001
    grid = grid_of((50, 70))
    strip = grid.strips[1].part(1, 5)
    rng = np.random.default_rng(0)
    wide = rng.random((2, 2, grid.patch, grid.block), np.float32)  # rows longer than a piece's
    pieces, canvas = wide[..., : grid.patch], grid.canvas(2, strip, grid.patch)
    canvas[:] = before = rng.random(canvas.shape, np.float32)
    window = grid.window if windowed else np.ones_like(grid.window)
    grid.overlap_add(pieces, canvas, 1, grid.window if windowed else None)
    for j in (0, 1):
        before[:, :, (j + 1) * grid.hop :][:, :, : grid.patch] += pieces[:, j] * window
    np.testing.assert_allclose(canvas, before, atol=1e-6)


def test_every_patch_is_in_one_strip_and_batch() -> None:
    grid = grid_of((50, 9000))
    cells = [
        (strip.row, column)
        for strip in grid.strips
        for batch in grid.batches(strip)
        for part in [strip.part(batch.start, batch.stop)]
        for column in range(part.first, part.last)
    ]
    assert len(cells) == len(set(cells)) == grid.rows * grid.columns


def test_strips_do_not_depend_on_the_threads() -> None:
    a = PatchGrid((500, 900), 5, 12, 5, run=Run(1))
    b = PatchGrid((500, 900), 5, 12, 5, run=Run(4))
    assert a.strips == b.strips


@pytest.mark.parametrize("ramp", [5, 12])
def test_blocks_are_what_patches_look_at(ramp: int) -> None:
    grid = grid_of((50, 70), margin=0, ramp=ramp)
    image = np.random.default_rng(0).random((2, 50, 70)).astype(np.float32)
    strip = grid.strips[2]
    blocks, patches = grid.blocks(image, strip), grid.patches(image, strip)
    n, p = grid.block, grid.patch
    assert blocks.shape == (2, strip.count, n, n)
    assert patches.shape == (2, strip.count, p, p)
    column = 3
    top, left = strip.row * grid.hop - ramp, column * grid.hop - ramp
    inside = image[:, top : top + p, left : left + p]
    np.testing.assert_array_equal(patches[:, column], inside)
    padded = grid.padded(patches[:, 3:5], grid.padding(2, strip))[:, 0]
    np.testing.assert_array_equal(padded[:, :p, :p], inside * grid.window)
    assert np.all(padded[:, p:] == 0)
    assert np.all(padded[:, :, p:] == 0)
    r = grid.radius
    np.testing.assert_array_equal(blocks[:, column, r : r + p, r : r + p], inside)
    assert np.all(grid.blocks(image, grid.strips[0])[:, 0, : r + ramp] == 0)


def test_cross_correlations_are_sums_over_pixels() -> None:
    grid = grid_of((30, 40), radius=3, hop=10, margin=3)
    rng = np.random.default_rng(0)
    observed = rng.random((2, 30, 40)).astype(np.float32)
    latent = rng.random((2, *grid.latent_shape)).astype(np.float32)
    total = np.zeros((grid.reach, grid.reach))
    for _, part in grid.cross_correlations(observed, latent, lambda _, c: c.sum(0)):
        total += part
    for dy, dx in ((0, 0), (-3, 2), (1, -3)):
        moved = latent[:, 3 + dy : 33 + dy, 3 + dx : 43 + dx]
        assert total[3 + dy, 3 + dx] == pytest.approx(float((observed * moved).sum()), rel=1e-5)


@pytest.mark.parametrize("radius", [3, 14, 40])  # lags within a patch, and far beyond it
def test_autocorrelations_are_sums_over_pixels(radius: int) -> None:
    grid = grid_of((30, 40), radius=radius, hop=10, margin=3)
    observed = np.random.default_rng(0).random((2, 30, 40)).astype(np.float32)
    strip = grid.strips[1]
    correlations = grid.autocorrelations(observed, strip)
    assert correlations.shape == (strip.count, 4 * radius + 1, 4 * radius + 1)
    patches = (grid.patches(observed, strip) * np.sqrt(grid.window * grid.transforms.gain))[:, 1]
    lags = range(-2 * radius, 2 * radius + 1)
    for dy, dx in [(0, 0), (2, 5), (-6, 3), *zip(lags, reversed(lags), strict=True)]:
        a = patches[:, max(0, -dy) : 20 - max(0, dy), max(0, -dx) : 20 - max(0, dx)]
        b = patches[:, max(0, dy) : 20 + min(0, dy), max(0, dx) : 20 + min(0, dx)]
        expected = float((a * b).sum()) if max(abs(dy), abs(dx)) < 20 else 0.0
        assert correlations[1, 2 * radius + dy, 2 * radius + dx] == pytest.approx(
            expected, rel=1e-4, abs=1e-3
        )


def test_centres_lie_within_the_frame() -> None:
    grid = grid_of((50, 70))
    centres = np.concatenate([grid.centres(strip) for strip in grid.strips])
    assert len(centres) == grid.rows * grid.columns
    assert centres.min() == 0
    np.testing.assert_array_equal(centres.max(0), [69, 49])
