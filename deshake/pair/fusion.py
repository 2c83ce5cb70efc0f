"""Fusion of two photos of one scene: a blurred one with its kernel, and a noisy, sharp one.

The sharp photo is the f that minimises

    1/2 |(A f - g) / sigma_g|^2 + 1/2 |sqrt(v) (f - f_M) / sigma_M|^2 + tau sum |s D f|_k^p,

with the symbols of `sparse_gradients`. The blurred photo has the light and all detail that is
coarser than its blur. The noisy photo has the edges. It alone has the frequencies that the blur
removed; the prior reduces its noise there. f_M is a mean of the noisy photo and of the same photo
denoised, f_M = (1 - b) f_N + b f_D, with b = r / (r + r_0) and r = sigma_g / sigma_N. A denoiser
removes faint detail with the noise. So the better g is, the smaller is the share of f_D.

sigma_g includes the errors of the kernel. Where the photos disagree, for example where something
moved, g has no weight, and the result shows the scene of the noisy photo (`pair_weights`). v is 0
where the noisy photo has no pixels. The noisy photo is registered beyond the frame, as far as the
blur reaches, since g has light from there. s = (1 / sigma_g^2 + 1 / sigma_N^2)^(1/2), where the
second term is averaged, approximates the precision of both photos together.

The start is f_D, or where v = 0 the result of a few iterations of Richardson-Lucy. A few stages of
half-quadratic splitting follow (`half_quadratic`). Where v = 0 this is a deconvolution of the
blurred photo alone. L. Yuan, J. Sun, L. Quan and H.-Y. Shum, "Image deblurring with blurred/noisy
image pairs", ACM Transactions on Graphics 26, 2007, https://doi.org/10.1145/1276377.1276379, do not
have the term of the noisy photo.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from deshake.operators.patch_inverse import approximate_inverse
from deshake.operators.planes import channels_first, fitted
from deshake.operators.shake_blur import blur_filters
from deshake.pair.pair_weights import agreement, blurred_variance, denoising_error
from deshake.restore.lights import trust
from deshake.restore.restoration import Restoration, check_photo
from deshake.restore.richardson_lucy import latent_start
from deshake.run import Run
from deshake.signal.half_quadratic import HalfQuadratic
from deshake.signal.noise import smoothed

if TYPE_CHECKING:
    from deshake.geometry.kernel import RotationKernel
    from deshake.operators.shake_blur import Filters
    from deshake.pair.denoising import NoisyPhoto
    from deshake.restore.quality import Quality


__all__ = ["fuse"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class _Settings:
    """Weights and thresholds of the fusion.

    No record says what the values were tuned on; `bench.py pair` measures them together.

    Parameters
    ----------
    rho : two floats
        Rho of `half_quadratic` in the first and in the last stage.
    tau : float
        Weight of the prior; with more, the result is smoother.
    denoised : float32
        r_0: at sigma_g / sigma_N = r_0, f_M is half f_N and half f_D.
    precision_px : int
        Px: half side of the windows that average the noisy photo's precision for s.
    white : float
        Light: brighter clipped pixels of the noisy photo stay in use.
    black : float
        Light: darker pixels of the noisy photo may be shadows that a camera cut off.
    clipped_px : int
        Px: side of the windows that count clipped pixels.
    clipped_share : float
        Share of clipped pixels: a window with more is rejected.
    beyond : float
        Light: a clipped pixel that should be brighter is not trusted.
    alone : int
        Iterations of Richardson-Lucy where the noisy photo has no pixels.

    """

    rho: tuple[float, float] = (0.015, 1.0)
    tau: float = 0.25
    denoised: np.float32 = np.float32(0.08)
    precision_px: int = 15
    white: float = 0.9
    black: float = 0.003
    clipped_px: int = 5
    clipped_share: float = 0.5
    beyond: float = 1.05
    alone: int = 6


_SETTINGS: Final = _Settings()
_STAGES = {"fast": 5, "default": 10, "high": 16}
_PREPARING = 8.0  # duration of the preparation for the progress bar, in stages


def fuse(
    g: Image,
    noisy: NoisyPhoto,
    kernel: RotationKernel,
    *,
    valid: Image,
    clipped: Mask | None = None,
    noisy_clipped: Mask | None = None,
    quality: Quality = "default",
    iterations: int | None = None,
    run: Run = Run(),
) -> Restoration:
    """Deblur a photo with the help of a sharp but noisy one.

    The result lies in the frame of the registered noisy photo. The kernel refers to this frame; it
    is not centred.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo in linear light, 1 where it clips, after `unclipped_mean`.
    noisy : NoisyPhoto
        The noisy photo, registered and as bright as the blurred one: in its frame, or wider on all
        sides, to show the scene beyond the blurred photo's border. Its arrays may be overwritten.
    valid : (h + 2 r, w + 2 r) array of float32
        1 where the noisy photo shows the scene, else 0.
    kernel : RotationKernel
        The blur in the frame of the registered photo, for a camera of the photo's size.
    clipped, noisy_clipped : arrays of bool, optional
        Where the photos clipped, (h, w); the second one registered, of the shape of valid.
    quality : {"fast", "default", "high"}
        5, 10 or 16 stages.
    iterations : int, optional
        Number of stages instead, >= 1.
    run : Run, optional
        Threads to use, and who receives the progress.

    Returns
    -------
    Restoration

    Raises
    ------
    ValueError
        If the photos are not finite or do not fit each other, the kernel's camera or the clipped
        pixels, or the iterations are fewer than 1.

    """
    check_photo(g, kernel, clipped, iterations)
    if valid.shape != noisy.pixels.shape[1:] or g.shape[2:] not in {(), noisy.pixels.shape[:1]}:
        raise ValueError(f"a noisy photo of {noisy.pixels.shape} does not fit one of {g.shape}")
    stages = iterations or _STAGES[quality]
    _, starting, splitting = run.parts((_PREPARING / 2, _PREPARING / 2, stages))

    margin = kernel.reach_px()
    blur = blur_filters(kernel, margin=margin, channels=len(noisy.pixels), run=run)
    v = np.array(valid, np.float32)
    if noisy_clipped is not None:
        share = uniform_filter(noisy_clipped.astype(np.float32), _SETTINGS.clipped_px)
        v[(share > _SETTINGS.clipped_share) & (noisy.denoised.max(0) < _SETTINGS.white)] = 0
    latent = g.shape[0] + 2 * margin, g.shape[1] + 2 * margin
    v = fitted(v, latent, beyond=0)
    pixels, denoised = (fitted(planes, latent) for planes in (noisy.pixels, noisy.denoised))
    noisy = replace(noisy, pixels=pixels, denoised=denoised)
    alone = latent_start(
        g,
        blur_filters(kernel, margin=margin, rough=True, channels=len(noisy.pixels), run=run),
        clipped=clipped,
        iterations=_SETTINGS.alone,
        run=starting,
    )
    start = _start(g, noisy, v, alone, blur)
    del alone
    descent = _descent(g, noisy, start, blur, clipped, run=run)
    del noisy, start, v
    for stage, rho in enumerate(np.geomspace(*_SETTINGS.rho[::-1], stages)[::-1], 1):
        descent.step(float(rho))
        splitting.report(stage / stages, f"deblurring, stage {stage}")
    out = np.empty_like(g, np.float32, order="C")
    inside = descent.f[:, margin:-margin, margin:-margin]
    np.maximum(inside, 0, out=channels_first(out))
    return Restoration(out, stages, descent.residual(clipped))


class _Start(NamedTuple):
    """The first estimate f with its margin, A f, and the weights m of g and v of f_N."""

    f: Image
    Af: Image
    m: Image
    v: Image


def _start(g: Image, noisy: NoisyPhoto, v: Image, alone: Image, blur: Filters) -> _Start:
    """Start from the denoised photo where valid, else from the blurred one, deblurred alone."""
    f = noisy.denoised.copy()
    Af = blur.forward(f)
    noise = fitted(noisy.variance(), g.shape[:2])
    apart = 1 - agreement(g, Af, noise, (f.shape[1] - len(g)) // 2)
    v = v * (1 - fitted(apart * (Af.max(0) < _SETTINGS.black), v.shape))
    doubt = 1 - v
    for c, plane in enumerate(alone):
        f[c] += doubt * (plane - f[c])
    return _Start(f, blur.forward(f), 1 - apart * fitted(v, apart.shape), v)


def _descent(
    g: Image,
    noisy: NoisyPhoto,
    start: _Start,
    blur: Filters,
    clipped: Mask | None,
    *,
    run: Run,
) -> HalfQuadratic:
    """Compute the weights of all terms; the noisy photo's array becomes f_M."""
    f, Af, m, v = start
    margin = (f.shape[1] - len(g)) // 2
    frame, latent = g.shape[:2], v.shape
    compared = m * fitted(v, frame)
    variance = blurred_variance(g, Af, noisy, compared, blur=blur, margin=margin)
    noise = noisy.variance()
    r = np.sqrt(fitted(variance, latent) / noise)
    b = r / (r + _SETTINGS.denoised)
    if clipped is not None and clipped.any():
        m *= trust(f, blur, clipped & (Af.max(0) > _SETTINGS.beyond), variance)
    known = smoothed(np.reciprocal(noise), _SETTINGS.precision_px)
    known += fitted(np.reciprocal(variance), latent)  # s^2
    m /= variance * fitted(known, frame)
    q = v / (noise * (1 - b + b * denoising_error(noisy)) * known)
    f_M = noisy.pixels
    for c, plane in enumerate(noisy.denoised):
        f_M[c] += b * (plane - f_M[c])
    return HalfQuadratic(
        f,
        Af,
        np.ascontiguousarray(channels_first(g)),
        approximate_inverse(blur),
        m=m,
        s=np.sqrt(known),
        f_N=f_M,
        q=q,
        tau=_SETTINGS.tau,
        run=run,
    )
