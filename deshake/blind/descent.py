"""The descent from a start to a minimum near it, with the exact gradient."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

__all__ = ["descent"]

Vector = NDArray[np.float64]


def descent(
    objective: Callable[[Vector], tuple[float, Vector]],
    start: Vector,
    iterations: int,
    bounds: Sequence[tuple[float, float]] | None = None,
) -> tuple[float, Vector]:
    """Descend by L-BFGS.

    Parameters
    ----------
    objective : callable
        The value at a place (n,), and its gradient (n,).
    start : array
        The place to begin with; the objective receives it flattened.
    iterations : int
        Most iterations.
    bounds : sequence of (float, float), optional
        Least and largest value of each coordinate.

    Returns
    -------
    value : float
        Value of the end.
    end : array
        The end, in the shape of the start.

    """
    from scipy.optimize import minimize  # noqa: PLC0415 - slow to import, and only estimates need it

    end = minimize(
        objective,
        start.ravel(),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": iterations},
    )
    return float(end.fun), np.asarray(end.x, np.float64).reshape(start.shape)
