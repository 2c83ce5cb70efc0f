from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.blind import tile_plan
from deshake.blind.settings import SETTINGS, Budget
from deshake.blind.tile_plan import planned_tiles
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps, reach
from deshake.signal.pyramid import Pyramid

if TYPE_CHECKING:
    from deshake.blind.tiles import Tiles

PARTS = ("fitted", "apart", "all")
CHOSEN = Budget(0.2e6, 0)  # as for a large photo, which tiles do not cover


@pytest.fixture(scope="module")
def photo() -> Pyramid:
    light = ((data.camera() / 255) ** 2.2).astype(np.float32)
    return Pyramid(light, Camera.from_focal(500.0, *light.shape))


def shake(camera: Camera, path) -> RotationKernel:
    return RotationKernel.from_path(np.array(path) * grid_steps(camera), camera).centred()


@pytest.fixture(scope="module")
def kernel(photo) -> RotationKernel:
    return shake(photo.camera, [[-2.0, -4, 0], [2, 4, 0]])


def places(tiles: Tiles) -> set[tuple[int, int]]:
    return {tuple(corner) for corner in tiles.corners.tolist()}


def test_tiles_of_a_plain_picture_are_cut_before_texture() -> None:
    light = np.full((900, 900), 0.3, np.float32)
    light[:, :450] += 0.5 * np.random.default_rng(0).random((180, 90)).repeat(5, 0).repeat(5, 1)
    for top in range(60, 800, 200):
        light[top : top + 90, 560:680] = 0.9
    photo = Pyramid(cv2.blur(light, (7, 7)), Camera.from_focal(900.0, *light.shape))
    nod = shake(photo.camera, [[-3.0, 0, 0], [3, 0, 0]])
    tiles = planned_tiles(photo, 0, nod, part="all", budget=Budget(0.1e6, 0))
    assert 4 < tiles.count < 12
    assert (tiles.centres[:, 0] > 450).mean() > 0.7


@pytest.mark.parametrize("level", [1, 2, 4])
def test_a_small_frame_is_covered(photo, kernel, level) -> None:
    camera = photo.at(level).camera
    fitted, apart, whole = (
        planned_tiles(photo, level, kernel.for_camera(camera), part=part) for part in PARTS
    )
    assert places(fitted) | places(apart) == places(whole)
    seen = np.zeros(camera.shape, bool)
    for y, x in places(whole):
        seen[y : y + whole.size, x : x + whole.size] = True
    assert seen.all()


def fields(tiles: Tiles) -> set[tuple[int, int]]:
    """Fields of the chessboard that the centres lie on."""
    middles = (tiles.corners + tiles.size / 2) / tiles.camera.shape
    return {tuple(field) for field in (middles * SETTINGS.tile_plan.fields).astype(int).tolist()}


@pytest.mark.parametrize("level", [0, 1])
def test_of_a_large_frame_no_field_is_both_fitted_and_kept_apart(photo, kernel, level) -> None:
    seen = kernel.for_camera(photo.at(level).camera)
    fitted, apart = (
        planned_tiles(photo, level, seen, part=part, budget=CHOSEN) for part in ("fitted", "apart")
    )
    assert fitted.count >= 6
    assert apart.count >= 6
    assert not fields(fitted) & fields(apart)


def test_a_third_of_the_frame_is_kept_apart() -> None:
    side = SETTINGS.tile_plan.fields
    at = (np.arange(side) + 0.5) / side
    x, y = np.meshgrid(at, at)
    apart = tile_plan._belongs(tile_plan._colour(x, y), "apart")
    assert apart.mean() == pytest.approx(1 / 3)
    assert not (apart & tile_plan._belongs(tile_plan._colour(x, y), "fitted")).any()
    assert not (apart[1:] & apart[:-1]).any()  # no two fields side by side
    assert not (apart[:, 1:] & apart[:, :-1]).any()


def test_few_tiles_serve_for_everything(photo, kernel) -> None:
    level = photo.coarsest
    seen = kernel.for_camera(photo.at(level).camera)
    plans = [places(planned_tiles(photo, level, seen, part=part)) for part in PARTS]
    assert plans[0] == plans[1] == plans[2]


def test_tiles_have_room_for_the_kernel(photo, kernel) -> None:
    tiles = planned_tiles(photo, 0, kernel, budget=CHOSEN)
    assert tiles.far == reach(photo.camera, kernel.theta)
    more = planned_tiles(photo, 0, kernel, budget=CHOSEN, room=1.5)
    assert more.far == np.ceil(1.5 * tiles.far)


def test_no_more_pixels_are_looked_at_than_the_budget_has(photo, kernel) -> None:
    for pixels in (0.12e6, 0.2e6):
        tiles = planned_tiles(photo, 0, kernel, part="all", budget=Budget(pixels, 0))
        assert tiles.count * tiles.size**2 <= pixels
        assert tiles.count >= 3
    assert planned_tiles(photo, 0, kernel, part="all", budget=Budget(1, 0)).count > 1


def test_the_more_a_camera_rolls_the_smaller_the_tiles(photo) -> None:
    sizes = []
    for roll in (0, 7, 10):
        rolled = shake(photo.camera, [[-2.0, -4, -roll], [2, 4, roll]])
        sizes.append(planned_tiles(photo, 0, rolled, budget=CHOSEN).size)
    assert sizes[0] > sizes[1] > sizes[2]
    assert all(size % 2 == 0 for size in sizes)


def test_rotations_without_weight_need_room_too(photo, kernel) -> None:
    wide = kernel.dilated().dilated()
    assert planned_tiles(photo, 0, wide, budget=CHOSEN).far > kernel.extent_px() / 2


def test_tiles_fit_the_smallest_frame() -> None:
    grey = np.random.default_rng(0).random((49, 61)).astype(np.float32)
    small = Pyramid(grey, Camera.from_focal(60.0, 49, 61))
    kernel = shake(small.camera, [[-2.0, -4, 0], [2, 4, 0]])
    tiles = planned_tiles(small, 0, kernel, part="all")
    assert tiles.size <= 49
    assert (tiles.corners + tiles.size <= (49, 61)).all()
    wide = replace(kernel, theta=4 * kernel.theta)
    assert planned_tiles(small, 0, wide).size <= 49


def test_blocks_cost_no_more_than_their_budget(photo) -> None:
    camera = photo.at(1).camera
    rolling = shake(camera, [[0, -6, -20], [0, 6, 20]])
    covering = planned_tiles(photo, 1, rolling, part="all", budget=Budget(blocks=1e9))
    some = planned_tiles(photo, 1, rolling, part="all", budget=Budget(blocks=0.15e6))
    assert covering.count * (covering.size + 2 * covering.far) ** 2 > 0.2e6
    assert some.count * (some.size + 2 * some.far) ** 2 <= 0.15e6
    assert 6 <= some.count < covering.count
    assert places(some) != places(covering)
