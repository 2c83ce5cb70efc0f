"""The data of a pair estimate at each scale: derivatives of both photos, and chosen pixels.

The derivatives are taken after a little smoothing. Noise changes a kernel less if more of the
chosen pixels lie on edges. So pixels are drawn with a chance that grows with the energy of edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.errors import EstimationError
from deshake.geometry.rotations import displacements, homographies
from deshake.pair.kernel_settings import SETTINGS
from deshake.pair.pair_rows import ROW_BLOCK
from deshake.signal.pyramid import reduced

if TYPE_CHECKING:
    from collections.abc import Iterable

    from deshake.geometry.camera import Camera

__all__ = [
    "DrawnPixels",
    "PairPictures",
    "derivatives",
    "drawn_pixels",
    "noise_excess",
    "usable_pixels",
]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PairPictures:
    """The pair in grey at one scale, with pictures of noise alone, and masks.

    Parameters
    ----------
    g, f : (h, w) arrays of float32
        The blurred photo and the registered noisy one.
    noise : list of (h, w) arrays of float32
        Noise like that of f.
    own : (h, w) array of float32
        Noise like that of g.
    known, clipped : (h, w) arrays of float32
        Shares of each pixel where f is known, and where g clipped.

    """

    g: Image
    f: Image
    noise: list[Image]
    own: Image
    known: Image
    clipped: Image

    @classmethod
    def of(
        cls,
        g: Image,
        f_reg: Image,
        valid: NDArray[np.generic],
        noise: Iterable[Image],
        own: Image | None = None,
    ) -> PairPictures:
        """Reduce a pair to its finest scale; pictures of noise are read one at a time."""
        factor = min(SETTINGS.longest_side / max(g.shape[:2]), 1.0)
        shape = round(g.shape[0] * factor), round(g.shape[1] * factor)
        brightest = g if g.ndim == 2 else g.max(-1)
        return cls(
            _grey(g, shape),
            _grey(f_reg, shape),
            [_grey(e, shape) for e in noise],
            np.zeros(shape, np.float32) if own is None else _grey(own, shape),
            reduced((valid != 0).astype(np.float32), shape),
            reduced((brightest >= SETTINGS.clipped).astype(np.float32), shape),
        )

    def at(self, shape: tuple[int, int]) -> PairPictures:
        """Return the pictures and masks, reduced to a size."""
        return PairPictures(
            reduced(self.g, shape),
            reduced(self.f, shape),
            [reduced(e, shape) for e in self.noise],
            reduced(self.own, shape),
            reduced(self.known, shape),
            reduced(self.clipped, shape),
        )


def noise_excess(pictures: PairPictures) -> float:
    """Measure the power of the photo's noise over that of the simulated noise, >= 1.

    The noise estimate uses the finest noise. Cameras remove it, and leave coarser noise. Where the
    blurred photo is flat, the noisy one shows little but noise. So the power of the derivatives is
    compared in the flattest parts of a few levels of brightness. The result is the least ratio.
    """
    if not pictures.noise:
        return 1.0
    inside = cv2.erode(
        (pictures.known > 1 - SETTINGS.ignored).astype(np.uint8),
        np.ones((5, 5), np.uint8),
        borderValue=0,
    )
    usable = (inside > 0) & (pictures.clipped < SETTINGS.ignored)
    if usable.sum() < SETTINGS.brightnesses * SETTINGS.fewest:
        return 1.0
    noisy, drawn = (
        np.square(derivatives(image)).sum(0)[usable] for image in (pictures.f, pictures.noise[0])
    )
    near = cv2.blur(
        np.square(derivatives(pictures.g)).sum(0), (SETTINGS.around_px, SETTINGS.around_px)
    )[usable]
    ratios = []
    for part in np.array_split(
        np.argsort(pictures.g[usable], kind="stable"), SETTINGS.brightnesses
    ):
        flat = part[np.argsort(near[part], kind="stable")[: max(len(part) // 5, 1)]]
        ratios.append(float(np.median(noisy[flat])) / max(float(np.median(drawn[flat])), 1e-12))
    return max(min(ratios), 1.0)


class DrawnPixels(NamedTuple):
    """Pixels (x, y), (n, 2), to fit a kernel to, and others to judge it by."""

    fitted: Indices
    held_out: Indices


def _grey(image: Image, shape: tuple[int, int]) -> Image:
    """Reduce an image to the mean of its channels, which has the least noise."""
    small = reduced(image, shape)
    return small if small.ndim == 2 else small.mean(-1, dtype=np.float32)


def derivatives(image: Image) -> Image:
    """Differences to the right and lower neighbour after a little smoothing, (2, h, w)."""
    smooth = cv2.GaussianBlur(image, (0, 0), SETTINGS.smoothing_px)
    out = np.zeros((2, *image.shape), np.float32)
    np.subtract(smooth[:, 1:], smooth[:, :-1], out=out[0, :, :-1])
    np.subtract(smooth[1:], smooth[:-1], out=out[1, :-1])
    return out


def usable_pixels(pictures: PairPictures, camera: Camera, theta: NDArray[np.float64]) -> Mask:
    """Mark pixels that are not clipped and depend on the known part of the noisy photo only."""
    moved = np.abs(displacements(homographies(camera, theta), camera.corners)).max((0, 1))
    most = int(SETTINGS.most_cut_off * min(camera.shape))
    across, down = np.minimum(np.ceil(moved).astype(int) + 2, most)
    kernel = np.ones((2 * down + 1, 2 * across + 1), np.uint8)
    known = (pictures.known > 1 - SETTINGS.ignored).astype(np.uint8)
    inside = cv2.erode(known, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    clear = np.ones((2 * SETTINGS.clear_px + 1, 2 * SETTINGS.clear_px + 1), np.uint8)
    clipped = cv2.dilate((pictures.clipped > SETTINGS.ignored).astype(np.uint8), clear)
    usable: Mask = (inside > 0) & (clipped == 0)
    return usable


def drawn_pixels(edges: Image, usable: Mask, seed: int) -> DrawnPixels:
    """Draw pixels, with a chance that grows with the energy of the edges near them.

    Parameters
    ----------
    edges : (2, h, w) array of float32
        Derivatives of the blurred photo: those of the noisy photo would favour its noise.
    usable : (h, w) array of bool
        The pixels to choose from.
    seed : int
        The same seed draws the same pixels.

    Raises
    ------
    EstimationError
        If there are too few of them, or no edges.

    """
    near = cv2.GaussianBlur(np.square(edges).sum(0), (0, 0), SETTINGS.near_px).astype(np.float64)
    candidates = np.flatnonzero(usable)
    count = min(len(candidates), SETTINGS.pixels + SETTINGS.held_out)
    judged = max(count // 5 // ROW_BLOCK, 1) * ROW_BLOCK
    fitted = (count - judged) // ROW_BLOCK * ROW_BLOCK
    if fitted <= 0:
        msg = "too few pixels are left that both photos show, neither clipped nor near the border"
        raise EstimationError(msg, hint="give a smaller --blur-size, or photos that overlap more")
    chance = near.ravel()[candidates]
    if not chance.mean() > SETTINGS.least_energy:
        msg = "there is no detail to estimate the shake from"
        raise EstimationError(msg, hint="the photo is all of one colour, or nearly so")
    chance += SETTINGS.flat * chance.mean()
    rng = np.random.default_rng(seed)
    # the largest of keys u^(1/p) are a draw without replacement (Efraimidis & Spirakis 2006)
    keys = np.log(rng.random(len(candidates))) / chance
    order = rng.permutation(np.argpartition(-keys, count - 1)[:count])
    chosen = candidates[order]
    places = np.stack([chosen % usable.shape[1], chosen // usable.shape[1]], 1)
    return DrawnPixels(places[:fitted], places[fitted : fitted + judged])
