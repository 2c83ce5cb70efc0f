"""The path of the camera that the streaks of small lights draw.

A lamp is a small spot of light. A shaken photo shows it as a streak, which is the path of the
camera at its place:

    L_t(x) = a_t int G(x - q_t - M_t c(time); sigma_t) dtime,

where c is a smooth path of rotations, M_t takes rotations to displacements at the place of streak
t, q_t is the place of its lamp, a_t its light, and G a Gaussian of its width sigma_t. The fit finds
the path and the lamps that explain the light of all streaks. Where the photo is clipped, L_t must
be at least white. A misfit counts by Welsch's function, ``1 - exp(-r^2 / 2 s^2)``, so that other
things near a streak do not pull it. Streaks that are apart in the frame determine the roll, too.

The shape of one streak gives a first path. The fit starts with few control points and a tolerant s;
then it has more control points and a stricter s. Streaks that do not fit are left out. Ben-Ezra &
Nayar (2004) and Hua & Low (2011) read blurs that are the same over the frame from lamps.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from deshake.blind.camera_path import SmoothPath, price_of_bends
from deshake.blind.descent import descent
from deshake.blind.settings import SETTINGS
from deshake.blind.streak_light import SIDE, StreakLight, light_of
from deshake.blind.streaks import agreeing, find_streaks
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.bilinear import splat_on_raster

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.settings import StreakFit
    from deshake.geometry.camera import Camera
    from deshake.signal.pyramid import Pyramid, Scale

__all__ = ["Drawing", "Lamps", "drawing", "energy", "streak_misfit"]

Vector = NDArray[np.float64]
Lamps = NDArray[np.float64]
"""Place x and y in the square, ln a and ln sigma of the lamp of each streak, (T, 4)."""

_S: Final = SETTINGS.drawn_path


class Drawing(NamedTuple):
    """The path that the streaks of a photo show.

    Parameters
    ----------
    kernel : RotationKernel
        The path, for the camera of the photo, centred.
    misfit : float
        Median over the streaks of the light that the path does not explain, as a share of their
        area: 0 is a perfect fit.
    boxes : (T, 4) array of float64
        Places of the streaks: x, y, width and height in pixels of the photo.

    """

    kernel: RotationKernel
    misfit: float
    boxes: Vector


class _Fit(NamedTuple):
    """A path, the streaks that it explains, their lamps, and the misfit of each."""

    path: SmoothPath
    streaks: list[StreakLight]
    lamps: Lamps
    misfits: Vector

    @property
    def misfit(self) -> float:
        return float(np.median(self.misfits))


def drawing(pyramid: Pyramid, *, roll: bool = True, bound: float | None = None) -> Drawing | None:
    """Return the path that the streaks of small lights draw.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    roll : bool
        Whether the camera may turn about its optical axis.
    bound : float, optional
        Largest extent of the kernel in pixels of the photo.

    Returns
    -------
    Drawing or None
        None: too few streaks agree, or no path explains them.

    """
    finest = pyramid.level_of(_S.pixels)
    best: Drawing | None = None
    for level in range(finest, finest + 2 * _S.scales, 2):
        if level > pyramid.coarsest or (best is not None and best.misfit <= _S.good):
            break
        scale = pyramid.at(level)
        fit = _fit(scale, roll=roll and not scale.camera.is_uniform)
        if fit is None or fit.misfit > _S.most_misfit:
            continue
        kernel = fit.path.kernel(pyramid.camera)
        if bound is not None and kernel.extent_px() > bound:
            continue
        if best is None or fit.misfit < _S.better * best.misfit:
            best = Drawing(kernel, fit.misfit, _boxes(fit.streaks, scale, pyramid))
    return best


def _boxes(streaks: list[StreakLight], scale: Scale, pyramid: Pyramid) -> Vector:
    """Return the places of streaks in the photo: x, y, width and height."""
    places = np.array([np.add(streak.square, streak.corner) for streak in streaks])
    sizes = np.array([streak.light.shape[::-1] for streak in streaks])
    ratio = np.divide(pyramid.camera.shape, scale.camera.shape)[::-1]
    return np.hstack([places * ratio, sizes * ratio])


def _fit(scale: Scale, *, roll: bool) -> _Fit | None:
    """Fit a path to the streaks of a scale."""
    seen = [light_of(streak, scale) for streak in agreeing(find_streaks(scale))[: _S.most]]
    streaks = [one for one in seen if one is not None]
    if len(streaks) < _S.fewest:
        return None
    first, *later = _S.fits
    fits = []
    for path in _first_paths(streaks, scale.camera):
        few = path.with_controls(_controls(path, first))
        lamps = _first_lamps(streaks, few, first.tolerance)
        fits.append(_descended(_Fit(few, streaks, lamps, np.zeros(len(streaks))), first, roll=roll))
    fits = sorted(fits, key=lambda fit: fit.misfit)[: _S.continued]
    for stage in later:
        fits = [_descended(_without_others(fit), stage, roll=roll) for fit in fits]
    best = min(fits, key=lambda fit: fit.misfit, default=None)
    if best is not None and best.misfit > _S.good:
        bent = min(
            (_descended(fit, _S.flexible, roll=roll) for fit in fits), key=lambda fit: fit.misfit
        )
        if bent.misfit < _S.better * best.misfit:
            return bent
    return best


def _first_paths(streaks: list[StreakLight], camera: Camera) -> list[SmoothPath]:
    """Return the paths that the shapes of single streaks show, without roll."""
    steps = grid_steps(camera)
    largest = sorted(streaks, key=lambda streak: (not streak.is_whole, -streak.area))
    paths = []
    for streak in largest[: _S.first_paths]:
        rows, columns = np.nonzero(streak.picture)
        places = np.stack([columns - columns.mean(), rows - rows.mean()], 1)
        turned = np.rint(places @ np.linalg.inv(streak.moves[:, :2]).T).astype(np.int64)
        turned, which = np.unique(turned, axis=0, return_inverse=True)
        light = np.bincount(which.ravel(), streak.picture[rows, columns])
        indices = np.column_stack([turned, np.zeros(len(turned), np.int64)])
        kernel = RotationKernel.from_indices(indices, light / light.sum(), steps, camera)
        paths += SmoothPath.through(kernel, camera, (0.0, 1.0))
    return [path for path in paths if path.length <= _S.longest]


def _controls(path: SmoothPath, stage: StreakFit) -> int:
    """Return the number of control points of a path in a stage of the fit."""
    return int(np.clip(path.length / stage.spacing, *stage.controls))


def _first_lamps(streaks: Sequence[StreakLight], path: SmoothPath, tolerance: float) -> Lamps:
    """Place the lamps where the drawn path overlaps most with each streak."""
    points = path.basis(_S.samples) @ path.controls
    lamps = np.zeros((len(streaks), 4))
    square = 2 * SIDE, 2 * SIDE
    for lamp, streak in zip(lamps, streaks, strict=True):
        moved = points @ streak.moves.T
        even = np.full(len(moved), 1 / len(moved))
        drawn = splat_on_raster(moved + SIDE / 2, even, (SIDE, SIDE)) > 0
        seen = scipy.fft.rfft2(streak.picture, square, workers=1)
        seen *= np.conj(scipy.fft.rfft2(drawn.astype(np.float32), square, workers=1))
        overlap = scipy.fft.irfft2(seen, square, workers=1)
        row, column = np.unravel_index(int(overlap.argmax()), square)
        shift = (np.array([column, row]) + SIDE) % (2 * SIDE) - SIDE
        lamp[:2] = SIDE / 2 + shift
        tries = [
            (*lamp[:2], light, width)
            for light in np.log(np.geomspace(*_S.lights))
            for width in np.log(_S.widths)
        ]
        misfits = [streak_misfit(streak, moved, np.array(one), tolerance)[0] for one in tries]
        lamp[:] = tries[int(np.argmin(misfits))]
    return lamps


def _without_others(fit: _Fit) -> _Fit:
    """Leave out the streaks that the path does not explain."""
    limit = max(_S.outlier * fit.misfit, _S.least_outlier)
    kept = np.flatnonzero(fit.misfits <= limit)
    if len(kept) < _S.fewest:
        return fit
    return _Fit(fit.path, [fit.streaks[t] for t in kept], fit.lamps[kept], fit.misfits[kept])


def _descended(fit: _Fit, stage: StreakFit, *, roll: bool) -> _Fit:
    """Descend to the path and the lamps that fit best."""
    path = fit.path.with_controls(max(_controls(fit.path, stage), len(fit.path.controls)))
    count = len(path.controls)
    free, lights, widths = (-np.inf, np.inf), _S.lights_between, _S.widths_between
    turns = [free, free, free if roll else (0.0, 0.0)]
    lamp = [free, free, *((math.log(low), math.log(high)) for low, high in (lights, widths))]
    samples = int(np.clip(_S.density * path.length, 3 * count, _S.most_samples))
    basis = path.basis(samples)

    def parts(v: Vector) -> tuple[Vector, Lamps]:
        return v[: 3 * count].reshape(-1, 3), v[3 * count :].reshape(-1, 4)

    def value(v: Vector) -> tuple[float, Vector]:
        controls, lamps = parts(v)
        e, of_controls, of_lamps = energy(fit.streaks, basis, controls, lamps, stage)
        return e, np.concatenate([of_controls.ravel(), of_lamps.ravel()])

    first = np.concatenate([path.controls.ravel(), fit.lamps.ravel()])
    bounds = turns * count + lamp * len(fit.streaks)
    end = descent(value, first, stage.iterations, bounds)[1]
    controls, lamps = parts(end)
    points = basis @ controls
    misfits = [
        streak_misfit(streak, points @ streak.moves.T, lamp, stage.tolerance)[0]
        for streak, lamp in zip(fit.streaks, lamps, strict=True)
    ]
    return _Fit(path._replace(controls=controls), fit.streaks, lamps, np.array(misfits))


def energy(
    streaks: Sequence[StreakLight],
    basis: Vector,
    controls: Vector,
    lamps: Lamps,
    stage: StreakFit,
) -> tuple[float, Vector, Lamps]:
    """Return the mean misfit of the streaks and the price of the path, and its gradients.

    Parameters
    ----------
    streaks : sequence of T StreakLight
        The streaks.
    basis : (m, n) array
        Weights of the control points at m equal steps of time.
    controls : (n, 3) array
        Control points of the path, in grid steps.
    lamps : (T, 4) array
        The lamps.
    stage : StreakFit
        The tolerance s, and the price of bends.

    Returns
    -------
    value : float
    of_controls : (n, 3) array
    of_lamps : (T, 4) array

    """
    points = basis @ controls
    value, of_points = 0.0, np.zeros_like(points)
    of_lamps = np.zeros_like(lamps)
    for t, (streak, lamp) in enumerate(zip(streaks, lamps, strict=True)):
        misfit, of_moved, of_lamps[t] = streak_misfit(
            streak, points @ streak.moves.T, lamp, stage.tolerance
        )
        value += misfit
        of_points += of_moved @ streak.moves
    value /= len(streaks)
    of_points /= len(streaks)
    of_lamps /= len(streaks)
    roll = points[:, 2] - points[:, 2].mean()
    value += _S.roll_price * float((roll**2).mean())
    of_points[:, 2] += 2 * _S.roll_price / len(roll) * roll
    of_controls = basis.T @ of_points
    bends = np.size(controls[2:])
    value += price_of_bends(controls, stage.bend_price / bends, of_controls)
    middle = controls.mean(0)  # the lamps say where they are, and the path begins at no place
    value += _S.middle_price * float(middle @ middle)
    of_controls += 2 * _S.middle_price / len(controls) * middle
    wider = lamps[:, 3] - np.log(_S.usual_width)
    value += _S.width_price * float((wider**2).mean())
    of_lamps[:, 3] += 2 * _S.width_price / len(wider) * wider
    return value, of_controls, of_lamps


def streak_misfit(
    streak: StreakLight, moved: Vector, lamp: Vector, tolerance: float
) -> tuple[float, Vector, Vector]:
    """Return how badly a path explains a streak, and its gradients.

    Parameters
    ----------
    streak : StreakLight
        The streak.
    moved : (m, 2) array
        Displacements of the lamp at m equal steps of time, in pixels.
    lamp : (4,) array
        Place, ln a and ln sigma of the lamp.
    tolerance : float
        s of Welsch's function.

    Returns
    -------
    misfit : float
        The sum over the pixels that count, over the area of the streak.
    of_moved : (m, 2) array
    of_lamp : (4,) array

    """
    variance = np.exp(2 * lamp[3])
    (left, top), (height, width) = streak.corner, streak.light.shape
    x = np.arange(left, left + width) - (lamp[0] + moved[:, :1])
    y = np.arange(top, top + height) - (lamp[1] + moved[:, 1:])
    across = np.exp(x * x * (-0.5 / variance))  # a Gaussian is separable
    down = np.exp(y * y * (-0.5 / variance))
    across *= np.exp(lamp[2]) / (2 * np.pi * variance * len(moved))
    light = down.T @ across
    r = np.where(streak.clipped, np.minimum(light - streak.white, 0), light - streak.light)
    r[~streak.counted] = 0
    kept = np.exp(-0.5 * (r / tolerance) ** 2)
    misfit = float((1 - kept).sum()) / streak.area
    slope = r * kept / (tolerance**2 * streak.area)
    of_x, of_y = across * (down @ slope), down * (across @ slope.T)
    of_moved = np.stack([(of_x * x).sum(1), (of_y * y).sum(1)], 1) / variance
    far = float((of_x * x * x).sum() + (of_y * y * y).sum())
    of_width = far / variance - 2 * float(of_x.sum())
    of_light = float((slope * light).sum())
    return misfit, of_moved, np.array([*of_moved.sum(0), of_light, of_width])
