"""Turn a scene into one by night: darker, and with lamps.

A lamp is a small spot of 15 to 300 times white, with a faint halo. Lamps are further apart than the
shake is wide.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.cases.shakes import Case

__all__ = ["by_night"]

Image = NDArray[np.float32]

GAINS = (0.06, 0.35)
"""Light of the scene, as a share of that by day."""
LAMPS = (4, 25)
"""Number of lamps, at least and at most."""
LIGHTS = (15.0, 300.0)
"""Light in the middle of a lamp; 1 is white."""
WIDTHS = (0.5, 1.3)
"""Standard deviations of a lamp, in pixels of the photo."""
PLACES = (0.06, 0.8, 0.04, 0.96)
"""Where lamps are: from and to, as shares of the height and of the width."""
APART = 1.3
"""Extents of the shake between two lamps, at least."""
LEAST_APART = 13.0  # px
TRIES = 2000  # places
HALO = 0.02  # of the light in the middle


def by_night(scene: Image, case: Case, over: int) -> Image:
    """Darken a scene in linear light, and put lamps into it.

    Parameters
    ----------
    scene : (h, w) or (h, w, 3) array of float32
        The scene, grey or BGR, so many times as large as the photo.
    case : Case
        Its seed and the width of its shake.
    over : int
        How many times.

    """
    rng = np.random.default_rng(case.seed + 7)
    dark = scene * np.float32(rng.uniform(*GAINS))
    height, width = scene.shape[:2]
    top, bottom, left, right = PLACES
    apart = over * max(APART * case.blur, LEAST_APART)
    count = int(rng.integers(LAMPS[0], LAMPS[1] + 1))
    places: list[NDArray[np.float64]] = []
    for _ in range(TRIES):
        place = rng.uniform([top * height, left * width], [bottom * height, right * width])
        if all(math.hypot(*(place - other)) > apart for other in places):
            places.append(place)
        if len(places) == count:
            break
    for place in places:
        sigma = over * rng.uniform(*WIDTHS)
        light = math.exp(rng.uniform(*np.log(LIGHTS)))
        colour = np.array([rng.uniform(0.4, 1), rng.uniform(0.7, 1), 1])  # white to orange
        add_lamp(dark, place, sigma, light, colour)
    return dark


def add_lamp(
    scene: Image, place: Sequence[float], sigma: float, light: float, colour: NDArray[np.float64]
) -> None:
    """Add a lamp at a place (y, x)."""
    reach = int(5 * sigma) + 2
    y, x = (int(one) for one in place)
    height, width = scene.shape[:2]
    part = np.s_[
        max(y - reach, 0) : min(y + reach + 1, height),
        max(x - reach, 0) : min(x + reach + 1, width),
    ]
    rows, columns = np.ogrid[part]
    far = np.hypot(rows - place[0], columns - place[1])
    spot = light * (np.exp(-0.5 * (far / sigma) ** 2) + HALO * np.exp(-far / (2 * sigma)))
    added = spot[..., None] * colour if scene.ndim == 3 else spot
    scene[part] += added.astype(np.float32)
