"""Registration of a noisy, sharp photo to a blurred one of the same scene (Secs. 6 and 7).

The model: ``g(x) = sum_k w_k F(H_k x)`` is the long exposure, ``f_N(x) = F(H_0 x) / ratio`` the
short one. An exhaustive search and a refinement, both on small copies, estimate ``theta_0`` and the
photometric factor ``a`` with ``g ~ a f_N``. The frame of the blurred photo is that of the blur's
centroid. The kernel absorbs the small error that remains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from math import exp, pi, radians
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.variational.coarse_to_fine import resize
from deshake.errors import EstimationError
from deshake.geometry.rotations import compose, homographies
from deshake.operators.strips import bands
from deshake.pair.alignment import align, likeness, seen_in_frame, smooth
from deshake.pair.photometric import brightness_ratio, photometric_scale
from deshake.pair.registration_settings import SETTINGS
from deshake.pair.rotation_search import distinct, exhaustive_search
from deshake.pair.small_pair import SmallPair, possible_turns, reduce_pair
from deshake.run import Run

if TYPE_CHECKING:
    from deshake.geometry.camera import Camera

__all__ = ["MAX_ANGLE", "Registration", "register", "registered"]

Image = NDArray[np.float32]

MAX_ANGLE = radians(10)
"""Half the range that is searched about each axis."""

_QUARTER = pi / 2
_BAND = 256  # rows and columns that are resampled at once


@dataclass(frozen=True, eq=False)
class Registration:
    """The rotation and the photometric factor between a noisy photo and a blurred one.

    Parameters
    ----------
    theta : (3,) array of float64
        ``theta_0`` in radians: ``f_N(x) = F(H_0 x) / ratio`` for the sharp scene F in the frame of
        the blurred photo. If the noisy photo is stored turned by 90 degrees, it includes that turn.
    scale : float
        Photometric factor ``a``, > 0: ``a f_N`` is as bright as the blurred photo.
    confidence : float
        Chance that the registration is right, 0..1.
    camera : Camera
        The camera of the blurred photo.

    """

    theta: NDArray[np.float64]
    scale: float
    confidence: float
    camera: Camera

    def report(self) -> dict[str, Any]:
        """Return all but the camera as JSON data."""
        return {
            "theta": self.theta.tolist(),
            "scale": self.scale,
            "confidence": self.confidence,
        }


def register(
    g: Image,
    f_N: Image,
    camera: Camera,
    *,
    max_angle: float = MAX_ANGLE,
    run: Run = Run(),
) -> Registration:
    """Find the rotation and the photometric factor between two photos of one scene.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo, in linear light, 1 where it clips.
    f_N : (h', w') or (h', w', C) array of float32
        The noisy photo, of any size with the same proportions; it may be turned by 90 degrees.
    camera : Camera
        The camera of the blurred photo.
    max_angle : float
        Largest angle about any axis to look for, in radians.
    run : Run, optional
        Threads to use, and who receives the progress.

    Returns
    -------
    Registration
        With a confidence of at least one half.

    Raises
    ------
    EstimationError
        If the photos do not show the same scene, have different proportions, or one of them is
        too small or shows nothing.
    ValueError
        If the camera does not have the size of the blurred photo.

    Notes
    -----
    The confidence is a logistic function of how alike the details of the registered photos are,
    with constants from simulated pairs, right and wrong.

    """
    if g.shape[:2] != camera.shape:
        msg = f"a photo of {g.shape[:2]} pixels does not fit a camera of {camera.shape}"
        raise ValueError(msg)
    best = None
    for number, turns in enumerate(possible_turns(camera.shape, f_N.shape[:2])):
        run.report(0.0, "registering" if number == 0 else "registering the photo turned")
        pair = reduce_pair(g, f_N, camera, turns)
        result = _register(pair, max_angle, run)
        if best is None or result.confidence > best.confidence:
            best = Registration(
                compose(result.theta, [0, 0, -turns * _QUARTER]),
                result.scale,
                result.confidence,
                camera,
            )
        if best.confidence >= SETTINGS.same_scene:
            # a symmetric scene resembles its mirror image, but itself more
            mirrored = replace(pair, f=np.ascontiguousarray(pair.f[:, ::-1]))
            if _register(mirrored, max_angle, run.silent()).confidence > best.confidence:
                raise EstimationError(
                    "one of the two photos is mirrored", hint="mirror it back, as the other one is"
                )
            return best
    raise EstimationError(
        "the two photos do not show the same scene",
        hint="try a larger --search-angle; both photos must be uncropped, and of one focal length",
    )


def registered(f_N: Image, registration: Registration, *, margin: int = 0) -> tuple[Image, Image]:
    """Resample the noisy photo in the blurred photo's frame: ``f_reg(x) = f_N(H_0^-1 x)``.

    Parameters
    ----------
    f_N : (h', w') or (h', w', C) array of float32
        The noisy photo, or anything of its size, such as noise.
    registration : Registration
        Its registration.
    margin : int
        Pixels m around that frame to include: the blurred photo has light from there.

    Returns
    -------
    f_reg : (h + 2 m, w + 2 m) or (h + 2 m, w + 2 m, C) array of float32
        By Lanczos interpolation, linear in `f_N`; beyond its border, the nearest pixels. A larger
        photo is first reduced to the blurred one's size.
    valid : (h + 2 m, w + 2 m) array of float32
        1 where the noisy photo has pixels, else 0.

    """
    camera = registration.camera
    turns = _turns_of(registration.theta)
    upright: Image = np.rot90(f_N, turns)
    if upright.shape[0] > camera.height:
        size = (camera.width, camera.height)
        smaller = cv2.resize(np.ascontiguousarray(upright), size, interpolation=cv2.INTER_AREA)
        upright = np.asarray(smaller, np.float32).reshape(camera.shape + f_N.shape[2:])
    theta = compose(registration.theta, [0, 0, turns * _QUARTER])
    stored = camera.scaled(*upright.shape[:2])
    # Where a pixel of the blurred photo lies in the noisy one.
    h = stored.matrix @ np.linalg.inv(camera.matrix) @ homographies(camera, -theta)
    valid = np.empty((camera.height + 2 * margin, camera.width + 2 * margin), np.float32)
    out = np.empty(valid.shape + f_N.shape[2:], np.float32)
    for tile in product(*(bands(side, _BAND) for side in valid.shape)):
        corner = tile[0].start - margin, tile[1].start - margin
        out[tile], valid[tile] = _sampled(upright, h, *corner, valid[tile].shape)
    return out, valid


def _register(
    pair: SmallPair,
    max_angle: float,
    run: Run,
) -> Registration:
    """Register an upright pair, at any confidence."""
    camera = pair.camera
    ratio = brightness_ratio(pair.g, pair.f)
    g, f = np.clip(pair.g, 0, 1), np.clip(ratio * pair.f, 0, 1)
    level = float(g.mean()) + 1e-9
    seen_g, seen_f = (
        np.sqrt(image / level + SETTINGS.shadow, dtype=np.float32) for image in (g, f)
    )
    if min(seen_g.std(), seen_f.std()) < SETTINGS.least_contrast:
        raise EstimationError(
            "one of the two photos shows nothing", hint="check that neither is black or white"
        )
    coarse = camera.scaled(*(round(SETTINGS.search * side) for side in camera.shape))
    small_g, small_f = resize(np.stack([seen_g, seen_f]), coarse.shape)
    candidates = exhaustive_search(
        smooth(small_g, 0.3, SETTINGS.search_px[1]),
        smooth(small_f, *SETTINGS.search_px),
        coarse,
        max_angle,
        run=run,
    )
    best, best_likeness = np.zeros(3), -1.0
    for candidate in distinct(candidates, coarse, SETTINGS.candidates, SETTINGS.apart_px):
        theta, _ = align(g, f, camera, candidate.theta)
        alike = likeness(seen_g, seen_f, camera, theta)
        if alike > best_likeness:
            best, best_likeness = theta, alike
    # Only now are the common part of both photos and its brightness known.
    f = np.clip(_scale(pair, best) * pair.f, 0, 1)
    best, _ = align(g, f, camera, best)
    confidence = 1 / (1 + exp(-(best_likeness - SETTINGS.even_likeness) / SETTINGS.likeness_scale))
    return Registration(best, _scale(pair, best), confidence, camera)


def _scale(pair: SmallPair, theta: NDArray[np.float64]) -> float:
    turned, mask = seen_in_frame(pair.g, pair.f, pair.camera, theta)
    return photometric_scale(pair.g, turned, mask & pair.usable)


def _turns_of(theta: NDArray[np.float64]) -> int:
    """Return how many quarter turns make the noisy photo of this registration upright."""
    return -round(float(theta[2]) / _QUARTER) % 4


def _sampled(
    image: Image, h: NDArray[np.float64], top: int, left: int, shape: tuple[int, int]
) -> tuple[Image, Image]:
    """Sample an image at ``H x`` for a tile of pixels x; return also where ``H x`` is inside it."""
    rows, columns = np.mgrid[top : top + shape[0], left : left + shape[1]].astype(np.float64)
    u, v, w = np.tensordot(h, np.stack([columns, rows, np.ones(shape)]), 1)
    w = np.maximum(w, 1e-6)
    height, width = image.shape[:2]
    u, v = np.clip(u / w, -2, width + 1), np.clip(v / w, -2, height + 1)
    inside = (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
    x0, y0 = max(int(u.min()) - 3, 0), max(int(v.min()) - 3, 0)
    piece = np.ascontiguousarray(image[y0 : int(v.max()) + 4, x0 : int(u.max()) + 4], np.float32)
    x, y = (u - x0).astype(np.float32), (v - y0).astype(np.float32)
    planes = [piece] if piece.ndim == 2 else list(np.moveaxis(piece, -1, 0))
    read = [
        cv2.remap(
            np.ascontiguousarray(plane),
            x,
            y,
            cv2.INTER_LANCZOS4,
            borderMode=cv2.BORDER_REPLICATE,
        )
        for plane in planes
    ]
    out = read[0] if image.ndim == 2 else np.stack(read, -1)
    return np.asarray(out, np.float32), inside.astype(np.float32)
