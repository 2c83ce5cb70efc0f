"""The constants that judge kernels: the judge, the comparison, the agreement, faults, trust."""

from __future__ import annotations

from dataclasses import dataclass

from deshake.blind.settings.choosing_tiles import Budget

__all__ = [
    "AgreementSettings",
    "FocalSearchSettings",
    "JudgeSettings",
    "KernelComparisonSettings",
    "KernelFaultsSettings",
    "RestoredTilesSettings",
    "SpotSettings",
    "TonesSettings",
    "TrustSettings",
]


@dataclass(frozen=True)
class JudgeSettings:
    """The energy of a kernel (`judge`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    lam : float
        Squared contrast of the pyramid: price of an edge pixel, and largest misfit of a pixel.
    beta_max : float
        Last weight of the split gradients, no unit.
    growth : float
        Factor of this weight between two steps. Chosen on 38 shaken photos of the set `tune`, by
        how far the true kernel exceeds the same one turned, shrunk and stretched, and by where a
        search for a path ends: docs/estimation.md.
    live : float
        Share of `lam`: a gradient is an edge if its square exceeds it.
    faint : float
        Share of `lam`: a smaller energy, that of tiles without texture, counts as this.
    room : float
        Room around a tile, in reaches of the widest kernel.
    budget : Budget
        Number of pixels on which kernels are judged.
    batches : Budget
        The same, for all judges of a few tiles each.
    batch : int
        Number of tiles of such a judge.
    noisy : float
        Contrast of the pyramid: standard deviation of the noise from which `lam` is the price of an
        edge for these judges, too. With less noise the price is lower in proportion.
    least_price : float
        Share of `lam`: the lowest such price. Both were found with given kernels of 84 photos, of
        `tune` and of scenes in no set: docs/estimation.md.

    """

    lam: float = 2e-3
    beta_max: float = 64.0
    growth: float = 4.0
    live: float = 1 / 64
    faint: float = 1e-3
    room: float = 1.2
    budget: Budget = Budget(0.12e6, 0.3e6)
    batches: Budget = Budget(1.2e6, 3e6)
    batch: int = 2
    noisy: float = 0.006
    least_price: float = 0.125


@dataclass(frozen=True)
class RestoredTilesSettings:
    """The restored picture of tiles (`restored_tiles`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    least_noise : float
        Contrast of the pyramid: a smaller standard deviation of the noise counts as this.
    power : float
        Exponent of the gradients in the prior.
    prior : float
        Weight of that prior, in variances of the noise.
    penalties : (float, float)
        First and last weight beta of the split gradients, no unit. The weights in between grow
        geometrically.
    stages : int
        Number of these weights.
    fill_at : int
        Index of the weight at which unknown pixels are filled.

    """

    least_noise: float = 0.002
    power: float = 0.8
    prior: float = 0.5
    penalties: tuple[float, float] = (0.01, 0.5)
    stages: int = 7
    fill_at: int = 4


@dataclass(frozen=True)
class KernelComparisonSettings:
    """The score of a kernel (`kernel_comparison`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`. The exception is `widest`:
    the photo X64 of the set `test` led to it. No record says more.

    Parameters
    ----------
    penalty : float
        Margin: penalty of a kernel that cannot be right, larger than any gain.
    width : float
        Px of the scale: largest width of a kernel at the scale where it is judged.
    sharpening_worth : float
        Margin per gain of 1 in -ln nsp.
    match_worth : float
        Margin per correlation of 1 of the spectra.
    search_match_worth : float
        The same, in the search for a path, whose margin is larger where an edge is cheaper.
    scarce : float
        Number of tiles n: in a frame that holds n others, the match counts by 1 / (1 + scarce / n),
        relative to a frame that holds all tiles that are wanted. A smaller frame counts as one that
        holds `fewest_tiles`. Tuned on 16 photos of Levin et al. and X01 of `tune`; no other small
        photo of the set changes.
    coarser : int
        Number of scales: a kernel that is judged so many scales coarser than another is much wider.
        With 1, a photo of Köhler et al. (1_10) got a kernel with a likeness of .83 in place of .94.
    neighbours : int
        Number of finer and of coarser scales whose match counts, too.
    fewest_tiles : int
        Number of tiles: the match of a scale with fewer does not count.
    widest : float
        Share of the frame's shorter side: a kernel with a larger extent cannot be right.
    narrowest : float
        Px of the photo: no path is searched along a kernel of a smaller width.
    confirming : int
        Number of scales: the margin of a path that is searched for counts at a scale that is so
        much finer, too, or at the size of the photo. Chosen on 23 photos of the set `tune` and 11
        of other scenes.
    gain : float
        Margin: the path wins if the sum of three gains is higher: those of its worth in the search,
        of its score, and of its margin at the finer scale.
    vain : float
        Margin: if the best path that the evolution could begin with is worth so much less than the
        kernel, there is no evolution. Both were chosen on 19 photos of `tune`, 16 of them rendered
        through a camera, too.
    turns : tuple of float
        Degrees: turns of a kernel that should explain the photo worse.
    unlike : float
        Difference of one from the agreement of a kernel with the same kernel turned. If it is
        smaller, the lead counts for more in proportion. Of 60 shaken photos, of `tune` and of
        its scenes, it is smaller for five. Chosen on these, on 15 photos of `tune` that are not
        shaken, and on four real ones.
    least_unlike : float
        Share of `unlike`: a smaller difference counts as this.

    """

    penalty: float = 10.0
    width: float = 28.0
    sharpening_worth: float = 0.15
    match_worth: float = 0.7
    search_match_worth: float = 0.5
    scarce: float = 15.0
    coarser: int = 2
    neighbours: int = 3
    fewest_tiles: int = 3
    widest: float = 0.25
    narrowest: float = 8.0
    confirming: int = 2
    gain: float = 0.003
    vain: float = 0.02
    turns: tuple[float, ...] = (60.0, 90.0, 120.0)
    unlike: float = 0.2
    least_unlike: float = 0.1


@dataclass(frozen=True)
class TonesSettings:
    """The choice of the tones (`tones`).

    That between linear light and display values was found with 24 photos of Köhler et al., whose
    values are linear, and with 43 of the set `tune` of `bench.py shakes`. That of the light before
    a camera's tone curve was found with the same 43, and with 12 of them rendered through a camera:
    docs/estimation.md.

    Parameters
    ----------
    of_margin, of_variation : float
        Correlation of the spectra that a margin of 1, and a variation that is smaller by the factor
        e, are worth.
    least_gain : float
        Correlation: least gain that shows that display values are right.
    least_score : float
        Margin: if the score falls by more than this, it contradicts them.
    of_margins : float
        Correlation that the sum of both margins is worth in the choice of the light before a
        camera's tone curve.
    least_before : float
        Correlation: least gain that shows such a curve.
    certain_curve : float
        Correlation: least gain, or loss, from the whole curve that ends the race's doubt of it.
        Chosen on 20 photos of `tune` and 20 that were rendered through a camera.

    """

    of_margin: float = 0.25
    of_variation: float = 0.3
    least_gain: float = 0.015
    least_score: float = -0.02
    of_margins: float = 0.2
    least_before: float = 0.006
    certain_curve: float = 0.004


@dataclass(frozen=True)
class AgreementSettings:
    """The likeness of two kernels (`agreement`). No record says what they were tuned on.

    Parameters
    ----------
    smoothing : float
        Standard deviation of the smoothing, as a share of the narrower kernel's spread.
    least_smoothing : float
        Px of the photo: the same, at least.
    most_unlike : float
        Ratio of the two spreads: below it the agreement is zero.
    drawn_sigma : float
        Px of the drawn filter: standard deviation of the smoothing there, at most.

    """

    smoothing: float = 0.3
    least_smoothing: float = 0.7
    most_unlike: float = 0.2
    drawn_sigma: float = 1.5


@dataclass(frozen=True)
class SpotSettings:
    """The small round spot of a soft lens (`spot`).

    Tuned on simulated photos: sharp and soft ones give spots of 0 to 1.3 px. Of 43 shakes of 3 px
    and more, none gives a spot from both finest starts.

    Parameters
    ----------
    small : float
        Px of the photo: largest standard deviation along the longer axis.
    roundness : float
        Least ratio of the shorter axis to the longer one.
    faint : float
        Share of the kernel's weight that does not count.
    point : float
        Px of the photo: a kernel this small is a point, whatever its shape.

    """

    small: float = 1.3
    roundness: float = 0.6
    faint: float = 0.2
    point: float = 0.7


@dataclass(frozen=True)
class KernelFaultsSettings:
    """The faults that a kernel itself shows (`kernel_faults`).

    No record says what they were tuned on. `most_cells` bounds the memory.

    Parameters
    ----------
    point : float
        Share of the weight within a step of the heaviest rotation: a point has more.
    outside : float
        Share of the weight beyond the bound: with more the bound is too small.
    widest : float
        Share of the shorter side: the bound if none is given.
    path : float
        Least share of the weight in the largest connected part of a path.
    disk : float
        Share of the cells of an even disk: disks take 0.79 to 0.98, paths 0.56.
    least_disk : float
        Grid steps, standard deviation: a smaller kernel is a point.
    most_cells : int
        Cells of the grid that holds all rotations, at most.

    """

    point: float = 0.9
    outside: float = 0.02
    widest: float = 0.3
    path: float = 0.7
    disk: float = 0.7
    least_disk: float = 0.65
    most_cells: int = 1 << 24


@dataclass(frozen=True)
class FocalSearchSettings:
    """The focal length that suits the spectra (`focal_search`).

    Chosen, not tuned. On 12 photos of the set `tune` of `bench.py shakes`, of 28 and 35 mm, the
    search ends between 25 and 35 mm.

    Parameters
    ----------
    shortest, longest : float
        Diagonals of the frame: 0.55 is 24 mm on 35 mm film, 3.5 is 150 mm. Beyond, the blur is
        nearly the same in all of the frame.
    steps : int
        Focal lengths to each doubling.

    """

    shortest: float = 0.55
    longest: float = 3.5
    steps: int = 6


@dataclass(frozen=True)
class TrustSettings:
    """The confidence (`trust`).

    The terms come from a logistic regression on results for 42 photos of the set `tune` of
    `bench.py shakes`, of which sixteen were not shaken. The constant term is 0.5 below that of the
    regression, because a wrong kernel harms a sharp photo more than a right kernel improves a
    shaken photo. A sharp photo, or one from a soft lens, can give a kernel with a high margin and
    agreement by chance. The spectra of such a photo do not match the kernel. A later change made
    the matches of right kernels about a tenth smaller. The constants stay: larger ones let a sharp
    page of text become worse.

    Parameters
    ----------
    constant : float
        Log odds: the constant term.
    of_margin : float
        Log odds per unit of margin.
    least_margin, most_margin : float
        Margin: values beyond count as these.
    of_agreement : float
        Log odds per power of ten by which the agreement comes nearer to one.
    closest : float
        Agreement: added to the difference from one, so that the logarithm stays finite.
    of_match : float
        Log odds per correlation of 1 of the spectra.
    most_match : float
        Correlation: a higher one counts as this, and a negative one as none.
    of_lead : float
        Log odds per unit by which the lead of a kernel over the same kernel turned exceeds
        `usual_lead`.
    usual_lead : float
        Lead, a difference of margins: of 29 photos that are not shaken, 27 have less; of 64 that
        are, and whose kernels are right, one does, and its shake is 3 px wide.
    least_of_lead, most_of_lead : float
        Log odds by the lead, at least and at most.
    drawn : float
        Log odds of a path that explains the streaks of lights perfectly.
    of_misfit : float
        Log odds per unit of its misfit. Chosen for a confidence of 0.8 at the largest misfit.

    """

    constant: float = -4.9
    of_margin: float = 15.0
    least_margin: float = -0.04
    most_margin: float = 0.12
    of_agreement: float = 1.7
    closest: float = 0.005
    of_match: float = 17.0
    most_match: float = 0.4
    of_lead: float = 60.0
    usual_lead: float = 0.075
    least_of_lead: float = -5.0
    most_of_lead: float = 0.7
    drawn: float = 4.5
    of_misfit: float = 10.0
