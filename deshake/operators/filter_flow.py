"""Efficient filter flow for rotations: the maps of Eqs. (7)-(9) at the cost of FFTs.

Within a patch p one filter approximates the blur, ``h_p = sum_k w_k splat(d_k(c_p))``: each
rotation moves the patch by the displacement ``d_k(c_p)`` of its centre, with bilinear weights.
Triangular windows blend the filters of neighbouring patches. Hirsch, Schuler, Harmeling &
Schoelkopf, "Fast removal of non-uniform camera shake", ICCV 2011, do the same for the rotational
model.

The cost does not depend on the number of rotations; the error against exact warps grows with how
far a rotation's displacement changes from patch to patch (`patch_hop`). A rough operator blends the
filters in narrow ramps only. Its blocks overlap less, so it takes less than half of the time, but
in the middle of a patch, where one filter acts alone, its error grows with the distance from the
centre.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deshake.geometry.rotations import displacements, homographies, reach
from deshake.operators.bilinear import filter_taps, gather, splat_taps
from deshake.operators.gram import patch_grams
from deshake.operators.local_filters import LocalFilters
from deshake.operators.patches import PatchGrid
from deshake.operators.planes import channels_first, check_size, image_like
from deshake.operators.transforms import transforms
from deshake.run import Run

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from deshake.geometry.camera import Camera
    from deshake.operators.strips import Strip

__all__ = ["FilterFlow", "checked_rotations", "checked_weights", "patch_hop"]

Image = NDArray[np.float32]

_TAPS_KEPT = 4_000_000  # (patch, rotation) pairs whose bilinear taps are kept, at most
_LEAST_HOP = 12  # px: least distance from patch to patch
_LEAST_SHARE = 0.25  # share of the blur's reach: least distance from patch to patch
_LARGEST = 640  # px: largest side of blocks, except for blurs that need larger ones
_BLOCK_EFFORT = 4096  # pixels whose time equals the fixed cost of a block
_FADE = 0.072  # px: change of displacements from patch to patch, per root of the blur's px
_BLEND = 1 / 3  # of a rough operator: share of the hop in which two filters are mixed
_PROBES = 5  # points along each side of the frame that measure this change


def patch_hop(camera: Camera, theta: ArrayLike, *, rough: bool = False) -> int:
    """Return the distance from patch to patch: the fastest with errors below 1e-3 rms of the range.

    Between two patches the filters of both are mixed. Displacements that differ by delta blur the
    picture by a second moment of up to delta^2 / 4. The Jacobian of the displacements gives the
    mean of this moment over the rotations. Its root mean square over the frame predicts the error
    against exact warps. A wider blur allows a larger error, since it leaves less detail. Of the
    distances that are short enough, the result is the one whose blocks take the least time. A very
    wide blur with much roll would need blocks many times as wide as their patches. There the
    distance is a quarter of the reach: the time stays bounded, and the error is larger. So is that
    of a rough operator.
    """
    h = homographies(camera, theta)
    along = (np.arange(_PROBES) + 0.5) / _PROBES
    x, y = np.meshgrid(along * camera.width - 0.5, along * camera.height - 0.5)
    points = np.stack([x.ravel(), y.ravel()], 1)
    here = displacements(h, points)
    moment = np.zeros(len(points))
    for step in ((1.0, 0.0), (0.0, 1.0)):
        moment += ((displacements(h, points + step) - here) ** 2).sum(-1).mean(-1)
    slope = float(np.sqrt(np.sqrt((moment**2).mean())))
    fade = _FADE * np.sqrt(max(np.ptp(here, axis=1).max(), 1.0))
    far = reach(camera, theta)
    least = max(_LEAST_HOP, int(_LEAST_SHARE * far))
    largest = int(np.clip(fade / max(slope, 1e-9), least, max(least, *camera.shape)))
    return _cheapest_hop(camera, largest, 2 * far, rough=rough)


def _cheapest_hop(camera: Camera, largest: int, around: int, *, rough: bool) -> int:
    """Return the distance, up to the largest, whose blocks take the least time in all."""
    hops: list[tuple[float, int]] = []
    length = transforms(around + 2 * _LEAST_HOP).length
    while not hops or length <= max(_LARGEST, 2 * around):
        hop = min(largest, int((length - around) / (1 + (_BLEND if rough else 1))))
        ramp = _ramp(hop, rough=rough)
        rows, columns = (-(-(side + ramp) // hop) for side in camera.shape)
        effort = transforms(around + hop + ramp).effort + _BLOCK_EFFORT
        hops.append((rows * columns * effort, hop))
        length = transforms(length + 1).length
    return min(hops)[1]


def _ramp(hop: int, *, rough: bool) -> int:
    """Return the pixels in which neighbouring patches are mixed."""
    return max(int(_BLEND * hop), 1) if rough else hop


def checked_rotations(theta: ArrayLike) -> NDArray[np.float64]:
    """Return rotations (K, 3) as float64; raise ValueError if they are something else."""
    angles = np.asarray(theta, np.float64)
    if (
        angles.ndim != 2
        or angles.shape[1] != 3
        or len(angles) == 0
        or not np.isfinite(angles).all()
    ):
        msg = f"rotations are (K, 3) finite angles, not {angles.shape}"
        raise ValueError(msg)
    return angles


def checked_weights(w: ArrayLike, count: int) -> NDArray[np.float64]:
    """Return weights (count,) as float64; raise ValueError if they are something else."""
    weights = np.asarray(w, np.float64)
    if weights.shape != (count,):
        msg = f"weights of shape {weights.shape} do not fit {count} rotations"
        raise ValueError(msg)
    return weights


class FilterFlow:
    """The rotational blur model on a set of rotations, through filter flow.

    Parameters
    ----------
    camera : Camera
        The camera of the observed photo.
    theta : (K, 3) array
        Rotations in radians.
    margin : int, optional
        Pixels by which latent images are larger on every side; by default the reach of the
        rotations, so that every observed pixel depends on latent ones only.
    hop : int, optional
        Distance between patches in pixels; by default `patch_hop`.
    rough : bool
        Whether the filters of neighbouring patches are mixed in a third of the distance only: less
        exact, and more than twice as fast where the patches are large.
    channels : int
        Expected number of channels, for the size of the batches.
    run : Run, optional
        Threads to use. The result does not depend on them.

    Raises
    ------
    ValueError
        If the rotations are not (K, 3) finite angles. The maps raise it if an image or the weights
        do not fit.

    Notes
    -----
    Images are float32, (h, w) or (h, w, C) observed and (h + 2 margin, w + 2 margin[, C]) latent.

    """

    def __init__(
        self,
        camera: Camera,
        theta: ArrayLike,
        *,
        margin: int | None = None,
        hop: int | None = None,
        rough: bool = False,
        channels: int = 1,
        run: Run = Run(),
    ) -> None:
        self.camera = camera
        self.theta = checked_rotations(theta)
        self._h = homographies(camera, self.theta)
        radius = reach(camera, self.theta)
        self.margin = radius if margin is None else margin
        if hop is None:
            hop = patch_hop(camera, self.theta, rough=rough)
        self.grid = PatchGrid(
            camera.shape,
            radius,
            hop,
            self.margin,
            ramp=_ramp(hop, rough=rough),
            channels=channels,
            run=run,
        )
        pairs = self.grid.rows * self.grid.columns * len(self.theta)
        self._taps: dict[Strip, tuple[NDArray[np.int32], Image]] | None = (
            {} if pairs <= _TAPS_KEPT else None
        )

    @property
    def latent_shape(self) -> tuple[int, int]:
        """Height and width of latent images in pixels."""
        return self.grid.latent_shape

    def filters(self, w: ArrayLike, *, power: int = 1) -> LocalFilters:
        """Bind a kernel: the operator A (or its powers' sum, ``sum_k w_k C_ijk^power``).

        Parameters
        ----------
        w : (K,) array
            Weights of the rotations.
        power : int
            1 for A itself, 2 for the squares that the variational updates need.

        Raises
        ------
        ValueError
            If there is not one weight for each rotation.

        """
        weights = checked_weights(w, len(self.theta))
        used = np.flatnonzero(weights)
        n = self.grid.reach

        def local(strip: Strip) -> Image:
            index, share = self.taps(strip)
            light = share[:, used].astype(np.float64) ** power * weights[used, None]
            return splat_taps(index[:, used].astype(np.int64), light, (n, n))

        return LocalFilters(self.grid, local)

    def blur(self, f: Image, w: ArrayLike) -> Image:
        """Blur: ``A f = B w``, linear in the latent image and in the kernel, Eq. (7)."""
        return image_like(self.filters(w).forward(channels_first(f)), f)

    def adjoint(self, g: Image, w: ArrayLike) -> Image:
        """Apply the transpose in the image: ``A^T g``, Eq. (8)."""
        return image_like(self.filters(w).adjoint(channels_first(g)), g)

    def kernel_adjoint(self, f: Image, r: Image) -> NDArray[np.float64]:
        """Apply the transpose in the kernel: ``B^T r``, (K,), Eq. (9); channels are summed."""
        total = np.zeros(len(self.theta))
        parts = self.grid.cross_correlations(channels_first(r), channels_first(f), self._gather)
        for _, part in parts:
            total += part
        return total

    def gram(
        self, f: Image, mask: Image | None = None, variance: Image | None = None
    ) -> NDArray[np.float64]:
        """Approximate ``B^T M B``, (K, K): each patch reads f at its own place.

        It is 2-9 % off: good as a Hessian beside the exact gradient. It is positive semi-definite.

        Parameters
        ----------
        f : (h, w[, C]) array
            Latent image without its margin.
        mask : (h, w) array, optional
            Weights m of the observed pixels.
        variance : (H, W[, C]) array, optional
            Variances of the latent pixels; then ``S_kl = sum_ij m_i C_ijk C_ijl var_j`` is added.

        Raises
        ------
        ValueError
            If an image has a wrong size.

        """
        planes = channels_first(f)
        check_size(planes, self.camera.shape)
        if mask is not None:
            planes = planes * np.sqrt(mask)
        n = self.grid.reach
        local: dict[Strip, Image] = {}
        if variance is not None:
            ones = np.ones(self.camera.shape, np.float32) if mask is None else mask
            local = dict(
                self.grid.cross_correlations(
                    np.broadcast_to(ones, (len(planes), *ones.shape)),
                    channels_first(variance),
                    _keep,
                )
            )

        def work(strip: Strip) -> NDArray[np.float64]:
            index, share = self.taps(strip)
            correlations = self.grid.autocorrelations(planes, strip)
            return patch_grams(*np.divmod(index, n), share, correlations, local.get(strip)).astype(
                np.float64
            )

        gram = np.zeros((len(self.theta), len(self.theta)))
        for _, part in self.grid.map_strips(work):
            gram += part
        upper = np.triu(gram)
        return upper + np.triu(upper, 1).T

    def taps(self, strip: Strip) -> tuple[NDArray[np.int32], Image]:
        """Bilinear taps of a strip's patches: places in the filter and shares, (count, K, 4)."""
        if self._taps is not None and strip in self._taps:
            return self._taps[strip]
        moved = displacements(self._h, self.grid.centres(strip))
        index, share = filter_taps(moved, self.grid.radius)
        if self._taps is not None:
            self._taps[strip] = index, share
        return index, share

    def _gather(self, strip: Strip, correlations: Image) -> NDArray[np.float64]:
        """Read the correlations of a strip's patches where each rotation moves them, (K,)."""
        return gather(correlations, *self.taps(strip))


def _keep(_: Strip, correlations: Image) -> Image:
    return correlations.copy()
