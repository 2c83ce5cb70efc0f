"""Estimate of the kernel from a blurred photo and a noisy, sharp one: Eq. (12), Sec. 6.

The estimate runs from coarse to fine; each scale is twice as large as the one before. At the
coarsest scale the unknowns are the weights of a whole cube of rotations. At the other scales they
are those of the active region: the rotations with weight at the scale before, and their neighbours.
The data are the derivatives of both photos after a little smoothing, at pixels drawn where the
blurred photo has edges. The effect of the noisy photo's noise is subtracted (`pair_rows`), and the
photometric factor is fitted again at each scale. The frame is that of the registered noisy photo.
The kernel includes the error of the registration, and is not centred.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, exp, log, log2
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deshake.blind.bounds import check_size
from deshake.blind.trimming import most_of, strongest, without_strays
from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.pair.kernel_settings import SETTINGS
from deshake.pair.pair_pixels import (
    PairPictures,
    derivatives,
    drawn_pixels,
    noise_excess,
    usable_pixels,
)
from deshake.pair.pair_rows import PairRows
from deshake.pair.simplex import least_on_simplex
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["PairEstimate", "PairScale", "estimate_pair_kernel"]

Image = NDArray[np.float32]
Indices = NDArray[np.int64]

BLUR_SHARE = 0.06
"""Bound of the blur where none is given, in longer sides of the photo; twice as wide ones fit."""

_NOTHING = 1e-12  # mean square of edges: avoids division by 0


@dataclass(frozen=True)
class PairScale:
    """The result of one scale: its size, rotations tried and kept, the photometric factor."""

    height: int
    width: int
    tried: int
    kept: int
    scale: float


@dataclass(frozen=True, eq=False)
class PairEstimate:
    """A blur kernel from a pair of photos, and its confidence.

    Parameters
    ----------
    kernel : RotationKernel
        For the camera of the whole photo, in the frame of the registered noisy photo f_reg:
        ``g(x) = a sum_k w_k f_reg(H_k x)``.
    scale : float
        The photometric factor a.
    confidence : float
        0..1, a falling function of `unexplained`: 0.5 at 22 %.
    unexplained : float
        Share of the blurred photo's edges, noise aside, that the pair does not explain, at pixels
        that the kernel was not fitted to.
    explained : float
        Share of the best single rotation's squared error that the kernel removes.
    notes : list of str
        Notes to the user.
    scales : list of PairScale
        From coarse to fine.

    """

    kernel: RotationKernel
    scale: float
    confidence: float
    unexplained: float
    explained: float
    notes: list[str]
    scales: list[PairScale]


def estimate_pair_kernel(
    g: Image,
    f_reg: Image,
    valid: NDArray[np.generic],
    camera: Camera,
    *,
    uniform: bool = False,
    blur_size: float | None = None,
    noise: Iterable[Image] | None = None,
    blurred_noise: Image | None = None,
    run: Run = Run(),
) -> PairEstimate:
    """Estimate the blur kernel of a photo with the help of a noisy one, Eq. (12).

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo in linear light, 1 where it clips.
    f_reg : (h, w) or (h, w, C) array of float32
        The noisy photo in linear light, at any exposure, registered to within a few pixels.
    valid : (h, w) array
        Non-zero where `f_reg` is known.
    camera : Camera
        The camera of the blurred photo.
    uniform : bool
        Whether to use the uniform model: the columns of B are translations.
    blur_size : float, optional
        Bound of the blur in pixels of the photo; by default `BLUR_SHARE`.
    noise : iterable of (h, w) or (h, w, C) arrays, optional
        Pictures of noise alone, in units of `f_reg` and resampled in the same way. Two are enough.
        By default `f_reg` is treated as free of noise.
    blurred_noise : (h, w) or (h, w, C) array of float32, optional
        Noise like that of `g`; by default there is none.
    run : Run, optional
        Threads to use, and who receives the progress.

    Returns
    -------
    PairEstimate

    Raises
    ------
    EstimationError
        If the photos are too small, too flat, too much clipped or do not overlap enough.
    ValueError
        If the sizes differ.

    References
    ----------
    Whyte, Sivic, Zisserman & Ponce, CVPR 2010, Sec. 6; Yuan et al., SIGGRAPH 2007.

    """
    if len(shapes := {g.shape[:2], f_reg.shape[:2], valid.shape, camera.shape}) > 1:
        raise ValueError(f"{sorted(shapes)} are not one size")
    height, width = camera.shape
    bound = blur_size or min(BLUR_SHARE * max(height, width), min(height, width) / 4)
    check_size(height, width, bound)
    whole = Camera.uniform(height, width) if uniform else camera
    pictures = PairPictures.of(g, f_reg, valid, noise or (), blurred_noise)
    bound *= max(pictures.g.shape) / max(height, width)
    return _Scales(pictures, whole, bound, uniform=uniform, run=run).estimate()


class _Scales:
    """The state of the estimate, from scale to scale."""

    def __init__(
        self,
        pictures: PairPictures,
        camera: Camera,
        blur: float,
        *,
        uniform: bool,
        run: Run,
    ) -> None:
        self.pictures = pictures
        self.whole = camera
        self.finest = camera.scaled(*pictures.g.shape)
        self.axes = (True, True, False) if uniform else ALL_AXES
        self._run = run
        self.blur = blur
        room = int(log2(max(min(pictures.g.shape) / SETTINGS.smallest_side, 1)))
        self.coarser = min(max(ceil(log2(self.blur / SETTINGS.coarsest_blur)), 0), room)
        self.kernel = RotationKernel.delta(camera)
        self.scale = 0.0
        self.bounds = np.zeros(3)
        self.misfits, self.noise = (0.0, 0.0, 0.0), 0.0
        self.reports: list[PairScale] = []

    def estimate(self) -> PairEstimate:
        """Work through the scales."""
        count = self.coarser + 1
        self._run.report(0.0, f"scale 1 of {count}")
        self._first()
        for level in range(self.coarser - 1, -1, -1):
            fine = max(self.kernel.camera.shape) >= SETTINGS.fine_side
            if fine and 2 * most_of(self.kernel).extent_px() > SETTINGS.enough_blur:
                break
            self._run.report(1 - 4.0 ** -(count - 1 - level), f"scale {count - level} of {count}")
            active = strongest(
                without_strays(self.kernel.above(SETTINGS.cut)), SETTINGS.most_passed
            )
            start = RotationKernel.from_indices(
                2 * active.indices, active.weights, self.kernel.steps / 2, self.whole
            ).dilated(self.axes)
            self._solve(level, start.indices, start.weights)
        self._run.report(1.0, "kernel estimated")
        kernel = without_strays(self.kernel.above(SETTINGS.final_cut))
        energy, left, single = (max(part - self.noise, _NOTHING) for part in self.misfits)
        confidence = 1 / (
            1 + exp(log(left / energy / SETTINGS.even_misfit) / SETTINGS.misfit_range)
        )
        notes = []
        if most_of(kernel).extent_px() < SETTINGS.still_px:
            notes.append("no shake was found: there is nothing to undo")
        beyond = np.any(np.abs(kernel.theta) > self.bounds, 1)
        if kernel.weights[beyond].sum() > SETTINGS.touching:
            notes.append(
                "the shake may be wider than what was looked for: try a larger --blur-size"
            )
        return PairEstimate(
            kernel.for_camera(self.whole),
            self.scale,
            confidence,
            left / energy,
            1 - left / single,
            notes,
            self.reports,
        )

    def _first(self) -> None:
        """Solve for the cube at the coarsest scale."""
        reach = ceil(self.blur / 2 ** (self.coarser + 1)) + SETTINGS.spare
        box = [np.arange(-reach, reach + 1) if axis else np.zeros(1, int) for axis in self.axes]
        cube = np.stack(np.meshgrid(*box, indexing="ij"), -1).reshape(-1, 3)
        self._solve(self.coarser, cube, np.ones(len(cube)))
        self.bounds = (reach - 0.5) * self.kernel.steps

    def _solve(self, level: int, indices: Indices, start: NDArray[np.float64]) -> None:
        """Estimate the weights of some rotations, and the photometric factor, at one scale."""
        height, width = self.pictures.g.shape
        shape = round(height / 2**level), round(width / 2**level)
        camera, steps = self.finest.scaled(*shape), grid_steps(self.finest) * 2**level
        pictures = self.pictures.at(shape)
        theta = indices * steps
        usable = usable_pixels(pictures, camera, theta)
        edges = derivatives(pictures.g)
        drawn = drawn_pixels(edges, usable, level)
        if self.scale == 0:
            self.scale = _brightness(pictures.g[usable], pictures.f[usable])
        a = np.float32(self.scale)
        louder = a * np.float32(noise_excess(pictures) ** 0.5)
        f, noise = derivatives(pictures.f) * a, [derivatives(e) * louder for e in pictures.noise]
        rows = PairRows(camera, theta, f, edges, drawn.fitted, noise=noise, run=self._run)
        w = least_on_simplex(rows, start, ridge=SETTINGS.ridge)
        used = w > 0
        theta, w = theta[used], w[used]
        judge = PairRows(camera, theta, f, edges, drawn.held_out, noise=noise, run=self._run)
        self.misfits = judge.misfits(w)
        x, y = drawn.held_out.T
        self.noise = float(np.square(derivatives(pictures.own)[:, y, x]).sum() / len(judge))
        light = PairRows(
            camera,
            theta,
            pictures.f[None] * a,
            pictures.g[None],
            drawn.fitted,
            noise=[e[None] * louder for e in pictures.noise],
            run=self._run,
        )
        self.scale *= min(max(light.scale(w), 1 / SETTINGS.most_change), SETTINGS.most_change)
        self.kernel = RotationKernel(theta, w / w.sum(), steps, camera)
        self.reports.append(PairScale(*shape, len(indices), len(w), self.scale))


def _brightness(g: Image, f: Image) -> float:
    """Return the ratio of the brightness of g to that of f."""
    light = float(f.mean(dtype=np.float64))
    if not light > SETTINGS.least_light:
        raise EstimationError("the noisy photo is black", hint="it must show the same scene")
    return float(g.mean(dtype=np.float64)) / light
