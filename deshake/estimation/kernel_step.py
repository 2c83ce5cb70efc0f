"""The kernel by least squares from edges: ``min |grad g - sum_k w_k W_k grad f|^2``, w >= 0.

Written out, ``min w' G w / 2 - b' w`` with the Gram matrix G and the correlation b of the blurred
gradients with the moved edges. Both are read off patchwise correlations,

    b_k  = sum_p (grad g  corr  win_p grad f)(d_k(p))
    G_kl = sum_p (win_p grad f  corr  grad f)(d_l(p) - d_k(p))

at the cost of a few FFTs, whatever the number of rotations. On a grid ``d_l - d_k`` is taken for
the displacement of ``theta_l - theta_k``, so that G needs one number for each difference of
indices.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from deshake.geometry.rotations import displacements, homographies
from deshake.operators.patch_solve import gather

if TYPE_CHECKING:
    from deshake.operators.patch_solve import PatchFrame
    from deshake.operators.strips import Strip

__all__ = ["NormalEquations", "fitted_weights", "nonnegative", "normal_equations"]

Image = NDArray[np.float32]
Spectrum = NDArray[np.complex64]
Vector = NDArray[np.float64]

_RIDGE = 0.005  # of the energy of the edges
_ISLAND = 0.03  # connected pieces of the kernel with less of its mass are noise
_LEAST_ENERGY = 1e-9  # below that of any edge
_LEAST_SUM = 1e-6  # of the weights, below which the edges explain nothing
_ITERATIONS = 300
_POWER_STEPS = 15
_SMALL_CHANGE = 1e-6


class NormalEquations(NamedTuple):
    """``G`` (K, K), ``b`` (K,) and the energy of the edges, the diagonal of G."""

    gram: Vector
    right: Vector
    energy: float


def normal_equations(
    frame: PatchFrame,
    indices: NDArray[np.int64],
    steps: Vector,
    edges: tuple[Image, Image],
    blurred: tuple[Image, Image],
) -> NormalEquations:
    """Set up the least squares of the kernel.

    Parameters
    ----------
    frame : PatchFrame
        The patches; its room must hold the difference of any two displacements.
    indices : (K, 3) array of int
        The rotations, in grid steps.
    steps : (3,) array
        Grid spacing in radians.
    edges : two (H, W) arrays
        Gradients of the sharp picture, across and down.
    blurred : two (H, W) arrays
        Those of the blurred one, zero where they are not known.

    """
    camera = frame.camera
    moved = homographies(camera, indices * steps)
    lags, place = _index_differences(indices)
    between = homographies(camera, lags * steps)
    count = len(indices)

    def work(strip: Strip) -> Vector:
        auto, cross = _correlations(frame, strip, edges[0], blurred[0])
        more = _correlations(frame, strip, edges[1], blurred[1])
        auto += more[0]
        cross += more[1]
        centres = frame.centres(strip)
        # edges against the photo at -d are the photo against edges at d
        right = gather(frame.irfft(cross), -displacements(moved, centres))
        gram = gather(frame.irfft(auto), displacements(between, centres))
        return np.concatenate([right, gram])

    total = np.zeros(count + len(lags))
    for _, part in frame.each(work):
        total += part
    gram = total[count:][place]
    energy = float(gram[0, 0])
    return NormalEquations((gram + gram.T) / 2, total[:count], energy)


def _correlations(
    frame: PatchFrame, strip: Strip, edges: Image, blurred: Image
) -> tuple[Spectrum, Spectrum]:
    """Spectra of a strip's windowed edges correlated with all edges, and with the photo."""
    windowed = np.conj(frame.rfft(frame.windowed(edges, strip)))
    auto = windowed * frame.rfft(frame.blocks(edges, strip))
    windowed *= frame.rfft(frame.blocks(blurred, strip))
    return auto, windowed


def fitted_weights(
    fit: NormalEquations, indices: NDArray[np.int64], weights: Vector, *, cut: float
) -> Vector:
    """Solve for the weights, and drop what is likely to be noise.

    A ridge keeps them small, and the smaller the farther they roll: a roll moves little of the
    picture, and what it explains is easily chance.

    Parameters
    ----------
    fit : NormalEquations
        The least squares.
    indices : (K, 3) array of int
        The rotations, in grid steps.
    weights : (K,) array
        The weights so far; they are returned where there are no edges to go by.
    cut : float
        Weights below this share of the largest are dropped.

    Returns
    -------
    (K,) array
        Weights that sum to one.

    """
    if not fit.energy > _LEAST_ENERGY:
        return weights
    roll = indices[:, 2] - weights @ indices[:, 2]
    ridge = _RIDGE * (1 + roll**2)
    found = nonnegative(fit.gram / fit.energy + np.diag(ridge), fit.right / fit.energy, weights)
    if not found.sum() > _LEAST_SUM:
        return weights
    kept = _without_islands(indices, np.where(found < cut * found.max(), 0.0, found))
    normed: Vector = kept / kept.sum()
    return normed


def nonnegative(gram: Vector, right: Vector, start: Vector) -> Vector:
    """Minimise ``w' G w / 2 - b' w`` over w >= 0 by accelerated projected gradients.

    Parameters
    ----------
    gram : (K, K) array
        G, symmetric with non-negative eigenvalues.
    right : (K,) array
        b.
    start : (K,) array
        Where to begin.

    """
    v = np.random.default_rng(0).random(len(right))
    bound = 1.0
    for _ in range(_POWER_STEPS):
        v = _times(gram, v)
        bound = float(np.linalg.norm(v))
        if bound == 0:
            return np.zeros_like(right)
        v /= bound
    bound *= 1.02
    w, ahead, momentum = start.copy(), start.copy(), 1.0
    for _ in range(_ITERATIONS):
        new = np.maximum(ahead - (_times(gram, ahead) - right) / bound, 0)
        if np.dot(ahead - new, new - w) > 0:  # it overshot: begin again from here
            momentum, ahead = 1.0, w.copy()
            continue
        change = np.abs(new - w).max()
        grown = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = new + (momentum - 1) / grown * (new - w)
        w, momentum = new, grown
        if change < _SMALL_CHANGE * max(w.max(), 1e-12):
            break
    return w


def _times(gram: Vector, v: Vector) -> Vector:
    """``G v`` on one thread: so small a product loses by more, and its last bits with them."""
    product: Vector = np.einsum("kl,l->k", gram, v)
    return product


def _index_differences(
    indices: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Distinct differences l - k of indices, and where each pair's (k, l) is among them."""
    span = np.ptp(indices, axis=0)
    base = 2 * span + 1
    shifted = indices - indices.min(0)
    code = (shifted[:, 0] * base[1] + shifted[:, 1]) * base[2] + shifted[:, 2]
    zero = (span[0] * base[1] + span[1]) * base[2] + span[2]
    pairs = code[None] - code[:, None] + zero
    present = np.zeros(int(base.prod()), bool)
    present[pairs] = True
    used = np.flatnonzero(present)
    place = (np.cumsum(present) - 1)[pairs]
    first, rest = np.divmod(used, base[1] * base[2])
    lags = np.stack([first, *np.divmod(rest, base[2])], 1) - span
    return lags, place


def _without_islands(indices: NDArray[np.int64], weights: Vector) -> Vector:
    """Drop the connected pieces of the kernel that hold little of its mass."""
    low = indices.min(0)
    box = np.zeros(indices.max(0) - low + 1)
    place = tuple((indices - low).T)
    box[place] = weights
    labels, count = scipy.ndimage.label(box > 0, np.ones((3, 3, 3)))
    mass = np.bincount(labels.ravel(), box.ravel(), count + 1)
    small = mass < _ISLAND * weights.sum()
    if small[1:].all():
        return weights
    return np.where(small[labels[place]], 0.0, weights)
