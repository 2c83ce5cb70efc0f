"""How a recorded hand turns the camera of a case, and where that moves the frame.

The convention is `g(x) = mean_k f(H_k x)` with `H = K R(theta) K^-1`, pixel centres at integers and
the principal point in the middle of the frame. The mean of the angles is 0. Nothing of deshake is
used here.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.hands import read_recording

if TYPE_CHECKING:
    from pathlib import Path

    from bench.cases.shakes import Case

__all__ = ["DIAGONAL", "Angles", "hand_window", "homographies", "moved", "path_in"]

Angles = NDArray[np.float64]

DIAGONAL = 43.2666  # mm, of 35 mm film
LEAST_OWN_EXTENT = 2.0  # px at 1000 px of width: below it a window is the sensor's noise
FINE_PATH = 800  # times of an exposure at which a path is measured
MOST_WARPS, MOST_WARPS_LARGE, MOST_WARPS_WIDE = 200, 100, 140
WIDE = 80  # px: blurs of large photos from which more warps are taken
LARGE = 4e6  # pixels


def exposed(times: Angles, turned: Angles, start: float, exposure: float) -> Angles:
    """Return angles (FINE_PATH, 3) at even times of an exposure, against its middle."""
    out = []
    last = len(times) - 2
    base = turned[min(int(np.searchsorted(times, start + exposure / 2)), last + 1)]
    for time in start + exposure * (np.arange(FINE_PATH) + 0.5) / FINE_PATH:
        at = int(np.clip(np.searchsorted(times, time) - 1, 0, last))
        step = cv2.Rodrigues(turned[at].T @ turned[at + 1])[0].ravel()
        part = np.clip((time - times[at]) / max(times[at + 1] - times[at], 1e-9), 0, 1)
        between = base.T @ turned[at] @ cv2.Rodrigues(step * part)[0]
        out.append(cv2.Rodrigues(between)[0].ravel())
    return np.array(out)


def extents(theta: Angles, focal: float, diagonal: float) -> Angles:
    """Return the largest displacements by turns about X, Y and Z, in pixels."""
    turned: Angles = np.ptp(theta, axis=0) * [focal, focal, diagonal / 2]
    return turned


def hand_window(case: Case, recording: Path) -> Angles:
    """Cut an exposure out of a recording in which the hand moved."""
    times, turned = read_recording(recording)
    rng = np.random.default_rng(case.seed)
    exposure = min(case.exposure, 0.9 * (times[-1] - times[0]))
    diagonal = math.hypot(1000, 667)
    keep = [float(axis in case.axes) for axis in "XYZ"]
    for _ in range(1000):
        start = times[0] + rng.uniform(0.01, 0.99) * (times[-1] - times[0] - exposure)
        theta = exposed(times, turned, start, exposure) * keep
        own = extents(theta, case.film / DIAGONAL * diagonal, diagonal)
        if own.max() >= LEAST_OWN_EXTENT:
            return theta
    raise ValueError(f"{case.name}: the hand of {recording.name} never moved")


def camera_matrix(focal: float, height: int, width: int) -> Angles:
    """Return K."""
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


def homographies(theta: Angles, focal: float, height: int, width: int) -> Angles:
    """Return H = K R K^-1 of each rotation, (n, 3, 3)."""
    K = camera_matrix(focal, height, width)
    inverse = np.linalg.inv(K)
    return np.array([K @ cv2.Rodrigues(one)[0] @ inverse for one in theta])


def moved(theta: Angles, focal: float, height: int, width: int) -> Angles:
    """Return where corners, edges and middle of the frame move to, (n, 9, 2) in pixels."""
    points = np.array([(x, y, 1.0) for y in (0, height / 2, height) for x in (0, width / 2, width)])
    projected = np.einsum("nij,pj->npi", homographies(theta, focal, height, width), points)
    out: Angles = projected[..., :2] / projected[..., 2:] - points[:, :2]
    return out


def stretched(theta: Angles, extent: float, focal: float, diagonal: float) -> Angles:
    """Centre a path, and scale it to an extent."""
    theta = theta - theta.mean(0)
    return theta * (extent / extents(theta, focal, diagonal).max())


def sampled(theta: Angles, count: int) -> Angles:
    """Sample a path at so many even times."""
    at = (np.arange(count) + 0.5) / count * len(theta) - 0.5
    return np.stack([np.interp(at, np.arange(len(theta)), axis) for axis in theta.T], 1)


def warps_for(theta: Angles, frame: tuple[float, int, int], extent: float) -> int:
    """Return how many warps a path takes: one every half pixel, up to a limit."""
    place = moved(theta, *frame)
    length = np.linalg.norm(np.diff(place, axis=0), axis=-1).max(1).sum()
    most = MOST_WARPS
    if frame[1] * frame[2] > LARGE:
        most = MOST_WARPS_LARGE if extent < WIDE else MOST_WARPS_WIDE
    return int(np.clip(math.ceil(2 * length), 16, most))


def path_in(window: Angles, case: Case, focal: float, height: int, width: int) -> Angles:
    """Return the rotations that a frame's scene is warped by: their extent is the case's."""
    diagonal = math.hypot(height, width)
    theta = stretched(window, case.blur, focal, diagonal)
    theta = sampled(theta, warps_for(theta, (focal, height, width), case.blur))
    return stretched(theta, case.blur, focal, diagonal)
