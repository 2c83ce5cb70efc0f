from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from deshake.blind.sharp_edges import l0_picture, latent_edges, shocked
from deshake.blind.tiles import Tiles
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import reach
from deshake.signal.gradients import differences

LAM = 2e-3
SIZE = 64
CORNERS = [(10, 14), (60, 150), (126, 60)]


@pytest.fixture
def tiles(shaken) -> Tiles:
    """Tiles of the shaken photo, with its kernel."""
    scale = shaken.pyramid.at(0)
    tiles = Tiles(scale, CORNERS, SIZE, reach(shaken.camera, shaken.kernel.theta))
    tiles.bind(shaken.kernel)
    return tiles


def truth(shaken, tiles: Tiles) -> np.ndarray:
    """The sharp picture's blocks, in the contrast of the tiles."""
    scale = shaken.pyramid.at(0)._replace(stored=shaken.still)
    return Tiles(scale, CORNERS, SIZE, tiles.far).g


def inner(tiles: Tiles) -> tuple[slice, ...]:
    part = slice(tiles.first, tiles.first + tiles.size)
    return slice(None), part, part


def energy(tiles: Tiles, picture: np.ndarray, lam: float = LAM) -> float:
    """``|A S - g|^2 + lam #{grad S != 0}``; tiny gradients count as zero."""
    across, down = differences(picture)
    edges = across**2 + down**2 > lam / 16
    misfit = tiles.blurred(picture) - tiles.filled
    return float(np.square(misfit, dtype=np.float64).sum() + lam * edges.sum())


@pytest.mark.parametrize("lam", [1e-3, 1e-2])
def test_the_picture_lowers_its_energy(tiles, lam) -> None:
    picture, across, down = l0_picture(tiles, lam)
    assert energy(tiles, picture, lam) < 0.8 * energy(tiles, tiles.filled, lam)
    kept = across**2 + down**2 > 0
    assert 0.005 < kept.mean() < 0.5


def test_a_weight_that_grows_faster_needs_fewer_steps(tiles, monkeypatch) -> None:
    solved, steps = Tiles.solved, []

    def counted(self, *args):
        steps[-1] += 1
        return solved(self, *args)

    monkeypatch.setattr(Tiles, "solved", counted)
    for growth in (1.5, 4.0):
        steps.append(0)
        picture, _, _ = l0_picture(tiles, LAM, growth=growth)
        assert energy(tiles, picture) < 0.8 * energy(tiles, tiles.filled)
    assert steps[1] < steps[0] / 2


def test_the_picture_is_sharper_than_the_photo(tiles, shaken) -> None:
    sharp = truth(shaken, tiles)[inner(tiles)]
    estimated, photo = (
        block[inner(tiles)] - block[inner(tiles)].mean((1, 2), keepdims=True)
        for block in (l0_picture(tiles, LAM)[0], tiles.g)
    )
    sharp = sharp - sharp.mean((1, 2), keepdims=True)
    assert np.linalg.norm(estimated - sharp) < 0.7 * np.linalg.norm(photo - sharp)


def test_a_wrong_kernel_needs_more_energy(tiles, shaken) -> None:
    kernel, price = shaken.kernel, 1e-2
    right = energy(tiles, l0_picture(tiles, price)[0], price)
    mirrored = replace(kernel, theta=kernel.theta * [-1, 1, 1])
    for wrong in (RotationKernel.delta(shaken.camera), mirrored):
        other = tiles.bound(wrong)
        assert right < 0.96 * energy(other, l0_picture(other, price)[0], price)


def test_a_higher_price_leaves_fewer_edges(tiles) -> None:
    counts = [np.count_nonzero(l0_picture(tiles, lam)[1]) for lam in (1e-3, 1e-2, 1e-1)]
    assert counts[0] > 1.3 * counts[1] > 1.3**2 * counts[2]


def test_split_gradients_are_those_of_the_picture_without_the_small_ones(tiles) -> None:
    picture, across, down = l0_picture(tiles, LAM)
    x, y = differences(picture)
    length, kept = x**2 + y**2, across**2 + down**2 > 0
    np.testing.assert_array_equal(across, x * kept)
    np.testing.assert_array_equal(down, y * kept)
    assert length[kept].min() >= length[~kept].max()


def test_tiles_do_not_change_one_another(tiles, shaken) -> None:
    together = l0_picture(tiles, LAM)[0]
    for p, corner in enumerate(CORNERS):
        alone = Tiles(shaken.pyramid.at(0), [corner], SIZE, tiles.far)
        alone.bind(shaken.kernel)
        np.testing.assert_allclose(l0_picture(alone, LAM)[0][0], together[p], atol=1e-5)


def test_groups_of_tiles_have_the_same_bytes(tiles, monkeypatch) -> None:
    pictures = []
    for pixels in (1, 2 * tiles.block**2, 2**30):
        monkeypatch.setattr("deshake.blind.tiles._GROUP", pixels)
        pictures.append(np.stack(l0_picture(tiles, LAM)))
    np.testing.assert_array_equal(pictures[0], pictures[2])
    np.testing.assert_array_equal(pictures[1], pictures[2])


@pytest.mark.parametrize(("kind", "least"), [("shock", 0.45), ("l0", 0.68), ("strong", 0.68)])
def test_edges_of_every_kind_are_like_the_true_ones(tiles, shaken, kind, least) -> None:
    sharp = differences(truth(shaken, tiles))
    estimated = latent_edges(tiles, LAM, kind)
    for edge, true in zip(estimated, sharp, strict=True):
        assert np.corrcoef(edge[inner(tiles)].ravel(), true[inner(tiles)].ravel())[0, 1] > least
    share = np.mean(estimated[0] ** 2 + estimated[1] ** 2 > 0)
    assert 0.005 < share < 0.5


def test_strong_edges_are_worth_their_price_and_split_ones_those_of_the_picture(tiles) -> None:
    _, across, down = l0_picture(tiles, LAM)
    filled = tiles.filled
    estimated = {}
    for kind in ("shock", "l0", "strong"):
        tiles.filled = filled
        estimated[kind] = latent_edges(tiles, LAM, kind)
    np.testing.assert_array_equal(estimated["l0"], (across, down))
    assert not np.array_equal(estimated["shock"][0], estimated["l0"][0])
    x, y = estimated["strong"]
    length = x**2 + y**2
    assert length[length > 0].min() >= np.float32(LAM)


def test_latent_edges_fill_in_unknown_pixels(shaken) -> None:
    clipped = np.zeros(shaken.grey.shape, bool)
    clipped[40:46, 40:50] = True
    spoilt = np.where(clipped, np.float32(1), shaken.grey)
    scale = shaken.pyramid.at(0)._replace(stored=spoilt, clipped=clipped)
    tiles = Tiles(scale, CORNERS, SIZE, reach(shaken.camera, shaken.kernel.theta))
    tiles.bind(shaken.kernel)
    picture, _, _ = l0_picture(tiles, LAM)
    latent_edges(tiles, LAM, "l0")
    unknown = tiles.belief == 0
    np.testing.assert_array_equal(tiles.filled[unknown], tiles.blurred(picture)[unknown])
    hidden = np.s_[0, tiles.first + 30 : tiles.first + 36, tiles.first + 26 : tiles.first + 36]
    assert unknown[hidden].all()
    assert tiles.filled[hidden].mean() < tiles.g[hidden].mean()  # nearer to what is around


def test_the_shock_filter_steepens_edges_and_keeps_flats() -> None:
    step = np.zeros((40, 40), np.float32)
    step[:, 20:] = 1
    blocks = np.stack([cv2.GaussianBlur(step, (0, 0), 2.0), cv2.GaussianBlur(step.T, (0, 0), 2.0)])
    sharpened = shocked(blocks)
    assert sharpened.shape == blocks.shape
    for axis, estimated, soft in zip((1, 0), sharpened, blocks, strict=True):
        slopes = [np.abs(np.diff(one, axis=axis))[5:-5, 5:-5].max() for one in (estimated, soft)]
        assert slopes[0] > 1.2 * slopes[1]
    np.testing.assert_allclose(sharpened[0][5:-5, 4:8], 0, atol=1e-3)
    assert sharpened[:, 5:-5, 5:-5].min() > -1e-3
    assert sharpened[:, 5:-5, 5:-5].max() < 1 + 1e-3


def test_the_shock_filter_leaves_its_input_alone() -> None:
    blocks = np.random.default_rng(0).random((2, 20, 20)).astype(np.float32)
    before = blocks.copy()
    shocked(blocks)
    np.testing.assert_array_equal(blocks, before)
