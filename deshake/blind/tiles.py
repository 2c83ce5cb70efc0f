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
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.geometry.rotations import displacements, homographies
from deshake.operators.bilinear import splat
from deshake.operators.transforms import squared_responses, transforms
from deshake.signal.gradients import adjoint_differences, differences
from deshake.signal.noise import noise_level

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from deshake.geometry.kernel import RotationKernel
    from deshake.operators.transforms import Spectra
    from deshake.signal.pyramid import Scale

__all__ = ["Tiles"]

Image = NDArray[np.float32]

_S: Final = SETTINGS.tiles
_GROUP: Final = 2**16  # pixels of the blocks of a group, about
_OF_EACH = ("corners", "centres", "g", "mean", "belief", "around", "middle", "filled", "H", "power")
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
        self,
        scale: Scale,
        corners: Sequence[tuple[int, int]] | NDArray[np.int64],
        size: int,
        far: int,
    ) -> None:
        self.camera = scale.camera
        self.contrast = np.float32(scale.contrast)
        self.corners = np.asarray(corners, np.int64).reshape(-1, 2)
        self.size = size
        self.far = far
        room = max(far + 2, _S.least_room)
        self.transforms = transforms(size + 2 * room)
        self.block = self.transforms.length
        self.first = (self.block - size) // 2
        self._room, self._frame = room, scale.stored.shape
        self.g, known = self._cut(scale)
        held = np.maximum(known.sum((1, 2), keepdims=True), 1)
        self.mean: Image = (self.g * known).sum((1, 2), keepdims=True) / held
        self.g -= self.mean
        self.belief = known * self._fade
        self.centres = self.corners[:, ::-1] + (size - 1) / 2
        slopes = squared_responses(self.block, self.block)
        self.squared_response = self.transforms.weights(*slopes)
        self.filled: Image = self.g

    @property
    def count(self) -> int:
        """Number of tiles."""
        return len(self.corners)

    @cached_property
    def around(self) -> Image:
        """The pixels of the frame around the middles whose latent light counts, (P, N, N)."""
        return (self._fade > _S.least_window) * self._in_frame()

    @cached_property
    def middle(self) -> Image:
        """The weights of the middles in the kernel step, (P, N, N)."""
        middle = _window(self.block, self.size - 2 * (self.far // _S.inset), _S.ramp)
        return np.outer(middle, middle) * self._in_frame()

    @cached_property
    def gradients(self) -> tuple[Spectra, Spectra]:
        """The spectra of the photo's gradients, across and down."""
        edges = self._in_frame(1)
        edges[:, -1] = 0
        edges[:, :, -1] = 0
        across, down = differences(self.g)
        across *= edges
        down *= edges
        return self.transforms.rfft(across), self.transforms.rfft(down)

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Pixels of the middles that count as data, (P, N, N)."""
        inside = np.zeros(self.g.shape, bool)
        inner = slice(self.first + _S.ramp, self.first + self.size - _S.ramp)
        inside[:, inner, inner] = True
        return inside & (self.belief > _S.known)

    @property
    def noise(self) -> float:
        """The standard deviation of the noise, in the contrast of the pyramid."""
        return float(noise_level(self.g.reshape(-1, self.block)))

    def in_other_tones(self, scale: Scale) -> Tiles:
        """Cut the same tiles from the scale of the photo in other tones."""
        return Tiles(scale, self.corners, self.size, self.far)

    def toned(self, blocks: Image) -> Image:
        """Return pictures of the tiles, (P, N, N), in the tones of the scale."""
        return (blocks + self.mean) / self.contrast

    def irfft(self, spectra: Spectra) -> Image:
        """Transform spectra, which are overwritten, back to blocks."""
        blocks = self.transforms.irfft(spectra)
        if self.transforms.gain != 1:
            blocks *= np.float32(1 / self.transforms.gain)
        return blocks

    def bound(self, kernel: RotationKernel, filled: Image | None = None) -> Tiles:
        """Return the same tiles for a kernel, as if they never had another one.

        So threads can compare kernels on the same tiles. If `filled` is given, their room is filled
        so.
        """
        tiles = copy(self)
        tiles.filled = tiles.g if filled is None else filled
        tiles.bind(kernel)
        return tiles

    def groups(self, *, for_kernel: bool = False) -> Iterator[tuple[slice, Tiles]]:
        """Yield these tiles a few at a time, and their places among all.

        A few tiles stay in the processor's cache from one step to the next. The arrays are views.
        The kernel step needs arrays that others do not; they are made for all tiles at once.
        """
        if for_kernel:
            _ = self.around, self.middle, self.gradients
        count = max(round(_GROUP / self.block**2), 1)
        for first in range(0, self.count, count):
            part = slice(first, min(first + count, self.count))
            yield part, self.some(part)

    def some(self, part: slice | NDArray[np.intp]) -> Tiles:
        """Return some of these tiles, given by their places among all."""
        some = copy(self)
        arrays = vars(self)  # without H and power, if no kernel is bound
        vars(some).update({name: arrays[name][part] for name in _OF_EACH if name in arrays})
        if "gradients" in arrays:
            some.gradients = self.gradients[0][part], self.gradients[1][part]
        return some

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

    @property
    def _fade(self) -> Image:
        """1 over the middle of a tile, falling to 0 over the room around it, (N, N)."""
        taper = _window(self.block, self.size, min(self._room, self.first))
        return np.outer(taper, taper)

    def _cut(self, scale: Scale) -> tuple[Image, Image]:
        """Return blocks of the photo, and of its known pixels within the frame."""
        height, width = self._frame
        steps = np.arange(self.block) - self.first
        known = self._in_frame()
        g = np.empty_like(known)
        for p, (top, left) in enumerate(self.corners):
            place = np.ix_(np.clip(top + steps, 0, height - 1), np.clip(left + steps, 0, width - 1))
            g[p] = scale.piece(place)
            if scale.clipped is not None:
                known[p][scale.clipped[place]] = 0
        g *= self.contrast
        return g, known

    def _in_frame(self, more: int = 0) -> Image:
        """Return blocks (P, N, N): 1 at pixels of the frame, and 0 elsewhere.

        Only pixels count whose neighbours, as far as `more` below and to the right, are in the
        frame, too.
        """
        height, width = self._frame
        steps = np.arange(self.block) - self.first
        y, x = self.corners[:, :1] + steps, self.corners[:, 1:] + steps
        rows, columns = (y >= 0) & (y + more < height), (x >= 0) & (x + more < width)
        blocks: Image = rows[:, :, None].astype(np.float32) * columns[:, None]
        return blocks


def _window(count: int, inner: int, ramp: int) -> Image:
    """Return a window: 1 over the middle `inner` of `count` pixels, with cosine ramps to 0."""
    window = np.zeros(count, np.float32)
    first = (count - inner) // 2
    window[first : first + inner] = 1
    rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(ramp) + 0.5) / ramp)
    window[first - ramp : first] = rise
    window[first + inner : first + inner + ramp] = rise[::-1]
    return window
