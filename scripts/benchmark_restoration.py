"""Compare the ways to deblur on real photos that are shaken here, with the truth in hand.

    python scripts/benchmark_restoration.py
    python scripts/benchmark_restoration.py --cases coffee,rocket --kernels true

Each photo, which a development dependency ships, is enlarged twice and blurred along a random
three-axis path by an exact warp every half pixel; then it is reduced and cropped, so that neither
what lies beyond its border nor the operator is known. It gets the noise of its photons and of its
readout, and becomes an 8-bit JPEG. Two night scenes are exposed until their lights clip.

The kernel is the path's (true), or that with a third of its weight spread to the neighbours on
the grid, each weight multiplied by e^N(0, 1/2), and all below a tenth of the largest cut (wrong):
about as wrong as estimates are.

Printed are PSNR (dB) and SSIM of display values over the whole frame, border included, and seconds
of processor time.
"""

from __future__ import annotations

import argparse
import io
import sys
import time
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures
from skimage import data
from skimage.metrics import structural_similarity
from sklearn.datasets import load_sample_image

from deshake.deconvolution.richardson_lucy import richardson_lucy
from deshake.deconvolution.sparse_gradients import sparse_gradients
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import homographies
from deshake.io.transfer import Srgb, decode, encode, is_clipped
from deshake.pipelines.camera_path import random_path

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from deshake.deconvolution.restoration import Restoration

Image = NDArray[np.float32]

PHOTOS: dict[str, Callable[[], NDArray[np.uint8]]] = {
    "astronaut": data.astronaut,
    "coffee": data.coffee,
    "chelsea": data.chelsea,
    "motorcycle": lambda: data.stereo_motorcycle()[0],
    "china": partial(load_sample_image, "china.jpg"),
    "flower": partial(load_sample_image, "flower.jpg"),
    "rocket": data.rocket,
    "hubble": lambda: data.hubble_deep_field()[150:580, 200:760],
}
METHODS = {"rl": richardson_lucy, "sparse": sparse_gradients}
KERNELS = ("true", "wrong")
READ_NOISE = 0.002
QUALITY = 90


class Case(NamedTuple):
    """How a photo is shaken: extent in pixels, light gathered at the clip level, exposure."""

    extent: float
    photons: float
    gain: float
    seed: int


CASES = {
    "astronaut": Case(15, 6000, 1, 1),
    "coffee": Case(20, 3000, 1, 2),
    "chelsea": Case(12, 4000, 1, 3),
    "motorcycle": Case(25, 6000, 1, 4),
    "china": Case(12, 2000, 1, 5),
    "flower": Case(30, 1500, 1, 6),
    "rocket": Case(15, 6000, 3, 7),
    "hubble": Case(12, 6000, 4, 8),
}


class Photo(NamedTuple):
    """A shaken photo, linear, where it clipped, its kernel, and the scene at twice the size."""

    pixels: Image
    clipped: NDArray[np.bool_]
    kernel: RotationKernel
    scene: Image

    def sharp(self, centroid: NDArray[np.float64]) -> Image:
        """Return the sharp photo, 0..1, as a camera saw it that a kernel's centroid turned."""
        [h] = homographies(self.kernel.camera, centroid[None])
        return np.clip(reduced(seen(self.scene, h, self.kernel.camera)), 0, 1)


def seen(scene: Image, h: NDArray[np.float64], camera: Camera) -> Image:
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


def shaken(name: str) -> Photo:
    """Shake, expose and compress a photo."""
    case = CASES[name]
    scene = decode(np.asarray(PHOTOS[name]()), Srgb()) * np.float32(case.gain)
    margin = int(case.extent) + 6
    height, width = (side - 2 * margin for side in scene.shape[:2])
    camera = Camera.from_focal(width, height, width)
    path = random_path(camera, case.extent, seed=case.seed).centred(camera)
    fine = cv2.resize(scene, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    fine = np.maximum(fine, 0)
    blurred = np.zeros((2 * height, 2 * width, 3), np.float32)
    theta, weights = path.pieces(camera)
    for h, weight in zip(homographies(camera, theta), weights, strict=True):
        blurred += np.float32(weight) * seen(fine, h, camera)
    light = reduced(blurred)
    rng = np.random.default_rng(case.seed)
    light = rng.poisson(light * case.photons) / case.photons
    light += rng.normal(0, READ_NOISE, light.shape)
    stream = io.BytesIO()
    codes = encode(light.astype(np.float32), Srgb(), 8)
    Pictures.fromarray(codes).save(stream, "JPEG", quality=QUALITY)
    codes = np.asarray(Pictures.open(stream))
    clipped = is_clipped(codes).any(-1)
    return Photo(decode(codes, Srgb()), clipped, path.kernel(camera), fine)


def wrong(kernel: RotationKernel, seed: int) -> RotationKernel:
    """Make a kernel as wrong as estimates are."""
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


def display(light: Image) -> NDArray[np.float64]:
    """Return display values, 0..1, of linear light."""
    return np.asarray(Srgb().from_linear(np.clip(light, 0, 1)), np.float64)


def score(light: Image, sharp: Image) -> tuple[float, float]:
    """PSNR in dB and SSIM of display values."""
    ours, truth = display(light), display(sharp)
    psnr = -10 * np.log10(np.mean((ours - truth) ** 2))
    ssim = structural_similarity(ours, truth, data_range=1, channel_axis=2)
    return float(psnr), float(ssim)


def restore(
    method: Callable[..., Restoration], photo: Photo, kernel: RotationKernel, threads: int | None
) -> tuple[float, float, float]:
    """Deblur a photo; return PSNR, SSIM and processor seconds."""
    start = time.process_time()
    restored = method(photo.pixels, kernel, clipped=photo.clipped, threads=threads)
    seconds = time.process_time() - start
    return *score(restored.pixels, photo.sharp(kernel.centroid)), seconds


def main(argv: Sequence[str] | None = None) -> int:
    """Run the comparison."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = partial(str.split, sep=",")
    parser.add_argument("--cases", type=names, default=list(CASES), help="default: all 8")
    parser.add_argument("--kernels", type=names, default=list(KERNELS), help="default: true,wrong")
    parser.add_argument("--threads", type=int, help="default: one a processor")
    args = parser.parse_args(argv)
    head = "".join(f" | {method:^21}" for method in METHODS)
    print(f"{'photo':<11}{'kernel':<7}{'blurred':>12}{head}   (dB, SSIM, CPU s)")
    for kind in args.kernels:
        gains = []
        for name in args.cases:
            photo = shaken(name)
            kernel = photo.kernel if kind == "true" else wrong(photo.kernel, CASES[name].seed)
            before = score(photo.pixels, photo.sharp(np.zeros(3)))
            found = [restore(m, photo, kernel, args.threads) for m in METHODS.values()]
            gains.append([psnr - before[0] for psnr, _, _ in found])
            row = "".join(f" | {p:7.2f} {s:6.3f} {t:6.1f}" for p, s, t in found)
            print(f"{name:<11}{kind:<7}{before[0]:6.2f} {before[1]:5.3f}{row}", flush=True)
        mean = "".join(f" | {gain:+7.2f} {'':13}" for gain in np.mean(gains, 0))
        print(f"{'gain, dB':<11}{kind:<7}{'':12}{mean}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
