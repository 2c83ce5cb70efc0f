"""Resampling between a photo and the picture that a pinhole would have taken.

Cubic B-splines with their prefilter resample an image once, band by band. Each value stays in the
range of its 5 x 5 neighbours, so that lights get no dark rings. Beyond its border, the photo is
mirrored.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.geometry.distortion import undistorted
from deshake.operators.planes import channels_first, image_like
from deshake.operators.strips import bands

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from deshake.geometry.camera import Camera

    Bands = Callable[[], Iterator[tuple[slice, NDArray[np.floating]]]]

__all__ = ["LensWarp"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_BAND = 128  # rows that are resampled at once
_NODE = 8  # px between the nodes whose inverse an iteration computes
_NEAR = np.ones((5, 5), np.uint8)
_TOUCHED = np.ones((3, 3), np.uint8)
_CLEAR = 1e-3  # share of marked pixels up to which a result counts as unmarked


class LensWarp:
    """Resampling between a photo and the straight picture of a pinhole, in both directions.

    Parameters
    ----------
    camera : Camera
        The photo's camera, with its distortion.
    straight_camera : Camera
        The pinhole, see `geometry.distortion.pinhole`.

    """

    def __init__(self, camera: Camera, straight_camera: Camera) -> None:
        self.camera = camera
        self.straight_camera = straight_camera

    def straighten(self, image: Image) -> Image:
        """Turn a photo (h, w[, C]) into the pinhole's picture."""
        return self._resampled(image, self.straight_camera.shape, self._straight_bands)

    def bend(self, image: Image) -> Image:
        """Turn the pinhole's picture (h, w[, C]) into a photo."""
        return self._resampled(image, self.camera.shape, self._bent_bands)

    def straighten_mask(self, mask: Mask) -> Mask:
        """Return where the pinhole's picture depends on marked pixels of the photo."""
        wide = np.asarray(cv2.dilate(mask.astype(np.float32), _TOUCHED), np.float32)
        out = np.empty(self.straight_camera.shape, bool)
        for rows, where in self._straight_bands():
            out[rows] = _interpolated(wide, where, order=1) > _CLEAR
        return out

    def straighten_codes(self, codes: NDArray[np.unsignedinteger]) -> NDArray[np.unsignedinteger]:
        """Resample a plane of codes (h, w), such as an opacity, bilinearly."""
        return _codes(codes, self.straight_camera.shape, self._straight_bands)

    def bend_codes(self, codes: NDArray[np.unsignedinteger]) -> NDArray[np.unsignedinteger]:
        """Resample a plane of codes the other way."""
        return _codes(codes, self.camera.shape, self._bent_bands)

    def _resampled(
        self,
        image: Image,
        shape: tuple[int, int],
        bands: Bands,
    ) -> Image:
        from scipy import ndimage  # noqa: PLC0415 - for lenses that distort alone

        out = np.empty(shape + image.shape[2:], np.float32)
        for plane, result in zip(channels_first(image), channels_first(out), strict=True):
            source = np.ascontiguousarray(plane, np.float32)
            low = np.asarray(cv2.erode(source, _NEAR), np.float32)
            high = np.asarray(cv2.dilate(source, _NEAR), np.float32)
            spline = ndimage.spline_filter(source, 3, output=np.float32, mode="mirror")
            for rows, where in bands():
                band = _interpolated(spline, where, order=3)
                least, most = (_interpolated(edge, where, order=0) for edge in (low, high))
                result[rows] = np.clip(band, least, most)
        return image_like(channels_first(out), image)

    def _straight_bands(self) -> Iterator[tuple[slice, Image]]:
        """Yield where the pixels of the pinhole's picture lie in the photo, as (y, x) by rows."""
        height, width = self.straight_camera.shape
        for rows in bands(height, _BAND):
            count = rows.stop - rows.start
            matrix = self.straight_camera.cropped(0, rows.start, width, count).matrix
            x, y = cv2.initUndistortRectifyMap(
                self.camera.matrix,
                self.camera.distortion,
                np.eye(3),
                matrix,
                (width, count),
                cv2.CV_32FC1,
            )
            yield rows, np.stack([y, x])

    def _bent_bands(self) -> Iterator[tuple[slice, Image]]:
        """Yield where the pixels of the photo lie in the pinhole's picture, as (y, x) by rows.

        An iteration computes the inverse on a grid of nodes; splines interpolate between them.
        """
        from scipy.interpolate import RectBivariateSpline  # noqa: PLC0415 - as above

        height, width = self.camera.shape
        y, x = (np.linspace(0, n - 1, max(-(-n // _NODE), 4) + 1) for n in (height, width))
        nodes = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        straight_nodes = undistorted(nodes, self.camera, self.straight_camera)
        moved = (straight_nodes - nodes).reshape(len(y), len(x), 2)
        across, down = (RectBivariateSpline(y, x, moved[..., axis]) for axis in (0, 1))
        columns = np.arange(width)
        for rows in bands(height, _BAND):
            lines = np.arange(rows.start, rows.stop)
            v, u = down(lines, columns) + lines[:, None], across(lines, columns) + columns
            yield rows, np.stack([v, u])


def _interpolated(plane: Image, where: NDArray[np.floating], *, order: int) -> Image:
    """Read a plane at some places (y, x); splines of order 3 are those of `spline_filter`."""
    from scipy import ndimage  # noqa: PLC0415 - as above

    out = np.empty(where.shape[1:], np.float32)
    how: Any = {"order": order, "prefilter": False, "mode": "mirror"}
    ndimage.map_coordinates(plane, where, output=out, **how)
    return out


def _codes(
    codes: NDArray[np.unsignedinteger], shape: tuple[int, int], bands: Bands
) -> NDArray[np.unsignedinteger]:
    out = np.empty(shape, codes.dtype)
    plane = codes.astype(np.float32)
    for rows, where in bands():
        out[rows] = np.rint(_interpolated(plane, where, order=1))
    return out
