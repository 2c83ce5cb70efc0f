"""The constants of the kernel estimate from a pair (`kernel_estimate`, `pair_pixels`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from deshake.pair.pair_rows import ROW_BLOCK

__all__ = ["SETTINGS", "KernelSettings"]


@dataclass(frozen=True)
class KernelSettings:
    """Thresholds, sizes and weights of the estimate.

    `even_misfit` and `misfit_range` are fitted to simulated pairs (`docs/decisions.md`). For the
    other values no record says what they were tuned on. `bench.py pair` measures all of them
    together.

    Parameters
    ----------
    longest_side : int
        Px: longer side of the finest scale; larger photos are reduced to it.
    fine_side : int
        Px: longer side; every scale up to it is solved.
    smallest_side : int
        Px: least side of the coarsest scale; a small photo has fewer scales.
    coarsest_blur : float
        Px: bound of the blur at the coarsest scale, if the photo is large enough.
    enough_blur : float
        Px: width of the blur; finer scales, where it is wider, are not solved.
    spare : int
        Grid steps beyond the bound, for the error of the registration; a larger error
        touches the cube's faces.
    smoothing_px : float
        Px: sigma of the smoothing before the derivatives.
    pixels, held_out : int
        Pixels that the kernel is fitted to, and further ones that judge it, at most; small
        photos have fewer of both.
    flat : float
        Extra chance of every pixel to be drawn, in mean chances: flat pixels have this
        alone.
    near_px : float
        Px: sigma of the smoothing of the energy of edges, which is the chance.
    clipped : float
        Light: a brighter pixel counts as clipped.
    ignored : float
        Share of a reduced pixel: up to it, clipped or unknown pixels are ignored.
    clear_px : int
        Px, at every scale: pixels this close to clipped ones are not used.
    most_cut_off : float
        Shorter sides: the border that is not used is no wider, however wide the blur.
    brightnesses, fewest : int
        Levels of brightness that compare noise, and least pixels of each; with fewer, the
        simulated noise is used as it is.
    around_px : int
        Px: side of the window that decides whether a pixel is flat.
    least_energy : float
        Mean square of the derivatives: less is an error.
    least_light : float
        Mean light of the noisy photo: less is an error.
    ridge : float
        Ridge of the least squares, in shares of the mean diagonal of G.
    most_change : float
        Factor: at one scale, the photometric factor changes by no more.
    cut : float
        Share of the largest weight: smaller weights do not pass to the next scale.
    most_passed : int
        Weights that pass to the next scale, at most: the largest ones.
    final_cut : float
        Share of the largest weight: smaller weights are removed at the end.
    touching : float
        Share of the weight on the faces of the cube: with more, a note says that the shake may be
        wider.
    still_px : float
        Px at the finest scale: a smaller extent is no shake, and a note says so.
    even_misfit : float
        Share of the edges left unexplained that gives a confidence of 0.5. On simulated
        pairs, right kernels leave up to 0.09, and pairs of two scenes 0.43 to 0.93.
    misfit_range : float
        Scale of the logarithm of that share in the logistic function: a larger one makes
        the confidence change more slowly.

    """

    longest_side: int = 1600
    fine_side: int = 400
    smallest_side: int = 32
    coarsest_blur: float = 6.0
    enough_blur: float = 45.0
    spare: int = 2
    smoothing_px: float = 1.0
    pixels: int = 188 * ROW_BLOCK
    held_out: int = 47 * ROW_BLOCK
    flat: float = 0.1
    near_px: float = 2.0
    clipped: float = 0.98
    ignored: float = 0.01
    clear_px: int = 3
    most_cut_off: float = 0.3
    brightnesses: int = 4
    fewest: int = 400
    around_px: int = 7
    least_energy: float = 1e-10
    least_light: float = 1e-7
    ridge: float = 0.01
    most_change: float = 2.0
    cut: float = 0.03
    most_passed: int = 160
    final_cut: float = 0.02
    touching: float = 0.05
    still_px: float = 2.0
    even_misfit: float = 0.22
    misfit_range: float = 0.25


SETTINGS: Final = KernelSettings()
