from __future__ import annotations

import numpy as np
import pytest

from deshake.operators.planes import (
    add_at,
    channels_first,
    check_size,
    fitted,
    image_like,
    mean_plane,
    window_of,
)

IMAGE = np.arange(60, dtype=np.float32).reshape(1, 6, 10)


@pytest.mark.parametrize("shape", [(6, 10), (6, 10, 1), (6, 10, 3)])
def test_channels_first_is_undone(shape: tuple[int, ...]) -> None:
    image = np.random.default_rng(0).random(shape).astype(np.float32)
    planes = channels_first(image)
    assert planes.shape[1:] == (6, 10)
    np.testing.assert_array_equal(image_like(planes, image), image)


@pytest.mark.parametrize("shape", [(6, 10), (6, 10, 1), (6, 10, 3)])
def test_the_mean_of_planes_leaves_them_as_they_are(shape: tuple[int, ...]) -> None:
    planes = channels_first(np.random.default_rng(1).random(shape).astype(np.float32))
    before = planes.copy()
    mean = mean_plane(planes)
    np.testing.assert_allclose(mean, before.mean(0, dtype=np.float64), rtol=1e-6)
    assert mean.dtype == np.float32
    mean += 1
    np.testing.assert_array_equal(planes, before)


def test_fitting_cuts_and_continues_alike_on_all_sides() -> None:
    np.testing.assert_array_equal(fitted(IMAGE, (4, 8)), IMAGE[:, 1:-1, 1:-1])
    wider = fitted(IMAGE, (8, 12))
    np.testing.assert_array_equal(fitted(wider, (6, 10)), IMAGE)
    assert wider[0, 0, 0] == IMAGE[0, 0, 0]
    assert wider[0, -1, -1] == IMAGE[0, -1, -1]
    assert fitted(IMAGE, (8, 12), beyond=-1)[0, 0].max() == -1
    for wrong in ((6, 12), (7, 11)):
        with pytest.raises(ValueError, match="does not fit"):
            fitted(IMAGE, wrong)


def test_window_inside_is_a_view() -> None:
    window = window_of(IMAGE, 1, 2, 3, 4)
    np.testing.assert_array_equal(window, IMAGE[:, 1:4, 2:6])
    assert np.shares_memory(window, IMAGE)


@pytest.mark.parametrize(("top", "left"), [(-2, -3), (4, 8), (-50, 0), (0, 50)])
def test_window_beyond_the_image_is_zero(top: int, left: int) -> None:
    padded = np.pad(IMAGE, ((0, 0), (60, 60), (60, 60)))
    expected = padded[:, 60 + top : 65 + top, 60 + left : 67 + left]
    np.testing.assert_array_equal(window_of(IMAGE, top, left, 5, 7), expected)


@pytest.mark.parametrize(("top", "left"), [(1, 2), (-2, -3), (4, 8), (-50, 0), (0, 50)])
def test_add_at_is_the_adjoint_of_window_of(top: int, left: int) -> None:
    piece = np.random.default_rng(0).random((1, 5, 7)).astype(np.float32)
    out = np.zeros_like(IMAGE)
    add_at(out, top, left, piece)
    window = window_of(IMAGE, top, left, 5, 7)
    assert np.vdot(out, IMAGE) == pytest.approx(np.vdot(piece, window), rel=1e-6)


def test_sizes_that_do_not_fit_are_refused() -> None:
    check_size(IMAGE, (6, 10))
    for wrong in (IMAGE[0], IMAGE[:, :5], IMAGE[None]):
        with pytest.raises(ValueError, match="does not fit"):
            check_size(wrong, (6, 10))
