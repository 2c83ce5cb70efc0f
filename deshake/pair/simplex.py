"""Least squares over the simplex: ``min |g - B w|^2, w >= 0, sum w = 1``, Eq. (12).

This is ``min w' G w / 2 - h' w`` with ``G = B' B`` and ``h = B' g``. At the minimum no weight can
gain by taking from another (the Kuhn-Tucker conditions): with the slope ``s = G w - h``,

    s_i >= s_j   for all i and every j whose w_j > 0.

Each move changes two weights, as for support vector machines: the weight of the lowest slope takes
from the weight that reduces the sum most. A move has a closed form, keeps the sum of the weights,
needs two columns of G, and leaves exact zeros (Fan, Chen & Lin, "Working set selection using second
order information for training SVM", JMLR 6, 2005). With too many weights for a whole Gram matrix,
only a working set is solved. It grows by the weights of the lowest slopes until none could gain.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["LeastSquares", "least_eigenvalue", "least_on_simplex", "pairwise_descent"]

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]

WHOLE = 3000
"""Number of weights up to which the whole of G is computed."""

_TOLERANCE = 1e-6  # share of the largest slope: smaller differences of slopes are ignored
_MOST_MOVES = 500  # moves for each weight, at most
_MOST_ROUNDS = 100  # growths of the working set, at most
_LEAST_CURVATURE = 1e-12  # share of G's diagonal
_SAFETY = 1.05  # factor of the least eigenvalue: Lanczos approaches it from above
_LANCZOS_STEPS = 60  # steps at most: with more, the eigenvalue is more exact
_DENSE = 200  # rows: up to it, computing all eigenvalues costs less


class LeastSquares(Protocol):
    """The quadratic ``w' G w / 2 - h' w`` of K weights; parts of G are computed on demand."""

    right: Vector
    """h, (K,)."""

    def gram(self, chosen: Indices) -> Vector:
        """Return the rows and columns of G that are chosen, (n, n)."""

    def slope(self, w: Vector) -> Vector:
        """Return ``G w - h``, (K,)."""


def least_on_simplex(
    problem: LeastSquares, start: ArrayLike, *, ridge: float = 0.0, whole: int = WHOLE
) -> Vector:
    """Minimise ``w' (G + r I) w / 2 - h' w`` over w >= 0, sum w = 1.

    Parameters
    ----------
    problem : LeastSquares
        G and h.
    start : (K,) array
        The first weights, >= 0, of any positive sum.
    ridge : float
        r as a share of G's mean diagonal, >= 0. If G + r I has negative eigenvalues, r is raised
        until it has none.
    whole : int
        Number of weights up to which the whole of G is computed.

    Returns
    -------
    (K,) array of float64
        The minimum. With a working set the eigenvalues are those of its part of G.

    """
    w = np.array(start, np.float64)
    count = len(w)
    working, growth = np.arange(count), max(whole // 3, 1)
    if count > whole:
        likely = np.lexsort((-problem.right, -w))  # among equal weights, the largest h first
        working = np.sort(likely[: max(whole // 2, 1)])
        w[np.setdiff1d(np.arange(count), working)] = 0
    w /= w.sum()
    r = 0.0
    for _ in range(_MOST_ROUNDS):
        gram = problem.gram(working)
        r = max(r, _ridge(gram, ridge))
        gram[np.diag_indices(len(working))] += r
        w[working] = pairwise_descent(gram, problem.right[working], w[working])
        if len(working) == count:
            break
        slope = problem.slope(w) + r * w
        used = np.flatnonzero(w)
        gap = 2 * _TOLERANCE * max(float(np.abs(problem.right).max()), float(np.abs(slope).max()))
        better = np.flatnonzero(slope < float(slope[used].max()) - gap)
        better = better[~np.isin(better, working)]
        if not len(better):
            break
        lowest = better[np.argsort(slope[better], kind="stable")[:growth]]
        working = np.union1d(used, lowest)
    return w


def pairwise_descent(gram: Vector, right: Vector, start: Vector) -> Vector:
    """Minimise ``w' G w / 2 - h' w`` over the simplex, two weights at a time.

    Parameters
    ----------
    gram : (K, K) array
        G, symmetric. If it has negative eigenvalues, the result is a point that no small move of
        two weights improves.
    right : (K,) array
        h.
    start : (K,) array
        Weights >= 0 that sum to 1.

    """
    w = start.copy()
    diagonal = np.diagonal(gram)
    used = np.flatnonzero(w)
    slope = w[used] @ gram[used] - right
    gap = _TOLERANCE * max(float(np.abs(right).max()), float(np.abs(slope).max()))
    least = max(_LEAST_CURVATURE * float(np.abs(diagonal).max()), np.finfo(np.float64).tiny)
    for _ in range(_MOST_MOVES * len(w)):
        i = int(np.argmin(slope))
        fall = slope[used] - slope[i]
        if fall.max() <= gap:
            break
        curvature = diagonal[used] + diagonal[i] - 2 * gram[i, used]
        np.maximum(curvature, least, out=curvature)
        move = np.minimum(fall / curvature, w[used])
        best = int(np.argmax(move * (fall - curvature * move / 2)))
        j, taken = int(used[best]), float(move[best])
        if w[i] == 0:
            used = np.append(used, i)
        w[i] += taken
        w[j] -= taken
        slope += taken * (gram[i] - gram[j])
        if w[j] <= 0:
            w[j] = 0
            used = np.delete(used, best)
    normed: Vector = w / w.sum()
    return normed


def least_eigenvalue(gram: Vector) -> float:
    """Return the least eigenvalue of a symmetric matrix, approached from above (Lanczos)."""
    if len(gram) <= _DENSE:
        return float(np.linalg.eigvalsh(gram)[0])
    v = np.random.default_rng(0).standard_normal(len(gram))
    basis = [v / np.linalg.norm(v)]
    along: list[float] = []
    beside: list[float] = []
    for _ in range(_LANCZOS_STEPS):
        u = np.einsum("kl,l->k", gram, basis[-1])
        along.append(float(u @ basis[-1]))
        known = np.array(basis)
        for _ in range(2):  # rounding spoils the orthogonality of a single pass
            u -= (known @ u) @ known
        length = float(np.linalg.norm(u))
        if length <= np.finfo(np.float64).eps * max(abs(a) for a in along) * len(gram):
            break
        beside.append(length)
        basis.append(u / length)
    off = beside[: len(along) - 1]
    return float(np.linalg.eigvalsh(np.diag(along) + np.diag(off, 1) + np.diag(off, -1))[0])


def _ridge(gram: Vector, share: float) -> float:
    """Return the ridge to add to the diagonal."""
    wanted = share * abs(float(np.diagonal(gram).mean()))
    return max(wanted, -_SAFETY * least_eigenvalue(gram))
