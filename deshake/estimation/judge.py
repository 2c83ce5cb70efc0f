"""A judge between kernels: the better explains the photo by a simpler sharp picture.

Two measures, both smaller for better kernels. The energy of the L0 picture,

    E = mean min((A S - g)^2, lam) + lam #{grad S != 0} / N

weighs how well a kernel explains the photo against how many edges it needs for that; a kernel too
wide or too small needs more of them. The misfit of a pixel counts up to a bound, since lights and
tone curves are beyond what any kernel explains. The normalised sparsity ``|grad f|_1 / |grad f|_2``
of the restored picture (Krishnan, Tay & Fergus, CVPR 2011), against the photo's own, rises with
ringing and falls with sharpness. Both are compared with what they are without any shake: the margin
is the gain in ``ln E + 0.6 ln nsp``. Energies that get worse count little: fine texture makes the
true kernel's so, while wrong kernels are told by their ringing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deshake.estimation.latent_edges import (
    Observation,
    contrast_scaled,
    differences,
    l0_picture,
    noise_level,
)
from deshake.operators.filter_flow import reach
from deshake.operators.patch_solve import PatchFrame, PatchSolver, patch_size

if TYPE_CHECKING:
    from deshake.geometry.kernel import RotationKernel

__all__ = ["Score", "confidence", "margin", "score"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_LAM = 2e-3
_BETA_MAX = 64.0
_LIVE = 1 / 64  # gradients whose square is above this share of lam are counted as edges
_SPARSITY_WEIGHT = 0.6
_MOST_LOSS = 0.05  # of energy
_BORDER = 12  # px left out on every side
_LEAST_NOISE = 0.002
_LIT = 0.1  # of the mean light: what is darker, a night sky, shows no noise
_POWER = 0.8  # of the gradients, in the restored picture's prior
_PRIOR = 0.5
_PENALTIES = tuple(float(beta) for beta in np.geomspace(0.01, 0.5, 7))
_FILL_AT = 4  # penalties in, when what is not known is filled in
_EVEN = 0.04  # margin at which the confidence is a half
_SLOPE = 0.015  # of the confidence


class Score(NamedTuple):
    """What the judge measured; of both, smaller is better.

    Parameters
    ----------
    energy : float
        ``ln E`` of the L0 picture.
    sparsity : float
        ``ln nsp`` of the restored picture.

    """

    energy: float
    sparsity: float


def score(
    grey: Image,
    kernel: RotationKernel,
    *,
    usable: Mask | None = None,
    threads: int | None = None,
) -> Score:
    """Score a kernel on the photo it is to explain; the smaller the better.

    Scores of one photo can be compared, also with that of the kernel that stands still; those of
    different photos cannot.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, 400 px or so.
    kernel : RotationKernel
        A kernel for this size of the photo.
    usable : (h, w) array of bool, optional
        Pixels to be believed; by default all.
    threads : int, optional
        Threads to use; by default all processors. The result does not depend on it.

    Raises
    ------
    EstimationError
        If the photo is flat.

    """
    picture, _ = contrast_scaled(grey)
    trial = _Trial(picture, kernel, usable, threads)
    return Score(float(np.log(trial.energy())), float(np.log(trial.sparsity())))


def margin(found: Score, still: Score) -> float:
    """How much better a kernel is than no shake at all, by the scores of both."""
    energy = max(still.energy - found.energy, -_MOST_LOSS)
    return energy + _SPARSITY_WEIGHT * (still.sparsity - found.sparsity)


def confidence(found: Score, still: Score) -> float:
    """Chance that a kernel makes the photo better, by its score and that of no shake at all.

    The logistic function of the margin, one half at 0.04 and 0.88 at 0.07. Fitted to kernels of
    simulated shakes, whose gain was known, to wrong kernels, and to real photos, where the eye was
    the judge.
    """
    excess = (margin(found, still) - _EVEN) / _SLOPE
    return float(1 / (1 + np.exp(-np.clip(excess, -50, 50))))


class _Trial:
    """A kernel on trial."""

    def __init__(
        self, picture: Image, kernel: RotationKernel, usable: Mask | None, threads: int | None
    ) -> None:
        camera = kernel.camera
        used = kernel.weights > 0
        theta, weights = kernel.theta[used], kernel.weights[used]
        far = reach(camera, theta)
        patch = patch_size(camera, theta)
        margin = max(2 * far, 8)
        frame = PatchFrame(camera, margin=margin, room=far + 4, patch=patch, threads=threads)
        self.solver = PatchSolver(frame, theta, weights)
        self.seen = Observation.of(picture, margin, usable)
        border = margin + min(_BORDER, (min(camera.shape) - 1) // 2)
        self.counted = np.zeros(self.seen.known.shape, bool)
        self.counted[border:-border, border:-border] = True
        self.counted &= self.seen.known
        if not self.counted.any():
            self.counted = self.seen.known

    def energy(self) -> float:
        """E of the L0 picture, borders and clipped pixels filled in on the way."""
        filled, blurred, picture = self.seen.picture, self.seen.picture, self.seen.picture
        for lam in (2 * _LAM, 2 * _LAM, _LAM):
            picture, _, _ = l0_picture(self.solver, filled, lam, beta_max=_BETA_MAX)
            blurred = self.solver.forward(picture)
            filled = self.seen.filled(blurred)
        across, down = differences(picture)
        live = across**2 + down**2 > _LAM * _LIVE
        misfit = (blurred - self.seen.picture)[self.counted].astype(np.float64)
        misfit = np.minimum(misfit**2, _LAM)
        return float(misfit.mean() + _LAM * live[self.counted].mean())

    def sparsity(self) -> float:
        """Normalised sparsity of the restored picture, in that of the photo."""
        return self._ratio(self._restored()) / self._ratio(self.seen.picture)

    def _restored(self) -> Image:
        """Restore under a sparse prior of gradients, ``sum |grad f|^0.8``, borders filled in."""
        g = self.seen.picture
        noise = max(2 * self._noise(), _LEAST_NOISE)
        length = np.hypot(*differences(g))[self.counted]
        price = _PRIOR * noise**2 / (_POWER * float((length**_POWER).mean()))
        picture = g
        data = self.solver.data(g)
        for stage, beta in enumerate(_PENALTIES):
            if stage == _FILL_AT:
                data = self.solver.data(self.seen.filled(self.solver.forward(picture)))
            across, down = differences(picture)
            share = _shrunk(np.hypot(across, down), price / beta)
            picture = self.solver.solve(data, across * share, down * share, beta)
        return picture

    def _noise(self) -> float:
        """Standard deviation of the noise where there is light."""
        picture = self.seen.picture
        lit = self.counted & (picture > _LIT * float(picture[self.counted].mean()))
        return noise_level(picture, lit if lit.any() else self.counted)

    def _ratio(self, image: Image) -> float:
        length = np.hypot(*differences(image))[self.counted].astype(np.float64)
        return float(length.mean() / np.sqrt((length**2).mean()))


def _shrunk(length: Image, step: float) -> Image:
    """Share of gradients of a length that is left by the prox of ``step |v|^p``."""
    threshold = (2 * step * (1 - _POWER)) ** (1 / (2 - _POWER))
    threshold += step * _POWER * (2 * step * (1 - _POWER)) ** ((_POWER - 1) / (2 - _POWER))
    left: Image = length
    for _ in range(3):
        slope: Image = np.maximum(left, np.float32(1e-8)) ** np.float32(_POWER - 1)
        left = length - np.float32(step * _POWER) * slope
    share: Image = np.where(
        length > threshold, np.maximum(left, 0) / np.maximum(length, 1e-12), 0
    ).astype(np.float32)
    return share
