"""The judge compares kernels: a better kernel explains the photo by a simpler sharp picture.

The energy of the L0 picture,

    E = mean min((A S - g)^2, lam) + lam #{grad S != 0} / N

has two terms. S is the L0 picture, A blurs it with the kernel, g is the photo, and N is the number
of pixels. The first term is the misfit, and the second one counts the edges. A kernel that is too
wide or too narrow needs more edges. The misfit of a pixel is at most lam, because no kernel
explains clipped lights and tone curves. The margin of a kernel is its gain in ``-ln E`` over a
still camera.

In dark photos with fine texture no kernel lowers the energy, although the restored picture is
sharper. So the judge has a second measure, the normalised sparsity of the restored picture f,
``nsp = |grad f|_1 / |grad f|_2`` (Krishnan, Tay & Fergus, CVPR 2011). It is lower for a sharper
picture, and higher for a picture with ringing.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from deshake.blind.restored_tiles import gradient_price, restored
from deshake.blind.settings import SETTINGS
from deshake.blind.sharp_edges import l0_picture
from deshake.blind.tile_plan import planned_tiles
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import reach
from deshake.signal.gradients import differences, length_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.tiles import Tiles
    from deshake.signal.pyramid import Pyramid

__all__ = ["Judge", "many_tiles", "mean_margin"]

Image = NDArray[np.float32]

_S: Final = SETTINGS.judge
_SEED: Final = 0


class Judge:
    """Tiles for the comparison of kernels.

    Parameters
    ----------
    tiles : Tiles
        Tiles of one scale. They should not be the tiles that the kernels were fitted to.
    lam : float, optional
        Squared contrast of the pyramid: price of an edge pixel, and largest misfit of a pixel.
    level : int, optional
        The scale of the tiles.

    """

    def __init__(self, tiles: Tiles, lam: float = _S.lam, level: int = 0) -> None:
        self.tiles = tiles
        self.level = level
        self.lam = lam
        self.counted = tiles.inside
        self._filled: Image | None = None
        self.still = self.energy(RotationKernel.delta(tiles.camera))
        self._margins: dict[RotationKernel, float] = {}

    @classmethod
    def of(cls, pyramid: Pyramid, level: int, kernels: Sequence[RotationKernel]) -> Judge:
        """Make a judge on the tiles kept apart, with enough room for all kernels."""
        camera = pyramid.camera_at(level)
        widest = max((kernel.for_camera(camera) for kernel in kernels), key=_reach)
        tiles = planned_tiles(pyramid, level, widest, part="apart", budget=_S.budget, room=_S.room)
        return cls(tiles, level=level)

    @classmethod
    def batches(cls, pyramid: Pyramid, level: int, kernel: RotationKernel) -> list[Judge]:
        """Make judges of kernels that hardly differ from one; each has a few tiles of its own.

        Together they have many tiles, those for the fit of kernels, too. With less noise an edge
        is cheaper: what tells such kernels apart is fine.
        """
        tiles = many_tiles(pyramid, level, kernel)
        seen = np.flatnonzero(tiles.inside.any((1, 2)))
        order = np.random.default_rng(_SEED).permutation(seen)
        parts = np.array_split(order, max(len(seen) // _S.batch, 1))
        lam = _S.lam * float(np.clip(tiles.noise / _S.noisy, _S.least_price, 1))
        return [cls(tiles.some(np.sort(part)), lam, level).near(kernel) for part in parts]

    def near(self, kernel: RotationKernel) -> Judge:
        """Return a judge of kernels that hardly differ from one.

        It fills the room around the tiles only once, by that kernel.
        """
        judge = copy(self)
        vars(judge).update(_filled=self._bound(kernel).filled, _margins={})
        return judge

    def has_room(self, kernel: RotationKernel) -> bool:
        """Return whether the room around the tiles holds the kernel's displacements."""
        return _reach(kernel.for_camera(self.tiles.camera)) <= self.tiles.far

    def margin(self, kernel: RotationKernel) -> float:
        """Return the gain of a kernel in ``-ln E`` over a still camera.

        The kernel may be for the photo at any size.
        """
        if kernel not in self._margins:
            self._margins[kernel] = self.still - self.energy(kernel)
        return self._margins[kernel]

    def energy(self, kernel: RotationKernel) -> float:
        """Return ``ln E`` of the L0 picture of a kernel."""
        return float(np.log(max(self._energy(self._bound(kernel)), _S.faint * self.lam)))

    def sharpening(self, kernel: RotationKernel) -> float:
        """Return the gain in ``-ln nsp``: how much sparser the restored picture's gradients are."""
        picture = restored(self._bound(kernel), self._price)
        return float(np.log(self._unrestored / self._ratio(picture)))

    def _bound(self, kernel: RotationKernel) -> Tiles:
        """Return the tiles for a kernel."""
        own = kernel.for_camera(self.tiles.camera)
        return self.tiles.bound(own, self._filled)

    def _energy(self, tiles: Tiles) -> float:
        """Return E of the L0 picture."""
        lam = self.lam
        picture, _, _ = l0_picture(tiles, lam, beta_max=_S.beta_max, growth=_S.growth)
        across, down = differences(picture)
        live = across**2 + down**2 > lam * _S.live
        rest = (tiles.blurred(picture) - tiles.g)[self.counted]
        misfit = np.minimum(rest.astype(np.float64) ** 2, lam)
        return float(misfit.mean() + lam * live[self.counted].mean())

    @cached_property
    def _unrestored(self) -> float:
        """The normalised sparsity of the photo itself."""
        return self._ratio(self.tiles.g)

    @cached_property
    def _price(self) -> float:
        """Price of a gradient in the restored picture."""
        return gradient_price(self.tiles)

    def _ratio(self, picture: Image) -> float:
        length = length_of(*differences(picture))[self.counted].astype(np.float64)
        return float(length.mean() / np.sqrt((length**2).mean()))


def many_tiles(pyramid: Pyramid, level: int, kernel: RotationKernel) -> Tiles:
    """Cut many tiles at a scale, those for the fit of kernels, too, with a room for a kernel."""
    own = kernel.for_camera(pyramid.camera_at(level))
    return planned_tiles(pyramid, level, own, part="all", budget=_S.batches, room=_S.room)


def mean_margin(judges: Sequence[Judge], kernel: RotationKernel) -> float:
    """Return the mean margin of a kernel over judges."""
    return float(np.mean([judge.margin(kernel) for judge in judges]))


def _reach(kernel: RotationKernel) -> int:
    return reach(kernel.camera, kernel.theta)
