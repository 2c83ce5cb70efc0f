from __future__ import annotations

import pytest

from deshake.blind.bounds import blur_bound, check_size
from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.geometry.rotations import grid_steps


def test_the_bound_of_an_angle_is_that_of_the_axis_that_moves_most() -> None:
    camera = Camera.from_focal(400.0, 300, 400)
    steps = grid_steps(camera)
    assert blur_bound(camera, 7 * steps.min()) == pytest.approx(7)


@pytest.mark.parametrize(("height", "width", "bound"), [(48, 60, 1), (60, 48, 24), (100, 120, 50)])
def test_a_bound_fits_up_to_half_the_shorter_side(height: int, width: int, bound: float) -> None:
    check_size(height, width, bound)


@pytest.mark.parametrize(
    ("height", "width", "bound", "words"),
    [
        (47, 200, 8.0, "too few to estimate"),
        (200, 47, 8.0, "too few to estimate"),
        (100, 120, 50.5, "does not fit"),
        (100, 120, 0.9, "does not fit"),
        (100, 120, float("nan"), "does not fit"),
    ],
)
def test_what_does_not_fit_is_an_error(height: int, width: int, bound: float, words: str) -> None:
    with pytest.raises(EstimationError, match=words) as caught:
        check_size(height, width, bound)
    assert caught.value.hint
