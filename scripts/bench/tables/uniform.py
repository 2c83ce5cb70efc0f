"""Compare deshake with scikit-image on uniform blur, against the truth.

    python scripts/bench.py uniform
    python scripts/bench.py uniform --photos moon coffee --extent 30 --seed 2 --repeats 5

Photos that a development dependency ships, grey ones and one in colour, are enlarged twice and
blurred by a translation every half pixel, then reduced and cropped: neither what lies beyond the
border nor the operator is known. White noise is added. All methods get the same linear photo and
the same blur, and are scored in linear light: PSNR (dB) of the whole frame, and in brackets of what
lies further within than the blur's extent.

scikit-image's functions take one plane and have no border. So they get the colours one by one, and
the photo itself, or continued by its edge pixels as far as the blur reaches, or mirrored four times
as far. The truth decides which of these is best, the number of iterations, and Wiener's balance.
Times are wall times of one thread, the shortest of the repeats, with set-up.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage import restoration

from bench.cases.photos import ShakenPhoto, reduced, scene_in_frame
from bench.cases.shipped import SHIPPED
from bench.markdown import head, row
from bench.metrics import psnr
from bench.processes import fastest
from deshake.formats.transfer import Srgb, decode
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps, homographies
from deshake.operators.planes import channels_first, image_like
from deshake.restore.richardson_lucy import richardson_lucy
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.restore.wiener import point_spread
from deshake.run import Run
from deshake.simulation.shake_path import CameraPath, random_path

if TYPE_CHECKING:
    import argparse

Image = NDArray[np.float32]
Method = Callable[[Image, Image], Image]

PHOTOS = ("camera", "moon", "astronaut", "coffee")
COUNTS = (5, 10, 20, 40)
BALANCES = np.geomspace(1e-4, 10, 26)
WAYS = {"as it is": (0, "edge"), "edges": (1, "edge"), "mirrored": (4, "symmetric")}


class Level(NamedTuple):
    """PSNR (dB) of the frame and of its inner part, how it was reached, and seconds."""

    whole: float
    inner: float
    setting: str = ""
    seconds: float = np.nan

    def __str__(self) -> str:
        """Show the two as one cell of a table."""
        return f"{self.whole:.2f} ({self.inner:.2f})"


class Truth:
    """The sharp photo that a deblurred one is compared with.

    Parameters
    ----------
    sharp : (h, w) or (h, w, C) array of float32
        Linear light, 0..1.
    border : int
        Pixels that the inner part leaves out.

    """

    def __init__(self, sharp: Image, border: int) -> None:
        self.sharp, self.border = sharp, border

    def score(self, pixels: Image, setting: str = "") -> Level:
        """Score a deblurred photo."""
        ours, b = np.clip(pixels, 0, 1), self.border
        inner = psnr(ours[b:-b, b:-b], self.sharp[b:-b, b:-b])
        return Level(psnr(ours, self.sharp), inner, setting)


def shaken(name: str, extent: float, sigma: float, seed: int) -> ShakenPhoto:
    """Shift a camera about while it takes a photo."""
    scene = decode(np.asarray(SHIPPED[name]()), Srgb())
    margin = int(extent) + 6
    height, width = (side - 2 * margin for side in scene.shape[:2])
    camera = Camera.uniform(height, width)
    theta = random_path(camera, extent, seed=seed).theta * (1, 1, 0)
    theta *= extent / CameraPath(theta).extent_px(camera)
    theta, weights = CameraPath(theta).centred(camera).pieces(camera)
    fine = cv2.resize(scene, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    fine = np.maximum(fine, 0)
    blurred = np.zeros((2 * height, 2 * width, *scene.shape[2:]), np.float32)
    for h, weight in zip(homographies(camera, theta), weights, strict=True):
        blurred += np.float32(weight) * scene_in_frame(fine, h, camera)
    light = reduced(blurred)
    noise = np.random.default_rng(seed).standard_normal(light.shape, np.float32)
    kernel = RotationKernel(theta, weights, grid_steps(camera), camera)
    pixels = light + np.float32(sigma) * noise
    return ShakenPhoto(pixels, np.zeros(camera.shape, bool), kernel, fine)


def by_library(method: Method, g: Image, h: Image, way: str) -> Image:
    """Deblur a photo plane by plane, continued in one of the ways, with a point spread h."""
    reaches, mode = WAYS[way]
    border = reaches * (len(h) // 2)
    inner = slice(border, -border or None)
    planes = [
        method(np.pad(plane, border, mode=mode), h)[inner, inner] for plane in channels_first(g)
    ]
    return image_like(np.stack(planes), g)


def rl_of(count: int) -> Method:
    """Return scikit-image's Richardson-Lucy; negative light would do it harm."""
    return lambda g, h: restoration.richardson_lucy(np.maximum(g, 0), h, count, clip=False)


def wiener_of(balance: float) -> Method:
    """Return scikit-image's Wiener filter."""
    return lambda g, h: restoration.wiener(g, h, balance, clip=False)


def unsupervised(g: Image, h: Image) -> Image:
    """Filter by scikit-image's unsupervised Wiener filter."""
    return restoration.unsupervised_wiener(g, h, clip=False, rng=0)[0]


def best_of(
    methods: dict[str, Method],
    photo: ShakenPhoto,
    truth: Truth,
    repeats: int,
) -> Level:
    """Find the best of scikit-image's methods, by their settings, and way to give it the photo."""
    g, h = photo.pixels, point_spread(photo.kernel.centred())
    scores = {
        (setting, way): truth.score(by_library(method, g, h, way), f"{setting}, {way}")
        for setting, method in methods.items()
        for way in WAYS
    }
    setting, way = max(scores, key=lambda tried: scores[tried])
    seconds = fastest({way: partial(by_library, methods[setting], g, h, way)}, repeats)
    return scores[setting, way]._replace(seconds=seconds[way])


def print_iterations(photo: ShakenPhoto, truth: Truth, repeats: int) -> dict[str, Level]:
    """Compare plain Richardson-Lucy at the same iterations; return the best of both."""
    g, h = photo.pixels, point_spread(photo.kernel.centred())
    titles = ["iterations", *(f"scikit-image, {way}" for way in WAYS), "ours"]
    titles += [f"ms/iteration: {way}" for way in WAYS] + ["ours"]
    print(head(titles))
    theirs, ours = [], []
    for count in COUNTS:
        works = {way: partial(by_library, rl_of(count), g, h, way) for way in WAYS}
        plain = partial(richardson_lucy, g, photo.kernel, accelerated=False, run=Run(1))
        mine = partial(plain, iterations=count)
        seconds = fastest(works | {"ours": mine}, repeats)
        scores = [
            truth.score(work(), f"{count}, {way}")._replace(seconds=seconds[way])
            for way, work in works.items()
        ]
        own = truth.score(mine().pixels, f"{count}")._replace(seconds=seconds["ours"])
        theirs += scores
        ours.append(own)
        milliseconds = [f"{took / count * 1e3:.1f}" for took in seconds.values()]
        print(row([count, *scores, own, *milliseconds]), flush=True)
    print()
    return {"Richardson-Lucy, scikit-image": max(theirs), "Richardson-Lucy, ours": max(ours)}


def compare(photo: ShakenPhoto, truth: Truth, repeats: int) -> None:
    """Compare all methods on one photo."""
    best = print_iterations(photo, truth, repeats)
    filters = {f"balance {balance:.2g}": wiener_of(balance) for balance in BALANCES}
    best["Wiener, scikit-image"] = best_of(filters, photo, truth, repeats)
    best["unsupervised Wiener, scikit-image"] = best_of(
        {"its own balance": unsupervised}, photo, truth, repeats
    )
    default = partial(sparse_gradients, photo.pixels, photo.kernel, run=Run(1))
    seconds = fastest({"ours": default}, repeats)["ours"]
    best["default, ours"] = truth.score(default().pixels)._replace(seconds=seconds)
    print(head(["method", "PSNR, dB (inner)", "best setting", "seconds"]))
    for name, score in best.items():
        print(row([name, score, score.setting, f"{score.seconds:.2f}"]), flush=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--photos", nargs="+", choices=PHOTOS, default=["camera", "astronaut"])
    parser.add_argument("--extent", type=float, default=20.0, help="of the blur, px; default: 20")
    parser.add_argument("--sigma", type=float, default=0.01, help="of the noise; default: 0.01")
    parser.add_argument("--seed", type=int, default=1, help="of path and noise; default: 1")
    parser.add_argument("--repeats", type=int, default=3, help="default: 3")


def run(args: argparse.Namespace) -> int:
    """Run the comparison."""
    cv2.setNumThreads(1)
    for name in args.photos:
        photo = shaken(name, args.extent, args.sigma, args.seed)
        truth = Truth(photo.sharp(photo.kernel.centroid), int(np.ceil(args.extent)))
        before = Truth(photo.sharp(np.zeros(3)), truth.border).score(photo.pixels)
        height, width = photo.kernel.camera.shape
        channels = photo.pixels.size // (height * width)
        print(
            f"\n{name}, {width} x {height}, {channels} channel(s), {args.extent:g} px, noise "
            f"{args.sigma:g}; blurred: {before}\n"
        )
        compare(photo, truth, args.repeats)
    return 0
