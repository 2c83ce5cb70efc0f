"""One photo to its blur kernel: the whole blind estimate (Secs. 5 and 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.errors import EstimationError
from deshake.estimation import priors
from deshake.estimation.coarse_to_fine import (
    Level,
    PyramidPlan,
    first_kernel,
    next_kernel,
    resize,
    turn,
)
from deshake.estimation.variational import Posterior, VariationalModel, start
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.filter_flow import FilterFlow, reach
from deshake.operators.shake_blur import observation_mask

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["DEFAULT_BLUR_SHARE", "BlindEstimate", "ScaleReport", "blur_bound", "estimate_blind"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

DEFAULT_BLUR_SHARE = 0.05
"""Bound of the blur where none is given, in longer sides of the photo."""

_LONGEST_SIDE = 640  # px, of the finest working resolution
_ENOUGH_BLUR = 22.0  # px: a blur this wide is fine enough, no larger scale is worked on
_SMALLEST_PHOTO = 48  # px, shorter side
_CONTRAST = 30.0  # rms gradient, of 0..256, that the photo is scaled to at 100 px
_CONTRAST_SIDE = 100  # px
_LEAST_CONTRAST = 0.02  # of 0..256 at 100 px: below it there is nothing to go by
_LEAST_OBSERVED = 0.05  # share of the pixels
_ITERATIONS = 12
_CUT = 0.05  # weights below this share of the largest are noise, between scales and at the end
_PRUNE = 0.004  # weights below this share of the largest are given up within a scale
_PRUNE_GAIN = 0.85
_HOPS = (24, 16)  # patch distance at the finest scale and at the coarser ones, px
_TOUCHING = 0.02  # share of the weight on the faces of the box that calls for a larger one
_STILL_PX = 1.5  # an extent below it at the working scale is no shake


@dataclass(frozen=True)
class ScaleReport:
    """How one scale ended."""

    height: int
    width: int
    rotations: int
    noise: float
    free_energy: float


@dataclass(frozen=True, eq=False)
class BlindEstimate:
    """A blur kernel and how far to trust it.

    Parameters
    ----------
    kernel : RotationKernel
        The kernel, for the camera of the whole photo.
    confidence : float
        Agreement of the last two scales, 0..1: the cosine between their kernels. It is not
        calibrated against known truth.
    notes : list of str
        What the user should know, in plain words.
    scales : list of ScaleReport
        From coarse to fine.

    """

    kernel: RotationKernel
    confidence: float
    notes: list[str]
    scales: list[ScaleReport]


def blur_bound(
    camera: Camera, *, blur_px: float | None = None, max_angle: float | None = None
) -> float:
    """Bound of the blur in pixels of the photo, from a size, an angle or the default.

    Parameters
    ----------
    camera : Camera
        The camera of the photo.
    blur_px : float, optional
        Largest blur in pixels.
    max_angle : float, optional
        Largest turn about any axis during the exposure, in radians.

    """
    if blur_px is not None:
        return blur_px
    if max_angle is not None:
        return float((max_angle / grid_steps(camera)).max())
    return DEFAULT_BLUR_SHARE * max(camera.shape)


def estimate_blind(  # noqa: PLR0913
    grey: Image,
    camera: Camera,
    *,
    clipped: Mask | None = None,
    blur_px: float | None = None,
    region: tuple[int, int, int, int] | None = None,
    uniform: bool = False,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> BlindEstimate:
    """Estimate the blur kernel of one photo by variational inference, coarse to fine.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, 0..1.
    camera : Camera
        Its camera.
    clipped : (h, w) array of bool, optional
        Pixels that are not to be believed.
    blur_px : float, optional
        Bound of the blur in pixels of the photo; by default 5 % of its longer side.
    region : (x, y, width, height), optional
        The part of the photo to go by; by default all of it.
    uniform : bool
        Use the uniform model: theta_Z = 0 and a very long focal length.
    threads : int, optional
        Threads to use; by default all processors.
    progress : callable, optional
        Called with the share done, 0..1, and a text.

    Raises
    ------
    EstimationError
        If the photo is too small, too flat or too much clipped.

    References
    ----------
    Whyte, Sivic, Zisserman & Ponce, CVPR 2010, Sec. 5; MacKay & Miskin 2000; Fergus et al. 2006.

    """
    height, width = grey.shape
    whole = Camera.uniform(height, width) if uniform else camera
    bound = blur_px if blur_px is not None else blur_bound(camera)
    x, y, w, h = (0, 0, width, height) if region is None else region
    picture, bad = grey[y : y + h, x : x + w], np.zeros((h, w), bool)
    if clipped is not None:
        bad = clipped[y : y + h, x : x + w]
    _check_size(h, w, bound)
    axes = (True, True, False) if uniform else ALL_AXES
    scale = min(1.0, _LONGEST_SIDE / max(h, w))
    shape = round(h * scale), round(w * scale)
    plan = PyramidPlan(whole.cropped(x, y, w, h).scaled(*shape), bound * scale, axes)
    finest = resize(_scaled_contrast(picture)[None], shape)[0]
    usable = resize(1 - bad.astype(np.float32)[None], shape)[0]
    scales = _Scales(plan, _gradients(finest), usable > 1 - 1e-3, threads, progress)
    kernel, confidence = scales.run()
    notes = scales.notes
    final = RotationKernel(kernel.theta, kernel.weights, kernel.steps, whole).centred()
    return BlindEstimate(final, confidence, notes, scales.reports)


class _Scales:
    """The estimate under way, scale by scale."""

    def __init__(
        self,
        plan: PyramidPlan,
        gradients: Image,
        usable: Mask,
        threads: int | None,
        progress: Callable[[float, str], None] | None,
    ) -> None:
        self.plan = plan
        self.gradients = gradients
        self.usable = usable
        self.threads = threads
        self.progress = progress or (lambda _share, _text: None)
        self.reports: list[ScaleReport] = []
        self.notes: list[str] = []
        self.done = 0.0

    def run(self) -> tuple[RotationKernel, float]:
        """Work through the scales; return the last kernel and how the last two agree."""
        levels = self.plan.levels()
        costs = np.array([level.camera.height * level.camera.width + 20000 for level in levels])
        shares = costs / costs.sum()
        kernel: RotationKernel | None = None
        before: RotationKernel | None = None
        latent = level_before = None
        for number, level in enumerate(levels):
            name = f"scale {number + 1} of {len(levels)}"
            if kernel is None or latent is None or level_before is None:
                active, f = first_kernel(level), resize(self.gradients, level.camera.shape)
            else:
                if kernel.extent_px() * np.sqrt(2) > _ENOUGH_BLUR:
                    break
                active, offset = next_kernel(kernel, level, self.plan.axes, cut=_CUT)
                turned = turn(latent, level_before.camera, -offset * level_before.steps)
                f = resize(turned, level.camera.shape)
            before = kernel
            kernel, latent = self._estimate(level, active, f, name, float(shares[number]))
            level_before = level
            self.done += float(shares[number])
        self.progress(1.0, "kernel estimated")
        assert kernel is not None  # noqa: S101 - there is at least one level
        self._judge(kernel, level_before)
        kept = kernel.above(_CUT)
        return kept, 0.0 if before is None else _agreement(before.above(_CUT), kept)

    def _estimate(
        self, level: Level, active: RotationKernel, f: Image, name: str, share: float
    ) -> tuple[RotationKernel, Image]:
        """Infer kernel and gradients at one scale."""
        g = resize(self.gradients, level.camera.shape)
        mask = self._mask(level, active)
        theta = active.theta
        model = self._model(level, theta, g, mask)
        q = model.update_latent(start(f, active.weights))
        rounds = _ITERATIONS + (0 if self.reports else 2)
        energy = np.inf
        for i in range(rounds):
            self.progress(self.done + share * i / rounds, name)
            if i > 0:
                q = model.update_latent(q)
            problem = model.kernel_problem(q)
            q = model.update_noise(model.update_kernel(q, problem), problem)
            if i == rounds - 1:
                energy = model.free_energy(q, problem)
            elif i >= 2 and i % 2 == 0:  # noqa: PLR2004
                keep = q.w > _PRUNE * q.w.max()
                if keep.mean() < _PRUNE_GAIN:
                    theta, q = theta[keep], _restricted(q, keep)
                    model = self._model(level, theta, g, mask)
        total = float(q.w.sum())
        noise = float(q.beta**-0.5)
        self.reports.append(ScaleReport(*level.camera.shape, len(theta), noise, energy))
        return RotationKernel(theta, q.w / total, level.steps, level.camera), q.f * np.float32(total)

    def _model(
        self, level: Level, theta: NDArray[np.float64], g: Image, mask: Image
    ) -> VariationalModel:
        hop = _HOPS[min(level.index, len(_HOPS) - 1)]
        flow = FilterFlow(
            level.camera, theta, margin=0, hop=hop, channels=len(g), threads=self.threads
        )
        return VariationalModel(flow, g, mask, priors.gradients(level.index))

    def _mask(self, level: Level, active: RotationKernel) -> Image:
        """Observed pixels: they saw only the frame, and no clipped pixel is near."""
        mask = observation_mask(level.camera, active.theta)
        if not self.usable.all():
            usable = resize(self.usable.astype(np.float32)[None], level.camera.shape)[0] > 1 - 1e-3
            around = reach(level.camera, active.theta)
            box = np.ones((2 * around + 1, 2 * around + 1), np.uint8)
            mask *= cv2.erode(usable.astype(np.uint8), box, borderValue=1)
        if mask.mean() < _LEAST_OBSERVED:
            msg = "too few pixels are left that are neither clipped nor near the border"
            raise EstimationError(msg, hint="give a smaller --blur-size, or another --region")
        return mask

    def _judge(self, kernel: RotationKernel, level: Level | None) -> None:
        """Note what the user should know of the kernel."""
        if kernel.above(_CUT).extent_px() < _STILL_PX:
            self.notes.append("no shake was found: the kernel is a single point")
        if level is None:
            return
        index = np.abs(kernel.indices)
        faces = np.any((index >= level.half) & (level.half > 0), 1)
        if kernel.weights[faces].sum() > _TOUCHING:
            self.notes.append("the kernel touches its bounds: try a larger --blur-size")


def _check_size(height: int, width: int, bound: float) -> None:
    if min(height, width) < _SMALLEST_PHOTO:
        msg = f"{width}x{height} pixels are too few to estimate a blur kernel from"
        hint = f"the shorter side must have at least {_SMALLEST_PHOTO} pixels"
        raise EstimationError(msg, hint=hint)
    if not 1 <= bound <= min(height, width) / 2:
        msg = f"a blur of {bound:.0f} px does not fit {width}x{height} pixels"
        hint = "give a --blur-size between 1 and half the shorter side"
        raise EstimationError(msg, hint=hint)


def _scaled_contrast(grey: Image) -> Image:
    """Scale a photo to the contrast that the gradient priors were learnt at."""
    scale = min(1.0, _CONTRAST_SIDE / max(grey.shape))
    shape = max(round(grey.shape[0] * scale), 2), max(round(grey.shape[1] * scale), 2)
    small = resize(grey[None], shape)[0] * priors.INTENSITY_RANGE
    across, down = np.diff(small, axis=1)[:-1], np.diff(small, axis=0)[:, :-1]
    contrast = float(np.sqrt((across**2 + down**2).mean()))
    if not contrast > _LEAST_CONTRAST:
        msg = "there is no texture to estimate a blur kernel from"
        raise EstimationError(msg, hint="the photo is all of one colour, or nearly so")
    scaled: Image = grey * np.float32(priors.INTENSITY_RANGE * _CONTRAST / contrast)
    return scaled


def _gradients(image: Image) -> Image:
    """Differences to the right and lower neighbour, (2, h, w), zero at the far edges."""
    out = np.zeros((2, *image.shape), np.float32)
    np.subtract(image[:, 1:], image[:, :-1], out=out[0, :, :-1])
    np.subtract(image[1:], image[:-1], out=out[1, :-1])
    return out


def _restricted(q: Posterior, keep: Mask) -> Posterior:
    return replace(q, w=q.w[keep], w_var=q.w_var[keep], w_entropy=q.w_entropy[keep])


def _agreement(coarse: RotationKernel, fine: RotationKernel) -> float:
    """Cosine between a kernel and the one of the scale before, on the coarser grid."""

    def smooth(kernel: RotationKernel) -> dict[tuple[int, ...], float]:
        onto = kernel.centred().resampled(coarse.steps * 1.5)
        return {tuple(i): w for i, w in zip(onto.indices.tolist(), onto.weights, strict=True)}

    a, b = smooth(coarse), smooth(fine)
    dot = sum(w * b.get(i, 0.0) for i, w in a.items())
    norms = sum(w * w for w in a.values()) * sum(w * w for w in b.values())
    return float(min(dot / np.sqrt(norms), 1.0))
