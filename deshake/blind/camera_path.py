"""A kernel as the path of a camera: a thin line, without breaks.

A camera moves along a curve. An estimate differs from that curve in two ways. It is too wide,
because of noise, and of edges that it takes for sharper than they are: `thinned` moves the
rotations to the ridge of their density, and `SmoothPath` is one smooth curve through them. At a
coarse scale it is a row of spikes, and the gaps between them leave dotted rims in the restored
photo: `filled_path` fills the gaps.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deshake.blind.descent import descent
from deshake.blind.settings import SETTINGS
from deshake.blind.trimming import heaviest, strongest
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.geometry.camera import Camera

__all__ = ["SmoothPath", "filled_path", "price_of_bends", "thinned"]

Points = NDArray[np.float64]

_S: Final = SETTINGS.camera_path
_ALONG = 1  # dimension of a path
_NEIGHBOURS = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
"""Differences of indices, in grid steps, to the neighbours of a rotation and to itself."""


def thinned(kernel: RotationKernel, width: float = 1.0) -> RotationKernel:
    """Move the rotations of a kernel to the ridge of their density; each keeps its weight.

    The method is subspace constrained mean shift (Ozertem & Erdogmus, JMLR 2011). A rotation moves
    to the mean of its neighbours, but only across the path. So no part of the path gets shorter or
    lighter.

    Parameters
    ----------
    kernel : RotationKernel
        A kernel on its grid.
    width : float
        Standard deviation of the neighbourhood, in grid steps.

    """
    used = kernel.weights > 0
    origin = kernel.centroid
    weights = kernel.weights[used]
    points = (kernel.theta[used] - origin) / kernel.steps
    moved = points.copy()
    squares = (points[:, :, None] * points[:, None]).reshape(len(points), -1)
    for _ in range(_S.ridge_steps):
        near = _gaussian(moved, points, width**2)
        near *= weights
        near /= near.sum(1, keepdims=True)
        mean = near @ points
        # the Hessian of ln density, scaled: the covariance of the neighbours
        bend = (near @ squares).reshape(-1, 3, 3) - mean[:, :, None] * mean[:, None]
        across = np.linalg.eigh(bend)[1][:, :, : points.shape[1] - _ALONG]
        moved += np.einsum("nij,nkj,nk->ni", across, across, mean - moved)
    return _on_grid(moved, weights, kernel)


class SmoothPath(NamedTuple):
    """A smooth curve of rotations: a cubic B-spline of time.

    Parameters
    ----------
    controls : (n, 3) array
        Control points, more of them for a longer curve, in grid steps of the camera.
    camera : Camera
        The camera of a scale.

    """

    controls: Points
    camera: Camera

    @classmethod
    def through(
        cls, kernel: RotationKernel, scale: Camera, evenness: Sequence[float] = (0.0,)
    ) -> list[SmoothPath]:
        """Draw curves through a kernel: one place of the curve, and several courses of time.

        The curve follows the branches of the minimum spanning tree of the thin path. Its time is
        the share of the weight up to there, the share of the length, or a mean of the two. An
        estimate often puts too much weight on one place, where the camera did not rest.

        Parameters
        ----------
        kernel : RotationKernel
            A kernel.
        scale : Camera
            The camera of a scale where the kernel is some 30 pixels wide. Details that are smaller
            than the pixels of this scale do not shape the curve.
        evenness : sequence of float
            Shares of the length in the time, 0..1, one for each curve. At 0 the camera moves as
            fast as the kernel says, at 1 it moves evenly.

        Returns
        -------
        list of SmoothPath
            A curve for each evenness; none if the kernel is a point.

        """
        reduced = _reduced(kernel, scale, _S.most_thinned)
        thin = strongest(heaviest(thinned(reduced), _S.faint), _S.most_points)
        places = (thin.theta - thin.centroid) / thin.steps
        places[:, np.ptp(places, 0) < _S.least_turn] = 0
        order, held = _walk(places, thin.weights)
        if len(order) == 1:
            return []
        lengths = np.linalg.norm(np.diff(places[order], axis=0), axis=1)
        along = np.convolve(lengths, [0.5, 0.5]) / lengths.sum()
        return [
            cls.along(places[order], (1 - even) * held + even * along, scale) for even in evenness
        ]

    @classmethod
    def along(cls, places: Points, duration: Points, scale: Camera) -> SmoothPath:
        """Fit a curve to places (m, 3) in grid steps, by the time that each lasts (sum 1)."""
        length = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
        count = int(np.clip(length / _S.spacing, _S.fewest_controls, _S.most_controls))
        return cls(_controls(places, duration, count), scale)

    @property
    def length(self) -> float:
        """Length of the curve in grid steps of its camera."""
        return float(np.linalg.norm(_pieces(len(self.controls)) @ self.controls, axis=1).sum())

    @property
    def reflected(self) -> SmoothPath:
        """The path with every rotation reversed; every local filter is reflected."""
        return self._replace(controls=-self.controls)

    def on_scale(self, camera: Camera) -> SmoothPath:
        """Return the same curve on the grid of a camera of another size."""
        ratio = grid_steps(self.camera) / grid_steps(camera)
        return SmoothPath(self.controls * ratio, camera)

    def settled(self, kernel: RotationKernel) -> SmoothPath:
        """Move the path to where its density is that of a kernel, as far as a thin path can.

        The path of `through` cuts corners, and where strokes of a kernel touch, it may join parts
        that the camera passed at different times. The squared difference of the two densities,
        each smoothed by a Gaussian, falls by a descent, first with a wide Gaussian.

        Parameters
        ----------
        kernel : RotationKernel
            The kernel that the path was drawn through.

        """
        reduced = _reduced(kernel, self.camera, _S.most_settled)
        places = (reduced.theta - reduced.centroid) / reduced.steps
        places[:, np.ptp(self.controls, axis=0) == 0] = 0
        basis = self.basis(int(np.clip(_S.density * self.length, *_S.settled_places)))
        controls = self.controls
        for width in _S.settled_widths:
            controls = _settled(controls, basis, places, reduced.weights, width)
        return self._replace(controls=controls)

    def with_controls(self, count: int) -> SmoothPath:
        """Return nearly the same curve by another number of control points."""
        if count == len(self.controls):
            return self
        places = self.basis(_S.copied * count) @ self.controls
        even = np.full(len(places), 1 / len(places))
        return self._replace(controls=_controls(places, even, count))

    def basis(self, count: int) -> Points:
        """Return the weights (count, n) of the control points at equal steps of time."""
        return _at_steps(count, len(self.controls))

    def kernel(self, camera: Camera) -> RotationKernel:
        """Return the kernel of the curve, centred, on the grid of a camera of any size."""
        steps = grid_steps(camera)
        own = self.on_scale(camera)
        count = max(int(_S.density * own.length), len(own.controls))
        curve = own.basis(count) @ own.controls
        rest = RotationKernel.delta(camera, steps=steps)
        return _on_grid(curve - curve.mean(0), np.full(count, 1 / count), rest)


def price_of_bends(controls: Points, price: Points | float, change: Points) -> float:
    """Return the price of the bends of control points, and add its gradient to another one.

    Parameters
    ----------
    controls : (n, d) array
        The control points.
    price : float or (d,) array
        Price of a squared second difference.
    change : (n, d) array
        Receives the gradient.

    """
    bends = np.diff(controls, 2, axis=0)
    change[:-2] += 2 * price * bends
    change[1:-1] -= 4 * price * bends
    change[2:] += 2 * price * bends
    return float((np.square(bends) * price).sum())


def _reduced(kernel: RotationKernel, scale: Camera, most: int) -> RotationKernel:
    """Resample a kernel to the grid of a scale; keep its heaviest rotations, so many at most."""
    return strongest(kernel.for_camera(scale).resampled(grid_steps(scale)), most)


def _squared_distances(one: Points, other: Points) -> Points:
    """Return the squared distances (n, m) between places (n, d) and (m, d)."""
    from scipy.spatial.distance import cdist  # noqa: PLC0415 - slow to import, and only estimates need it

    values: Points = cdist(one, other, "sqeuclidean")
    return values


def _gaussian(one: Points, other: Points, variance: float) -> Points:
    """Return Gaussians (n, m) of the distances between places (n, d) and (m, d); 1 at none."""
    values = _squared_distances(one, other)
    values *= -0.5 / variance
    return np.exp(values, out=values)


def _controls(places: Points, duration: Points, count: int) -> Points:
    """Fit the control points of a curve to places (m, 3), by the time that each of them lasts."""
    basis = _spline(np.cumsum(duration) - duration / 2, count)
    bends = np.diff(np.eye(count), 2, axis=0)
    pull = basis.T * duration
    normal = pull @ basis + _S.stiffness * bends.T @ bends + _S.least_pull * np.eye(count)
    controls: Points = np.linalg.solve(normal, pull @ places).astype(np.float64)
    return controls


def _settled(
    controls: Points, basis: Points, places: Points, weights: Points, width: float
) -> Points:
    """Minimise the squared difference of two densities that are smoothed by Gaussians of a width.

    One is that of a curve, with as much weight at each of its places; the other is that of a kernel
    with weights at places. Bends have a price.
    """
    share = 1 / len(basis)
    variance = 2 * width**2  # that of two Gaussians, one after the other
    own = weights @ _gaussian(places, places, variance) @ weights
    price = _S.settled_stiffness * own / len(controls)

    def objective(flattened: Points) -> tuple[float, Points]:
        moved = flattened.reshape(controls.shape)
        curve = basis @ moved
        curve -= curve.mean(0)
        among = _gaussian(curve, curve, variance) * share**2
        across = _gaussian(curve, places, variance) * weights * share
        slope = across.sum(1)[:, None] * curve - across @ places
        slope -= among.sum(1)[:, None] * curve - among @ curve
        slope -= slope.mean(0)
        change = basis.T @ slope / width**2
        bends = price_of_bends(moved, price, change)
        value = among.sum() - 2 * across.sum() + own + bends
        return float(value / own), change.ravel() / own

    return descent(objective, controls, _S.settling)[1]


@lru_cache
def _at_steps(count: int, controls: int) -> Points:
    """Return the values (count, controls) of the B-splines in the middle of equal steps of time."""
    values = _spline((np.arange(count) + 0.5) / count, controls)
    values.flags.writeable = False
    return values


@lru_cache
def _pieces(controls: int) -> Points:
    """Return what takes control points to the short pieces of their curve."""
    pieces: Points = np.diff(_spline(np.linspace(0, 1, 10 * controls), controls), axis=0)
    pieces.flags.writeable = False
    return pieces


def _spline(time: Points, controls: int) -> Points:
    """Return the values (n, controls) of the B-splines at times 0..1."""
    from scipy.interpolate import BSpline  # noqa: PLC0415 - slow to import, and only estimates need it

    inner = np.linspace(0, 1, controls - _S.degree + 1)
    knots = np.concatenate([np.zeros(_S.degree), inner, np.ones(_S.degree)])
    values: Points = BSpline.design_matrix(np.clip(time, 0, 1), knots, _S.degree).toarray()
    return values


def _walk(places: Points, weights: Points) -> tuple[NDArray[np.int64], Points]:
    """Return points in the order of a walk along the branches of their tree, and durations.

    The tree is the minimum spanning tree. The walk follows its longest branch. It goes along each
    long side branch and back, and the visits of a point share its weight. The points of a short
    side branch add their weight to the point where it begins.
    """
    from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree  # noqa: PLC0415 - likewise

    distances = np.sqrt(_squared_distances(places, places))
    tree = minimum_spanning_tree(distances**_S.long_way)
    tree.data **= 1 / _S.long_way
    length, before = dijkstra(tree, directed=False, return_predecessors=True)
    first, last = (int(n) for n in np.unravel_index(np.argmax(length), length.shape))
    distance, before = length[first], before[first]
    longest = [last]
    while longest[-1] != first:
        longest.append(int(before[longest[-1]]))
    far, held = distance.copy(), weights.copy()
    sides: list[list[int]] = [[] for _ in places]
    for at in np.argsort(-distance, kind="stable").tolist():  # the ends of branches come first
        if at in longest:
            continue
        begin = int(before[at])
        far[begin] = max(far[begin], far[at])
        if far[at] - distance[begin] > _S.least_branch:
            sides[begin].append(at)
        else:
            held[begin] += held[at]

    def there_and_back(at: int) -> list[int]:
        visits = [at]
        for side in sides[at]:
            visits += [*there_and_back(side), at]
        return visits

    order = np.array([n for at in reversed(longest) for n in there_and_back(at)], np.int64)
    return order, held[order] / np.bincount(order, minlength=len(places))[order]


def _on_grid(points: Points, weights: Points, kernel: RotationKernel) -> RotationKernel:
    """Distribute rotations (n, 3), in grid steps from the centroid, on the grid trilinearly."""
    low = np.floor(points)
    share = points - low
    corners = np.stack(np.meshgrid(*[(0, 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    parts = np.where(corners[:, None], share, 1 - share).prod(2) * weights
    places = (low + corners[:, None]).astype(np.int64).reshape(-1, 3)
    on_grid = RotationKernel.from_indices(places, parts.ravel(), kernel.steps, kernel.camera)
    least = _S.light / on_grid.weights.max()
    return _moved(on_grid.above(least), kernel)


def filled_path(kernel: RotationKernel) -> RotationKernel:
    """Fill the gaps of a kernel, so that neighbours lie about a pixel of the photo apart.

    The mean of all rotations does not change. A kernel without gaps is returned unchanged.

    Parameters
    ----------
    kernel : RotationKernel
        A kernel for the camera of the photo, on the grid of its estimate.

    """
    ratio = float((kernel.steps / grid_steps(kernel.camera)).max())
    if ratio <= _S.fine_enough:
        return kernel
    used = kernel.weights > 0
    if not used.all():
        kernel = replace(kernel, theta=kernel.theta[used], weights=kernel.weights[used])
    offset = kernel.theta[np.argmax(kernel.weights)]
    index = np.rint((kernel.theta - offset) / kernel.steps).astype(np.int64)
    place = {tuple(at): k for k, at in enumerate(index.tolist())}
    pairs = [
        (k, place[other])
        for at, k in place.items()
        for step in _NEIGHBOURS.tolist()
        if any(step) and (other := tuple(np.add(at, step).tolist())) in place
    ]
    if not pairs:
        return kernel
    first, second = np.array(pairs).T
    total = np.bincount(first, kernel.weights[second], len(kernel.weights))
    share = kernel.weights[first] * kernel.weights[second] / total[first]
    count = max(min(int(np.ceil(ratio / 2)), _S.most_filled // len(pairs)), 1)
    along = (np.arange(count) + 0.5) / (2 * count)
    theta = kernel.theta[first] + along[:, None, None] * (
        kernel.theta[second] - kernel.theta[first]
    )
    alone = total == 0
    theta = np.concatenate([theta.reshape(-1, 3), kernel.theta[alone]])
    weights = np.concatenate([np.tile(share / count, count), kernel.weights[alone]])
    steps = kernel.steps / ratio
    filled = RotationKernel(theta, weights / weights.sum(), steps, kernel.camera)
    return _moved(filled, kernel)


def _moved(kernel: RotationKernel, to: RotationKernel) -> RotationKernel:
    """Move a kernel to the centroid of another kernel."""
    theta = kernel.theta + (to.centroid - kernel.centroid)
    return RotationKernel(theta, kernel.weights, kernel.steps, kernel.camera)
