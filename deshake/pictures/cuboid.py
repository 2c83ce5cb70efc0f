"""The rotation cuboid: a kernel's weights in their three dimensions, as in Figs. 3, 4 and 7.

The cuboid's axes are theta_X, theta_Y and theta_Z, all to the same scale: one unit of each moves
the edge of the frame by one pixel (Sec. 7). A point is a rotation, the larger and darker the
longer the camera stayed there; on the three faces behind lie the sums of the weights along the
axis across them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from deshake.geometry.rotations import grid_steps
from deshake.operators.bilinear import splat_on_raster

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel
    from deshake.pictures.canvas import Canvas, Colour

__all__ = ["Axes", "draw_cuboid", "round_above"]

_AXES = "XYZ"
_INK: Colour = (40, 44, 52)
_FAINT: Colour = (112, 118, 130)
_EDGE: Colour = (150, 156, 168)
_FRONT: Colour = (196, 200, 209)  # lighter: these edges pass before the points
_GRID: Colour = (226, 229, 235)
_FLOOR: Colour = (243, 244, 247)
_WALLS: tuple[Colour, Colour] = (250, 250, 252), (247, 248, 250)
_SHADE: Colour = (20, 52, 120)
_LIGHT_POINT = np.array((255, 214, 120), np.float64)
_DARK_POINT = np.array((176, 10, 30), np.float64)
_POINT_EDGE: Colour = (92, 40, 10)

_AZIMUTH, _ELEVATION = np.radians(233.0), np.radians(26.0)
_RIGHT = np.array((-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0))
_UP = np.array(
    (
        -np.sin(_ELEVATION) * np.cos(_AZIMUTH),
        -np.sin(_ELEVATION) * np.sin(_AZIMUTH),
        np.cos(_ELEVATION),
    )
)
_TOWARDS = np.cross(_RIGHT, _UP)

_NICE = (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
_LEAST_HALF = 2.0  # pixels: least half side, also for a still camera
_MOST_CELLS = 160  # across a face
_LEAST_EDGED = 1.2  # pixels of radius: smaller points have no edge
_CONTRAST = 0.5  # exponent that lifts faint sums


@dataclass(frozen=True, eq=False)
class Axes:
    """The range of the three axes.

    Parameters
    ----------
    unit : (3,) array
        Radians that move the edge of the frame by one pixel.
    centre : (3,) array
        The middle of the cuboid, in those units.
    half : float
        Half its side, in those units.

    """

    unit: NDArray[np.float64]
    centre: NDArray[np.float64]
    half: float

    @classmethod
    def around(cls, kernels: Sequence[RotationKernel]) -> Axes:
        """Choose axes that hold all the kernels, in pixels of the first one's frame."""
        unit = grid_steps(kernels[0].camera)
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for kernel in kernels:
            places = kernel.theta[kernel.weights > 0] / unit
            low, high = np.minimum(low, places.min(0)), np.maximum(high, places.max(0))
        middle, reach = (low + high) / 2, max(float((high - low).max()) / 2, _LEAST_HALF)
        centre = np.where(np.abs(middle) > 0.25 * reach, np.rint(middle), 0.0)
        farthest = np.maximum(high - centre, centre - low).max()
        return cls(unit, centre, round_above(1.04 * max(float(farthest), _LEAST_HALF)))

    def places(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the places (..., 3) of rotations in the cuboid, each axis from -1 to 1."""
        return (theta / self.unit - self.centre) / self.half


class _View:
    """The cuboid seen from above and in front, in parallel projection."""

    def __init__(self, left: float, top: float, size: float) -> None:
        self.scale = 0.262 * size
        self._middle = np.array((left + 0.52 * size, top + 0.49 * size))

    def __call__(self, place: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points (..., 2) of the picture for places (..., 3) in the cuboid."""
        place = np.asarray(place, np.float64)
        flat = np.stack([place @ _RIGHT, -(place @ _UP)], -1)
        points: NDArray[np.float64] = self._middle + self.scale * flat
        return points


def draw_cuboid(
    canvas: Canvas,
    kernel: RotationKernel,
    axes: Axes,
    *,
    size: float,
    left: float = 0.0,
    title: str = "",
) -> None:
    """Draw a kernel's cuboid into a square of `size` pixels, from x = `left` on.

    Parameters
    ----------
    canvas : Canvas
        Where to draw.
    kernel : RotationKernel
        What to draw.
    axes : Axes
        The range of the axes.
    size : float
        Side of the square in pixels.
    left : float
        Where the square begins, in pixels.
    title : str
        A word before the kernel's figures in the upper left corner.

    """
    view = _View(left, 0.03 * size, size)
    _draw_faces(canvas, view)
    _draw_sums(canvas, view, kernel, axes)
    _draw_edges(canvas, view, behind=True)
    _draw_points(canvas, view, kernel, axes, size)
    _draw_edges(canvas, view, behind=False)
    _draw_labels(canvas, view, kernel, axes, size)
    count = int((kernel.weights > 0).sum())
    figures = f"{count:,} rotation{'s' * (count != 1)}, blur {kernel.extent_px():.3g} px"
    text = 0.03 * size
    if title:
        canvas.text((left + text, 1.2 * text), title, 1.25 * text, _INK, anchor="left")
    canvas.text(
        (left + text, (2.6 if title else 1.2) * text), figures, 0.85 * text, _FAINT, anchor="left"
    )


def _draw_faces(canvas: Canvas, view: _View) -> None:
    """Draw the floor and the two walls behind, with a grid on each."""
    for axis, fill in ((0, _WALLS[0]), (1, _WALLS[1]), (2, _FLOOR)):
        at = -1.0 if axis == 2 else 1.0
        one, other = (a for a in range(3) if a != axis)

        def point(
            u: float, v: float, *, a: int = one, b: int = other, c: int = axis, d: float = at
        ) -> NDArray[np.float64]:
            place = np.zeros(3)
            place[[a, b, c]] = u, v, d
            return view(place)

        canvas.polygon([point(-1, -1), point(1, -1), point(1, 1), point(-1, 1)], fill)
        for tick in (-0.5, 0.0, 0.5):
            canvas.line(point(tick, -1), point(tick, 1), _GRID, 0.8)
            canvas.line(point(-1, tick), point(1, tick), _GRID, 0.8)


def _draw_sums(canvas: Canvas, view: _View, kernel: RotationKernel, axes: Axes) -> None:
    """Shade each face by the sum of the weights along the axis across it."""
    places = axes.places(kernel.theta)
    cell = np.maximum(kernel.steps / axes.unit / axes.half, 2 / _MOST_CELLS)
    heaviest = places[np.argmax(kernel.weights)]  # the cells are aligned with it
    index = (places - heaviest) / cell
    for axis in range(3):
        across, down = (a for a in range(3) if a != axis)
        low = np.floor(index.min(0)).astype(int) - 1
        count = np.ceil(index.max(0)).astype(int) + 2 - low
        inside = (index - low)[:, [across, down]]
        cover = splat_on_raster(inside, kernel.weights, (count[down], count[across]))
        corners = []
        for u, v in ((0, 0), (count[across], 0), (0, count[down])):
            place = np.full(3, -1.0 if axis == 2 else 1.0)
            place[across] = heaviest[across] + (low[across] + u - 0.5) * cell[across]
            place[down] = heaviest[down] + (low[down] + v - 0.5) * cell[down]
            corners.append(view(place))
        cover = (cover / cover.max()) ** _CONTRAST
        canvas.shade(cover, (corners[0], corners[1], corners[2]), _SHADE)


def _draw_edges(canvas: Canvas, view: _View, *, behind: bool) -> None:
    """Draw the edges that meet in the corner behind, or the others."""
    for axis in range(3):
        one, other = (a for a in range(3) if a != axis)
        for u in (-1.0, 1.0):
            for v in (-1.0, 1.0):
                start, end = np.zeros(3), np.zeros(3)
                start[[axis, one, other]] = -1.0, u, v
                end[[axis, one, other]] = 1.0, u, v
                hidden = bool(np.all(((start + end) / 2 * _TOWARDS) <= 0))
                if hidden == behind:
                    canvas.line(view(start), view(end), _EDGE if behind else _FRONT, 1.0)


def _draw_points(
    canvas: Canvas, view: _View, kernel: RotationKernel, axes: Axes, size: float
) -> None:
    """Draw the rotations, the farthest first."""
    places = axes.places(kernel.theta)
    share = kernel.weights / kernel.weights.max()
    spacing = float((kernel.steps / axes.unit).min()) / axes.half * view.scale
    largest = float(np.clip(0.75 * spacing, 0.003 * size, 0.014 * size))
    points = view(places)
    for k in np.argsort(places @ _TOWARDS, kind="stable"):
        if share[k] == 0:
            continue
        tint = _LIGHT_POINT + share[k] * (_DARK_POINT - _LIGHT_POINT)
        fill = (round(tint[0]), round(tint[1]), round(tint[2]))
        radius = largest * max(share[k] ** 0.5, 0.3)
        canvas.disc(points[k], radius, fill, _POINT_EDGE if radius > _LEAST_EDGED else None)


def _draw_labels(
    canvas: Canvas, view: _View, kernel: RotationKernel, axes: Axes, size: float
) -> None:
    """Write what each axis is, its ticks in pixels, and the kernel's extent along it."""
    text = 0.026 * size
    shown = kernel.theta[kernel.weights >= 0.01 * kernel.weights.max()]
    extent = np.ptp(shown, axis=0)
    # Each axis is labelled along one edge: there the other two coordinates are constant.
    edges = (
        (np.array((0.0, -1.0, -1.0)), np.array((0.35, 1.0)), "left"),
        (np.array((-1.0, 0.0, -1.0)), np.array((-0.35, 1.0)), "right"),
        (np.array((-1.0, 1.0, 0.0)), np.array((-1.0, 0.0)), "right"),
    )
    for axis, (middle, outward, side) in enumerate(edges):
        for tick in (-1.0, -0.5, 0.0, 0.5, 1.0):
            place = middle.copy()
            place[axis] = tick
            start = view(place)
            canvas.line(start, start + 0.35 * text * outward, _EDGE, 1.0)
            if abs(tick) != 0.5:
                value = axes.centre[axis] + tick * axes.half
                canvas.text(
                    start + 0.95 * text * outward,
                    f"{value:g}",
                    text,
                    _FAINT,
                    anchor="left" if side == "left" else "right",
                )
        pixels = f"{extent[axis] / axes.unit[axis]:.3g} px"
        degrees = f"{np.degrees(extent[axis]):.2g}°"
        figures = pixels if kernel.camera.is_uniform else f"{pixels}, {degrees}"
        if axis == 2:
            x, y = view((-1.0, 1.0, 1.0)) - 2.6 * text
            canvas.text((x, y), "θ_Z", 1.9 * text, _INK, anchor="left")
            canvas.text((x + 2.3 * text, y), figures, text, _INK, anchor="left")
        else:
            x, y = view(middle) + 3.0 * text * outward
            canvas.text((x, y), f"θ_{_AXES[axis]}", 1.9 * text, _INK)
            canvas.text((x, y + 1.7 * text), figures, text, _INK)


def round_above(value: float) -> float:
    """Return the first round number that is not below `value` > 0."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(next(n * decade for n in _NICE if n * decade >= value * (1 - 1e-9)))
