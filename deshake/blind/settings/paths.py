"""The constants of camera paths: trimming, thin and smooth paths, and the spectra they match."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = [
    "CameraPathSettings",
    "NarrowingSettings",
    "PathScales",
    "PathSearchSettings",
    "SoftSceneSettings",
    "SpectralMatchSettings",
    "SpectralStartSettings",
    "SpectrumTiles",
    "TrimmingSettings",
]


@dataclass(frozen=True)
class TrimmingSettings:
    """Which parts of a kernel are kept (`trimming`). No record says what they were tuned on.

    Parameters
    ----------
    most : float
        Share of the kernel's weight that counts as most of the kernel.
    stray : float
        Share of the kernel's weight: a separate piece with less is noise.
    apart : int
        Grid steps: least distance between two pieces.

    """

    most: float = 0.8
    stray: float = 0.03
    apart: int = 2


@dataclass(frozen=True)
class CameraPathSettings:
    """Thin paths, smooth paths, and paths without gaps (`camera_path`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`. `spacing` and
    `most_controls` were tuned on 12 photos of it, the constants of settling on seven, by how near
    a path comes to its kernel. No record says more.

    Parameters
    ----------
    fine_enough : float
        Px of the photo between neighbours: a finer kernel has no gaps.
    most_filled : int
        Rotations of a path whose gaps are filled, at most; more make the restoration slower.
    ridge_steps : int
        Iterations of the mean shift.
    light : float
        Share of the kernel's weight: lighter rotations are discarded.
    fewest_controls, most_controls : int
        Control points of a smooth path, at least and at most.
    spacing : float
        Grid steps of a smooth path for each control point.
    least_branch : float
        Grid steps: a shorter side branch is no part of a smooth path.
    copied : int
        Places of a smooth path for each control point of its copy.
    degree : int
        Degree of its B-spline.
    density : float
        Rotations on a smooth path, per grid step of its camera.
    faint : float
        Share of the kernel's weight that a smooth path does not count.
    most_thinned : int
        Rotations that are thinned, at most; the time grows with the square of their number.
    most_points : int
        Rotations that a smooth path is drawn through, at most.
    least_turn : float
        Grid steps: a smaller extent about an axis counts as none.
    stiffness : float
        Weight of the squared bends of the control points, in squared grid steps.
    least_pull : float
        Weight that keeps a control point near the others if no rotation is near it.
    long_way : float
        Exponent of the distance: above 1, several short steps cost less than one long step.
    most_settled : int
        Rotations whose density a smooth path takes, at most.
    settled_places : (int, int)
        Places of a smooth path that stand for its density, at least and at most.
    settled_widths : sequence of float
        Grid steps: widths of the Gaussians that smooth the densities, one after the other.
    settled_stiffness : float
        Price of the squared bends of the control points, relative to the squared density.
    settling : int
        Iterations of the descent at each width.

    """

    fine_enough: float = 1.5
    most_filled: int = 1500
    ridge_steps: int = 15
    light: float = 1e-6
    fewest_controls: int = 8
    most_controls: int = 30
    spacing: float = 2.5
    least_branch: float = 2.0
    copied: int = 12
    degree: int = 3
    density: float = 2.0
    faint: float = 0.05
    most_thinned: int = 2000
    most_points: int = 150
    least_turn: float = 0.5
    stiffness: float = 1e-3
    least_pull: float = 1e-6
    long_way: float = 1.5
    most_settled: int = 300
    settled_places: tuple[int, int] = (60, 160)
    settled_widths: tuple[float, ...] = (1.5, 0.8)
    settled_stiffness: float = 3e-3
    settling: int = 15


@dataclass(frozen=True)
class SoftSceneSettings:
    """When a kernel contains the softness of a large photo (`soft_scene`).

    Tuned on the large photos of the set `tune` of `bench.py shakes`, and on nine more narrow shakes
    of the same scenes.

    Parameters
    ----------
    least_pixels : float
        Pixels of a photo that may be soft in this sense. Photos of 3 megapixels are not, photos of
        8 are.
    widest : float
        Px of the photo: extent of a narrow shake.
    thickness : (float, float)
        Rotations of a kernel for each grid step of its extent. A kernel with fewer is a path; one
        with more is a disk, as the photo D03 of the set `tune` gives it.

    """

    least_pixels: float = 5e6
    widest: float = 30.0
    thickness: tuple[float, float] = (6.0, 15.0)


@dataclass(frozen=True)
class SpectrumTiles:
    """The tiles whose spectra are measured.

    Parameters
    ----------
    size : int
        Px of the scale: side of a tile.
    count : int
        Largest number of tiles.

    """

    size: int
    count: int


@dataclass(frozen=True)
class NarrowingSettings:
    """How narrow a kernel may become across its path (`narrowing`).

    Chosen on 36 photos of the set `tune` and 20 more narrow shakes of its scenes:
    docs/estimation.md.

    Parameters
    ----------
    shares : tuple of float
        Widths of the narrower kernels, as shares of the width of the estimate, the widest first.
    tolerance : float
        Margin: the sum of the worth in the search and of the score may be so much lower than that
        of the best kernel.
    least_width : float
        Grid steps: standard deviation of the rotations across the longest axis, at least.

    """

    shares: tuple[float, ...] = (0.85, 0.7, 0.55, 0.4, 0.25)
    tolerance: float = 0.015
    least_width: float = 0.7


@dataclass(frozen=True)
class SpectralMatchSettings:
    """The fluctuations of spectra, and the descent to the path that matches them best.

    They are those of `spectral_match`. Tuned with the whole estimate on the set `tune` of
    `bench.py shakes`. `clip` was tuned on 16 photos of it, by how much better the true kernel
    matches than wrong ones do; `bending` on 12 photos; `closer` and `finer` on 30 photos, each
    begun from the winner of the race. No record says more.

    Parameters
    ----------
    tiles : SpectrumTiles
        The tiles, unless others are asked for.
    edges : float
        Px of the scale: least length of the edges that count for the choice of tiles.
    floor : float
        Added to the power of the filter, because noise hides low power. A still camera has 1.
    slowest : float
        Cycles per tile: higher frequencies count.
    fastest : float
        Cycles per pixel of the scale: lower frequencies count.
    smoothing : int
        Frequencies: side of the box that smooths the power.
    fluctuation : int
        Frequencies: side of the box whose mean, taken twice, is subtracted.
    clip : float
        Standard deviations of a tile: a larger fluctuation of the photo counts only this much.
    least_power : float
        Share of the largest power that is added to all, so that none is 0.
    evenness : tuple of float
        Shares of the length in the time of a path, see `SmoothPath.through`.
    first_iterations : int
        Iterations of the descent from each of them; the best one goes on.
    iterations : int
        Further iterations of that one.
    begun : float
        Share of the length in the time of a path before it settles along a kernel.
    closer : float
        Control points of a path that is traced closely, per control point of one that is not.
    finer : int
        Scales that are finer than that of a kernel, and whose spectra count in its tracing.
    weight_iterations : int
        Iterations of the descent of the weights; more of them fit the noise.
    faint : float
        Share of the kernel's weight that the descent of the weights does not count.
    light : float
        Share of the kernel's weight: rotations that hold less are discarded.
    bending : float
        Weight of the sum of squared second differences of the control points, per squared px.
    along : float
        Rotations per pixel of the path.
    fewest, most : int
        Rotations on a path, at least and at most; `most` is for the weights, too.

    """

    tiles: SpectrumTiles = SpectrumTiles(128, 24)
    edges: float = 12.0
    floor: float = 0.01
    slowest: float = 16 / 7
    fastest: float = 0.4
    smoothing: int = 3
    fluctuation: int = 7
    clip: float = 2.0
    least_power: float = 1e-9
    evenness: tuple[float, ...] = (0.0, 0.5, 1.0)
    first_iterations: int = 6
    iterations: int = 18
    begun: float = 0.5
    closer: float = 1.5
    finer: int = 2
    weight_iterations: int = 12
    faint: float = 0.03
    light: float = 1e-4
    bending: float = 3e-3
    along: float = 2.0
    fewest: int = 24
    most: int = 150


@dataclass(frozen=True)
class PathSearchSettings:
    """The search for a path along a kernel (`path_search`).

    They were chosen on six photos: one of the set `tune` of `bench.py shakes`, and five of other
    scenes that are no part of its sets. The number of evaluations was chosen on eleven, seven of
    them of `tune`.

    Parameters
    ----------
    places : int
        Places of a path that a folded one is drawn through.
    shares : tuple of float
        Shares of a path that folded ones pass twice.
    apart : float
        Grid steps: distance of the two strokes from their middle.
    opening : float
        Share of a path over which the strokes part.
    descending : int
        Number of paths that descend on the spectra.
    iterations : int
        Iterations of this descent.
    waves : int
        Number of waves that change a path.
    step : float
        Grid steps: standard deviation of the slowest wave.
    decay : float
        Wave whose standard deviation is half as large.
    evaluations : int
        Number of paths that are compared.

    """

    places: int = 100
    shares: tuple[float, ...] = (0.33, 0.66, 1.0)
    apart: float = 1.0
    opening: float = 0.1
    descending: int = 4
    iterations: int = 18
    waves: int = 12
    step: float = 0.5
    decay: float = 3.0
    evaluations: int = 900


@dataclass(frozen=True)
class PathScales:
    """The scales at which random paths are drawn.

    Parameters
    ----------
    tiles : SpectrumTiles
        The tiles.
    fewest : int
        Tiles: a scale with fewer is left out.
    sides : (float, float)
        Px: least and largest shorter side of the frame at the scales.
    every : int
        Every so many scales are used.
    widths : (float, float)
        Px of the scale: mean diagonal of a path's box over the tiles, least and largest.

    """

    tiles: SpectrumTiles
    fewest: int
    sides: tuple[float, float]
    every: int
    widths: tuple[float, float]


@dataclass(frozen=True)
class SpectralStartSettings:
    """Paths that are found by the spectra alone (`spectral_start`).

    Chosen on 16 photos of the set `tune` of `bench.py shakes`, by how alike the best ends are to
    the true kernel. More paths, more descents or more scales did not better them.

    Parameters
    ----------
    usual : PathScales
        For most shakes.
    wide : PathScales
        For shakes as wide as a tenth of the frame. Nearly all of the frame is a single tile there.
        Chosen on two real photos of Köhler et al., shaken by 105 to 125 of 800 px, by how alike
        the best ends are to the kernel that a pair of photos gives. Tiles of 192 px, or every
        second scale, found less.
    paths : int
        Number of random paths at a scale.
    turns : (float, float)
        Correlation of the steps of a path from control point to control point: least, largest.
    rests : float
        Standard deviation of the logarithm of the steps' lengths.
    rolls : tuple of float
        Angles of the roll, relative to the other angles in grid steps; one of them is drawn.
    first, second : int
        Number of paths that descend a little, and of those that descend farther.
    first_iterations, second_iterations : int
        Iterations of the two descents.
    times : int
        Times at which two paths are compared.
    unlike : float
        Px of the scale: root mean square distance of two paths that are not the same.
    most : int
        Number of paths that take part in the race, and of their reflections.
    alike : float
        Agreement from which only one of two kernels takes part.

    """

    usual: PathScales = PathScales(SpectrumTiles(64, 12), 3, (0.0, math.inf), 2, (8.0, 21.0))
    wide: PathScales = PathScales(SpectrumTiles(128, 6), 1, (95.0, 270.0), 1, (12.0, 42.0))
    paths: int = 200
    turns: tuple[float, float] = (0.3, 0.95)
    rests: float = 0.8
    rolls: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0)
    first: int = 16
    second: int = 6
    first_iterations: int = 8
    second_iterations: int = 20
    times: int = 24
    unlike: float = 1.0
    most: int = 4
    alike: float = 0.9
