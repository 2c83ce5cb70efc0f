"""Camera shake as an operator, for deconvolution and estimation.

`RotationModel` is the bilinear map ``(f, w) -> A f = B w`` with its transposes, in two
exchangeable kinds: `FilterFlow`, fast, and `Warps`, exact. `ShakeBlur` binds a kernel to it.
Uniform blur is the special case of `Camera.uniform`. Its lens is so long that every rotation is a
translation of the whole frame. There the blur is a `Convolution`, both fast and exact.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from deshake.geometry.rotations import displacements, homographies
from deshake.operators.convolution import Convolution
from deshake.operators.filter_flow import FilterFlow
from deshake.operators.local_filters import LocalFilters
from deshake.operators.planes import channels_first, image_like
from deshake.operators.strips import Strip, bands
from deshake.operators.warps import Warps
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from deshake.geometry.camera import Camera
    from deshake.geometry.kernel import RotationKernel

__all__ = ["Filters", "RotationModel", "ShakeBlur", "blur_filters", "observation_mask"]

Image = NDArray[np.float32]
Filters = Convolution | LocalFilters
"""The operator A of a known kernel, on images (C, ., .)."""

_SPREAD = 0.01  # px: if a rotation's displacements vary by more, the blur is not uniform


class RotationModel(Protocol):
    """The four maps of Eqs. (7)-(9) on a set of K rotations."""

    camera: Camera
    theta: NDArray[np.float64]
    margin: int

    @property
    def latent_shape(self) -> tuple[int, int]:
        """Height and width of latent images in pixels."""

    def blur(self, f: Image, w: ArrayLike) -> Image:
        """Blur: ``A f = B w``."""

    def adjoint(self, g: Image, w: ArrayLike) -> Image:
        """Apply ``A^T`` to an observed image."""

    def kernel_adjoint(self, f: Image, r: Image) -> NDArray[np.float64]:
        """Apply ``B^T`` to a residual."""

    def gram(self, f: Image, mask: Image | None = None) -> NDArray[np.float64]:
        """Compute ``B^T M B``."""


class ShakeBlur:
    """The operator A of a known kernel, with an observation mask: ``f -> m . (A f)``.

    Parameters
    ----------
    kernel : RotationKernel
        The blur; only its non-zero weights are used.
    margin : int, optional
        Pixels by which the latent image is larger on every side; by default the reach of the
        kernel, so that every observed pixel depends on latent ones only.
    mask : (h, w) array, optional
        Weights m of the observed pixels, 0..1; by default 1.
    kind : "filter_flow" or "warps"
        Fast (by `blur_filters`) or exact.
    channels : int
        Expected number of channels, for the size of the batches.
    run : Run, optional
        Threads to use. The result does not depend on them.

    """

    def __init__(
        self,
        kernel: RotationKernel,
        *,
        margin: int | None = None,
        mask: Image | None = None,
        kind: Literal["filter_flow", "warps"] = "filter_flow",
        channels: int = 1,
        run: Run = Run(),
    ) -> None:
        self._forward: Callable[[Image], Image]
        self._adjoint: Callable[[Image], Image]
        self.kernel = kernel
        self.mask = mask
        theta, weights = _used(kernel)
        self.margin = kernel.reach_px() if margin is None else margin
        if kind == "warps":
            warps = Warps(kernel.camera, theta, margin=self.margin)
            self._forward = lambda f: warps.blur(f, weights)
            self._adjoint = lambda g: warps.adjoint(g, weights)
        else:
            filters = blur_filters(kernel, margin=self.margin, channels=channels, run=run)
            self._forward = lambda f: image_like(filters.forward(channels_first(f)), f)
            self._adjoint = lambda g: image_like(filters.adjoint(channels_first(g)), g)

    @property
    def observed_shape(self) -> tuple[int, int]:
        """Height and width of the observed photo in pixels."""
        return self.kernel.camera.shape

    @property
    def latent_shape(self) -> tuple[int, int]:
        """Height and width of the latent image in pixels."""
        height, width = self.observed_shape
        return height + 2 * self.margin, width + 2 * self.margin

    def forward(self, f: Image) -> Image:
        """Blur a latent image (H, W[, C]) to an observed one (h, w[, C])."""
        return self._masked(self._forward(f))

    def adjoint(self, g: Image) -> Image:
        """Apply the transpose to an observed image (h, w[, C]), giving (H, W[, C])."""
        return self._adjoint(self._masked(g))

    def _masked(self, g: Image) -> Image:
        if self.mask is None:
            return g
        masked: Image = g * (self.mask if g.ndim == self.mask.ndim else self.mask[..., None])
        return masked


def blur_filters(
    kernel: RotationKernel,
    *,
    margin: int | None = None,
    rough: bool = False,
    channels: int = 1,
    run: Run = Run(),
) -> Filters:
    """Return the filters of a kernel: one for the whole frame if the blur is uniform.

    Parameters
    ----------
    kernel : RotationKernel
        The blur; only its non-zero weights are used.
    margin : int, optional
        Pixels by which latent images are larger on every side; by default the reach of the kernel.
    rough : bool
        Whether the filters may be less exact, and take less time (`filter_flow`).
    channels : int
        Expected number of channels, for the size of the batches.
    run : Run, optional
        Threads to use. The result does not depend on them.

    Returns
    -------
    Convolution or LocalFilters
        A convolution if every rotation moves the whole frame alike, to within 0.01 pixels.

    """
    camera = kernel.camera
    theta, weights = _used(kernel)
    flow = FilterFlow(camera, theta, margin=margin, rough=rough, channels=channels, run=run)
    filters = flow.filters(weights)
    moved = displacements(homographies(camera, theta), camera.corners)
    if np.ptp(moved, axis=0).max() > _SPREAD:
        return filters
    row, column = flow.grid.rows // 2, flow.grid.columns // 2
    h = filters.filters(Strip(row, column, column + 1))[0]
    return Convolution(h, camera.shape, flow.margin, run=run)


def observation_mask(camera: Camera, theta: ArrayLike) -> Image:
    """Mark the pixels whose rotated positions all lie within the frame.

    Parameters
    ----------
    camera : Camera
        The camera of the photo.
    theta : (K, 3) array
        Every rotation that may have a weight.

    Returns
    -------
    (h, w) array of float32
        1 where all light of a pixel is from the frame, else 0.

    """
    theta = np.asarray(theta, np.float64)
    height, width = camera.shape
    # displacements are nearly linear in theta: the corners of its box bound them
    low, high = theta.min(0), theta.max(0)
    box = np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij")).reshape(3, -1).T
    h = homographies(camera, box)
    y, x = np.mgrid[0:height, 0:width].reshape(2, -1)
    inside = np.ones(height * width, bool)
    slack = 1e-3
    for part in bands(height * width, 1 << 20):
        points = np.stack([x[part], y[part]], 1).astype(np.float64)
        moved = displacements(h, points) + points[:, None]
        inside[part] = np.all(
            (moved >= -slack) & (moved <= np.array([width - 1, height - 1]) + slack), (1, 2)
        )
    return inside.reshape(height, width).astype(np.float32)


def _used(kernel: RotationKernel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the rotations that have a weight, and their weights."""
    used = kernel.weights > 0
    return kernel.theta[used], kernel.weights[used]
