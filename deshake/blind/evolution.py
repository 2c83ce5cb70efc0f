"""The evolution of a place to where an objective that is rough is lower.

The gradient of a rough objective misleads. So random places around the present one are compared,
and it moves to a weighted mean of the best. The steps become longer while successive ones agree in
their direction, and shorter otherwise: cumulative step-size adaptation [1], with the weights and
rates of [2]. Each generation may have an objective of its own, for example a measure on a few of
many data. What all data favour adds up, and what a few of them favour does not.

References
----------
.. [1] N. Hansen and A. Ostermeier, "Completely derandomized self-adaptation in evolution
   strategies", Evolutionary Computation 9, 2001.
.. [2] N. Hansen, "The CMA evolution strategy: a tutorial", arXiv:1604.00772.

"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from deshake.operators.strips import reported

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.run import Run

__all__ = ["evolved"]

Vector = NDArray[np.float64]

_SEED: Final = 0


def evolved(
    objectives: Callable[[int, Vector], Callable[[Vector], float]],
    widths: Vector,
    evaluations: int,
    run: Run,
) -> Vector:
    """Move from 0 to where objectives are lower.

    Parameters
    ----------
    objectives : callable
        Returns the objective of a generation, from its number and the mean (n,) of its places. The
        objective is a callable of a place (n,), which threads call.
    widths : (n,) array
        Standard deviation of the first random places, > 0.
    evaluations : int
        Values to compute, about; only whole generations are computed, one at least.
    run : Run
        Threads to use, which do not change the result, and who receives the progress.

    Returns
    -------
    (n,) array
        The mean of the last generation's best places.

    """
    n = len(widths)
    size = 4 + int(3 * np.log(n))
    parents = size // 2
    shares = np.log((size + 1) / 2) - np.log(np.arange(1, parents + 1))
    shares /= shares.sum()
    selected = 1 / np.square(shares).sum()
    rate = (selected + 2) / (n + selected + 5)
    damping = 1 + rate + 2 * max(0.0, ((selected - 1) / (n + 1)) ** 0.5 - 1)
    usual = n**0.5 * (1 - 1 / (4 * n) + 1 / (21 * n**2))  # mean length of a normal vector
    random = np.random.default_rng(_SEED)
    mean, trail, step = np.zeros(n), np.zeros(n), 1.0
    for number, part in enumerate(run.parts([1] * max(evaluations // size, 1))):
        objective = objectives(number, mean)
        drawn = random.standard_normal((size, n))
        places = list(mean + step * drawn * widths)
        values = [value for _, value in reported(objective, places, part, "search of the path")]
        best = drawn[np.argsort(values, kind="stable")[:parents]]
        moved = shares @ best
        mean = mean + step * moved * widths
        trail = (1 - rate) * trail + (rate * (2 - rate) * selected) ** 0.5 * moved
        step *= float(np.exp(rate / damping * (np.linalg.norm(trail) / usual - 1)))
    return mean
