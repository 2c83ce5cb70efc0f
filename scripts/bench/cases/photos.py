"""Photos with simulated shake and known truth: the cases of the restoration benchmarks.

Each photo, which a development dependency ships, is enlarged twice and blurred along a path about
all three axes by an exact warp every half pixel; then it is reduced and cropped, so that neither
what lies beyond its border nor the operator is known. Some paths are those of recorded hands, some
are drawn at random. Some photos get only white noise. Others get the noise of their photons and of
the readout, and become 8-bit JPEGs. Night scenes are exposed until their lights clip; two of them
get lamps that are a hundred times as bright as white.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures

from bench.cases.shipped import SHIPPED
from bench.hands import read_recording
from deshake.formats.transfer import Srgb, decode, encode, is_clipped
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import angle_axis, grid_steps, homographies
from deshake.simulation.shake_path import CameraPath, random_path

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

__all__ = ["CASES", "PHOTOS", "Shake", "ShakenPhoto", "shaken", "wrong"]

Image = NDArray[np.float32]

PHOTOS: dict[str, Callable[[], NDArray[np.uint8]]] = {
    **{name: SHIPPED[name] for name in ("astronaut", "coffee", "chelsea", "motorcycle")},
    **{name: SHIPPED[name] for name in ("china", "flower", "rocket")},
    "hubble": lambda: SHIPPED["hubble"]()[150:580, 200:760],
    "retina": lambda: SHIPPED["retina"]()[400:1000, 400:1000],
}
READ_NOISE = 0.002
FINE = 93  # quality from which colours are kept at full size, as cameras do
LAMP = 100  # times the clip level
EXPOSURES = (0.125, 0.8)  # s, of recorded hands


class Shake(NamedTuple):
    """How a photo is shaken.

    Parameters
    ----------
    photo : str
        One of `PHOTOS`.
    extent : float
        Of the blur, in pixels.
    seed : int
        Of the path, the noise and the lamps.
    hand : bool
        Whether the path is a recorded one.
    sigma : float
        White noise that is added, in shares of the clip level; 0 for an 8-bit JPEG.
    photons : float
        At the clip level, for an 8-bit JPEG.
    quality : int
        Of the JPEG.
    gain : float
        Exposure.
    lamps : int
        How many are added.

    """

    photo: str
    extent: float
    seed: int
    hand: bool = False
    sigma: float = 0
    photons: float = 0
    quality: int = 90
    gain: float = 1
    lamps: int = 0

    @property
    def night(self) -> bool:
        """Whether lights clip."""
        return self.gain > 1 or self.lamps > 0


CASES = {
    "astronaut": Shake("astronaut", 18, 11, hand=True, sigma=0.005),
    "coffee": Shake("coffee", 24, 12, hand=True, sigma=0.01),
    "motorcycle": Shake("motorcycle", 15, 13, sigma=0.005),
    "china": Shake("china", 12, 14, sigma=0.01, gain=0.7),
    "chelsea": Shake("chelsea", 20, 15, hand=True, sigma=0.02),
    "retina": Shake("retina", 16, 16, sigma=0.005),
    "astronaut jpeg": Shake("astronaut", 12, 1, photons=6000, quality=85),
    "motorcycle jpeg": Shake("motorcycle", 25, 4, photons=6000),
    "china jpeg": Shake("china", 14, 5, hand=True, photons=4000, quality=93, gain=0.7),
    "coffee jpeg": Shake("coffee", 20, 2, photons=3000, quality=95),
    "chelsea jpeg": Shake("chelsea", 15, 3, hand=True, photons=4000),
    "flower jpeg": Shake("flower", 30, 6, photons=1500),
    "rocket night": Shake("rocket", 15, 7, photons=6000, quality=95, gain=3),
    "hubble night": Shake("hubble", 12, 8, photons=6000, quality=95, gain=4),
    "china lamps": Shake("china", 20, 9, hand=True, photons=6000, gain=0.2, lamps=25),
    "coffee lamps": Shake("coffee", 26, 10, photons=6000, quality=95, gain=0.25, lamps=15),
}
"""Smooth photos with a shallow depth of field are coffee, chelsea and flower."""


class ShakenPhoto(NamedTuple):
    """A shaken photo, linear, where it clipped, its kernel, and the scene at twice the size."""

    pixels: Image
    clipped: NDArray[np.bool_]
    kernel: RotationKernel
    scene: Image

    def sharp(self, centroid: NDArray[np.float64]) -> Image:
        """Return the sharp photo, 0..1, as a camera saw it that a kernel's centroid turned."""
        [h] = homographies(self.kernel.camera, centroid[None])
        return np.clip(reduced(scene_in_frame(self.scene, h, self.kernel.camera)), 0, 1)


def scene_in_frame(scene: Image, h: NDArray[np.float64], camera: Camera) -> Image:
    """Warp a scene at twice the size into a frame at twice the size."""
    margin = (scene.shape[0] // 2 - camera.height) // 2
    out_of = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])
    into = np.array([[2, 0, 0.5 + 2 * margin], [0, 2, 0.5 + 2 * margin], [0, 0, 1]])
    size = 2 * camera.width, 2 * camera.height
    way = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(scene, into @ h @ out_of, size, flags=way))


def reduced(image: Image) -> Image:
    """Reduce to half the size; no light is negative."""
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return np.maximum(half, 0)


def lit(scene: Image, lamps: int, rng: np.random.Generator) -> Image:
    """Put lamps of many sizes and colours into a scene."""
    out = scene.copy()
    height, width = scene.shape[:2]
    for _ in range(lamps):
        x, y = rng.integers(width // 10, width * 9 // 10), rng.integers(height // 10, height // 2)
        light = np.float32(LAMP) * rng.uniform(0.05, 1) * rng.uniform(0.6, 1, 3)
        cv2.circle(out, (int(x), int(y)), int(rng.integers(1, 5)), light.tolist(), cv2.FILLED)
    return out


def hand_path(logs: Sequence[Path], rng: np.random.Generator) -> NDArray[np.float64]:
    """Cut a window as long as an exposure out of a log.

    The result is the orientations (T, 3) of the camera against its middle one.
    """
    times, matrices = read_recording(logs[rng.integers(len(logs))])
    exposure = rng.uniform(*EXPOSURES)
    start = times[0] + rng.uniform() * (times[-1] - times[0] - exposure)
    exposed = matrices[(times >= start) & (times < start + exposure)]
    turned = np.einsum("nij,ik->njk", exposed, exposed[len(exposed) // 2])
    return angle_axis(turned) * [1, -1, -1]  # from the phone's axes to the camera's


def path_of(case: Shake, camera: Camera, logs: Sequence[Path]) -> CameraPath:
    """Return the path that shakes a case's camera."""
    if not case.hand:
        return random_path(camera, case.extent, seed=case.seed).centred(camera)
    theta = hand_path(logs, np.random.default_rng(case.seed))
    theta = theta - theta.mean(0)
    for _ in range(3):  # displacements are nearly linear in the angles
        theta *= case.extent / CameraPath(theta).extent_px(camera)
    return CameraPath(theta).centred(camera)


def shaken(case: Shake, logs: Sequence[Path]) -> ShakenPhoto:
    """Shake a photo and expose it."""
    rng = np.random.default_rng(case.seed)
    scene = decode(np.asarray(PHOTOS[case.photo]()), Srgb()) * np.float32(case.gain)
    margin = int(case.extent) + 6
    height, width = (side - 2 * margin for side in scene.shape[:2])
    camera = Camera.from_focal(width, height, width)
    path = path_of(case, camera, logs)
    fine = cv2.resize(scene, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    fine = lit(np.maximum(fine, 0), case.lamps, rng)
    blurred = np.zeros((2 * height, 2 * width, 3), np.float32)
    theta, weights = path.pieces(camera)
    kernel = RotationKernel(theta, weights, grid_steps(camera), camera)
    for h, weight in zip(homographies(camera, theta), weights, strict=True):
        blurred += np.float32(weight) * scene_in_frame(fine, h, camera)
    light = reduced(blurred)
    if case.sigma:
        pixels = np.clip(light + rng.normal(0, case.sigma, light.shape), None, 1)
        return ShakenPhoto(pixels.astype(np.float32), (pixels >= 1).any(-1), kernel, fine)
    light = rng.poisson(light * case.photons) / case.photons
    light += rng.normal(0, READ_NOISE, light.shape)
    codes = encode(light.astype(np.float32), Srgb(), 8)
    stream = io.BytesIO()
    sampling = 0 if case.quality >= FINE else 2
    Pictures.fromarray(codes).save(stream, "JPEG", quality=case.quality, subsampling=sampling)
    codes = np.asarray(Pictures.open(stream))
    return ShakenPhoto(decode(codes, Srgb()), is_clipped(codes).any(-1), kernel, fine)


def wrong(kernel: RotationKernel, seed: int) -> RotationKernel:
    """Make a kernel about as wrong as estimates are.

    A third of its weight is spread to the neighbours on the grid, each weight is multiplied by
    e^N(0, 1/2), and all below a tenth of the largest are cut.
    """
    rng = np.random.default_rng(seed)
    indices, weights = kernel.indices, kernel.weights
    around = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    spread = [(indices, weights * 2 / 3)]
    spread += [(indices + step, weights / 18) for step in around]
    indices = np.concatenate([part[0] for part in spread])
    blurred = RotationKernel.from_indices(
        indices, np.concatenate([part[1] for part in spread]), kernel.steps, kernel.camera
    )
    weights = blurred.weights * np.exp(rng.normal(0, 0.5, len(blurred.weights)))
    jittered = RotationKernel(blurred.theta, weights / weights.sum(), blurred.steps, blurred.camera)
    return jittered.above(0.1)
