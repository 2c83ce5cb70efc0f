"""A judge between kernels: the better explains the photo by a simpler sharp picture.

Two measures, both smaller for better kernels. The energy of the L0 picture,

    E = mean min((A S - g)^2, lam) + lam #{grad S != 0} / N

weighs how well a kernel explains the photo against how many edges it needs for that: a kernel too
wide or too small needs more of them. The misfit of a pixel counts up to a bound, since lights and
tone curves are beyond what any kernel explains. The normalised sparsity ``|grad f|_1 / |grad f|_2``
of the restored picture (Krishnan, Tay & Fergus, CVPR 2011), against the photo's own, rises with
ringing and falls with sharpness. Both are compared with what they are without any shake: the margin
is the gain in ``ln E + 0.6 ln nsp``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deshake.blind.sharp_edges import l0_picture
from deshake.blind.tile_plan import Budget, planned_tiles
from deshake.blind.tiles import Tiles, reach
from deshake.geometry.kernel import RotationKernel
from deshake.signal.gradients import differences
from deshake.signal.noise import noise_level

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.signal.pyramid import Pyramid

__all__ = ["Judge", "Score"]

Image = NDArray[np.float32]

_LAM = 2e-3
_BETA_MAX = 64.0
_LIVE = 1 / 64  # gradients whose square is above this share of lam are counted as edges
_SPARSITY_WEIGHT = 0.6
_MOST_LOSS = 0.05  # of energy
_LEAST_NOISE = 0.002
_POWER = 0.8  # of the gradients, in the restored picture's prior
_PRIOR = 0.5
_PENALTIES = tuple(float(beta) for beta in np.geomspace(0.01, 0.5, 7))
_FILL_AT = 4  # penalties in, when what is not known is filled in
_ROOM = 1.2  # times the reach of the widest kernel
_BUDGET = Budget(0.12e6, 0.3e6)


class Score(NamedTuple):
    """What the judge measures; of both, smaller is better.

    Parameters
    ----------
    energy : float
        ``ln E`` of the L0 picture.
    sparsity : float
        ``ln nsp`` of the restored picture.

    """

    energy: float
    sparsity: float


class Judge:
    """Tiles that kernels are compared on.

    Parameters
    ----------
    tiles : Tiles
        Tiles of one scale, best none that the kernels were fitted to.

    """

    def __init__(self, tiles: Tiles) -> None:
        self.tiles = tiles
        self.counted = tiles.inside
        self.noise = noise_level(tiles.g.reshape(-1, tiles.block))
        self.still = self.score(RotationKernel.delta(tiles.camera))

    @classmethod
    def of(cls, pyramid: Pyramid, level: int, kernels: Sequence[RotationKernel]) -> Judge:
        """Make a judge with room for kernels, on tiles that are kept apart."""
        camera = pyramid.at(level).camera
        widest = max((kernel.for_camera(camera) for kernel in kernels), key=_reach)
        tiles = planned_tiles(pyramid, level, widest, part="apart", budget=_BUDGET, room=_ROOM)
        return cls(tiles)

    def margin(self, kernel: RotationKernel) -> float:
        """How much better a kernel is than a camera that stands still."""
        found = self.score(kernel)
        energy = max(self.still.energy - found.energy, -_MOST_LOSS)
        return energy + _SPARSITY_WEIGHT * (self.still.sparsity - found.sparsity)

    def score(self, kernel: RotationKernel) -> Score:
        """Score a kernel, for the photo at any size, on the tiles."""
        self.tiles.bind(kernel.for_camera(self.tiles.camera), afresh=True)
        energy = self._energy()
        return Score(
            float(np.log(energy)),
            float(np.log(self._ratio(self._restored()) / self._ratio(self.tiles.g))),
        )

    def _energy(self) -> float:
        """E of the L0 picture, the room around the tiles filled in on the way."""
        tiles = self.tiles
        for lam in (2 * _LAM, 2 * _LAM, _LAM):
            picture, _, _ = l0_picture(tiles, lam, beta_max=_BETA_MAX)
            blurred = tiles.fill(picture)
        across, down = differences(picture)
        live = across**2 + down**2 > _LAM * _LIVE
        misfit = np.minimum((blurred - tiles.g)[self.counted].astype(np.float64) ** 2, _LAM)
        return float(misfit.mean() + _LAM * live[self.counted].mean())

    def _restored(self) -> Image:
        """Restore under a sparse prior of gradients, ``sum |grad f|^0.8``."""
        tiles = self.tiles
        length = np.hypot(*differences(tiles.g))[self.counted]
        noise = max(2 * self.noise, _LEAST_NOISE)
        price = _PRIOR * noise**2 / (_POWER * float((length**_POWER).mean()))
        tiles.fill(tiles.g)
        picture, data = tiles.g, tiles.data()
        for stage, beta in enumerate(_PENALTIES):
            if stage == _FILL_AT:
                tiles.fill(picture)
                data = tiles.data()
            across, down = differences(picture)
            share = _shrunk(np.hypot(across, down), price / beta)
            picture = tiles.solved(data, across * share, down * share, beta)
        return picture

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


def _reach(kernel: RotationKernel) -> int:
    return reach(kernel.camera, kernel.theta)
