from __future__ import annotations

import numpy as np
import pytest

from deshake.geometry.rotations import grid_steps
from deshake.pictures.canvas import Canvas
from deshake.pictures.cuboid import Axes, _View, draw_cuboid, round_above


@pytest.mark.parametrize(
    ("value", "above"), [(2.1, 2.5), (10, 10), (10.01, 15), (73, 80), (0.31, 0.4), (990, 1000)]
)
def test_round_numbers(value, above):
    assert round_above(value) == pytest.approx(above)


def test_axes_hold_all_kernels(kernels):
    for kernel in kernels.values():
        axes = Axes.around([kernel])
        assert np.abs(axes.places(kernel.theta)).max() <= 1
    both = Axes.around([kernels["flat"], kernels["roll"]])
    for name in ("flat", "roll"):
        assert np.abs(both.places(kernels[name].theta)).max() <= 1


def test_axes_are_in_pixels_at_the_edge_of_the_frame(kernels):
    axes = Axes.around([kernels["flat"]])  # 20 px about Y
    assert axes.unit == pytest.approx(grid_steps(kernels["flat"].camera))
    assert axes.centre == pytest.approx(0)
    assert axes.half == 15
    assert Axes.around([kernels["uniform"]]).half == 8  # 12 px, also through a long lens


def test_axes_follow_a_kernel_far_from_the_origin(kernels):
    axes = Axes.around([kernels["far"]])
    assert axes.half <= 6
    assert axes.centre[0] == pytest.approx(0.2 / axes.unit[0], abs=0.5)


def test_a_camera_that_stood_still_gets_a_scale(kernels):
    assert Axes.around([kernels["delta"]]).half > 0


def test_the_view_is_right_handed_with_z_up():
    view = _View(0, 0, 100)
    origin = view((0, 0, 0))
    x, y, z = (view(row) - origin for row in np.eye(3))
    assert x[0] > 0 > y[0]  # X to the right, Y to the left ...
    assert x[1] < 0
    assert y[1] < 0  # ... both away from the viewer, who looks down on them
    assert z == pytest.approx((0, z[1]), abs=1e-9)
    assert z[1] < 0


def drawn(kernel, size=320):
    canvas = Canvas(size, size)
    axes = Axes.around([kernel])
    draw_cuboid(canvas, kernel, axes, size=size)
    return canvas.finished().astype(int), axes


def test_points_lie_where_their_rotations_are(kernels):
    kernel = kernels["roll"]
    picture, axes = drawn(kernel)
    reddish = picture[..., 0] - picture[..., 2] > 60
    rows, columns = np.nonzero(reddish)
    points = _View(0, 0.03 * 320, 320)(axes.places(kernel.theta))
    assert columns.mean() == pytest.approx(points[:, 0].mean(), abs=2)
    assert rows.min() == pytest.approx(points[:, 1].min(), abs=6)
    assert rows.max() == pytest.approx(points[:, 1].max(), abs=6)


def test_sums_lie_on_the_faces(kernels):
    kernel = kernels["roll"]
    picture, _ = drawn(kernel)
    bluish = picture[..., 2] - picture[..., 0] > 60
    view = _View(0, 0.03 * 320, 320)
    for place in ((1.0, 0.0, 0.3), (0.0, 1.0, 0.3), (0.0, 0.0, -1.0)):
        x, y = np.rint(view(place)).astype(int)
        assert bluish[y - 3 : y + 4, x - 3 : x + 4].any(), place
    x, y = np.rint(view((0.5, 0.5, -1.0))).astype(int)
    assert not bluish[y - 3 : y + 4, x - 3 : x + 4].any()


def test_heavier_rotations_are_drawn_darker_and_larger(kernels):
    kernel = kernels["flat"]
    weights = np.where(np.arange(len(kernel.weights)) == 10, 20.0, 1.0)
    heavy = type(kernel)(kernel.theta, weights / weights.sum(), kernel.steps, kernel.camera)
    picture, axes = drawn(heavy)
    x, y = np.rint(_View(0, 0.03 * 320, 320)(axes.places(heavy.theta[10]))).astype(int)
    assert picture[y, x, 1] < 60
    x, y = np.rint(_View(0, 0.03 * 320, 320)(axes.places(heavy.theta[3]))).astype(int)
    assert picture[y, x, 1] > 100
