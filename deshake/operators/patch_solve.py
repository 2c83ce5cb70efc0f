"""Least-squares pictures under a local blur, patch by patch through Fourier space.

The frame, with a margin around it, is cut into patches under windows that sum to one. Patch p has
one filter ``h_p = sum_k w_k splat(d_k(p))``; what is blurred is the windowed *sharp* patch:

    A f = sum_p h_p corr (win_p f)

For a picture S with gradients near given fields (hx, hy), each patch is then solved alone,

    S = sum_p F^-1[ (conj(H_p) F(win_p g) + beta (Dx* F(win_p hx) + Dy* F(win_p hy)))
                    / (|H_p|^2 + beta |D|^2) ]

which is exact for uniform blur, where one patch covers all, and near enough inside an estimate
elsewhere. Neighbouring patches overlap by half under raised cosines: flatter windows leave seams.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from deshake.geometry.rotations import displacements, homographies
from deshake.operators.planes import add_at, window_of
from deshake.operators.strips import Strip, available_threads, in_order

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import ArrayLike

    from deshake.geometry.camera import Camera

__all__ = ["PatchFrame", "PatchSolver", "bilinear_taps", "gather", "patch_size", "splat"]

Image = NDArray[np.float32]
Spectrum = NDArray[np.complex64]
T = TypeVar("T")

_PATCH_RANGE = (48, 256)
_PATCH_TURN = 3.0  # px by which the ends of a patch are moved differently


def patch_size(camera: Camera, theta: ArrayLike) -> int | None:
    """Width of a patch in pixels over which the rotations (K, 3) move all much alike.

    To be asked for *all* candidate rotations: patches that are too large for some of them cannot
    tell a roll of the camera from its absence. None stands for one patch that covers all, which
    is right for the uniform model's camera.
    """
    if camera.is_uniform:
        return None
    turn = float(np.ptp(np.asarray(theta, np.float64), axis=0).max())
    low, high = _PATCH_RANGE
    size = int(np.clip(_PATCH_TURN / max(turn, 1e-9), low, max(low, min(high, *_third(camera)))))
    return size + size % 2


def _third(camera: Camera) -> tuple[int, int]:
    return camera.height // 3, camera.width // 3


class PatchFrame:
    """A frame with its margin, cut into overlapping patches and put together again.

    Parameters
    ----------
    camera : Camera
        The camera of the frame.
    margin : int
        Pixels added on every side.
    room : int
        Pixels around each patch in its block: as far as anything in it may be moved.
    patch : int, optional
        Width of a patch, even. By default one patch covers all, as uniform blur allows.
    threads : int, optional
        Threads to use; by default all processors. Results do not depend on it.

    """

    def __init__(
        self,
        camera: Camera,
        *,
        margin: int,
        room: int,
        patch: int | None = None,
        threads: int | None = None,
    ) -> None:
        self.camera = camera
        self.margin = margin
        self.room = room
        self.shape = camera.height + 2 * margin, camera.width + 2 * margin
        self.threads = threads or available_threads()
        high, wide = self.shape
        if patch is None:
            self.size, self.hop, self.first = (high, wide), (high, wide), (0, 0)
            self.rows, self.columns = 1, 1
            self.window = np.ones((high, wide), np.float32)
        else:
            hop = patch // 2
            self.size, self.hop, self.first = (patch, patch), (hop, hop), (-hop, -hop)
            self.rows, self.columns = -(-high // hop) + 1, -(-wide // hop) + 1
            ramp = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(patch) + 0.5) / patch)
            self.window = np.outer(ramp, ramp).astype(np.float32)
        lengths = [scipy.fft.next_fast_len(n + 2 * room, real=True) for n in self.size]
        self.block = (int(lengths[0]), int(lengths[1]))
        self.strips = [Strip(row, 0, self.columns) for row in range(self.rows)]

    def centres(self, strip: Strip) -> NDArray[np.float64]:
        """Middles (x, y) of a strip's patches, clipped to the frame, (count, 2)."""
        columns = np.arange(strip.first, strip.last)
        x = self.first[1] + columns * self.hop[1] + (self.size[1] - 1) / 2 - self.margin
        y = self.first[0] + strip.row * self.hop[0] + (self.size[0] - 1) / 2 - self.margin
        x = np.clip(x, 0, self.camera.width - 1)
        return np.stack([x, np.full_like(x, np.clip(y, 0, self.camera.height - 1))], 1)

    def blocks(self, image: Image, strip: Strip) -> Image:
        """Cut the blocks (count, *block) around a strip's patches out of an image (H, W)."""
        top, left = self._origin(strip)
        wide = self.block[1] + (strip.count - 1) * self.hop[1]
        covered = window_of(image[None], top, left, self.block[0], wide)[0]
        view = np.lib.stride_tricks.sliding_window_view(covered, self.block[1], axis=1)
        blocks: Image = np.moveaxis(view[:, :: self.hop[1]], 1, 0)
        return blocks

    def windowed(self, image: Image, strip: Strip) -> Image:
        """Cut the same blocks, under the windows of their patches."""
        y, x = (
            slice(self.room, self.room + self.size[0]),
            slice(self.room, self.room + self.size[1]),
        )
        out = np.zeros((strip.count, *self.block), np.float32)
        np.multiply(self.blocks(image, strip)[:, y, x], self.window, out=out[:, y, x])
        return out

    def rfft(self, blocks: Image) -> Spectrum:
        """Transform blocks to their spectra (count, N, M // 2 + 1)."""
        spectra: Spectrum = scipy.fft.rfft2(blocks, workers=1)
        return spectra

    def irfft(self, spectra: Spectrum) -> Image:
        """Transform spectra, which are overwritten, back to blocks."""
        blocks: Image = scipy.fft.irfft2(spectra, self.block, overwrite_x=True, workers=1)
        return blocks

    def assembled(self, work: Callable[[Strip], Image]) -> Image:
        """Add up the blocks that `work` makes of every strip to an image (H, W)."""

        def piece(strip: Strip) -> Image:
            blocks = work(strip)
            out = np.zeros(
                (self.block[0], self.block[1] + (strip.count - 1) * self.hop[1]), np.float32
            )
            for j in range(strip.count):
                out[:, j * self.hop[1] : j * self.hop[1] + self.block[1]] += blocks[j]
            return out

        image = np.zeros((1, *self.shape), np.float32)
        for strip, part in self.each(piece):
            add_at(image, *self._origin(strip), part[None])
        whole: Image = image[0]
        return whole

    def each(self, work: Callable[[Strip], T]) -> Iterator[tuple[Strip, T]]:
        """Yield `work` of every strip, in order."""
        return in_order(work, self.strips, self.threads)

    def _origin(self, strip: Strip) -> tuple[int, int]:
        return (
            self.first[0] + strip.row * self.hop[0] - self.room,
            self.first[1] + strip.first * self.hop[1] - self.room,
        )


class PatchSolver:
    """A kernel bound to a frame: blurring, and pictures near given gradients.

    Parameters
    ----------
    frame : PatchFrame
        The patches; its room must hold the reach of the kernel.
    theta : (K, 3) array
        Rotations in radians.
    weights : (K,) array
        Their weights.

    """

    def __init__(self, frame: PatchFrame, theta: ArrayLike, weights: ArrayLike) -> None:
        self.frame = frame
        h = homographies(frame.camera, theta)
        w = np.asarray(weights, np.float64)
        self._spectra: dict[Strip, Spectrum] = {}
        self._powers: dict[Strip, Image] = {}
        rows, columns = frame.block
        angle_y = 2 * np.pi * np.arange(rows)[:, None] / rows
        angle_x = 2 * np.pi * np.arange(columns // 2 + 1)[None] / columns
        self._dx = (np.exp(-1j * angle_x) - 1).astype(np.complex64)  # transpose of f(x+1) - f(x)
        self._dy = (np.exp(-1j * angle_y) - 1).astype(np.complex64)
        self._d2 = (4 * np.sin(angle_y / 2) ** 2 + 4 * np.sin(angle_x / 2) ** 2).astype(np.float32)
        for strip in frame.strips:
            filters = splat(displacements(h, frame.centres(strip)), w, frame.block)
            spectra = frame.rfft(filters)
            self._spectra[strip] = np.conj(spectra)
            self._powers[strip] = spectra.real**2 + spectra.imag**2

    def forward(self, f: Image) -> Image:
        """Blur a picture (H, W), margin included: ``A f``."""
        frame = self.frame

        def work(strip: Strip) -> Image:
            product = frame.rfft(frame.windowed(f, strip))
            product *= self._spectra[strip]
            return frame.irfft(product)

        return frame.assembled(work)

    def data(self, g: Image) -> dict[Strip, Spectrum]:
        """Spectra ``conj(H_p) F(win_p g)`` of a blurred picture (H, W), for `solve`."""
        frame = self.frame

        def work(strip: Strip) -> Spectrum:
            spectra = frame.rfft(frame.windowed(g, strip))
            spectra *= np.conj(self._spectra[strip])
            return spectra

        return dict(frame.each(work))

    def solve(self, data: dict[Strip, Spectrum], hx: Image, hy: Image, beta: float) -> Image:
        """Return the picture that explains the data and has gradients near (hx, hy).

        Parameters
        ----------
        data : dict
            From `data`.
        hx, hy : (H, W) arrays
            Differences to the right and lower neighbour that are wanted.
        beta : float
            How much they count against the data, > 0.

        """
        frame = self.frame
        weight = np.float32(beta)

        def work(strip: Strip) -> Image:
            sum_ = frame.rfft(frame.windowed(hx, strip))
            sum_ *= self._dx
            down = frame.rfft(frame.windowed(hy, strip))
            down *= self._dy
            sum_ += down
            sum_ *= weight
            sum_ += data[strip]
            sum_ /= self._powers[strip] + weight * self._d2
            return frame.irfft(sum_)

        return frame.assembled(work)


def splat(
    moved: NDArray[np.float64], weights: NDArray[np.float64], block: tuple[int, int]
) -> Image:
    """Splat weights at displacements (P, K, 2) bilinearly, lag 0 at the origin, periodic."""
    count = len(moved)
    place, share = bilinear_taps(moved, block)
    place += (np.arange(count) * block[0] * block[1])[:, None, None]
    spread = share * weights[:, None]
    summed = np.bincount(place.ravel(), spread.ravel(), count * block[0] * block[1])
    return summed.reshape(count, *block).astype(np.float32)


def gather(correlations: Image, moved: NDArray[np.float64]) -> NDArray[np.float64]:
    """Read periodic correlations (P, N, M) bilinearly at lags (P, K, 2); their sum over P, (K,)."""
    place, share = bilinear_taps(moved, (correlations.shape[1], correlations.shape[2]))
    total = np.zeros(moved.shape[1])
    for flat, index, part in zip(
        correlations.reshape(len(correlations), -1), place, share, strict=True
    ):
        total += np.einsum("ka,ka->k", flat[index], part)
    return total


def bilinear_taps(
    moved: NDArray[np.float64], block: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Places in a periodic block and shares, (P, K, 4), of the bilinear taps of lags (x, y)."""
    low = np.floor(moved)
    a, b = moved[..., 0] - low[..., 0], moved[..., 1] - low[..., 1]
    x, y = low[..., 0].astype(np.int64), low[..., 1].astype(np.int64)
    left, right = x % block[1], (x + 1) % block[1]
    top, bottom = y % block[0] * block[1], (y + 1) % block[0] * block[1]
    index = np.stack([top + left, top + right, bottom + left, bottom + right], -1)
    share = np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], -1)
    return index, share
