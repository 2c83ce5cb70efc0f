from __future__ import annotations

import tracemalloc

import cv2
import numpy as np
import pytest

from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.signal.noise import noise_level
from deshake.signal.pyramid import RATIO, Pyramid, reduced, reduced_in_bands, root


def of(grey: np.ndarray, clipped: np.ndarray | None = None) -> Pyramid:
    return Pyramid(grey, Camera.from_focal(300.0, *grey.shape), clipped)


def test_the_first_scale_is_the_photo(sharp) -> None:
    pyramid = of(sharp)
    scale = pyramid.at(0)
    assert scale.picture is sharp
    assert scale.camera is pyramid.camera
    assert scale.clipped is None


def test_each_scale_is_smaller_by_the_root_of_two(sharp) -> None:
    pyramid = of(sharp)
    for level in range(pyramid.coarsest + 1):
        scale = pyramid.at(level)
        assert scale.picture.shape == scale.camera.shape
        assert scale.picture.dtype == np.float32
        wanted = np.array(sharp.shape) / RATIO**level
        assert np.abs(np.array(scale.picture.shape) - wanted).max() <= 0.5
        shrink = scale.camera.width / sharp.shape[1]
        assert scale.camera.matrix[0, 0] == pytest.approx(300 * shrink)


def test_a_pixel_is_the_mean_of_light_over_its_area(sharp) -> None:
    half = of(sharp).at(2).picture
    blocks = sharp.reshape(100, 2, 130, 2).mean((1, 3))
    np.testing.assert_allclose(half, blocks, atol=1e-6)
    pyramid = of(sharp)
    for level in range(pyramid.coarsest + 1):
        mean = float(pyramid.at(level).picture.mean(dtype=np.float64))
        assert mean == pytest.approx(float(sharp.mean(dtype=np.float64)), rel=2e-3)


def test_scales_are_the_same_in_any_order_and_made_once(sharp) -> None:
    downward, upward = of(sharp), of(sharp)
    levels = range(downward.coarsest + 1)
    one = [downward.at(level) for level in levels]
    other = [upward.at(level) for level in reversed(levels)][::-1]
    for a, b in zip(one, other, strict=True):
        assert a.picture.tobytes() == b.picture.tobytes()
        assert a.contrast == b.contrast
    assert all(downward.at(level).picture is one[level].picture for level in levels)


@pytest.mark.parametrize(
    ("shape", "coarsest"), [((48, 60), 0), ((67, 400), 0), ((68, 70), 1), ((194, 194), 4)]
)
def test_the_coarsest_scale_has_about_48_pixels(shape, coarsest) -> None:
    noise = np.random.default_rng(0).random(shape).astype(np.float32)
    pyramid = of(noise)
    assert pyramid.coarsest == coarsest
    assert 47 <= min(pyramid.at(coarsest).picture.shape) < 48 * RATIO


def test_smaller_photos_have_one_scale() -> None:
    assert of(np.random.default_rng(0).random((30, 40)).astype(np.float32)).coarsest == 0


def test_the_finest_scale_with_at_most_so_many_pixels(sharp) -> None:
    pyramid = of(sharp)
    for pixels in (52_000, 51_999, 20_000, 5_000.5):
        level = pyramid.level_of(pixels)
        assert pyramid.at(level).picture.size <= 1.02 * pixels
        assert level == 0 or pyramid.at(level - 1).picture.size > 0.98 * pixels
    assert pyramid.level_of(1e9) == 0


def test_contrast_does_not_depend_on_exposure_or_size(sharp) -> None:
    pyramid, dim = of(sharp), of(sharp * np.float32(0.1))
    assert dim.at(1).contrast == pytest.approx(10 * pyramid.at(1).contrast, rel=1e-4)
    assert len({pyramid.at(level).contrast for level in range(4)}) == 1
    large = cv2.resize(sharp, None, fx=5, fy=5, interpolation=cv2.INTER_NEAREST)
    assert of(large).at(0).contrast == pytest.approx(pyramid.at(0).contrast, rel=0.02)


def test_flat_photos_are_refused() -> None:
    for value in (0.0, 0.5):
        with pytest.raises(EstimationError, match="no detail") as error:
            of(np.full((60, 80), value, np.float32))
        assert error.value.hint


def test_pixels_are_clipped_where_half_of_what_they_show_is(sharp) -> None:
    clipped = np.zeros(sharp.shape, bool)
    clipped[40:80, 60:100] = True
    clipped[120, 160] = True  # a quarter of a pixel of half the size
    clipped[140:142, 180:183] = True
    pyramid = of(sharp, clipped)
    assert pyramid.at(0).clipped is clipped
    half = clipped.reshape(100, 2, 130, 2).mean((1, 3)) >= 0.5
    assert half[70, 90]
    assert not half[60, 80]
    np.testing.assert_array_equal(pyramid.at(2).clipped, half)
    for level in range(pyramid.coarsest + 1):
        share = pyramid.at(level).clipped.mean()
        assert share == pytest.approx(clipped.mean(), abs=0.02)


def test_where_nothing_is_clipped_no_mask_is_kept(sharp) -> None:
    pyramid = of(sharp, np.zeros(sharp.shape, bool))
    assert pyramid.at(0).clipped is None
    assert pyramid.at(3).clipped is None


def test_what_was_made_of_a_photo_is_kept_under_its_key(sharp) -> None:
    pyramid = of(sharp)
    made: list[int] = []

    def make() -> list[int]:
        made.append(1)
        return made

    assert pyramid.kept("one", make) is pyramid.kept("one", make)
    assert len(made) == 1
    pyramid.kept(("one", 2), make)
    assert len(made) == 2


def test_what_is_forgotten_is_made_again(sharp) -> None:
    pyramid = of(sharp)
    photo, reduced = pyramid.at(0).picture, pyramid.at(2).picture
    pyramid.kept("one", lambda: 1)
    pyramid.forget()
    assert pyramid.at(0).picture is photo
    assert pyramid.at(2).picture is not reduced
    np.testing.assert_array_equal(pyramid.at(2).picture, reduced)
    assert pyramid.kept("one", lambda: 2) == 2


def test_another_focal_length_changes_the_cameras_alone(sharp) -> None:
    pyramid = of(sharp)
    pyramid.kept("camera", lambda: pyramid.camera)
    longer = pyramid.zoomed(1.5)
    for level in (0, 1, 3):
        one, other = pyramid.at(level), longer.at(level)
        assert np.array_equal(one.picture, other.picture)
        assert one.contrast == other.contrast
        assert other.camera.focal_px == pytest.approx(1.5 * one.camera.focal_px)
    assert longer.kept("camera", lambda: longer.camera) is longer.camera
    assert pyramid.zoomed(1.0) is pyramid


def test_noise_is_in_the_contrast_of_the_pyramid(sharp) -> None:
    grain = np.random.default_rng(0).normal(0, 0.05, sharp.shape).astype(np.float32)
    pyramid = of(sharp + grain)
    assert pyramid.noise(0) == pytest.approx(0.05 * pyramid.at(0).contrast, rel=0.2)
    assert pyramid.noise(2) < 0.7 * pyramid.noise(0)
    assert pyramid.noise(0) == pyramid.noise(0)


def test_displayed_pictures_have_the_root_of_the_light(sharp) -> None:
    clipped = np.zeros(sharp.shape, bool)
    clipped[:20] = True
    pyramid = of(2 * sharp - 0.1, clipped)  # light below 0 and above 1 counts as black and white
    shown = pyramid.displayed()
    wanted = np.sqrt(np.clip(2 * sharp - 0.1, 0, 1))
    np.testing.assert_array_equal(shown.at(0).picture, wanted)
    assert shown.at(0).picture.dtype == np.float32
    np.testing.assert_array_equal(shown.at(0).clipped, clipped)
    assert shown.camera is pyramid.camera
    assert not np.array_equal(shown.at(2).picture, np.sqrt(np.clip(pyramid.at(2).picture, 0, 1)))


def test_both_kinds_of_tones_have_the_same_clipped_pixels(sharp) -> None:
    clipped = np.zeros(sharp.shape, bool)
    clipped[:21, :33] = True
    pyramid = of(sharp, clipped)
    early = pyramid.displayed()
    for level in (1, 2, 5):
        assert pyramid.at(level).clipped is early.at(level).clipped
        assert pyramid.displayed().at(level).clipped is early.at(level).clipped
        assert early.at(level).clipped[0, 0]
        assert not early.at(level).clipped[-1, -1]


def test_the_scales_are_in_any_tones(sharp) -> None:
    toned = of(sharp).in_tones(np.cbrt)
    np.testing.assert_array_equal(toned.at(0).picture, np.cbrt(sharp))
    for level in (1, 2, 4):
        shape = toned.at(level).picture.shape
        wanted = reduced(np.cbrt(sharp), shape)
        np.testing.assert_allclose(toned.at(level).picture, wanted, atol=0.02)
    wanted = noise_level(np.cbrt(sharp)) * toned.at(0).contrast
    assert toned.noise(0) == pytest.approx(wanted, rel=1e-3)
    assert not toned.is_displayed
    assert toned.in_other_tones().is_displayed
    np.testing.assert_array_equal(toned.in_tones(None).at(2).picture, of(sharp).at(2).picture)


def test_a_piece_is_that_of_the_picture_in_either_tones(sharp) -> None:
    place = np.s_[17:90, 5:66]
    for pyramid in (of(sharp), of(sharp).displayed(), of(sharp).in_tones(np.cbrt)):
        for level in (0, 1, 2):
            scale = pyramid.at(level)
            np.testing.assert_array_equal(scale.piece(place), scale.picture[place])
    np.testing.assert_array_equal(of(sharp).displayed().at(0).picture, np.sqrt(sharp))


def test_a_camera_needs_no_picture(sharp) -> None:
    for pyramid in (of(sharp), of(sharp).zoomed(1.3)):
        cameras = [pyramid.camera_at(level) for level in range(4)]
        assert [pyramid.at(level).camera for level in range(4)] == cameras
        focal = pyramid.camera.focal_px
        assert cameras[2].focal_px == pytest.approx(focal / 2)


@pytest.mark.parametrize("tones", [None, np.cbrt])
def test_the_other_tones_are_display_values_or_those_before(sharp, tones) -> None:
    light = of(sharp).in_tones(tones)
    shown = light.in_other_tones()
    back = shown.in_other_tones()
    assert shown.is_displayed
    assert not back.is_displayed
    for level in (0, 1, 2):
        expected = light.displayed().at(level).picture
        np.testing.assert_array_equal(shown.at(level).picture, expected)
        np.testing.assert_array_equal(back.at(level).picture, light.at(level).picture)


def test_displayed_pictures_that_are_forgotten_are_made_again(sharp) -> None:
    shown = of(sharp).displayed().zoomed(1.2)
    first = [shown.at(level).picture for level in (0, 1, 2)]
    shown.forget()
    for level, picture in enumerate(first):
        np.testing.assert_array_equal(shown.at(level).picture, picture)
        assert shown.at(level).camera.focal_px == pytest.approx(
            shown.camera.focal_px * shown.at(level).camera.width / shown.camera.width, rel=0.02
        )


@pytest.mark.parametrize("shape", [(200, 260), (141, 184), (100, 130), (67, 259), (1, 1)])
def test_in_bands_a_pixel_is_the_mean_over_its_area(sharp, shape) -> None:
    ends = [np.linspace(0, n, m + 1) for n, m in zip(sharp.shape, shape, strict=True)]
    down, across = (
        np.clip(np.minimum(end[1:, None], p + 1) - np.maximum(end[:-1, None], p), 0, 1)
        for end, p in zip(ends, map(np.arange, sharp.shape), strict=True)
    )
    light = 2 * sharp - np.float32(0.1)
    mean = down @ np.sqrt(np.clip(light, 0, 1)) @ across.T * np.prod(shape) / sharp.size
    ours = reduced_in_bands(light, shape, root)
    assert ours.dtype == np.float32
    np.testing.assert_allclose(ours, mean, atol=1e-3)
    np.testing.assert_allclose(ours, reduced(root(light), shape), atol=1e-3)


def test_display_values_of_a_large_photo_are_never_whole_in_memory() -> None:
    light = np.random.default_rng(0).random((2400, 3000), np.float32)
    shown = of(light, light > 0.9).displayed()
    shown.forget()
    tracemalloc.start()
    try:
        assert shown.noise(0) > 0
        for level in (1, 2):
            shown.at(level)
            shown.forget()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1.25 * light.nbytes  # two pictures of half the pixels, and a mask
