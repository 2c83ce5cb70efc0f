from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from deshake.blind.tiles import Tiles
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import displacements, homographies, reach
from deshake.signal.gradients import differences
from deshake.signal.pyramid import Scale

SIZE = 48
CORNERS = [(20, 24), (60, 110), (96, 40), (56, 56)]
TURN = np.array([[-2.0, -4, 0], [1, 0, 0], [3, 3, 0]])
ROLL = np.array([[-2.0, -4, -1], [1, 0, 0], [3, 3, 1]])


@dataclass(frozen=True)
class Case:
    tiles: Tiles
    latent: np.ndarray  # the sharp picture's blocks
    exact: np.ndarray  # the middles as the exact warps blur them


def cut(picture: np.ndarray, camera: Camera, far: int, clipped=None, corners=CORNERS) -> Tiles:
    return Tiles(Scale(picture, camera, clipped, 1.0), corners, SIZE, far)


def middles(picture: np.ndarray) -> np.ndarray:
    return np.stack([picture[y : y + SIZE, x : x + SIZE] for y, x in CORNERS])


def without_mean(blocks: np.ndarray) -> np.ndarray:
    return blocks - blocks.mean((1, 2), keepdims=True)


def case(shake, camera: Camera, path: np.ndarray) -> Case:
    shaken = shake(camera, path, noise=0)
    tiles = cut(shaken.grey, camera, reach(camera, shaken.kernel.theta))
    tiles.bind(shaken.kernel)
    latent = cut(shaken.still, camera, tiles.far).g
    return Case(tiles, latent, middles(shaken.grey))


def inner(tiles: Tiles) -> tuple[slice, ...]:
    part = slice(tiles.first, tiles.first + tiles.size)
    return slice(None), part, part


def test_reach_bounds_all_that_is_moved(shaken) -> None:
    camera, theta = shaken.camera, shaken.kernel.theta
    y, x = np.mgrid[: camera.height, : camera.width]
    moved = displacements(homographies(camera, theta), np.stack([x.ravel(), y.ravel()], 1))
    most = np.abs(moved).max()
    assert most <= reach(camera, theta) - 1 + 1e-6
    assert reach(camera, theta) < most + 2 + 1e-6
    assert reach(camera, np.zeros((1, 3))) == 1


@pytest.mark.parametrize(
    ("focal", "path", "off"),
    [
        pytest.param(None, TURN, 1e-5, id="uniform"),
        pytest.param(960.0, TURN, 0.005, id="long lens"),
        pytest.param(240.0, TURN, 0.06, id="lens"),
        pytest.param(240.0, ROLL, 0.06, id="lens, with a roll"),
    ],
)
def test_the_blur_within_a_tile_is_that_of_the_exact_warps(shake, focal, path, off) -> None:
    """To within a share of what the blur changes."""
    shape = 200, 240
    camera = Camera.from_focal(focal, *shape) if focal else Camera.uniform(*shape)
    seen = case(shake, camera, path)
    blurred = without_mean(seen.tiles.blurred(seen.latent)[inner(seen.tiles)])
    exact = without_mean(seen.exact)
    changed = np.linalg.norm(without_mean(seen.latent[inner(seen.tiles)]) - exact)
    assert np.linalg.norm(blurred - exact) < off * changed


@pytest.fixture(scope="module")
def tiles(shaken) -> Tiles:
    """Tiles of the shaken photo, the first half of them with clipped pixels."""
    clipped = np.zeros(shaken.grey.shape, bool)
    clipped[36:44, 40:52] = True
    clipped[70:76, 130:150] = True
    tiles = cut(shaken.grey, shaken.camera, reach(shaken.camera, shaken.kernel.theta), clipped)
    tiles.bind(shaken.kernel)
    return tiles


def noise(tiles: Tiles, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=tiles.g.shape).astype(np.float32)


def test_the_blur_is_linear_and_keeps_light(tiles) -> None:
    one, other = noise(tiles, 0), noise(tiles, 1)
    both = tiles.blurred(2 * one - 3 * other)
    np.testing.assert_allclose(both, 2 * tiles.blurred(one) - 3 * tiles.blurred(other), atol=1e-5)
    np.testing.assert_allclose(tiles.blurred(one).mean((1, 2)), one.mean((1, 2)), atol=1e-6)
    np.testing.assert_allclose(tiles.blurred(np.ones_like(one)), 1, atol=1e-5)


def test_the_data_are_the_transpose_of_the_blur(tiles) -> None:
    latent = noise(tiles, 0)
    back = tiles.irfft(tiles.data())
    left = np.einsum("pij,pij->p", tiles.blurred(latent).astype(np.float64), tiles.filled)
    right = np.einsum("pij,pij->p", latent.astype(np.float64), back)
    spread = np.linalg.norm(tiles.filled, axis=(1, 2))
    assert np.abs(left - right).max() < 1e-5 * spread.max()


def test_the_power_is_that_of_blur_and_transpose(tiles) -> None:
    latent = noise(tiles, 0)
    fourier = tiles.transforms
    both, weighed = fourier.rfft(tiles.blurred(latent)), fourier.rfft(latent)
    fourier.multiply(both, tiles.H)
    fourier.weigh(weighed, tiles.power)
    np.testing.assert_allclose(tiles.irfft(both), tiles.irfft(weighed), atol=1e-5)


def test_known_pixels_are_the_photo_about_its_mean(tiles, shaken) -> None:
    middle = tiles.g[inner(tiles)]
    photo = middles(shaken.grey)
    offset = (photo - middle).mean((1, 2), keepdims=True)
    np.testing.assert_allclose(middle + offset, photo, atol=1e-6)
    known = tiles.belief > 0
    assert np.abs((tiles.g * known).sum((1, 2))).max() < 0.05 * known.sum((1, 2)).max()


def test_clipped_pixels_and_all_beyond_the_frame_are_unknown(tiles, shaken) -> None:
    first = tiles.first
    assert not tiles.belief[0, first + 16 : first + 24, first + 16 : first + 28].any()
    assert not tiles.inside[0, first + 16 : first + 24, first + 16 : first + 28].any()
    assert tiles.inside[0, first + 30, first + 30]
    assert tiles.inside[3].sum() > 0.6 * SIZE**2
    outer = tiles.inside.copy()
    outer[inner(tiles)] = False
    assert not outer.any()
    at_the_corner = cut(shaken.grey, shaken.camera, 8, corners=[(0, 0), (102, 132)])
    first = at_the_corner.first
    for part in (at_the_corner.belief, at_the_corner.around, at_the_corner.middle):
        assert not part[0, :first].any()
        assert not part[0, :, :first].any()
        assert not part[1, first + SIZE :].any()
        assert not part[1, :, first + SIZE :].any()
        assert part[0, first, first + 20] > 0


def test_unknown_pixels_are_filled_in_from_the_latent_picture(tiles) -> None:
    before = tiles.filled
    latent = noise(tiles, 0)
    blurred = tiles.fill(latent)
    np.testing.assert_array_equal(blurred, tiles.blurred(latent))
    sure, unknown = tiles.belief == 1, tiles.belief == 0
    np.testing.assert_allclose(tiles.filled[sure], tiles.g[sure], atol=1e-6)
    np.testing.assert_array_equal(tiles.filled[unknown], blurred[unknown])
    low, high = np.minimum(tiles.g, blurred) - 1e-6, np.maximum(tiles.g, blurred) + 1e-6
    assert ((low <= tiles.filled) & (tiles.filled <= high)).all()
    tiles.filled = before


def test_only_the_first_kernel_fills_the_room(shaken) -> None:
    tiles = cut(shaken.grey, shaken.camera, 10)
    tiles.bind(shaken.kernel)
    first = tiles.filled
    assert not np.array_equal(first, tiles.g)
    tiles.bind(RotationKernel.delta(shaken.camera))
    assert tiles.filled is first
    again = tiles.bound(shaken.kernel)
    np.testing.assert_array_equal(again.filled, first)


def test_tiles_for_another_kernel_leave_the_first_ones_alone(shaken) -> None:
    tiles = cut(shaken.grey, shaken.camera, 10)
    tiles.bind(RotationKernel.delta(shaken.camera))
    filters, filled = tiles.H, tiles.filled
    other = tiles.bound(shaken.kernel)
    assert tiles.H is filters
    assert tiles.filled is filled
    assert not np.array_equal(other.H, filters)
    assert other.g is tiles.g


def test_the_room_may_be_filled_before(shaken) -> None:
    tiles = cut(shaken.grey, shaken.camera, 10)
    filled = tiles.bound(shaken.kernel).filled
    other = tiles.bound(RotationKernel.delta(shaken.camera), filled)
    assert other.filled is filled
    assert not np.array_equal(filled, tiles.bound(RotationKernel.delta(shaken.camera)).filled)


@pytest.mark.parametrize("pixels", [1, 9000, 2**16])
def test_groups_are_all_tiles_in_order_with_a_room_of_their_own(tiles, monkeypatch, pixels) -> None:
    monkeypatch.setattr("deshake.blind.tiles._GROUP", pixels)
    filled = tiles.filled.copy()
    latent = np.random.default_rng(2).random(tiles.g.shape, np.float32)
    places = np.zeros(tiles.count, int)
    whole = tiles.bound(RotationKernel.delta(tiles.camera))
    for part, group in whole.groups():
        places[part] += 1
        assert group.count == len(places[part]) <= max(round(pixels / tiles.block**2), 1)
        np.testing.assert_array_equal(group.data(), whole.data()[part])
        np.testing.assert_array_equal(group.fill(latent[part]), whole.blurred(latent)[part])
        for one, all_ in zip(group.gradients, whole.gradients, strict=True):
            np.testing.assert_array_equal(one, all_[part])
        np.testing.assert_array_equal(group.corners, whole.corners[part])
    np.testing.assert_array_equal(places, 1)
    np.testing.assert_array_equal(tiles.filled, filled)


def test_rotations_without_weight_do_not_blur(shaken) -> None:
    kernel = shaken.kernel
    theta = np.concatenate([kernel.theta, 3 * kernel.theta])
    weights = np.concatenate([kernel.weights, 0 * kernel.weights])
    blurs = []
    for one in (kernel, RotationKernel(theta, weights, kernel.steps, kernel.camera)):
        tiles = cut(shaken.grey, shaken.camera, 12)
        tiles.bind(one)
        blurs.append(tiles.blurred(tiles.g).tobytes())
    assert blurs[0] == blurs[1]


def test_a_still_camera_blurs_nothing(shaken) -> None:
    tiles = cut(shaken.grey, shaken.camera, 5)
    tiles.bind(RotationKernel.delta(shaken.camera))
    np.testing.assert_allclose(tiles.blurred(tiles.g), tiles.g, atol=1e-5)


def test_tiles_know_their_place(shaken) -> None:
    tiles = cut(shaken.grey, shaken.camera, 5)
    assert tiles.count == len(CORNERS)
    np.testing.assert_allclose(tiles.centres[0], [24 + 23.5, 20 + 23.5])
    assert tiles.block >= SIZE + 2 * (5 + 1)


def test_the_gradients_are_the_photos_where_it_is_seen(shaken) -> None:
    corners = [(56, 56), (102, 132)]
    tiles = cut(shaken.grey, shaken.camera, 6, corners=corners)
    steps = np.arange(tiles.block) - tiles.first
    photo = np.pad(shaken.grey, 40, mode="edge")
    for axis, spectra in enumerate(tiles.gradients):
        back = tiles.irfft(spectra.copy())
        slopes = differences(photo)[axis]
        for p, (y, x) in enumerate(corners):
            wanted = slopes[np.ix_(40 + y + steps[:-1], 40 + x + steps[:-1])]
            inside = np.outer(y + steps[:-1] + 1 < 150, x + steps[:-1] + 1 < 180)
            np.testing.assert_allclose(back[p, :-1, :-1], wanted * inside, atol=1e-5)
            assert np.abs(back[p, -1]).max() < 1e-5


def test_contrast_is_a_factor(shaken) -> None:
    plain = cut(shaken.grey, shaken.camera, 5)
    strong = Tiles(Scale(shaken.grey, shaken.camera, None, 3.0), CORNERS, SIZE, 5)
    np.testing.assert_allclose(strong.g, 3 * plain.g, atol=1e-5)


def test_smaller_steps_are_nearer_the_exact_warps(shake) -> None:
    """A tile has one filter: its error is that of the displacement at its rim."""
    camera = Camera.from_focal(240.0, 200, 240)
    errors = []
    for roll in (1.0, 4.0):
        seen = case(shake, camera, np.array([[0, 0, -roll], [0, 0, roll]]))
        blurred = without_mean(seen.tiles.blurred(seen.latent)[inner(seen.tiles)])
        errors.append(np.linalg.norm(blurred - without_mean(seen.exact)))
    assert errors[0] < 0.6 * errors[1]


def test_some_tiles_are_those_of_their_places(tiles) -> None:
    whole = tiles.bound(RotationKernel.delta(tiles.camera))
    _ = whole.gradients
    places = np.array([tiles.count - 1, 0])
    some = whole.some(places)
    assert some.count == 2
    for name in ("corners", "centres", "g", "filled", "power"):
        np.testing.assert_array_equal(getattr(some, name), getattr(whole, name)[places])
    for one, all_ in zip(some.gradients, whole.gradients, strict=True):
        np.testing.assert_array_equal(one, all_[places])
