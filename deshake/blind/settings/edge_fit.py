"""The constants of the two steps of an estimate: the picture of edges, and the kernel."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["KernelStepSettings", "LatentPictureSettings", "SharpEdgesSettings"]


@dataclass(frozen=True)
class SharpEdgesSettings:
    """The L0 picture and the shock filter (`sharp_edges`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    beta_max : float
        Last weight of the split gradients, no unit.
    growth : float
        Factor of this weight between two steps.
    shock_steps : int
        Iterations of the shock filter.
    shock_time : float
        Px: length dt of a step of the shock filter.
    shock_sigma : float
        Px of the scale: standard deviation of the smoothing in the shock filter.
    shock_floor : float
        Share of the price of an edge pixel: a sharpened gradient whose square is smaller does not
        count.

    """

    beta_max: float = 16.0
    growth: float = 2.83
    shock_steps: int = 2
    shock_time: float = 0.5
    shock_sigma: float = 1.0
    shock_floor: float = 0.25


@dataclass(frozen=True)
class KernelStepSettings:
    """The least squares for the weights of a kernel (`kernel_step`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more. The
    tolerances of the solver (`pivots` to `jitter`) are chosen, not tuned.

    Parameters
    ----------
    ridge : float
        Share of the energy of the edges, for a rotation without roll. It grows with the square of
        the roll.
    texture : float
        Share of the edges' mean square: prior variance of the gradients about the edges.
    misfit : float
        Variance of all that the model does not explain, in variances of the noise.
    least_noise : float
        Contrast of the pyramid: a smaller standard deviation of the noise counts as this.
    island : float
        Share of the kernel's weight: a connected piece with less is noise.
    least_energy : float
        Squared contrast, summed over pixels: every edge has more.
    least_sum : float
        Sum of the weights: below it the edges explain nothing.
    pivots : int
        Steps of the solver, at most; it needs 2 to 7.
    tries : int
        Steps without fewer wrong weights, before they are exchanged one by one.
    slack : float
        Share of the largest correlation: smaller gradients count as zero.
    jitter : float
        Share of the largest diagonal element that is added, so that G is never singular.

    """

    ridge: float = 0.003
    texture: float = 0.3
    misfit: float = 8.0
    least_noise: float = 0.002
    island: float = 0.03
    least_energy: float = 1e-9
    least_sum: float = 1e-6
    pivots: int = 100
    tries: int = 3
    slack: float = 1e-9
    jitter: float = 1e-10


@dataclass(frozen=True)
class LatentPictureSettings:
    """The sharp picture that belongs to a kernel (`latent_picture`).

    `largest` lets it take about a second. For the others no record says what they were tuned on.

    Parameters
    ----------
    largest : float
        Pixels: largest frame of the scale that is used.
    widest : float
        Px of that scale: largest extent of the kernel; a wider one takes a coarser scale.
    price : float
        Squared contrast of the pyramid: price of an edge pixel.

    """

    largest: float = 0.35e6
    widest: float = 41.0
    price: float = 2e-3
