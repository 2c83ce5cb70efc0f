from __future__ import annotations

import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.distortion import distorted, pinhole, undistorted
from deshake.lens.lens_warp import LensWarp

CAMERA = Camera.from_focal(180.0, 160, 240).with_lens(np.array([-0.2, 0.05, 0, 0, -0.01]))


def scene(points: np.ndarray) -> np.ndarray:
    """A smooth scene at any pixels (N, 2)."""
    x, y = points.T
    return (0.5 + 0.3 * np.sin(x / 4) * np.cos(y / 5)).astype(np.float32)


def pixels(shape: tuple[int, int]) -> np.ndarray:
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    return np.stack([x, y], -1).reshape(-1, 2).astype(float)


@pytest.mark.parametrize("whole", [False, True], ids=["part", "whole"])
@pytest.mark.parametrize("channels", [None, 3])
def test_straightening_is_the_scene_without_the_lens(whole, channels):
    straight_camera = pinhole(CAMERA, whole=whole)
    photo = scene(pixels(CAMERA.shape)).reshape(CAMERA.shape)
    photo = photo if channels is None else np.stack([photo, 0.5 * photo, 1 - photo], -1)
    straight = LensWarp(CAMERA, straight_camera).straighten(photo)
    assert straight.shape == straight_camera.shape + photo.shape[2:]
    places = distorted(pixels(straight_camera.shape), CAMERA, straight_camera)
    inner = ((places > 4) & (places < np.array([235, 155]))).all(1)
    grey = straight if channels is None else straight[..., 0]
    assert np.abs(grey.ravel() - scene(places))[inner].max() < 5e-3
    if channels:
        np.testing.assert_allclose(straight[..., 1], 0.5 * straight[..., 0], atol=1e-6)


def test_bending_undoes_straightening():
    straight_camera = pinhole(CAMERA, whole=True)
    warp = LensWarp(CAMERA, straight_camera)
    photo = scene(pixels(CAMERA.shape)).reshape(CAMERA.shape)
    again = warp.bend(warp.straighten(photo))
    assert again.shape == CAMERA.shape
    assert np.abs(again - photo)[2:-2, 2:-2].max() < 5e-3
    assert np.abs(again - photo).mean() < 2e-4


def test_the_way_back_is_the_inverse_to_a_thousandth():
    straight_camera = pinhole(CAMERA, whole=True)
    for rows, (v, u) in LensWarp(CAMERA, straight_camera)._bent_bands():
        there = undistorted(pixels(CAMERA.shape).reshape(*CAMERA.shape, 2)[rows].reshape(-1, 2),
                            CAMERA, straight_camera)  # fmt: skip
        np.testing.assert_allclose(np.stack([u.ravel(), v.ravel()], 1), there, atol=1e-3)


def test_straight_lines_become_straight():
    straight_camera = pinhole(CAMERA)
    y, x = np.mgrid[0:160, 0:240].astype(float)
    line = np.stack([np.arange(-20, 260.0), np.full(280, 18.0)], 1)
    there = distorted(line, CAMERA, straight_camera)
    bent = np.exp(-0.5 * np.square((y - np.interp(x, *there.T)) / 1.5)).astype(np.float32)
    straight = LensWarp(CAMERA, straight_camera).straighten(bent)

    def deviation(picture: np.ndarray) -> float:
        columns = np.arange(12, 228)
        weight = picture[:50, columns] ** 2
        middle = (weight * y[:50, columns]).sum(0) / weight.sum(0)
        fit = np.polyval(np.polyfit(columns, middle, 1), columns)
        return float(np.abs(middle - fit).max())

    assert deviation(bent) > 1.5
    assert deviation(straight) < 0.05


def test_lights_have_no_dark_rings():
    photo = np.full(CAMERA.shape, 0.1, np.float32)
    photo[40:44, 60:64] = 1.0
    photo[100, 150] = 30.0
    straight = LensWarp(CAMERA, pinhole(CAMERA)).straighten(photo)
    assert straight.min() >= 0.1 - 1e-6
    assert straight.max() <= 30


def test_no_corner_is_black():
    warp = LensWarp(CAMERA, pinhole(CAMERA))
    white = warp.straighten(np.ones(CAMERA.shape, np.float32))
    np.testing.assert_allclose(white, 1, atol=1e-5)
    whole = LensWarp(CAMERA, pinhole(CAMERA, whole=True))
    np.testing.assert_allclose(whole.straighten(np.ones(CAMERA.shape, np.float32)), 1, atol=1e-5)


def test_marks_cover_all_that_a_marked_pixel_touches():
    straight_camera = pinhole(CAMERA)
    warp = LensWarp(CAMERA, straight_camera)
    mask = np.zeros(CAMERA.shape, bool)
    mask[30, 50] = mask[120, 200] = True
    straight_mask = warp.straighten_mask(mask)
    light = warp.straighten(mask.astype(np.float32) * 10)
    assert straight_mask.dtype == bool
    assert straight_mask[light > 0.5].all()
    assert 2 * 9 <= straight_mask.sum() < 2 * 40
    assert not warp.straighten_mask(np.zeros(CAMERA.shape, bool)).any()


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_opacity_keeps_its_depth(depth):
    warp = LensWarp(CAMERA, pinhole(CAMERA))
    top = np.iinfo(depth).max
    opaque = np.full(CAMERA.shape, top, depth)
    assert (warp.straighten_codes(opaque) == top).all()
    assert (warp.bend_codes(opaque) == top).all()
    half = opaque.copy()
    half[:, 120:] = 0
    straight = warp.straighten_codes(half)
    assert straight.dtype == depth
    assert straight[80, 60] == top
    assert straight[80, 180] == 0
