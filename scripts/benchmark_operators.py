"""Measure the cost of the operators, against the bare FFTs of the same blocks, in one run.

    python scripts/benchmark_operators.py [--megapixels 12] [--extent 15 30 60] [--threads 4]

Each map is timed in turn with SciPy's rfft2 + irfft2 of as many blocks, in the same batches, by the
same threads, and with the transforms that the maps really use, which may be faster; the best of the
repeats counts. Ratios are the cost of the maps over that of their FFTs: of A, A^T
and P, the approximate inverse patch by patch, and of B^T. Memory is the peak that NumPy allocates
while a map runs, with its result, but without earlier arrays such as stored spectra.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from collections.abc import Callable
from typing import TYPE_CHECKING

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.filter_flow import FilterFlow
from deshake.operators.patch_inverse import PatchInverse
from deshake.operators.warps import Warps
from deshake.run import Run, available_threads

if TYPE_CHECKING:
    from deshake.operators.strips import Strip
    from deshake.operators.transforms import Transforms

Image = NDArray[np.float32]
Work = Callable[[], object]


def main() -> None:
    """Run all the measurements and print them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--megapixels", type=float, default=12.0)
    parser.add_argument("--extent", type=float, nargs="+", default=[15.0, 30.0, 60.0])
    parser.add_argument("--threads", type=int, default=available_threads())
    parser.add_argument("--repeats", type=int, default=5)
    args = parser.parse_args()
    cv2.setNumThreads(args.threads)
    width = round((args.megapixels * 1e6 * 4 / 3) ** 0.5)
    camera = Camera.from_focal(width, round(width * 0.75), width)
    print(f"{width} x {camera.height} pixels, {args.threads} threads, best of {args.repeats}")

    for channels in (3, 1):
        print(f"\nby extent of the blur (about 300 rotations, {channels} channels)")
        for extent in args.extent:
            print_maps(camera, shake(camera, extent, 300), channels, args)
    print("\nby number of rotations (30 px, 1 channel)")
    for count in (30, 300, 3000):
        print_maps(camera, shake(camera, 30, count), 1, args)
    print("\nexact warps (30 px, 1 channel), time for each rotation")
    print_warps(camera, shake(camera, 30, 300))
    print("\nGram matrices of gradients (2 channels)")
    for height, wide in ((240, 320), (480, 640)):
        for count in (300, 1000, 2000):
            print_gram(Camera.from_focal(wide, height, wide), count, args)


def shake(camera: Camera, extent: float, count: int) -> RotationKernel:
    """Make a curved three-axis shake of about so many pixels and so many rotations."""
    t = np.linspace(0, 1, 400)
    path = np.stack([np.sin(5 * t), 1.5 * t, 0.4 * np.sin(9 * t + 1)], 1)
    path -= path.mean(0)
    size = 1e-3
    for _ in range(3):
        kernel = RotationKernel.from_path(path * size, camera)
        size *= extent / kernel.extent_px()
    path *= size
    # more rotations lie closer together, fewer further apart
    low, high = 0.01, 100.0
    for _ in range(40):
        middle = (low * high) ** 0.5
        kernel = RotationKernel.from_path(path, camera, steps=np.full(3, middle * 1e-3))
        low, high = (middle, high) if len(kernel.weights) > count else (low, middle)
        if abs(len(kernel.weights) - count) < 0.05 * count:
            break
    return kernel


def print_maps(
    camera: Camera, kernel: RotationKernel, channels: int, args: argparse.Namespace
) -> None:
    """Time A f, A^T g, P f and B^T r against the FFTs of their blocks."""
    flow = FilterFlow(camera, kernel.theta, channels=channels, run=Run(args.threads))
    rng = np.random.default_rng(0)
    tail = () if channels == 1 else (channels,)
    f = rng.random((*flow.latent_shape, *tail), np.float32)
    g = rng.random((*camera.shape, *tail), np.float32)
    planes = f[None] if channels == 1 else np.moveaxis(f, -1, 0)
    blurred_planes = g[None] if channels == 1 else np.moveaxis(g, -1, 0)
    filters = flow.filters(kernel.weights)
    start = time.perf_counter()
    for _ in flow.grid.map_strips(filters.filters):
        pass
    setup = time.perf_counter() - start
    inverse = PatchInverse(filters)
    works = {
        "FFTs": bare_ffts(flow, channels),
        "transforms used": bare_ffts(flow, channels, flow.grid.transforms),
        "A f": lambda: filters.forward(planes),
        "A^T g": lambda: filters.adjoint(blurred_planes),
        "P f": lambda: inverse.apply(planes, 0.1),
        "B^T r": lambda: flow.kernel_adjoint(f, g),
    }
    seconds = best_of(works, args.repeats)
    bare = seconds.pop("FFTs")
    costs = ", ".join(
        f"{name} {took:.3f} s ({took / bare:.2f}x, {peak(works[name]):.0f} MB)"
        for name, took in seconds.items()
    )
    grid = flow.grid
    print(
        f"  {kernel.extent_px():.0f} px, {len(kernel.weights)} rotations, "
        f"{grid.rows * grid.columns} patches at every {grid.hop} px, blocks of {grid.block}: "
        f"filters {setup:.3f} s, FFTs {bare:.3f} s, {costs}",
        flush=True,
    )


def bare_ffts(flow: FilterFlow, channels: int, own: Transforms | None = None) -> Work:
    """Make the transforms there and back of as many blocks, in the same strips and batches."""
    grid = flow.grid
    n = grid.block
    blocks = np.random.default_rng(0).random((channels, grid.batch, n, n), np.float32)

    def work(strip: Strip) -> None:
        for batch in grid.batches(strip):
            part = blocks[:, : batch.stop - batch.start]
            if own is not None:
                own.irfft(own.rfft(part))
            else:
                spectra = scipy.fft.rfft2(part, workers=1)
                scipy.fft.irfft2(spectra, (n, n), overwrite_x=True, workers=1)

    def run() -> None:
        for _ in grid.map_strips(work):
            pass

    return run


def print_warps(camera: Camera, kernel: RotationKernel) -> None:
    """Time exact warps on a few of a kernel's rotations."""
    few = 5
    warps = Warps(camera, kernel.theta[:few])
    w = np.full(few, 1 / few)
    rng = np.random.default_rng(0)
    f = rng.random(warps.latent_shape, np.float32)
    g = rng.random(camera.shape, np.float32)
    works: dict[str, Work] = {
        "A f": lambda: warps.blur(f, w),
        "A^T g": lambda: warps.adjoint(g, w),
        "B^T r": lambda: warps.kernel_adjoint(f, g),
    }
    seconds = best_of(works, 1)
    costs = ", ".join(f"{name} {took / few * 1e3:.0f} ms" for name, took in seconds.items())
    print(f"  {costs}", flush=True)


def print_gram(camera: Camera, count: int, args: argparse.Namespace) -> None:
    """Time the Gram matrix of the rotations nearest to the origin."""
    reach = np.arange(-9, 10)
    indices = np.stack(np.meshgrid(reach, reach, reach, indexing="ij"), -1).reshape(-1, 3)
    indices = indices[np.argsort((indices**2).sum(1), kind="stable")[:count]]
    f = np.random.default_rng(0).normal(size=(*camera.shape, 2)).astype(np.float32)
    works: dict[str, Work] = {}
    for hop in (24, 32):
        flow = FilterFlow(
            camera,
            indices * grid_steps(camera),
            margin=0,
            hop=hop,
            channels=2,
            run=Run(args.threads),
        )
        works[f"hop {hop}"] = lambda flow=flow: flow.gram(f)
    seconds = best_of(works, min(args.repeats, 3))
    costs = ", ".join(f"{name} {took:.3f} s" for name, took in seconds.items())
    print(f"  {camera.width} x {camera.height}, {count} rotations: {costs}", flush=True)


def best_of(works: dict[str, Work], repeats: int) -> dict[str, float]:
    """Time every work in turn, again and again; the shortest of each, in seconds."""
    best = dict.fromkeys(works, np.inf)
    for work in works.values():
        work()  # the first run fills caches
    for _ in range(repeats):
        for name, work in works.items():
            start = time.perf_counter()
            work()
            best[name] = min(best[name], time.perf_counter() - start)
    return best


def peak(work: Work) -> float:
    """Megabytes that are allocated at once while a work runs."""
    tracemalloc.start()
    work()
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most / 1e6


if __name__ == "__main__":
    main()
