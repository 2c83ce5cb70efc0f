"""The constants of camera paths: trimming, thin and smooth paths, and the spectra they match."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["CameraPathSettings", "SpectralMatchSettings", "TrimmingSettings"]


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

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more.

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
    controls : int
        Control points of a smooth path.
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

    """

    fine_enough: float = 1.5
    most_filled: int = 1500
    ridge_steps: int = 15
    light: float = 1e-6
    controls: int = 8
    degree: int = 3
    density: float = 2.0
    faint: float = 0.05
    most_thinned: int = 2000
    most_points: int = 150
    least_turn: float = 0.5
    stiffness: float = 1e-3
    least_pull: float = 1e-6
    long_way: float = 1.5


@dataclass(frozen=True)
class SpectralMatchSettings:
    """The fluctuations of spectra, and the descent to the path that matches them best.

    They are those of `spectral_match`. Tuned with the whole estimate on the set `tune` of
    `bench.py shakes`. `clip` was tuned on 16 photos of it, by how much better the true kernel
    matches than wrong ones do. No record says more.

    Parameters
    ----------
    size : int
        Px of the scale: side of a tile.
    tiles : int
        Largest number of tiles.
    edges : float
        Px of the scale: least length of the edges that count for the choice of tiles.
    floor : float
        Added to the power of the filter, because noise hides low power. A still camera has 1.
    band : (float, float)
        Cycles per pixel of the scale: frequencies that count.
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

    size: int = 128
    tiles: int = 24
    edges: float = 12.0
    floor: float = 0.01
    band: tuple[float, float] = (1 / 56, 0.4)
    smoothing: int = 3
    fluctuation: int = 7
    clip: float = 2.0
    least_power: float = 1e-9
    evenness: tuple[float, ...] = (0.0, 0.5, 1.0)
    first_iterations: int = 6
    iterations: int = 18
    weight_iterations: int = 12
    faint: float = 0.03
    light: float = 1e-4
    bending: float = 1e-3
    along: float = 2.0
    fewest: int = 24
    most: int = 150
