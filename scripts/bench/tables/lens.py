"""Measure the gain of removing a lens's distortion, against the truth.

    python scripts/bench.py lens

Photos that a development dependency ships serve as photos of a pinhole. They are shaken along
random paths, distorted by lensfun's profiles of some wide lenses, and exposed with noise. The true
rotations deblur them twice over the whole frame: once as if there were no lens, once straightened
before and distorted again afterwards. The table has PSNRs (dB) of display values in the photo's
geometry, over the whole frame and over its corners (the outer fifth of the diagonal), without a
border. It also has the deviation in pixels of the images of straight lines, before and after
straightening.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cases.shipped import SHIPPED
from bench.markdown import head, row
from bench.metrics import decibels, display
from deshake.formats.transfer import Srgb, decode
from deshake.geometry.camera import Camera
from deshake.geometry.distortion import distorted, pinhole
from deshake.lens.lens_profiles import find_profile
from deshake.lens.lens_warp import LensWarp
from deshake.metadata.camera_tags import CameraTags
from deshake.run import Run
from deshake.simulation.shake_path import random_path
from deshake.simulation.shaken_photo import shake
from deshake.stages.methods import restore

if TYPE_CHECKING:
    import argparse

    from deshake.simulation.shaken_photo import Shaken

Image = NDArray[np.float32]


class Lens(NamedTuple):
    """A lens of lensfun's database on a camera of some crop factor, and its focal length (mm)."""

    name: str
    focal_mm: float
    crop: float


LENSES = (
    Lens("Canon EF 24-105mm f/4L IS USM", 24, 1.0),
    Lens("E PZ 16-50mm f/3.5-5.6 OSS", 16, 1.534),
    Lens("Canon PowerShot S95 & compatibles", 6, 4.67),
)
PHOTOS = ("china", "motorcycle", "astronaut")
DIAGONAL = float(np.hypot(36, 24))
BORDER = 12  # px left out on every side
CORNERS = 0.8  # of half the diagonal: what lies farther out
NOISE = 0.003


def camera_of(lens: Lens, height: int, width: int) -> Camera:
    """Return the camera of a lens that a photo is taken through."""
    diagonal = float(np.hypot(height, width))
    focal = lens.focal_mm * lens.crop * diagonal / DIAGONAL
    tags = CameraTags(focal_mm=lens.focal_mm)
    profile = find_profile(tags, focal, (width, height), lens=lens.name)
    return Camera.from_focal(focal, height, width).with_lens(profile.distortion)


def psnrs(light: Image, sharp: Image) -> tuple[float, float]:
    """PSNR over the frame and over its corners."""
    height, width = sharp.shape[:2]
    y, x = np.mgrid[0:height, 0:width]
    far = np.hypot(x - (width - 1) / 2, y - (height - 1) / 2) / np.hypot(width / 2, height / 2)
    inside = np.zeros((height, width), bool)
    inside[BORDER:-BORDER, BORDER:-BORDER] = True
    error = np.square(display(light) - display(sharp), dtype=np.float64)
    return tuple(decibels(error[m].mean()) for m in (inside, inside & (far > CORNERS)))


def deblurred(shaken: Shaken, *, undone: bool) -> Image:
    """Deblur with the true rotations, with the lens removed or as if there were none."""
    kernel, camera = shaken.kernel, shaken.kernel.camera
    if not undone:
        plain = Camera(camera.matrix, camera.height, camera.width)
        return restore(shaken.pixels, kernel.for_camera(plain), run=Run(1)).pixels
    straight_camera = pinhole(camera, whole=True)
    warp = LensWarp(camera, straight_camera)
    straight = warp.straighten(shaken.pixels)
    return warp.bend(restore(straight, kernel.for_camera(straight_camera), run=Run(1)).pixels)


def bends(camera: Camera) -> tuple[float, float]:
    """Largest deviation of the images of straight lines, in pixels, before and after.

    Lines of the pinhole's picture are drawn, distorted and straightened again; their middles are
    measured in the pictures to a part of a pixel.
    """
    straight_camera = pinhole(camera)
    warp = LensWarp(camera, straight_camera)
    height, width = camera.shape
    at = (np.arange(height) - (height - 1) / 2) / height
    lines = [y for y in at * height if abs(y) > 0.3 * height][:: height // 8]
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    worst = [0.0, 0.0]
    for offset in lines:
        middle = offset + (height - 1) / 2
        # where photo pixels see the line: through the inverse map, as the photo would show it
        points = np.stack([np.arange(width, dtype=float), np.full(width, middle)], 1)
        there = distorted(points, camera, straight_camera)
        drawn = np.exp(-0.5 * np.square((y - np.interp(x, there[:, 0], there[:, 1])) / 1.5))
        for k, picture in enumerate((drawn, warp.straighten(drawn.astype(np.float32)))):
            columns = np.arange(width // 20, width - width // 20)
            weight = picture[:, columns] ** 2
            centre = (weight * y[:, columns]).sum(0) / weight.sum(0)
            fit = np.polyval(np.polyfit(columns, centre, 1), columns)
            worst[k] = max(worst[k], float(np.abs(centre - fit).max()))
    return worst[0], worst[1]


def measure(lens: Lens, blur_size: float, seeds: int) -> str:
    """Shake and deblur all photos through a lens; return its line of the table."""
    results = []
    for number, name in enumerate(PHOTOS):
        sharp = decode(np.ascontiguousarray(SHIPPED[name]()), Srgb())
        camera = camera_of(lens, *sharp.shape[:2])
        for seed in range(seeds):
            path = random_path(camera, blur_size, seed=10 * number + seed)
            shaken = shake(sharp, camera, path, noise_sigma=NOISE, seed=seed)
            ways = [shaken.pixels, *(deblurred(shaken, undone=way) for way in (False, True))]
            results.append([psnrs(way, shaken.sharp) for way in ways])
    table = np.array(results)  # cases, ways, parts
    before, after = bends(camera_of(lens, 400, 600))
    cells = [f"{lens.name} at {lens.focal_mm:g} mm"]
    for part in (0, 1):
        gain = table[:, 2, part] - table[:, 1, part]
        cells += [f"{mean:.1f}" for mean in table[..., part].mean(0)]
        cells.append(f"{gain.mean():+.2f} ({gain.min():+.2f})")
    return row([*cells, f"{before:.1f} px, {after:.2f} px"])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--blur-size", type=float, default=24, help="px; default: 24")
    parser.add_argument("--seeds", type=int, default=2, help="paths for each photo; default: 2")


def run(args: argparse.Namespace) -> int:
    """Run the benchmark."""
    cv2.setNumThreads(1)
    for lens in LENSES:  # an error if there are no profiles
        camera_of(lens, 400, 600)
    ways = ["blurred", "no lens", "lens undone", "gain"]
    print(head(["lens", *ways, "corners: blurred", *ways[1:], "lines bend"]))
    for lens in LENSES:
        print(measure(lens, args.blur_size, args.seeds), flush=True)
    return 0
