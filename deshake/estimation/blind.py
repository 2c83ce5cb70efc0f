"""One photo to its blur kernel: the whole blind estimate (Secs. 5 and 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt
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
from deshake.operators.filter_flow import FilterFlow
from deshake.operators.shake_blur import observation_mask

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["BLUR_SHARES", "BlindEstimate", "ScaleReport", "blur_bound", "estimate_blind"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

BLUR_SHARES = (0.015, 0.025, 0.04, 0.06)
"""Bounds of the blur that are tried where none is given, in longer sides of the photo."""

_TRIAL_SIDE = 200  # px, longer side of the scale at which a bound is found too small
_LONGEST_SIDE = 640  # px, of the finest working resolution
_ENOUGH_BLUR = 22.0  # px: a blur this wide is fine enough, no larger scale is worked on
_SMALLEST_PHOTO = 48  # px, shorter side
_CONTRAST = 30.0  # rms gradient, of 0..256, that the photo is scaled to at 100 px
_CONTRAST_SIDE = 100  # px
_LEAST_CONTRAST = 0.02  # of 0..256 at 100 px: below it there is nothing to go by
_LEAST_OBSERVED = 0.05  # share of the pixels
_NOISY = 2.0  # of 0..256, in the contrast of the priors: photos above it are smoothed first
_SMOOTHING_PX = 1.0
_ITERATIONS = 12
_CUT = 0.05  # weights below this share of the largest are noise, between scales and at the end
_PRUNE = 0.004  # weights below this share of the largest are given up within a scale
_PRUNE_GAIN = 0.85
_HOPS = (32, 16)  # patch distance at the finest scale and at the coarser ones, px
_TOUCHING = 0.02  # share of the weight on the faces of the box that calls for a larger one
_CLOSE = 0.005  # the same at a coarse scale, where a larger one costs little
_STILL_PX = 1.5  # an extent below it at the working scale is no shake


@dataclass(frozen=True)
class ScaleReport:
    """How one scale ended: its size, rotations left, noise (of 0..256) and C_KL per gradient."""

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
        Agreement of the last two scales, 0..1: the cosine between their kernels, less the weight
        that lies on the bounds. It is not calibrated against known truth.
    notes : list of str
        What the user should know, in plain words.
    scales : list of ScaleReport
        From coarse to fine.

    """

    kernel: RotationKernel
    confidence: float
    notes: list[str]
    scales: list[ScaleReport]


def blur_bound(camera: Camera, max_angle: float) -> float:
    """Bound of the blur, in pixels of the photo, of turns by at most `max_angle` radians.

    The angle is the largest from one end of the shake to the other, about any axis.
    """
    return float((max_angle / grid_steps(camera)).max())


def estimate_blind(
    grey: Image,
    camera: Camera,
    *,
    clipped: Mask | None = None,
    blur_px: float | None = None,
    region: tuple[int, int, int, int] | None = None,
    uniform: bool = False,
    finest: bool = False,
    roll_rate: float = priors.ROLL_RATE,
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
        Bound of the blur in pixels of the photo. By default the smallest of `BLUR_SHARES` whose
        bounds the kernel does not touch at a coarse scale, or the one that it touches least.
    region : (x, y, width, height), optional
        The part of the photo to go by; by default all of it.
    uniform : bool
        Use the uniform model: theta_Z = 0 and a very long focal length.
    finest : bool
        Go on to the finest scale, however wide the blur is. By default the estimate ends at the
        scale where it is wide enough to be known well.
    roll_rate : float
        Rate of the prior on turns about the optical axis, `priors.ROLL_RATE`; 0 for none, where
        the camera was not in a hand.
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
    x, y, w, h = (0, 0, width, height) if region is None else region
    picture, bad = grey[y : y + h, x : x + w], np.zeros((h, w), bool)
    if clipped is not None:
        bad = clipped[y : y + h, x : x + w]
    bounds = [share * max(w, h) for share in BLUR_SHARES] if blur_px is None else [blur_px]
    bounds = [b for b in bounds if b <= min(w, h) / 2] or bounds[:1]
    _check_size(h, w, bounds[0])
    axes = (True, True, False) if uniform else ALL_AXES
    scale = min(1.0, _LONGEST_SIDE / max(h, w))
    shape = round(h * scale), round(w * scale)
    gradients = _gradients(_without_noise(resize(_scaled_contrast(picture)[None], shape)[0]))
    usable = resize(1 - bad.astype(np.float32)[None], shape)[0] > 1 - 1e-3
    tell = _rising(progress)
    trials = []
    for bound in bounds:
        plan = PyramidPlan(whole.cropped(x, y, w, h).scaled(*shape), bound * scale, axes)
        trials.append(
            _Scales(
                plan,
                gradients,
                usable,
                finest=finest,
                roll_rate=roll_rate,
                threads=threads,
                progress=tell,
            )
        )
        if len(bounds) == 1 or trials[-1].try_coarse() <= _CLOSE:
            break
    # where every kernel touches its bounds, the one that does so least is the least wrong
    scales = min(reversed(trials), key=lambda tried: tried.outermost)
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
        *,
        finest: bool,
        roll_rate: float,
        threads: int | None,
        progress: Callable[[float, str], None],
    ) -> None:
        self.plan = plan
        self.gradients = gradients
        self.usable = usable
        self.finest = finest
        self.roll_rate = roll_rate
        self.threads = threads
        self.progress = progress
        self.levels = plan.levels()
        costs = np.array([lev.camera.height * lev.camera.width + 20000 for lev in self.levels])
        self.shares = costs / costs.sum()
        self.reports: list[ScaleReport] = []
        self.notes: list[str] = []
        self.before: RotationKernel | None = None
        self.kernel: RotationKernel | None = None
        self.latent: Image | None = None

    def try_coarse(self) -> float:
        """Work through the coarse scales; return the weight that touches the bounds."""
        while self._goes_on():
            self._step()
            if max(self.levels[len(self.reports) - 1].camera.shape) >= _TRIAL_SIDE:
                break
        return self.outermost

    def run(self) -> tuple[RotationKernel, float]:
        """Work through the scales left; return the last kernel and how far to trust it."""
        while self._goes_on():
            self._step()
        self.progress(1.0, "kernel estimated")
        assert self.kernel is not None  # noqa: S101 - there is at least one level
        kept = self.kernel.above(_CUT)
        if kept.extent_px() < _STILL_PX:
            self.notes.append("no shake was found: the kernel is a single point")
        outermost = self.outermost
        if outermost > _TOUCHING:
            self.notes.append("the kernel touches its bounds: try a larger --blur-size")
        if self.before is None:
            return kept, 0.0
        return kept, _agreement(self.before.above(_CUT), kept) * (1 - outermost)

    def _goes_on(self) -> bool:
        """Whether there is a finer scale, and the blur is not wide enough yet."""
        if len(self.reports) == len(self.levels):
            return False
        if self.kernel is None or self.finest:
            return True
        return self.kernel.extent_px() * sqrt(2) <= _ENOUGH_BLUR

    def _step(self) -> None:
        """Estimate at the next scale."""
        number = len(self.reports)
        level = self.levels[number]
        if self.kernel is None or self.latent is None:
            active, f = first_kernel(level), resize(self.gradients, level.camera.shape)
        else:
            coarser = self.levels[number - 1]
            active, offset = next_kernel(self.kernel, level, self.plan.axes, cut=_CUT)
            turned = turn(self.latent, coarser.camera, -offset * coarser.steps)
            f = resize(turned, level.camera.shape)
        name = f"scale {number + 1} of {len(self.levels)}"
        self.before = self.kernel
        done, share = float(self.shares[:number].sum()), float(self.shares[number])
        self.kernel, self.latent = self._estimate(
            level, active, f, lambda part: self.progress(done + share * part, name)
        )

    @property
    def outermost(self) -> float:
        """Share of the weight on the faces of the box."""
        if self.kernel is None:
            return 0.0
        half = self.levels[len(self.reports) - 1].half
        faces = np.any((np.abs(self.kernel.indices) >= half) & (half > 0), 1)
        return float(self.kernel.weights[faces].sum())

    def _estimate(
        self,
        level: Level,
        active: RotationKernel,
        f: Image,
        advance: Callable[[float], None],
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
            advance(i / rounds)
            if i > 0:
                q = model.update_latent(q)
            problem = model.kernel_problem(q)
            q = model.update_noise(model.update_kernel(q, problem), problem)
            if i == rounds - 1:
                energy = model.free_energy(q, problem)
            elif i >= 2 and i % 2 == 0:
                keep = q.w > _PRUNE * q.w.max()
                if keep.mean() < _PRUNE_GAIN:
                    theta, q = theta[keep], _restricted(q, keep)
                    model = self._model(level, theta, g, mask)
        total = float(q.w.sum())
        noise = float(q.beta**-0.5)
        per_gradient = energy / model.count
        self.reports.append(ScaleReport(*level.camera.shape, len(theta), noise, per_gradient))
        kernel = RotationKernel(theta, q.w / total, level.steps, level.camera)
        return kernel, q.f * np.float32(total)

    def _model(
        self, level: Level, theta: NDArray[np.float64], g: Image, mask: Image
    ) -> VariationalModel:
        hop = _HOPS[min(level.index, len(_HOPS) - 1)]
        flow = FilterFlow(
            level.camera, theta, margin=0, hop=hop, channels=len(g), threads=self.threads
        )
        return VariationalModel(
            flow,
            g,
            mask,
            priors.gradients(level.index),
            roll_rate=self.roll_rate,
            roll_step=level.steps[2],
        )

    def _mask(self, level: Level, active: RotationKernel) -> Image:
        """Observed pixels: they saw only the frame, and no clipped pixel is near."""
        mask = observation_mask(level.camera, active.theta)
        if not self.usable.all():
            usable = resize(self.usable.astype(np.float32)[None], level.camera.shape)[0] > 1 - 1e-3
            # a difference needs both its pixels; further away the linear model holds
            mask *= cv2.erode(usable.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1)
        if mask.mean() < _LEAST_OBSERVED:
            msg = "too few pixels are left that are neither clipped nor near the border"
            raise EstimationError(msg, hint="give a smaller --blur-size, or another --region")
        return mask


def _rising(progress: Callable[[float, str], None] | None) -> Callable[[float, str], None]:
    """Tell of progress that never falls, however often the work starts anew."""
    highest = 0.0

    def tell(share: float, text: str) -> None:
        nonlocal highest
        highest = max(highest, share)
        if progress is not None:
            progress(highest, text)

    return tell


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


def _without_noise(image: Image) -> Image:
    """Smooth a noisy photo a little: the noise of differences puts a spike into the kernel.

    The noise is told by the median of the photo's second differences across 2 x 2 pixels.
    """
    across = image[1:, 1:] - image[1:, :-1] - image[:-1, 1:] + image[:-1, :-1]
    noise = float(np.median(np.abs(across))) / 2 / 0.6745
    if noise < _NOISY:
        return image
    smooth: Image = cv2.GaussianBlur(image, (0, 0), _SMOOTHING_PX).astype(np.float32)
    return smooth


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
