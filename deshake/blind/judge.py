"""A judge between kernels: the better explains the photo by a simpler sharp picture.

The energy of the L0 picture,

    E = mean min((A S - g)^2, lam) + lam #{grad S != 0} / N

weighs how well a kernel explains the photo against how many edges it needs for that: a kernel too
wide or too small needs more of them. The misfit of a pixel counts up to a bound, since lights and
tone curves are beyond what any kernel explains. The margin of a kernel is its gain in ``-ln E``
over a camera that stands still.

Dark photos of fine texture leave the energy silent: no kernel lowers it, though the restored
picture is plainly sharper. There the normalised sparsity of the restored picture speaks,
``nsp = |grad f|_1 / |grad f|_2`` (Krishnan, Tay & Fergus, CVPR 2011), which falls with sharpness
and rises with ringing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deshake.blind.sharp_edges import l0_picture
from deshake.blind.tile_plan import Budget, planned_tiles
from deshake.blind.tiles import Tiles, reach
from deshake.geometry.kernel import RotationKernel
from deshake.signal.gradients import differences, length_of
from deshake.signal.noise import noise_level

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.signal.pyramid import Pyramid

__all__ = ["Judge"]

Image = NDArray[np.float32]

_LAM = 2e-3
_BETA_MAX = 64.0
_BETA_FIRST = 2.0  # of the pictures that only fill in what is around the tiles
_LIVE = 1 / 64  # gradients whose square is above this share of lam are counted as edges
_ROOM = 1.2  # times the reach of the widest kernel
_BUDGET = Budget(0.12e6, 0.3e6)
_LEAST_NOISE = 0.002  # in the contrast of the pyramid
_POWER = 0.8  # of the gradients, in the restored picture's prior
_PRIOR = 0.5  # its weight, in variances of the noise
_PENALTIES = tuple(float(beta) for beta in np.geomspace(0.01, 0.5, 7))
_TINY = 1e-6
_FILL_AT = 4  # penalties in, when what is not known is filled in


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
        self.still = self.energy(RotationKernel.delta(tiles.camera))
        self.unrestored = self._ratio(tiles.g)

    @classmethod
    def of(cls, pyramid: Pyramid, level: int, kernels: Sequence[RotationKernel]) -> Judge:
        """Make a judge with room for kernels, on tiles that are kept apart."""
        camera = pyramid.at(level).camera
        widest = max((kernel.for_camera(camera) for kernel in kernels), key=_reach)
        tiles = planned_tiles(pyramid, level, widest, part="apart", budget=_BUDGET, room=_ROOM)
        return cls(tiles)

    def margin(self, kernel: RotationKernel) -> float:
        """How much better a kernel, for a photo of any size, is than a camera that stands still."""
        return self.still - self.energy(kernel)

    def energy(self, kernel: RotationKernel) -> float:
        """``ln E`` of the L0 picture that a kernel leaves."""
        self.tiles.bind(kernel.for_camera(self.tiles.camera), afresh=True)
        return float(np.log(self._energy()))

    def sharpening(self, kernel: RotationKernel) -> float:
        """Gain in ``-ln nsp``, by how much sparser a kernel makes the photo's gradients."""
        self.tiles.bind(kernel.for_camera(self.tiles.camera), afresh=True)
        return float(np.log(self.unrestored / self._ratio(self._restored())))

    def _energy(self) -> float:
        """E of the L0 picture, the room around the tiles filled in on the way."""
        tiles = self.tiles
        for _ in range(2):
            tiles.fill(l0_picture(tiles, 2 * _LAM, beta_max=_BETA_FIRST)[0])
        picture, _, _ = l0_picture(tiles, _LAM, beta_max=_BETA_MAX)
        blurred = tiles.fill(picture)
        across, down = differences(picture)
        live = across**2 + down**2 > _LAM * _LIVE
        misfit = np.minimum((blurred - tiles.g)[self.counted].astype(np.float64) ** 2, _LAM)
        return float(misfit.mean() + _LAM * live[self.counted].mean())

    def _restored(self) -> Image:
        """Restore under a sparse prior of gradients, ``sum |grad f|^0.8``."""
        tiles = self.tiles
        length = length_of(*differences(tiles.g))[self.counted]
        noise = max(2 * noise_level(tiles.g.reshape(-1, tiles.block)), _LEAST_NOISE)
        price = _PRIOR * noise**2 / (_POWER * float((length**_POWER).mean()))
        picture, data = tiles.g, tiles.data()
        for stage, beta in enumerate(_PENALTIES):
            if stage == _FILL_AT:
                tiles.fill(picture)
                data = tiles.data()
            across, down = differences(picture)
            share = _shrunk(length_of(across, down), price / beta)
            picture = tiles.solved(data, across * share, down * share, beta)
        return picture

    def _ratio(self, picture: Image) -> float:
        length = length_of(*differences(picture))[self.counted].astype(np.float64)
        return float(length.mean() / np.sqrt((length**2).mean()))


def _shrunk(length: Image, step: float) -> Image:
    """Share of gradients of a length that generalised shrinkage for ``step |h|^0.8`` leaves."""
    safe = np.maximum(length, np.float32(_TINY))
    share: Image = np.maximum(1 - np.float32(_POWER * step) * safe ** np.float32(_POWER - 2), 0)
    return share


def _reach(kernel: RotationKernel) -> int:
    return reach(kernel.camera, kernel.theta)
