"""One scale of the estimate by sharp edges: latent picture and kernel in turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deshake.estimation.kernel_step import fitted_weights, normal_equations
from deshake.estimation.latent_edges import (
    Observation,
    differences,
    edge_gradients,
    l0_picture,
    strong_gradients,
)
from deshake.geometry.kernel import RotationKernel
from deshake.operators.filter_flow import reach
from deshake.operators.patch_solve import PatchFrame, PatchSolver, patch_size

__all__ = ["EdgeScale"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_BETA_MAX = 16.0


class EdgeScale:
    """One scale of the estimate: the observed picture, and the latent one under way.

    Parameters
    ----------
    kernel : RotationKernel
        All rotations that may get a weight, for the camera of this scale.
    grey : (h, w) array of float32
        The picture, in the contrast of `contrast_scaled`.
    usable : (h, w) array of bool, optional
        Pixels to be believed; by default all.
    threads : int, optional
        Threads to use; by default all processors. Results do not depend on it.

    """

    def __init__(
        self, kernel: RotationKernel, grey: Image, usable: Mask | None, threads: int | None
    ) -> None:
        camera = kernel.camera
        far = reach(camera, kernel.theta)
        self.seen = Observation.of(grey, max(2 * far, 8), usable)
        patch = None if camera.is_uniform else patch_size(camera, kernel.theta)
        margin = self.seen.margin
        self.solving = PatchFrame(camera, margin=margin, room=far + 4, patch=patch, threads=threads)
        self.fitting = PatchFrame(camera, margin=margin, room=2 * far, patch=patch, threads=threads)
        self.filled = self.latent = self.seen.picture
        # Gradients count beside pixels that are not to be believed, too: without them the strongest
        # edges, those of lights, would be missed, and kernels collapse.
        frame = np.zeros(self.filled.shape, np.float32)
        frame[margin : -margin - 1, margin : -margin - 1] = 1
        across, down = differences(self.seen.picture)
        self.gradients = across * frame, down * frame
        # edges whose blur is not wholly within it would be missed
        inner = margin + min(max(far // 2, 1), min(camera.shape) // 8)
        self.interior = np.zeros(self.filled.shape, np.float32)
        self.interior[inner:-inner, inner:-inner] = 1

    def edges(self, kernel: RotationKernel, lam: float, *, shock: bool) -> tuple[Image, Image]:
        """Gradients of the latent picture under a kernel; fill in what is not known."""
        across, down = self._update_latent(kernel, lam)
        if shock:
            across, down = edge_gradients(self.latent, lam)
        return across * self.interior, down * self.interior

    def strong_edges(self, kernel: RotationKernel, lam: float) -> tuple[Image, Image]:
        """Gradients as the latent picture has them, where they are worth their price."""
        self._update_latent(kernel, lam)
        across, down = strong_gradients(self.latent, lam)
        return across * self.interior, down * self.interior

    def _update_latent(self, kernel: RotationKernel, lam: float) -> tuple[Image, Image]:
        used = kernel.weights > 0
        solver = PatchSolver(self.solving, kernel.theta[used], kernel.weights[used])
        self.latent, across, down = l0_picture(solver, self.filled, lam, beta_max=_BETA_MAX)
        self.filled = self.seen.filled(solver.forward(self.latent))
        return across, down

    def latent_gradients(self) -> Image:
        """Gradients (2, h, w) of the last latent picture, before any filter or threshold."""
        margin = self.seen.margin
        return np.stack(differences(self.latent))[:, margin:-margin, margin:-margin]

    def refined(
        self, kernel: RotationKernel, edges: tuple[Image, Image], *, cut: float
    ) -> RotationKernel:
        """Estimate the weights anew from the edges; the same kernel where there are none."""
        indices = kernel.indices
        fit = normal_equations(self.fitting, indices, kernel.steps, edges, self.gradients)
        weights = fitted_weights(fit, indices, kernel.weights, cut=cut)
        return RotationKernel(kernel.theta, weights, kernel.steps, kernel.camera)
