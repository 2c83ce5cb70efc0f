"""Pictures of kernels: the rotation cuboid (Figs. 3, 4, 7) and the local filters over the frame."""

from __future__ import annotations

import io
import logging
from typing import TYPE_CHECKING

import cv2
import numpy as np
from PIL import Image

from deshake.errors import OutputError
from deshake.files.disk import STREAM, check_output, write_bytes
from deshake.files.kernel_file import read_kernel
from deshake.geometry.rotations import displacements, homographies
from deshake.operators.bilinear import splat_on_raster
from deshake.pictures.canvas import Canvas, Colour, Picture
from deshake.pictures.cuboid import Axes, draw_cuboid, round_above

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel

__all__ = [
    "picture_name",
    "point_light",
    "render_comparison",
    "render_file",
    "render_filters",
    "render_kernel",
]

_log = logging.getLogger(__name__)

_BORDER: Colour = (86, 92, 104)
_LIGHT: Colour = (255, 255, 255)
_DARK: Colour = (10, 12, 18)
_INK: Colour = (40, 44, 52)
_LEAST_CELL = 12  # pixels: the picture grows if cells would be smaller
_LEAST_REACH = 3.0  # pixels of the photo around a point that does not move
_MARGIN = 1.06  # factor: room between the farthest light and the cell's border
_MOST_CELLS = 4096  # across the raster that a filter is summed on
_GAMMA = 2.2  # a filter is light, and is shown as a photo of that light


def render_kernel(kernel: RotationKernel, *, size: int = 640) -> Picture:
    """Draw the rotation cuboid of a kernel, as in Figs. 3, 4 and 7.

    Parameters
    ----------
    kernel : RotationKernel
        The kernel.
    size : int
        Width and height of the picture in pixels.

    Returns
    -------
    (size, size, 3) array of uint8
        RGB on white. Points are rotations, larger and darker the heavier they are; the sums of
        the weights lie on the three faces behind; ticks are pixels at the edge of the frame.

    Raises
    ------
    ValueError
        If the size is below 1.

    Examples
    --------
    >>> import deshake
    >>> camera = deshake.Camera.from_focal(900.0, height=480, width=720)
    >>> kernel = deshake.RotationKernel.from_path([(0, -0.01, 0), (0, 0.01, 0)], camera)
    >>> deshake.render_kernel(kernel, size=320).shape
    (320, 320, 3)

    """
    _check_size(size)
    canvas = Canvas(size, size)
    draw_cuboid(canvas, kernel, Axes.around([kernel]), size=size)
    return canvas.finished()


def render_comparison(kernels: Mapping[str, RotationKernel], *, size: int = 640) -> Picture:
    """Draw the cuboids of several kernels side by side, on the same axes.

    Parameters
    ----------
    kernels : mapping of str to RotationKernel
        The kernels by their titles.
    size : int
        Width and height of each cuboid in pixels.

    Returns
    -------
    (size, N * size, 3) array of uint8
        RGB on white; pixels at the axes are those of the first kernel's frame.

    Raises
    ------
    ValueError
        If there is no kernel, or the size is below 1.

    Examples
    --------
    >>> import deshake
    >>> camera = deshake.Camera.from_focal(900.0, height=480, width=720)
    >>> kernel = deshake.RotationKernel.from_path([(0, -0.01, 0), (0, 0.01, 0)], camera)
    >>> still = deshake.RotationKernel.delta(camera)
    >>> deshake.render_comparison({"true": kernel, "estimate": still}, size=320).shape
    (320, 640, 3)

    """
    _check_size(size)
    if not kernels:
        msg = "there is no kernel to draw"
        raise ValueError(msg)
    axes = Axes.around(list(kernels.values()))
    canvas = Canvas(size * len(kernels), size)
    for column, (title, kernel) in enumerate(kernels.items()):
        draw_cuboid(canvas, kernel, axes, size=size, left=column * size, title=title)
    return canvas.finished()


def render_filters(kernel: RotationKernel, rows: int, cols: int, *, size: int = 960) -> Picture:
    """Draw the local point spread functions of a kernel over the frame.

    Each cell shows what the blurred photo shows of a point light in the middle of that part of
    the frame, x right and y down. By Eq. (7) the point ``p`` of the sharp image is seen wherever
    ``H_k x = p``, thus at the offsets ``H_k^-1 p - p``, which are about ``-d_k(p)``.

    Parameters
    ----------
    kernel : RotationKernel
        The kernel.
    rows, cols : int
        Number of cells down and across the frame.
    size : int
        Longer side of the frame in the picture, in pixels; more where cells would get too small.

    Returns
    -------
    (H, W, 3) array of uint8
        RGB: light on black, all cells at one scale and each as bright as its brightest spot
        allows; below the frame a bar that shows the scale.

    Raises
    ------
    ValueError
        If there are no rows or columns, or the size is below 1.

    Examples
    --------
    >>> import deshake
    >>> camera = deshake.Camera.from_focal(900.0, height=480, width=720)
    >>> kernel = deshake.RotationKernel.from_path([(0, -0.01, 0), (0, 0.01, 0)], camera)
    >>> deshake.render_filters(kernel, 2, 3, size=360).shape[1:]
    (360, 3)

    """
    _check_size(size)
    if rows < 1 or cols < 1:
        raise ValueError(f"{rows} rows and {cols} columns of filters: there is nothing to draw")
    camera = kernel.camera
    scale = max(
        size / max(camera.shape),
        _LEAST_CELL * cols / camera.width,
        _LEAST_CELL * rows / camera.height,
    )
    height, width = (max(1, round(scale * side)) for side in camera.shape)
    side = min(height / rows, width / cols) - 2
    points = np.stack(
        np.meshgrid(
            (np.arange(cols) + 0.5) * camera.width / cols - 0.5,
            (np.arange(rows) + 0.5) * camera.height / rows - 0.5,
        ),
        -1,
    )
    backwards = homographies(camera, -kernel.theta)
    farthest = float(np.abs(displacements(backwards, camera.corners)).max())
    reach = max(_LEAST_REACH, _MARGIN * farthest)
    zoom = side / (2 * reach + 2)

    text = max(9.0, 0.016 * max(height, width))
    strip = round(2.4 * text)
    canvas = Canvas(width, height + strip)
    canvas.rectangle((0, 0), (width, height), _DARK)
    for r in range(rows):
        offsets = displacements(backwards, points[r])
        for c in range(cols):
            light = point_light(offsets[c], kernel.weights, reach, max(3, round(side)))
            x = (c + 0.5) * width / cols - side / 2
            y = (r + 0.5) * height / rows - side / 2
            canvas.shade(light, ((x, y), (x + side, y), (x, y + side)), _LIGHT)
    for r in range(rows + 1):
        y = r * height / rows
        canvas.line((0, y), (width, y), _BORDER)
    for c in range(cols + 1):
        x = c * width / cols
        canvas.line((x, 0), (x, height), _BORDER)
    span = round_above(reach / 2)
    middle, start = height + strip / 2, text
    canvas.rectangle((start, middle - 1.5), (start + span * zoom, middle + 1.5), _INK)
    canvas.text((2 * text + span * zoom, middle), f"{span:g} px", text, _INK, anchor="left")
    return canvas.finished()


def _check_size(size: int) -> None:
    if size < 1:
        raise ValueError(f"a picture of {size} pixels: it has at least one")


def picture_name(source: Path, *, filters: bool) -> str:
    """Return the default name of a kernel's picture: ``<stem>.png`` or ``<stem>-filters.png``.

    Raises
    ------
    OutputError
        If the kernel comes from standard input: it has no name.

    """
    if str(source) == STREAM:
        raise OutputError("a kernel from standard input has no name", hint="name a PNG with -o")
    return f"{source.stem}{'-filters' if filters else ''}.png"


def render_file(
    source: Path,
    output: Path | None = None,
    *,
    filters: tuple[int, int] | None = None,
    size: int | None = None,
    overwrite: bool = False,
) -> Path:
    """Draw the kernel of a file into a PNG.

    Parameters
    ----------
    source : Path
        The kernel file, or "-" for standard input.
    output : Path, optional
        The PNG, or "-" for standard output; by default the kernel's name with ``.png``, or with
        ``-filters.png``, beside it.
    filters : (int, int), optional
        Rows and columns of local filters to draw; without it, the rotation cuboid.
    size : int, optional
        Longer side of the picture in pixels.
    overwrite : bool
        Whether an existing output may be replaced.

    Returns
    -------
    Path
        The PNG.

    Raises
    ------
    KernelFileError
        If the kernel cannot be read.
    OutputError
        If the picture cannot be written.

    """
    if output is None:
        output = source.with_name(picture_name(source, filters=filters is not None))
    if str(output) != STREAM and output.suffix.lower() != ".png":
        raise OutputError(
            "kernels are drawn as PNG", hint="give the output a name in .png", file=output
        )
    check_output(output, source, overwrite=overwrite)
    kernel = read_kernel(source).kernel
    sized = {} if size is None else {"size": size}
    if filters is None:
        picture = render_kernel(kernel, **sized)
    else:
        picture = render_filters(kernel, *filters, **sized)
    encoded = io.BytesIO()
    Image.fromarray(picture).save(encoded, "PNG", optimize=True)
    write_bytes(output, encoded.getvalue(), overwrite=overwrite, made_from=[source])
    _log.info("%s: %d x %d pixels", output, picture.shape[1], picture.shape[0])
    return output


def point_light(
    offsets: NDArray[np.float64], weights: NDArray[np.float64], reach: float, side: int
) -> NDArray[np.float64]:
    """Draw what a blurred photo shows of a point light, from 0 to 1.

    Parameters
    ----------
    offsets : (K, 2) array
        Places of the light, in pixels of the photo from the picture's middle.
    weights : (K,) array
        Share of the exposure at each place.
    reach : float
        Half the side of the picture in pixels of the photo, less one.
    side : int
        The side of the picture in pixels of its own.

    """
    count = min(12 * int(np.ceil(reach + 1)), 2 * side, _MOST_CELLS)
    places = (offsets / (reach + 1) + 1) * count / 2 - 0.5
    raster = splat_on_raster(places, weights, (count, count))
    pixel = count / (2 * reach + 2)  # raster cells in a pixel of the photo
    sigma = 0.35 * max(pixel, 1)  # no light is a sharp point
    blurred = cv2.GaussianBlur(raster, (0, 0), sigma)
    way = cv2.INTER_AREA if count > side else cv2.INTER_LINEAR
    light = np.asarray(cv2.resize(blurred, (side, side), interpolation=way), np.float64)
    shown: NDArray[np.float64] = (light / light.max()) ** (1 / _GAMMA)
    return shown
