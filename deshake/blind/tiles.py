"""Tiles of a photo, each with its place in the camera's frame, for the estimate of a kernel.

The rotational model is global. So a few tiles at different places of the frame determine the kernel
as well as all pixels do, and the cost does not grow with the photo. Tile t is a block of N x N
pixels. Its middle, `size` x `size` pixels, counts as data. The room around it holds the light that
the blur moves in or out. Within a tile the blur is one filter, Eq. (7) at the tile's centre c_t:

    A_t f = h_t corr f,   h_t = sum_k w_k splat(d_k(c_t))

In the room around the middle the photo fades into the blurred latent picture. So the block can be
treated as periodic, and every step is a batch of FFTs.
"""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.geometry.rotations import displacements, homographies
from deshake.operators.bilinear import splat
from deshake.operators.transforms import squared_responses, transforms
from deshake.signal.gradients import adjoint_differences, differences

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from deshake.geometry.kernel import RotationKernel
    from deshake.operators.transforms import Spectra
    from deshake.signal.pyramid import Scale

__all__ = ["Tiles"]

Image = NDArray[np.float32]

_S: Final = SETTINGS.tiles
_GROUP: Final = 2**16  # pixels of the blocks of a group, about
_OF_EACH = ("corners", "centres", "g", "belief", "around", "middle", "filled", "H", "power")
"""Names of the arrays that have an item for each tile."""


class Tiles:
    """Tiles of one scale of a photo.

    Parameters
    ----------
    scale : Scale
        The scale.
    corners : sequence of (y, x)
        Upper left pixels of the tiles' middles.
    size : int
        Width and height of the middles in pixels.
    far : int
        Largest displacement by the kernel in pixels, from `reach`.

    """

    def __init__(
        self, scale: Scale, corners: Sequence[tuple[int, int]], size: int, far: int
    ) -> None:
        self.camera = scale.camera
        self.corners = np.asarray(corners, np.int64).reshape(-1, 2)
        self.size = size
        self.far = far
        room = max(far + 2, _S.least_room)
        self.transforms = transforms(size + 2 * room)
        self.block = self.transforms.length
        self.first = (self.block - size) // 2
        self.g, in_frame, known = self._cut(scale)
        self.g -= (self.g * known).sum((1, 2), keepdims=True) / np.maximum(
            known.sum((1, 2), keepdims=True), 1
        )
        taper = _window(self.block, size, min(room, self.first))
        window = np.outer(taper, taper)
        self.belief = known * window
        self.around = (window > _S.least_window) * in_frame
        middle = _window(self.block, size - 2 * (far // _S.inset), _S.ramp)
        self.middle = np.outer(middle, middle) * in_frame
        across, down = differences(self.g)
        edge = in_frame * np.roll(in_frame, -1, 1) * np.roll(in_frame, -1, 2)
        edge[:, -1] = 0
        edge[:, :, -1] = 0
        self.gradients = self.transforms.rfft(across * edge), self.transforms.rfft(down * edge)
        self.centres = self.corners[:, ::-1] + (size - 1) / 2
        slopes = squared_responses(self.block, self.block)
        self.squared_response = self.transforms.weights(*slopes)
        self.filled: Image = self.g

    @property
    def count(self) -> int:
        """Number of tiles."""
        return len(self.corners)

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Pixels of the middles that count as data, (P, N, N)."""
        inside = np.zeros(self.g.shape, bool)
        inner = slice(self.first + _S.ramp, self.first + self.size - _S.ramp)
        inside[:, inner, inner] = True
        return inside & (self.belief > _S.known)

    def irfft(self, spectra: Spectra) -> Image:
        """Transform spectra, which are overwritten, back to blocks."""
        blocks = self.transforms.irfft(spectra)
        if self.transforms.gain != 1:
            blocks *= np.float32(1 / self.transforms.gain)
        return blocks

    def bound(self, kernel: RotationKernel) -> Tiles:
        """Return the same tiles for a kernel, as if they never had another one.

        So threads can compare kernels on the same tiles.
        """
        tiles = copy(self)
        tiles.filled = tiles.g
        tiles.bind(kernel)
        return tiles

    def groups(self) -> Iterator[tuple[slice, Tiles]]:
        """Yield these tiles a few at a time, and their places among all.

        A few tiles stay in the processor's cache from one step to the next. The arrays are views.
        """
        count = max(round(_GROUP / self.block**2), 1)
        for first in range(0, self.count, count):
            part = slice(first, min(first + count, self.count))
            group = copy(self)
            arrays = vars(self)  # without H and power, if no kernel is bound
            vars(group).update({name: arrays[name][part] for name in _OF_EACH if name in arrays})
            group.gradients = self.gradients[0][part], self.gradients[1][part]
            yield part, group

    def bind(self, kernel: RotationKernel) -> None:
        """Set the kernel of the blur; fill the room the first time."""
        used = kernel.weights > 0
        h = homographies(self.camera, kernel.theta[used])
        moved = displacements(h, self.centres)
        filters = splat(moved, kernel.weights[used], (self.block, self.block))
        self.H = self.transforms.rfft(filters)
        self.power = self.transforms.power(self.H)
        if self.filled is self.g:
            self.fill(self.g)

    def blurred(self, latent: Image) -> Image:
        """Blur a latent picture (P, N, N): ``A_t f``."""
        spectra = self.transforms.rfft(latent)
        self.transforms.multiply(spectra, self.H, conjugate=True)
        return self.irfft(spectra)

    def data(self) -> Spectra:
        """Return the spectra of ``A_t^T g``, for the photo with its room filled."""
        spectra = self.transforms.rfft(self.filled)
        self.transforms.multiply(spectra, self.H)
        return spectra

    def solved(self, data: Spectra, across: Image, down: Image, beta: float) -> Image:
        """Return the picture that explains `data` and whose gradients are near the given ones.

        ``min |A_t S - g|^2 + beta |grad S - h|^2``, with h = (across, down).
        """
        spectra = self.transforms.rfft(adjoint_differences(across, down))
        spectra *= np.float32(beta)
        spectra += data
        weights = np.reciprocal(self.power + np.float32(beta) * self.squared_response)
        self.transforms.weigh(spectra, weights)
        return self.irfft(spectra)

    def fill(self, latent: Image) -> Image:
        """Fill the unknown pixels from a blurred latent picture; return that blurred picture."""
        blurred = self.blurred(latent)
        self.filled = blurred + self.belief * (self.g - blurred)
        return blurred

    def _cut(self, scale: Scale) -> tuple[Image, Image, Image]:
        """Return blocks of the photo, of the pixels in its frame, and of its usable pixels."""
        height, width = scale.picture.shape
        steps = np.arange(self.block) - self.first
        shape = len(self.corners), self.block, self.block
        g, in_frame, known = (np.empty(shape, np.float32) for _ in range(3))
        for p, (top, left) in enumerate(self.corners):
            y, x = top + steps, left + steps
            rows, columns = np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)
            place = np.ix_(rows, columns)
            g[p] = scale.picture[place]
            in_frame[p] = np.outer(rows == y, columns == x)
            known[p] = in_frame[p] if scale.usable is None else in_frame[p] * scale.usable[place]
        g *= np.float32(scale.contrast)
        return g, in_frame, known


def _window(count: int, inner: int, ramp: int) -> Image:
    """Return a window: 1 over the middle `inner` of `count` pixels, with cosine ramps to 0."""
    window = np.zeros(count, np.float32)
    first = (count - inner) // 2
    window[first : first + inner] = 1
    rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(ramp) + 0.5) / ramp)
    window[first - ramp : first] = rise
    window[first + inner : first + inner + ramp] = rise[::-1]
    return window
