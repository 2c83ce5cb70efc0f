"""The variational estimate of one photo, scale by scale (Secs. 5 and 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.variational import priors
from deshake.blind.variational.coarse_to_fine import (
    Level,
    PyramidPlan,
    first_kernel,
    latent_differences,
    next_kernel,
    resize,
    turn,
)
from deshake.blind.variational.posterior import Posterior, start
from deshake.blind.variational.settings import SETTINGS
from deshake.blind.variational.updates import VariationalModel
from deshake.errors import EstimationError
from deshake.geometry.kernel import RotationKernel
from deshake.operators.filter_flow import FilterFlow
from deshake.operators.shake_blur import observation_mask

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.run import Run

__all__ = ["ScaleByScale", "ScaleReport"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ScaleReport:
    """The result of one scale: size, rotations, noise (scaled photo, 0..256), C_KL per gradient."""

    height: int
    width: int
    rotations: int
    noise: float
    free_energy: float


class ScaleByScale:
    """The state of an estimate, scale by scale."""

    def __init__(
        self,
        plan: PyramidPlan,
        gradients: Image,
        usable: Mask,
        *,
        finest: bool,
        roll_rate: float,
        run: Run,
    ) -> None:
        self.plan = plan
        self.gradients = gradients
        self.usable = usable
        self.finest = finest
        self.roll_rate = roll_rate
        self._run = run
        self.levels = plan.levels()
        costs = np.array([lev.camera.height * lev.camera.width + 20000 for lev in self.levels])
        self.shares = costs / costs.sum()
        self.reports: list[ScaleReport] = []
        self.notes: list[str] = []
        self.before: RotationKernel | None = None
        self.kernel: RotationKernel | None = None
        self.latent: Image | None = None

    def try_coarse(self) -> float:
        """Solve the coarse scales; return the weight that touches the bounds."""
        while self._continues():
            self._step()
            if max(self.levels[len(self.reports) - 1].camera.shape) >= SETTINGS.trial_side:
                break
        return self.outermost

    def run(self) -> tuple[RotationKernel, float]:
        """Solve the remaining scales; return the last kernel and its confidence."""
        while self._continues():
            self._step()
        self._run.report(1.0, "kernel estimated")
        assert self.kernel is not None  # noqa: S101 - there is at least one level
        kept = self.kernel.above(SETTINGS.cut)
        if kept.extent_px() < SETTINGS.still_px:
            self.notes.append("no shake was found: there is nothing to undo")
        outermost = self.outermost
        if outermost > SETTINGS.touching:
            self.notes.append(
                "the shake may be wider than what was looked for: try a larger --blur-size"
            )
        if self.before is None:
            return kept, 0.0
        return kept, _agreement(self.before.above(SETTINGS.cut), kept) * (1 - outermost)

    def latent_gradients(self) -> Image:
        """Return the sharp picture's differences to the right and lower neighbour, (2, h, w).

        At the last scale, in the frame of the kernel's centroid.
        """
        assert self.kernel is not None  # noqa: S101 - there is at least one level
        assert self.latent is not None  # noqa: S101
        level = self.levels[len(self.reports) - 1]
        return latent_differences(self.latent, level, self.kernel.above(SETTINGS.cut).centroid)

    def _continues(self) -> bool:
        """Whether there is a finer scale, and the blur is not wide enough yet."""
        if len(self.reports) == len(self.levels):
            return False
        if self.kernel is None or self.finest:
            return True
        return self.kernel.extent_px() * sqrt(2) <= SETTINGS.enough_blur

    def _step(self) -> None:
        """Estimate at the next scale."""
        number = len(self.reports)
        level = self.levels[number]
        if self.kernel is None or self.latent is None:
            active, f = first_kernel(level), resize(self.gradients, level.camera.shape)
        else:
            coarser = self.levels[number - 1]
            active, offset = next_kernel(self.kernel, level, self.plan.axes, cut=SETTINGS.cut)
            turned = turn(self.latent, coarser.camera, -offset * coarser.steps)
            f = resize(turned, level.camera.shape)
        name = f"scale {number + 1} of {len(self.levels)}"
        self.before = self.kernel
        done, share = float(self.shares[:number].sum()), float(self.shares[number])
        run = self._run.part(done, done + share)
        self.kernel, self.latent = self._estimate(
            level, active, f, lambda part: run.report(part, name)
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
        rounds = SETTINGS.iterations + (0 if self.reports else 2)
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
                keep = q.w > SETTINGS.prune * q.w.max()
                if keep.mean() < SETTINGS.prune_gain:
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
        hop = SETTINGS.hops[min(level.index, len(SETTINGS.hops) - 1)]
        flow = FilterFlow(level.camera, theta, margin=0, hop=hop, channels=len(g), run=self._run)
        return VariationalModel(
            flow,
            g,
            mask,
            priors.gradients(level.index),
            roll_rate=self.roll_rate,
            roll_step=level.steps[2],
        )

    def _mask(self, level: Level, active: RotationKernel) -> Image:
        """Return the observed pixels: their light is from the frame, and none near is clipped."""
        mask = observation_mask(level.camera, active.theta)
        if not self.usable.all():
            usable = resize(self.usable.astype(np.float32)[None], level.camera.shape)[0] > 1 - 1e-3
            # a difference needs both its pixels; a clipped pixel further away does no harm
            mask *= cv2.erode(usable.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1)
        if mask.mean() < SETTINGS.least_observed:
            msg = "too few pixels are left that are neither clipped nor near the border"
            raise EstimationError(msg, hint="give a smaller --blur-size, or another --region")
        return mask


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
