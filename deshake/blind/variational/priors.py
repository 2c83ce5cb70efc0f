"""Priors of the variational estimator: mixtures for image gradients and for kernel weights.

The gradient mixtures are those that Fergus, Singh, Hertzmann, Roweis & Freeman ("Removing camera
shake from a single photograph", SIGGRAPH 2006) learnt on a street scene, as their published code
lists them; Whyte et al. (Sec. 5) use the same. They hold for differences of neighbouring pixels
of linear intensity on 0..256, taken at full resolution and then resized.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "INTENSITY_RANGE",
    "KERNEL_PRIOR",
    "ROLL_RATE",
    "ExponentialMixture",
    "GaussianMixture",
    "gradients",
]

INTENSITY_RANGE = 256.0
"""White, in the units of the gradient mixtures."""


@dataclass(frozen=True, eq=False)
class GaussianMixture:
    """Zero-mean mixture: ``p(f) = sum_a pi_a N(f; 0, 1/gamma_a)``.

    Parameters
    ----------
    pi : (A,) array
        Shares, summing to 1.
    gamma : (A,) array
        Precisions, one over squared intensity.

    """

    pi: NDArray[np.float64]
    gamma: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ExponentialMixture:
    """Mixture on weights >= 0: ``p(w) = sum_d rho_d r_d exp(-r_d w)``.

    Parameters
    ----------
    rho : (D,) array
        Shares, summing to 1; estimated for each photo.
    rate : (D,) array
        Rates r_d.

    """

    rho: NDArray[np.float64]
    rate: NDArray[np.float64]


def _mixture(pi: tuple[float, ...], gamma: tuple[float, ...]) -> GaussianMixture:
    shares = np.array(pi)
    return GaussianMixture(shares / shares.sum(), np.array(gamma))


_GRADIENTS = (
    _mixture(
        (0.34243403, 0.40767651, 0.07812420, 0.17176525),
        (2.98020011e-1, 3.05733352, 1.44912314e-3, 1.70459273e-2),
    ),
    _mixture(
        (0.31907050, 0.09596426, 0.38799399, 0.19697125),
        (6.35312431e-1, 2.87427402e-3, 5.95692820, 3.57494283e-2),
    ),
    _mixture(
        (0.09976788, 0.35482575, 0.21415239, 0.33125398),
        (4.14789513e-3, 9.91287419, 5.23568148e-2, 1.07603673),
    ),
    _mixture(
        (0.08064577, 0.35310875, 0.33509045, 0.23115502),
        (5.04546957e-3, 16.5471291, 1.51145346, 6.03056842e-2),
    ),
    _mixture(
        (0.38376693, 0.25498623, 0.05017783, 0.31106902),
        (2.19689834, 6.29588203e-2, 4.33833850e-3, 31.4507221),
    ),
    _mixture(
        (0.23615795, 0.02410008, 0.38895609, 0.35078588),
        (4.94504495e-2, 2.40052239e-3, 27.7726782, 1.38182544),
    ),
    _mixture(
        (0.37508366, 0.22785640, 0.39073379, 0.00632616),
        (30.8742386, 3.42210383e-2, 1.36763960, 6.61534246e-4),
    ),
    _mixture(
        (0.36546850, 0.44443631, 0.00382081, 0.18627437),
        (6.65507621e-1, 21.1466698, 3.19313729e-4, 2.31605042e-2),
    ),
)

_COUNTS = np.array([787.8988, 201.7349, 236.1948, 143.1756])

KERNEL_PRIOR = ExponentialMixture(
    _COUNTS / _COUNTS.sum(), np.array([5114.3, 5006.4, 173.8885, 50.6538])
)
"""Prior of the kernel's weights: rates of the published code, shares to start from."""


ROLL_RATE = 0.02
"""Rate of the prior on turns about the optical axis, in nats per gradient and grid step.

Hands turn a camera less about Z than about X and Y, and a roll leaves no trace in the middle of
the frame: without this prior the kernel spreads along theta_Z wherever the photo is flat at its
borders. A true roll of tens of pixels outweighs it.
"""


def gradients(level: int) -> GaussianMixture:
    """Return the prior of the gradients at a scale: 0 is the finest, one more a factor sqrt(2)."""
    return _GRADIENTS[min(level, len(_GRADIENTS) - 1)]
