"""The kernel by least squares from edges: ``min |grad g - sum_k w_k W_k grad f|^2``, w >= 0.

This is ``min w' G w / 2 - b' w``. G is the Gram matrix, and b is the correlation of the blurred
gradients with the moved edges. Both are samples of correlations of the tiles,

    b_k  = sum_t (grad g  corr  win_t grad f)(d_k(c_t))
    G_kl = sum_t (win_t grad f  corr  grad f)(d_l(c_t) - d_k(c_t))

On a grid ``d_l - d_k`` is nearly the displacement by ``theta_l - theta_k``. With this approximation
G needs one number for each difference of indices.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import scipy.linalg
import scipy.ndimage
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.blind.trimming import without_light
from deshake.geometry.rotations import displacements, homographies
from deshake.operators.bilinear import gathering_matrix
from deshake.operators.positive_definite import solved

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from deshake.blind.tiles import Tiles

__all__ = ["NormalEquations", "RotationGrid", "fitted_weights", "nonnegative"]

Image = NDArray[np.float32]
Vector = NDArray[np.float64]

_S: Final = SETTINGS.kernel_step


class NormalEquations(NamedTuple):
    """``G`` (K, K), ``b`` (K,) and the energy of the edges, the diagonal of G."""

    gram: Vector
    right: Vector
    energy: float


class RotationGrid:
    """Rotations on a grid, and the displacements of the tiles' centres by each rotation.

    Parameters
    ----------
    tiles : Tiles
        The tiles. Their room holds the displacement of every rotation.
    indices : (K, 3) array of int
        The rotations, in grid steps.
    steps : (3,) array
        Grid spacing in radians.

    """

    def __init__(self, tiles: Tiles, indices: NDArray[np.int64], steps: Vector) -> None:
        self.tiles = tiles
        self.indices = indices
        lags, self._place = _index_differences(indices)
        # the correlation of edges with the photo at -d is that of the photo with edges at d
        self._right = _gatherer(tiles, indices * steps, -1)
        self._gram = _gatherer(tiles, lags * steps, 1)

    def equations(self, edges: tuple[Image, Image], noise: float | None = None) -> NormalEquations:
        """Set up the least squares for the kernel, summed over all tiles.

        Parameters
        ----------
        edges : two (P, N, N) arrays
            Gradients of the sharp picture, across and down.
        noise : float, optional
            Standard deviation of the photo's noise. With it the edges are the mean of the true
            gradients, which have a posterior variance. Without it the edges are exact.

        """
        cross, auto = np.empty_like(self.tiles.g), np.empty_like(self.tiles.g)
        for part, tiles in self.tiles.groups(for_kernel=True):
            own = edges[0][part], edges[1][part]
            cross[part], auto[part] = _correlations(tiles, own, noise)
        right: Image = self._right.dot(cross.ravel())
        lagged: Image = self._gram.dot(auto.ravel())
        gram = lagged.astype(np.float64)[self._place]
        energy = float(gram[0, 0])
        gram += gram.T
        gram /= 2
        return NormalEquations(gram, right.astype(np.float64), energy)


def _correlations(
    tiles: Tiles, edges: tuple[Image, Image], noise: float | None
) -> tuple[Image, Image]:
    """Correlate edges with the gradients of the photo, and with themselves: both (P, N, N)."""
    transforms = tiles.transforms
    cross, auto = np.zeros_like(tiles.gradients[0]), np.zeros_like(tiles.gradients[0])
    for edge, gradient in zip(edges, tiles.gradients, strict=True):
        middle = transforms.rfft(edge * tiles.middle)
        seen, own = gradient.copy(), transforms.rfft(edge * tiles.around)
        transforms.multiply(seen, middle, conjugate=True)
        transforms.multiply(own, middle, conjugate=True)
        cross += seen
        auto += own
    if noise is not None:
        transforms.add(auto, _posterior(tiles, edges, noise))
    return tiles.irfft(cross), tiles.irfft(auto)


def _posterior(tiles: Tiles, edges: tuple[Image, Image], noise: float) -> Image:
    """Return the posterior variance of the gradients, as weights of frequencies (P, N, M).

    The prior of the texture is white. At the zeros of the filter the photo says nothing, so
    the posterior variance is that of the prior. Without this term the least squares treat the
    gradients there as known to be zero, and kernels drift towards a point.
    """
    pixels = tiles.middle.sum((1, 2))[:, None, None]
    energy = sum((edge**2 * tiles.middle).sum((1, 2)) for edge in edges)[:, None, None]
    texture = _S.texture * energy / (2 * pixels)
    error = 2 * _S.misfit * max(noise, _S.least_noise) ** 2
    variance: Image = 2 * pixels * texture * error / (texture * tiles.power + error)
    return variance.astype(np.float32)


def _gatherer(tiles: Tiles, theta: Vector, sign: int) -> csr_array:
    """Return the matrix that samples correlations (P, N, N) at displacements and sums them."""
    moved = sign * displacements(homographies(tiles.camera, theta), tiles.centres)
    return gathering_matrix(moved, (tiles.block, tiles.block))


def fitted_weights(
    fit: NormalEquations,
    indices: NDArray[np.int64],
    weights: Vector,
    *,
    cut: float,
) -> Vector:
    """Solve for the weights, and discard those that are likely to be noise.

    A ridge keeps the weights small. It grows with the roll of a rotation: a roll moves little of
    the picture, so chance easily explains as much as a roll does.

    Parameters
    ----------
    fit : NormalEquations
        The least squares.
    indices : (K, 3) array of int
        The rotations, in grid steps.
    weights : (K,) array
        The current weights. They are returned unchanged if there are no edges.
    cut : float
        The smallest weights that together hold less than this share are discarded.

    Returns
    -------
    (K,) array
        Weights that sum to one.

    """
    if not fit.energy > _S.least_energy:
        return weights
    roll = indices[:, 2] - weights @ indices[:, 2]
    ridge = _S.ridge * (1 + roll**2)
    gram = fit.gram / fit.energy
    _add_to_diagonal(gram, ridge)
    solution = nonnegative(gram, fit.right / fit.energy, weights)
    if not solution.sum() > _S.least_sum:
        return weights
    kept = _without_islands(indices, without_light(solution, cut))
    normed: Vector = kept / kept.sum()
    return normed


def nonnegative(gram: Vector, right: Vector, start: Vector) -> Vector:
    """Minimise ``w' G w / 2 - b' w`` over w >= 0 by block principal pivoting.

    Each step solves for the free weights as if they had no bound. Then it sets negative weights to
    zero, and frees those zero weights that would lower the value (Kim & Park, SIAM J. Sci. Comput.
    2011). The least free set that is right ends the search.

    Parameters
    ----------
    gram : (K, K) array
        G, symmetric. Its eigenvalues are not negative, but for the errors of an approximation; if
        one is, the diagonal grows until none is. It is unchanged at the end.
    right : (K,) array
        b.
    start : (K,) array
        Weights near the solution. Only which of them are positive matters.

    """
    diagonal = gram.diagonal().copy()
    if not diagonal.max() > 0:
        return np.zeros_like(right)
    shift = _S.jitter * diagonal.max()
    try:  # in place: G is the largest array of an estimate
        _add_to_diagonal(gram, shift)
        return _pivoted(gram, right, start > 0)
    except scipy.linalg.LinAlgError:
        np.fill_diagonal(gram, diagonal)
        least = scipy.linalg.eigvalsh(gram, subset_by_index=(0, 0))[0]
        _add_to_diagonal(gram, shift - min(2 * least, 0))
        return _pivoted(gram, right, start > 0)
    finally:
        np.fill_diagonal(gram, diagonal)


def _add_to_diagonal(gram: Vector, shift: Vector | float) -> None:
    """Add numbers to the diagonal of G, in place; one number shifts all of its eigenvalues."""
    gram.flat[:: len(gram) + 1] += shift


def _pivoted(gram: Vector, right: Vector, free: NDArray[np.bool_]) -> Vector:
    """Return the minimum for a positive definite G; `free` are the first free weights."""
    slack = _S.slack * np.abs(right).max()
    fewest, tries = len(right) + 1, 0
    for _ in range(_S.pivots):
        w, gradient = _unbounded(gram, right, free)
        wrong = np.where(free, w < 0, gradient < -slack)
        count = int(wrong.sum())
        if count < fewest:
            fewest, tries = count, _S.tries
        else:
            tries -= 1
        if count == 0:
            break
        if tries < 0:  # the steps go in a circle: exchange one weight alone
            wrong[: np.flatnonzero(wrong)[-1]] = False
        free = free ^ wrong
    return np.maximum(w, 0)


def _unbounded(gram: Vector, right: Vector, free: NDArray[np.bool_]) -> tuple[Vector, Vector]:
    """Return the best free weights without a bound, the others zero, and the gradient there."""
    used = np.flatnonzero(free)
    w = np.zeros_like(right)
    if len(used):
        w[used] = solved(gram.take(used, 0).take(used, 1), right[used])
    return w, gram @ w - right


def _index_differences(
    indices: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the distinct differences l - k of indices, and the place of each pair (k, l) there."""
    span = np.ptp(indices, axis=0)
    base = 2 * span + 1
    shifted = indices - indices.min(0)
    code = (shifted[:, 0] * base[1] + shifted[:, 1]) * base[2] + shifted[:, 2]
    zero = (span[0] * base[1] + span[1]) * base[2] + span[2]
    pairs = code[None] - code[:, None] + zero
    present = np.zeros(int(base.prod()), bool)
    present[pairs] = True
    used = np.flatnonzero(present)
    place = (np.cumsum(present) - 1).astype(np.int32)[pairs]
    first, rest = np.divmod(used, base[1] * base[2])
    lags = np.stack([first, *np.divmod(rest, base[2])], 1) - span
    return lags, place


def _without_islands(indices: NDArray[np.int64], weights: Vector) -> Vector:
    """Discard the connected pieces of the kernel that hold little of its weight."""
    low = indices.min(0)
    box = np.zeros(indices.max(0) - low + 1)
    place = tuple((indices - low).T)
    box[place] = weights
    labels, count = scipy.ndimage.label(box > 0, np.ones((3, 3, 3)))
    mass = np.bincount(labels.ravel(), box.ravel(), count + 1)
    small = mass < _S.island * weights.sum()
    if small[1:].all():
        return weights
    return np.where(small[labels[place]], 0.0, weights)
