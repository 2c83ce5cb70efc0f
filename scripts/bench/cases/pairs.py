"""Simulated pairs of photos: one shaken, one short, noisy and rotated against it.

The scenes, the paths and the exact warps are those of `bench.cases.photos`. The camera of the short
exposure is rotated by about a degree. Most of its noise is that of photons. The noise has the given
root mean square, measured after it is scaled to the brightness of the long exposure, which has more
photons and so less noise. Linear pairs keep their values as numbers.
Camera pairs go through two different tone curves and white balances to 8-bit JPEGs; the short one
is delivered darker and, as cameras do, denoised.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cases.camera_files import LONG_CURVE, ToneCurve
from bench.cases.photos import PHOTOS, Shake, path_of, reduced, scene_in_frame
from deshake.formats.encoding import Encoding
from deshake.formats.photo import Photo
from deshake.formats.transfer import Srgb, decode, encode, is_clipped
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import compose, displacements, grid_steps, homographies
from deshake.metadata.metadata import Metadata

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["PAIRS", "Pair", "PairCase", "shaken_pair"]

Image = NDArray[np.float32]

NOISES = (0.03, 0.06, 0.12)
RATIO = 16.0  # of the exposures
QUALITY = 92  # of the camera's JPEGs
DENOISED = 0.75  # share that the camera's denoiser has in the short exposure
BALANCE = 0.06  # how much the white balances differ, either way
BRIGHTEST = np.float32(0.95)


SHORT_CURVE = ToneCurve(RATIO**-0.5, 0.25, 0.02)


class PairCase(NamedTuple):
    """How a pair is made: the shaken photo, the noise of the other, and as files or as numbers."""

    shake: Shake
    noise: float
    camera_files: bool = False


SHAKES = {
    "astronaut": (Shake("astronaut", 16, 21, hand=True), Shake("astronaut", 24, 22), 30),
    "coffee": (Shake("coffee", 20, 31, hand=True), Shake("coffee", 14, 32), 28),
    "china": (Shake("china", 15, 41, hand=True), Shake("china", 22, 42), 32),
    "rocket": (Shake("rocket", 18, 51, hand=True), Shake("rocket", 26, 52), 22),
}


def _cases() -> dict[str, PairCase]:
    cases: dict[str, PairCase] = {}
    for scene, (hand, drawn, wide) in SHAKES.items():
        shakes = (hand, drawn, drawn._replace(extent=wide, seed=drawn.seed + 1))
        for shake in shakes:
            for noise in NOISES:
                cases[f"{scene} {shake.extent:.0f} px, {noise:g}"] = PairCase(shake, noise)
    return cases


PAIRS = _cases()


@dataclass(frozen=True)
class Pair:
    """A pair, linear light as its files have it, with the truth.

    Attributes
    ----------
    g, f_n : (h, w, 3) arrays of float32
        The shaken photo and the noisy one.
    kernel : RotationKernel
        The blur.
    theta : (3,) array
        The rotation of the noisy photo.
    scene : (H, W, 3) array
        At twice the size.
    curve : ToneCurve, optional
        That of the shaken photo, if it went through a camera.

    """

    g: Image
    f_n: Image
    kernel: RotationKernel
    theta: NDArray[np.float64]
    scene: Image
    curve: ToneCurve | None

    def sharp(self, theta: NDArray[np.float64]) -> Image:
        """Return the noiseless sharp photo of a camera so turned, as `g` would show it, linear."""
        camera = self.kernel.camera
        [h] = homographies(camera, theta[None])
        light = np.clip(reduced(scene_in_frame(self.scene, h, camera)), 0, 1)
        return light if self.curve is None else Srgb().to_linear(self.curve.develop(light))

    def photos(self) -> tuple[Photo, Photo]:
        """Return both as photos, as if they had been read from files."""
        photos = []
        for pixels in (self.g, self.f_n):
            if self.curve is None:
                clipped = (pixels >= 1).any(-1)
            else:
                clipped = is_clipped(encode(pixels, Srgb(), 8)).any(-1)
            encoding = Encoding("PNG", transfer=Srgb())
            photos.append(Photo(pixels, clipped, None, encoding, Metadata(), Path(__file__)))
        return photos[0], photos[1]

    def misplaced(self, frame: NDArray[np.float64]) -> float:
        """Return how far a frame is from that of the blur's centroid: px, rms over the photo."""
        camera = self.kernel.camera
        xs, ys = np.linspace(0, camera.width - 1, 9), np.linspace(0, camera.height - 1, 9)
        points = np.stack(np.meshgrid(xs, ys), -1).reshape(-1, 2)
        h = homographies(camera, np.stack([frame, self.kernel.centroid]))
        moved = displacements(h, points)
        return float(np.sqrt(np.square(moved[:, 0] - moved[:, 1]).sum(-1).mean()))


def shaken_pair(case: PairCase, logs: Sequence[Path]) -> Pair:
    """Make a pair."""
    shake = case.shake
    rng = np.random.default_rng(shake.seed + round(1000 * case.noise))
    scene = decode(np.asarray(PHOTOS[shake.photo]()), Srgb()) * BRIGHTEST
    margin = int(shake.extent) + 12
    height, width = (side - 2 * margin for side in scene.shape[:2])
    camera = Camera.from_focal(width, height, width)
    theta, weights = path_of(shake, camera, logs).pieces(camera)
    kernel = RotationKernel(theta, weights, grid_steps(camera), camera)
    fine = np.maximum(cv2.resize(scene, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), 0)
    blurred = np.zeros((2 * height, 2 * width, 3), np.float32)
    for h, weight in zip(homographies(camera, theta), weights, strict=True):
        blurred += np.float32(weight) * scene_in_frame(fine, h, camera)
    turn = rng.normal(size=3)
    turn *= (margin - shake.extent / 2 - 4) / np.hypot(width, height) / np.linalg.norm(turn)
    theta_0 = compose(turn, kernel.centroid[None])[0]
    [h] = homographies(camera, theta_0[None])
    long = _exposed(reduced(blurred), case.noise / RATIO**0.5, rng)
    short = _exposed(reduced(scene_in_frame(fine, h, camera)), case.noise, rng)
    if not case.camera_files:
        g = np.clip(long, 0, 1)
        return Pair(g, short / np.float32(RATIO), kernel, theta_0, fine, None)
    balance = (1 + BALANCE * rng.uniform(-1, 1, 3)).astype(np.float32)
    g = _filed(LONG_CURVE.develop(long))
    noisy = SHORT_CURVE.develop(short * balance)
    f_n = _filed((1 - DENOISED) * noisy + DENOISED * _denoised(noisy))
    return Pair(g, f_n, kernel, theta_0, fine, LONG_CURVE)


def _exposed(light: Image, noise: float, rng: np.random.Generator) -> Image:
    """Add the noise of photons and readout, of the root mean square given."""
    variance = noise**2 * (0.2 + 0.8 * light / light.mean())
    noisy: Image = (light + np.sqrt(variance) * rng.standard_normal(light.shape)).astype(np.float32)
    return noisy


def _denoised(tone: Image) -> Image:
    """Denoise as a camera does."""
    codes = np.rint(255 * tone).astype(np.uint8)
    fine = tone[..., 1] - cv2.GaussianBlur(tone[..., 1], (0, 0), 1.2)
    sigma = float(np.median(np.abs(fine)) * 1.48 * 255)
    done = cv2.fastNlMeansDenoisingColored(
        codes, None, max(0.55 * sigma, 1.0), max(sigma, 1.0), 3, 11
    )
    return done.astype(np.float32) / 255


def _filed(tone: Image) -> Image:
    """Write display values to a JPEG and read its light."""
    codes = encode(Srgb().to_linear(tone), Srgb(), 8)
    _, stream = cv2.imencode(".jpg", codes[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return decode(np.ascontiguousarray(cv2.imdecode(stream, 1)[..., ::-1]), Srgb())
