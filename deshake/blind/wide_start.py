"""Kernels of very wide shakes, from the whole frame at coarse scales.

A candidate's kernel grows from a point. If the shake is as wide as a tenth of the frame, the first
scales are too small for that: the kernel grows until it is as wide as the frame. Here the kernel
has a fixed room from the beginning, a square, and the frame is one periodic picture. So every edge
counts, also those near the border. One filter serves for the whole frame, and each step takes a few
Fourier transforms. The roll follows in the race.

Two steps alternate, from coarse to fine. The latent picture S has few edges (`sharp_edges`), and
black pixels are common in it [1]: a blur makes the darkest pixel of a patch brighter. So the
darkest pixel of each patch becomes black if it is dark already. The kernel w is that of the least
squares between the edges of S and those of the photo g, which has a closed form:

    w = F^-1( sum conj(F D S) F D g / (sum |F D S|^2 + gamma) )

Its small values and small pieces are noise. In some starts these are values that are small beside
the largest one. In others they are the smallest values that together hold a share of the light: a
camera that rests and then goes far leaves a long faint tail, and it may hold more. Each start
succeeds on some photos only. The starts differ in scale, room, noise and price of an edge, and they
are cheap. Clipped pixels count like others, because a periodic picture has no gaps; the race judges
the kernels without them.

A kernel that is nearly right, or a part of a wide one, is refined in the same way
(`refined_on_frame`), with noise by its share of the light.

References
----------
.. [1] F. Wen, R. Ying, Y. Liu, P. Liu and T.-K. Truong, "A simple local minimal intensity prior
   and an improved algorithm for blind image deblurring", IEEE Transactions on Circuits and Systems
   for Video Technology 31, 2021, https://arxiv.org/abs/1906.06642

"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.blind.trimming import without_light
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import displacements, grid_steps, homographies
from deshake.operators.bilinear import splat
from deshake.operators.strips import in_order
from deshake.operators.transforms import power_of, squared_responses
from deshake.signal.gradients import adjoint_differences, differences, strong
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.candidate import Axes
    from deshake.blind.settings import FrameWay, WideWay
    from deshake.geometry.camera import Camera
    from deshake.run import Run
    from deshake.signal.pyramid import Pyramid, Scale

__all__ = ["levels_on_frame", "refined_on_frame", "wide_starts"]

Image = NDArray[np.float32]
Spectrum = NDArray[np.complex64]

_S: Final = SETTINGS.wide_start


def wide_starts(pyramid: Pyramid, axes: Axes, run: Run) -> list[tuple[int, RotationKernel]]:
    """Estimate kernels of wide shakes, without roll.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    axes : three bools
        The axes that the camera may turn about.
    run : Run
        Threads to use.

    Returns
    -------
    list of (level, kernel)
        The scale of each estimate, and the kernel for the camera of the photo, centred.

    """
    shorter = min(pyramid.camera.shape)
    levels = [round(np.log(shorter / way.side) / np.log(RATIO)) for way in _S.ways]
    jobs = [(level, way) for level, way in zip(levels, _S.ways, strict=True) if level >= 0]
    work = in_order(lambda job: _estimated(pyramid, *job, axes), jobs, run)
    return [(level, kernel) for (level, _), kernel in work]


def _estimated(pyramid: Pyramid, level: int, way: WideWay, axes: Axes) -> RotationKernel:
    """Estimate a kernel from coarse to fine; the last scale is `level`."""
    scales = 1 + round(np.log(way.reach / _S.least_reach) / np.log(RATIO))
    prices = np.geomspace(way.first, way.last, scales * way.iterations)
    darks = np.linspace(_S.dark, 0, len(prices), endpoint=False)
    reaches = [int(np.ceil(way.reach / RATIO**coarser)) for coarser in reversed(range(scales))]
    levels = range(level + scales - 1, level - 1, -1)
    frames = _frames(pyramid, levels, reaches, contrast_of=level)
    first = _first_kernel(reaches[0])
    kernel = _alternated(frames, first, prices, darks, axes, cut=way.cut, faint=way.faint)
    return _of_camera(kernel, pyramid.at(level), pyramid)


def refined_on_frame(
    pyramid: Pyramid, kernel: RotationKernel, level: int, way: FrameWay, axes: Axes
) -> RotationKernel | None:
    """Estimate a wide kernel again from a part of it, without roll, from coarse to fine.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    kernel : RotationKernel
        The kernel to begin with, for the camera of the photo.
    level : int
        The scale that suits this kernel.
    way : FrameWay
        The scales, the room of the kernel, and the prices.
    axes : three bools
        The axes that the camera may turn about.

    Returns
    -------
    RotationKernel or None
        The kernel, for the camera of the photo, centred; None if the photo has no scale so coarse.

    """
    first, last = levels_on_frame(pyramid, level, way)
    if last >= first:
        return None
    drawn = _filter(kernel, pyramid.camera_at(first))
    reach = int(np.ceil(way.room * (len(drawn) // 2)))
    drawn = np.pad(drawn, reach - len(drawn) // 2)
    levels = range(first, last - 1, -1)
    reaches = [int(np.ceil(reach * RATIO ** (first - one))) for one in levels]
    frames = _frames(pyramid, levels, reaches, contrast_of=first)
    prices = np.geomspace(way.dear, way.cheap, len(frames) * way.iterations)
    darks = np.zeros_like(prices)
    grown = _alternated(frames, drawn, prices, darks, axes, cut=0.0, faint=way.faint)
    return _of_camera(grown, pyramid.at(last), pyramid)


def levels_on_frame(pyramid: Pyramid, level: int, way: FrameWay) -> tuple[int, int]:
    """Return the first scale of a refinement on the frame, and the last one.

    `level` is the scale that suits the kernel. If the frame is too large at these scales, coarser
    ones take their place.
    """
    last = max(level + way.last, pyramid.level_of(way.pixels))
    return min(last + way.first - way.last, pyramid.coarsest), last


def _frames(
    pyramid: Pyramid, levels: Sequence[int], reaches: Sequence[int], *, contrast_of: int
) -> list[_Frame]:
    """Make the frames of scales, all in a contrast that suits one of the scales."""
    contrast = _S.contrast / float(pyramid.at(contrast_of).picture.std())
    return [
        _Frame(pyramid.at(level), reach, contrast)
        for level, reach in zip(levels, reaches, strict=True)
    ]


def _alternated(
    frames: Sequence[_Frame],
    kernel: Image,
    prices: NDArray[np.float64],
    darks: NDArray[np.float64],
    axes: Axes,
    *,
    cut: float,
    faint: float,
) -> Image:
    """Alternate the two steps on frames, from coarse to fine; the kernel is for the first one.

    There is a price of an edge, and a brightness of dark pixels, for each iteration of each frame.
    """
    iterations = len(prices) // len(frames)
    for n, frame in enumerate(frames):
        if n:
            kernel = _resized(kernel, frame.reach)
        for i in range(n * iterations, (n + 1) * iterations):
            across, down = frame.edges(kernel, float(prices[i]), float(darks[i]))
            fitted = _without_noise(frame.fitted(across, down, frame.reach), cut, faint)
            kernel = _cleaned(fitted, axes, otherwise=kernel)
    return kernel


def _filter(kernel: RotationKernel, camera: Camera) -> Image:
    """Return the filter of a kernel in the middle of a frame, (n, n), with a little room."""
    middle = np.array([camera.width - 1, camera.height - 1]) / 2
    moved = displacements(homographies(camera, kernel.theta), middle[None])
    moved -= np.einsum("k,pki->pi", kernel.weights, moved)[:, None]
    reach = int(np.ceil(np.abs(moved).max())) + _S.spare
    side = 2 * reach + 1
    # light moves against the displacement: the photo reads the scene there
    return np.roll(splat(-moved, kernel.weights, (side, side))[0], (reach, reach), (0, 1))


class _Frame:
    """The picture of a scale as one periodic picture.

    Beyond the right and the lower border the picture turns smoothly into that at the opposite one.
    """

    def __init__(self, scale: Scale, reach: int, contrast: float) -> None:
        self.shape, self.reach = scale.camera.shape, reach
        h, w = self.shape
        rows, columns = (scipy.fft.next_fast_len(n + 2 * reach, real=True) for n in self.shape)
        picture = np.empty((rows, columns), np.float32)
        np.multiply(scale.picture, np.float32(contrast), out=picture[:h, :w])
        picture[:h, w:] = _between(picture[:h, w - 1 : w], picture[:h, :1], columns - w, axis=1)
        picture[h:] = _between(picture[h - 1 : h], picture[:1], rows - h, axis=0)
        self.picture = picture
        self.data = _spectrum(picture)
        self.gradients = [_spectrum(part) for part in differences(picture)]
        along_rows, along_columns = squared_responses(rows, columns)
        self.squared_response = along_rows[:, None] + along_columns

    def edges(self, kernel: Image, price: float, dark: float) -> tuple[Image, Image]:
        """Return the edges of the latent picture that explains the photo, within the frame."""
        H = _spectrum(_placed(kernel, self.picture.shape))
        data, power = np.conj(H) * self.data, power_of(H)
        latent, beta = self.picture, 2 * price
        while beta < _S.beta_max:
            across, down = strong(*differences(self._darkened(latent, dark)), price / beta)
            spectrum = _spectrum(adjoint_differences(across, down))
            spectrum *= np.float32(beta)
            spectrum += data
            spectrum /= power + np.float32(beta) * self.squared_response
            latent = _inverse(spectrum, latent.shape)
            beta *= _S.growth
        across, down = strong(*differences(latent), 2 * price / beta)
        for part in (across, down):
            part[self.shape[0] - 1 :] = 0
            part[:, self.shape[1] - 1 :] = 0
        return across, down

    def fitted(self, across: Image, down: Image, reach: int) -> Image:
        """Return the kernel of the least squares of edges, (2 reach + 1, 2 reach + 1)."""
        F_across, F_down = _spectrum(across), _spectrum(down)
        matched: Spectrum = np.conj(F_across)
        matched *= self.gradients[0]
        matched += np.conj(F_down) * self.gradients[1]
        matched /= power_of(F_across) + power_of(F_down) + np.float32(_S.ridge)
        kernel = np.roll(_inverse(matched, across.shape), (reach, reach), (0, 1))
        return kernel[: 2 * reach + 1, : 2 * reach + 1]

    def _darkened(self, latent: Image, dark: float) -> Image:
        """Make the darkest pixel of each patch black, if it is darker than `dark`."""
        side = max(int(_S.patch * sum(self.shape) / 2), _S.least_patch)
        rows, columns = (n // side for n in self.shape)
        patches = latent[: rows * side, : columns * side].reshape(rows, side, columns, side)
        flat = patches.transpose(0, 2, 1, 3).reshape(rows, columns, -1)
        darkest = flat.argmin(2)
        found = np.take_along_axis(flat, darkest[..., None], 2)[..., 0] < dark
        y = (np.arange(rows)[:, None] * side + darkest // side)[found]
        x = (np.arange(columns) * side + darkest % side)[found]
        darkened = latent.copy()
        darkened[y, x] = 0
        return darkened


def _spectrum(picture: Image) -> Spectrum:
    """Transform a picture."""
    spectrum: Spectrum = scipy.fft.rfft2(picture)
    return spectrum


def _inverse(spectrum: Spectrum, shape: tuple[int, ...]) -> Image:
    """Transform a spectrum back to a picture of a shape."""
    picture: Image = scipy.fft.irfft2(spectrum, s=shape)
    return picture


def _between(one: Image, other: Image, count: int, axis: int) -> Image:
    """Return `count` rows or columns that lead from one to another."""
    share = (np.arange(count, dtype=np.float32) + 1) / np.float32(count + 1)
    share = np.expand_dims(share, 1 - axis)
    return (1 - share) * one + share * other


def _placed(kernel: Image, shape: tuple[int, ...]) -> Image:
    """Place a kernel in a picture of a shape, its centre at the first pixel."""
    reach = len(kernel) // 2
    picture = np.zeros(shape, np.float32)
    picture[: len(kernel), : len(kernel)] = kernel
    return np.roll(picture, (-reach, -reach), (0, 1))


def _first_kernel(reach: int) -> Image:
    """Return a kernel with half of the light at rest and half beside it, to break the symmetry."""
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    kernel[reach, reach : reach + 2] = 0.5
    return kernel


def _resized(kernel: Image, reach: int) -> Image:
    """Resample a kernel to the room of a scale; its sum is 1."""
    side = 2 * reach + 1
    finer = cv2.resize(kernel, (side, side), interpolation=cv2.INTER_LINEAR)
    return np.asarray(finer / finer.sum(), np.float32)


def _without_noise(kernel: Image, cut: float, faint: float) -> Image:
    """Discard values that are small beside the largest one, and those that hold little light."""
    kept = np.where(kernel < cut * kernel.max(), 0, kernel).ravel().astype(np.float64)
    return without_light(kept, faint).reshape(kernel.shape).astype(np.float32)


def _cleaned(kernel: Image, axes: Axes, otherwise: Image) -> Image:
    """Discard small pieces, and centre the kernel; its sum is 1."""
    reach = len(kernel) // 2
    kernel = kernel.copy()
    steps = np.arange(-reach, reach + 1)
    if not axes[0]:  # a turn about X moves the picture up and down
        kernel[steps != 0] = 0
    if not axes[1]:
        kernel[:, steps != 0] = 0
    count, pieces = cv2.connectedComponents((kernel > 0).astype(np.uint8), connectivity=8)
    light = np.bincount(pieces.ravel(), kernel.ravel(), count)
    kernel = np.where((light < _S.least_piece * light.sum())[pieces], 0, kernel)
    total = kernel.sum()
    if not total > 0:
        return otherwise
    kernel /= total
    centre = [-round(float(kernel.sum(1 - axis) @ steps)) for axis in (0, 1)]
    return np.roll(kernel, centre, (0, 1)).astype(np.float32)


def _of_camera(kernel: Image, scale: Scale, pyramid: Pyramid) -> RotationKernel:
    """Turn a filter of a scale into rotations about X and Y, for the camera of the photo."""
    reach = len(kernel) // 2
    y, x = np.nonzero(kernel)
    steps = grid_steps(scale.camera)
    # light moves by (x, y): the picture is read at (-x, -y); a turn about X moves it up
    moves = np.stack([y - reach, reach - x, np.zeros_like(x)], 1)
    indices = np.rint(moves / (scale.camera.focal_px * steps)).astype(np.int64)
    own = RotationKernel.from_indices(indices, kernel[y, x], steps, scale.camera)
    return own.centred().for_camera(pyramid.camera)
