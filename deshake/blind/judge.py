"""The judge compares kernels: a better kernel explains the photo by a simpler sharp picture.

The energy of the L0 picture,

    E = mean min((A S - g)^2, lam) + lam #{grad S != 0} / N

has two terms: the misfit of the kernel, and the number of edges that the kernel needs. A kernel
that is too wide or too small needs more edges. The misfit of a pixel is bounded, because no kernel
explains lights and tone curves. The margin of a kernel is its gain in ``-ln E`` over a still
camera.

In dark photos of fine texture no kernel lowers the energy, although the restored picture is
sharper. For those photos the judge offers a second measure, the normalised sparsity of the restored
picture, ``nsp = |grad f|_1 / |grad f|_2`` (Krishnan, Tay & Fergus, CVPR 2011). It falls with
sharpness and rises with ringing.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deshake.blind.sharp_edges import l0_picture
from deshake.blind.tile_plan import Budget, planned_tiles
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import reach
from deshake.signal.gradients import differences, length_of
from deshake.signal.noise import noise_level
from deshake.signal.shrinkage import shrunk

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.tiles import Tiles
    from deshake.signal.pyramid import Pyramid

__all__ = ["Judge"]

Image = NDArray[np.float32]

_LAM = 2e-3  # squared contrast of the pyramid: price of an edge pixel
_BETA_MAX = 64.0  # last weight of the split gradients, no unit
_BETA_FIRST = 2.0  # the same, for pictures that only fill the room around the tiles
_LIVE = 1 / 64  # share of lam; a gradient is an edge if its square exceeds it
_ROOM = 1.2  # room around a tile, in reaches of the widest kernel
_BUDGET = Budget(0.12e6, 0.3e6)  # pixels
_LEAST_NOISE = 0.002  # contrast of the pyramid: standard deviation
_POWER = 0.8  # exponent of the gradients in the prior of the restored picture
_PRIOR = 0.5  # weight of that prior, in variances of the noise
_PENALTIES = tuple(float(beta) for beta in np.geomspace(0.01, 0.5, 7))  # weights beta, no unit
_FILL_AT = 4  # index into the penalties, at which unknown pixels are filled


class Judge:
    """Tiles for the comparison of kernels.

    Parameters
    ----------
    tiles : Tiles
        Tiles of one scale. They should not be the tiles that the kernels were fitted to.

    """

    def __init__(self, tiles: Tiles) -> None:
        self.tiles = tiles
        self.counted = tiles.inside
        self.still = self.energy(RotationKernel.delta(tiles.camera))

    @classmethod
    def of(cls, pyramid: Pyramid, level: int, kernels: Sequence[RotationKernel]) -> Judge:
        """Make a judge on the tiles kept apart, with enough room for all kernels."""
        camera = pyramid.at(level).camera
        widest = max((kernel.for_camera(camera) for kernel in kernels), key=_reach)
        tiles = planned_tiles(pyramid, level, widest, part="apart", budget=_BUDGET, room=_ROOM)
        return cls(tiles)

    def has_room(self, kernel: RotationKernel) -> bool:
        """Return whether the room around the tiles holds the kernel's displacements."""
        return _reach(kernel.for_camera(self.tiles.camera)) <= self.tiles.far

    def margin(self, kernel: RotationKernel) -> float:
        """Return the gain of a kernel in ``-ln E`` over a still camera.

        The kernel may be for the photo at any size.
        """
        return self.still - self.energy(kernel)

    def energy(self, kernel: RotationKernel) -> float:
        """Return ``ln E`` of the L0 picture of a kernel."""
        self.tiles.bind(kernel.for_camera(self.tiles.camera), afresh=True)
        return float(np.log(self._energy()))

    def sharpening(self, kernel: RotationKernel) -> float:
        """Return the gain in ``-ln nsp``: how much sparser the restored picture's gradients are."""
        self.tiles.bind(kernel.for_camera(self.tiles.camera), afresh=True)
        return float(np.log(self._unrestored / self._ratio(self._restored())))

    def _energy(self) -> float:
        """Return E of the L0 picture; fill the room around the tiles first."""
        tiles = self.tiles
        for _ in range(2):
            tiles.fill(l0_picture(tiles, 2 * _LAM, beta_max=_BETA_FIRST)[0])
        picture, _, _ = l0_picture(tiles, _LAM, beta_max=_BETA_MAX)
        blurred = tiles.fill(picture)
        across, down = differences(picture)
        live = across**2 + down**2 > _LAM * _LIVE
        misfit = np.minimum((blurred - tiles.g)[self.counted].astype(np.float64) ** 2, _LAM)
        return float(misfit.mean() + _LAM * live[self.counted].mean())

    @cached_property
    def _unrestored(self) -> float:
        """The normalised sparsity of the photo itself."""
        return self._ratio(self.tiles.g)

    @cached_property
    def _price(self) -> float:
        """Price of a gradient in the restored picture's prior, from the photo and its noise."""
        tiles = self.tiles
        length = length_of(*differences(tiles.g))[self.counted]
        noise = max(2 * noise_level(tiles.g.reshape(-1, tiles.block)), _LEAST_NOISE)
        return _PRIOR * noise**2 / (_POWER * float((length**_POWER).mean()))

    def _restored(self) -> Image:
        """Restore the tiles with a sparse prior of gradients, ``sum |grad f|^0.8``."""
        tiles, price = self.tiles, self._price
        picture, data = tiles.g, tiles.data()
        for stage, beta in enumerate(_PENALTIES):
            if stage == _FILL_AT:
                tiles.fill(picture)
                data = tiles.data()
            across, down = differences(picture)
            share = shrunk(length_of(across, down), price / beta, _POWER)
            picture = tiles.solved(data, across * share, down * share, beta)
        return picture

    def _ratio(self, picture: Image) -> float:
        length = length_of(*differences(picture))[self.counted].astype(np.float64)
        return float(length.mean() / np.sqrt((length**2).mean()))


def _reach(kernel: RotationKernel) -> int:
    return reach(kernel.camera, kernel.theta)
