"""Lens distortion: the difference between a lens and a pinhole.

OpenCV's model: a ray through (x, y, 1) appears at ``(x, y) q(r^2)``, with r its distance from the
axis and

    q = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6),

and some tangential terms. The camera matrix K belongs to the photo. The straight picture is the one
that a pinhole at the same place would have taken. `pinhole` chooses its focal length: either the
photo shows all of the straight picture, or the straight picture shows all of the photo.

References
----------
.. [1] https://docs.opencv.org/5.x/, Camera Calibration and 3D Reconstruction.

"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from deshake.geometry.camera import Camera

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Points = NDArray[np.float64]

__all__ = ["bent_camera", "distorted", "fit_distortion", "pinhole", "undistorted"]

_STEPS: Final = 12  # reweighted least-squares steps of a fit
_POLE: Final = 0.2  # least denominator and least scale: a fit below it is discarded
_FINE: Final = 1e-5  # share of the farthest distance: a fit with a smaller error ends the search
_BORDER: Final = 257  # points along each side of the frame
_ITERATIONS: Final = (3, 40, 1e-10)  # TermCriteria: at most 40 iterations, or steps below 1e-10
_SAME: Final = 0.1  # px: a point that returns farther than this from its start lies in a fold
_ROUNDING: Final = 1e-6  # px of tolerance at the frame's border
_LARGER: Final = 2.0  # areas of the photo: a larger straight picture is an error; barrels reach 1.5
_ZOOM: Final = (0.2, 5.0)  # range of zooms of the straight camera; beyond it is an error


def distorted(points: Points, camera: Camera, straight_camera: Camera) -> Points:
    """Map points of the pinhole's picture into the photo.

    Parameters
    ----------
    points : (N, 2) array
        Pixels (x, y) of the pinhole's picture.
    camera : Camera
        The camera of the photo, with its distortion.
    straight_camera : Camera
        The pinhole.

    Returns
    -------
    (N, 2) array of float64
        Pixels of the photo.

    """
    rays = _rays(points, straight_camera)
    nowhere = np.zeros(3)
    mapped, _ = cv2.projectPoints(rays, nowhere, nowhere, camera.matrix, camera.distortion)
    return np.asarray(mapped, np.float64).reshape(-1, 2)


def undistorted(points: Points, camera: Camera, straight_camera: Camera) -> Points:
    """Map points of the photo into the pinhole's picture: the inverse of `distorted`."""
    mapped = cv2.undistortPoints(
        np.ascontiguousarray(points, np.float64).reshape(-1, 1, 2),
        camera.matrix,
        camera.distortion,
        R=np.eye(3),
        P=straight_camera.matrix,
        criteria=_ITERATIONS,
    )
    return np.asarray(mapped, np.float64).reshape(-1, 2)


def pinhole(camera: Camera, *, whole: bool = False) -> Camera:
    """Return the camera of the picture without distortion.

    Parameters
    ----------
    camera : Camera
        The camera of the photo, with its distortion.
    whole : bool, keyword-only
        Whether the picture shows all of the photo, and is at least as large. By default it has the
        photo's size, and the photo shows all of it: then its focal length is the least for which
        no pixel lies beyond the photo.

    Raises
    ------
    ValueError
        If the distortion is too strong.

    """
    height, width = camera.shape
    if whole:
        border = undistorted(_border(camera), camera, camera)
        again = distorted(border, camera, camera)
        if not np.abs(again - _border(camera)).max() < 0.01:
            raise ValueError("the distortion folds the picture")
        low, high = np.floor(border.min(0)).astype(int), np.ceil(border.max(0)).astype(int)
        if np.prod(high - low, dtype=np.float64) > _LARGER * width * height:
            raise ValueError("the distortion is too strong")
        straight = Camera(camera.matrix, height, width)
        whole_size = straight.cropped(int(low[0]), int(low[1]), *(int(n) + 1 for n in high - low))
        zoom = max(1.0, width / whole_size.width, height / whole_size.height)
        return whole_size.scaled(*(math.ceil(zoom * side) for side in whole_size.shape))
    zoom = _least_zoom(lambda zoom: _sees(camera, _zoomed(camera, zoom)))
    return _zoomed(camera, zoom)


def bent_camera(straight_camera: Camera, distortion: Points) -> Camera:
    """Return the camera of a photo that shows nothing beyond a pinhole's picture.

    Parameters
    ----------
    straight_camera : Camera
        The pinhole.
    distortion : (k,) array
        Distortion of the photo's lens, in OpenCV's order.

    Returns
    -------
    Camera
        The photo's camera, of the same size; its focal length is the least possible.

    Raises
    ------
    ValueError
        If the distortion is too strong.

    """

    def shows(zoom: float) -> bool:
        camera = _zoomed(straight_camera, zoom).with_lens(distortion)
        border = _border(camera)
        straight_border = undistorted(border, camera, straight_camera)
        back = distorted(straight_border, camera, straight_camera)
        return (
            _inside(straight_border, straight_camera) and float(np.abs(back - border).max()) < _SAME
        )

    return _zoomed(straight_camera, _least_zoom(shows)).with_lens(distortion)


def fit_distortion(straight: Points, bent: Points) -> tuple[Points, float]:
    """Fit the model to a curve: distances from the axis with the lens against those without.

    The scale of the straight picture is free: only the shape of the curve matters.

    Parameters
    ----------
    straight : (N,) array
        Distances without distortion, in focal lengths, rising and > 0.
    bent : (N,) array
        The same distances with distortion, in focal lengths.

    Returns
    -------
    distortion : (8,) array of float64
        In OpenCV's order.
    error : float
        The largest difference, in focal lengths.

    Raises
    ------
    ValueError
        If the distances with distortion do not rise.

    """
    straight, bent = np.asarray(straight, np.float64), np.asarray(bent, np.float64)
    if not (np.isfinite(bent).all() and bent[0] > 0 and (np.diff(bent) > 0).all()):
        raise ValueError("it folds the picture")
    best: Points = np.zeros(8)
    error = np.inf
    for terms in range(4):  # of the denominator: no more than are needed
        coefficients, left = _fit(straight, bent, terms)
        if left < error:
            best, error = coefficients, left
        if error < _FINE * straight[-1]:
            break
    return best, float(error)


def _fit(straight: Points, bent: Points, terms: int) -> tuple[Points, float]:
    """Fit by reweighted least squares, with `terms` terms in the denominator [Sanathanan 1963].

    With x = (r / r_max)^2 and the ratio q: ``sum_i a_i x^i - q sum_j b_j x^j = q``.
    """
    far = straight[-1]
    x, q = (straight / far) ** 2, bent / straight
    above = np.stack([x**i for i in range(4)], 1)
    below = np.stack([x**j for j in range(1, terms + 1)], 1) if terms else np.zeros((len(x), 0))
    matrix = np.hstack([above, -q[:, None] * below])
    denominator: Points = np.ones(len(x))
    a: Points = np.zeros(4)
    b: Points = np.zeros(terms)
    for _ in range(_STEPS if terms else 1):
        weight = (straight / denominator)[:, None]
        solved = np.linalg.lstsq(matrix * weight, q * weight[:, 0])[0]
        coefficients: Points = np.asarray(solved, np.float64)
        a, b = coefficients[:4], coefficients[4:]
        denominator = 1 + below @ b
        if denominator.min() < _POLE or a[0] < _POLE:
            return np.zeros(8), np.inf
    left = np.abs(above @ a / denominator - q) * straight
    # The unit of distance is that of the straight picture, a_0 r: its scale fits the middle.
    unit = (far * a[0]) ** 2
    k, m = a[1:] / a[0] / unit ** np.arange(1, 4), np.zeros(3)
    m[:terms] = b / unit ** np.arange(1, terms + 1)
    return np.array([k[0], k[1], 0, 0, k[2], *m]), float(left.max())


def _least_zoom(fits: Callable[[float], bool]) -> float:
    """Return the least zoom that fits, by bisection of `_ZOOM`."""
    inside, outside = _ZOOM[1], _ZOOM[0]
    if not fits(inside):
        raise ValueError("the distortion is too strong")
    for _ in range(40):
        middle = float(np.sqrt(inside * outside))
        inside, outside = (middle, outside) if fits(middle) else (inside, middle)
    return inside


def _sees(camera: Camera, straight_camera: Camera) -> bool:
    """Return whether a pinhole shows nothing beyond the photo."""
    border = _border(straight_camera)
    bent_border = distorted(border, camera, straight_camera)
    if not _inside(bent_border, camera):
        return False
    return float(np.abs(undistorted(bent_border, camera, straight_camera) - border).max()) < _SAME


def _inside(points: Points, camera: Camera) -> bool:
    """Return whether all pixels lie in the frame, and are numbers."""
    last = np.array(camera.shape[::-1]) - 1
    return bool(((points >= -_ROUNDING) & (points <= last + _ROUNDING)).all())


def _zoomed(camera: Camera, zoom: float) -> Camera:
    matrix = camera.matrix.copy()
    matrix[:2, :2] *= zoom
    return Camera(matrix, camera.height, camera.width)


def _border(camera: Camera) -> Points:
    """Return pixels (x, y) along the border of the frame."""
    t = np.linspace(0, 1, _BORDER)
    zero, one = np.zeros(_BORDER), np.ones(_BORDER)
    sides = [(t, zero), (t, one), (zero, t), (one, t)]
    points = np.concatenate([np.stack(side, 1) for side in sides])
    pixels: Points = points * (np.array(camera.shape[::-1]) - 1)
    return pixels


def _rays(points: Points, camera: Camera) -> Points:
    """Return the rays (x, y, 1) through pixels."""
    ahead = np.column_stack([points, np.ones(len(points))])
    rays: Points = ahead @ np.linalg.inv(camera.matrix).T
    return rays
