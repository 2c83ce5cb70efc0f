"""The search for the path of a camera along a kernel that is nearly right.

An estimate is a band around the path. Where the camera went there and back, the two strokes are
one band, and a smooth path through its middle passes it only once. So folded paths are drawn along
the kernel, too: both ends, some lengths of the part that is passed twice, and both sides. All paths
settle where their density is that of the kernel (`camera_path`). The best few are moved to where
they match the spectra of some scales (`spectral_match`).

The best path is then moved to where a measure of its worth is higher: that of the comparison
(`kernel_comparison`). The measure needs a new picture of edges for each path. So it has no bias to
the kernel that the present picture belongs to; but it is rough, and its gradient misleads. An
evolution of random changes finds the way (`evolution`). The changes are slow waves along the path.
Each generation of them is measured on a few tiles only, and the next one on others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from deshake.blind.camera_path import SmoothPath
from deshake.blind.evolution import evolved
from deshake.blind.settings import SETTINGS
from deshake.blind.spectral_match import close_path, descended
from deshake.operators.strips import in_order

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from deshake.blind.spectral_match import SpectralMatch
    from deshake.geometry.kernel import RotationKernel
    from deshake.run import Run

__all__ = ["searched"]

Points = NDArray[np.float64]

_S: Final = SETTINGS.path_search


def searched(
    kernel: RotationKernel,
    scales: Sequence[SpectralMatch],
    *,
    worth: Callable[[RotationKernel], float],
    around: Callable[[int, SmoothPath], Callable[[SmoothPath], float]],
    least: float,
    run: Run,
) -> RotationKernel | None:
    """Search for a smooth path along a kernel that is worth as much as possible.

    Parameters
    ----------
    kernel : RotationKernel
        A kernel that is nearly right, for the camera of the photo.
    scales : sequence of SpectralMatch
        The scale of the kernel, the last one, and finer ones.
    worth : callable
        Returns what a kernel is worth; higher is better. Threads call it.
    around : callable
        Returns a measure of the paths of a generation, from its number and a path that they are
        near. The measure is a callable like `worth`, but of a path.
    least : float
        What a path is worth that gives hope. If none is worth so much, there is no evolution.
    run : Run
        Threads to use, and who receives the progress.

    Returns
    -------
    RotationKernel or None
        The path, on the grid of the kernel's camera; None if the kernel is a point, or without
        hope.

    """
    once = close_path(kernel, scales[-1].camera)
    if once is None or not _turning(once).any():
        return None

    def worth_of(path: SmoothPath) -> float:
        return worth(path.kernel(kernel.camera))

    settled = [
        path for _, path in in_order(lambda path: path.settled(kernel), [once, *_folds(once)], run)
    ]
    best = [path for _, path in _ranked(settled, worth_of, run)[: _S.descending]]
    moved = [descended(scales, path, _S.iterations, run)[1] for path in best]
    value, path = _ranked([best[0], *moved], worth_of, run)[0]
    if value < least:
        return None
    waves = _waves(path)

    def objectives(number: int, mean: Points) -> Callable[[Points], float]:
        measure = around(number, _changed(path, waves, mean))
        return lambda change: -measure(_changed(path, waves, change))

    changes = evolved(
        objectives,
        np.repeat(_S.step / (1 + np.arange(waves.shape[1]) / _S.decay), _turning(path).sum()),
        _S.evaluations,
        run,
    )
    return _changed(path, waves, changes).kernel(kernel.camera)


def _ranked(
    paths: Sequence[SmoothPath], worth: Callable[[SmoothPath], float], run: Run
) -> list[tuple[float, SmoothPath]]:
    """Return what paths are worth, and the paths, the best first."""
    values = [value for _, value in in_order(worth, paths, run)]
    return [(values[n], paths[n]) for n in np.argsort(np.negative(values), kind="stable")]


def _folds(path: SmoothPath) -> list[SmoothPath]:
    """Draw paths that pass a part of a path twice, there and back."""
    curve = path.basis(_S.places) @ path.controls
    lengths = np.cumsum(np.linalg.norm(np.diff(curve, axis=0, prepend=curve[:1]), axis=1))
    even = np.linspace(0, lengths[-1], _S.places)
    curve = np.stack([np.interp(even, lengths, column) for column in curve.T], -1)
    return [
        _fold(ordered, share, side, path)
        for ordered in (curve, curve[::-1])
        for share in _S.shares
        for side in (_S.apart, -_S.apart)
    ]


def _fold(curve: Points, share: float, side: float, path: SmoothPath) -> SmoothPath:
    """Draw a path that begins at a share of a curve, goes to its first place, and then along all.

    The two strokes lie apart by twice `side`, except at the fold.
    """
    twice = round(share * len(curve))
    place = np.arange(len(curve))
    ramp = _S.opening * len(curve)
    opened = np.interp(place, [0, ramp, twice, twice + ramp], [0, 1, 1, 0])[:, None]
    along = np.gradient(curve, axis=0)
    across = np.stack([-along[:, 1], along[:, 0], np.zeros(len(curve))], -1)
    across /= np.linalg.norm(across, axis=1, keepdims=True) + np.finfo(float).tiny
    across *= side * opened
    back = (curve + across)[:twice][::-1]
    duration = np.concatenate([np.ones(twice), np.where(place < twice, 1.0, 2.0)])
    places = np.concatenate([back, curve - across])
    return SmoothPath.along(places, duration / duration.sum(), path.camera)


def _turning(path: SmoothPath) -> NDArray[np.bool_]:
    """Return the axes that a path turns about."""
    turning: NDArray[np.bool_] = np.ptp(path.controls, axis=0) > 0
    return turning


def _waves(path: SmoothPath) -> Points:
    """Return slow waves along the control points of a path, (n, waves), each of norm 1."""
    count = len(path.controls)
    place, number = np.arange(count) + 0.5, np.arange(min(_S.waves, count))
    waves: Points = np.cos(np.pi / count * place[:, None] * number)
    waves /= np.linalg.norm(waves, axis=0)
    return waves


def _changed(path: SmoothPath, waves: Points, change: Points) -> SmoothPath:
    """Add waves to a path, about the axes that it turns about."""
    controls = path.controls.copy()
    controls[:, _turning(path)] += waves @ change.reshape(waves.shape[1], -1)
    return path._replace(controls=controls)
