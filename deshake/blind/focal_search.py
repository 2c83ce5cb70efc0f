"""The focal length that suits the spectra of a photo best, if no one knows it.

The focal length says how much more a rotation moves the corners of the frame than its middle. So a
kernel whose filter is right in the middle is wrong at the corners if the focal length is wrong, and
the match of the spectra is lower there. The match needs no restored picture, and it changes
smoothly with the focal length. So it is computed for kernels that a wrong focal length gave, with
other focal lengths. The best of these is nearer to the true one.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.blind.settings import SETTINGS
from deshake.operators.strips import in_order

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.entry import Entry
    from deshake.blind.kernel_comparison import Comparison
    from deshake.geometry.camera import Camera

__all__ = ["best_zoom"]

_S: Final = SETTINGS.focal_search


def best_zoom(comparison: Comparison, entries: Sequence[Entry]) -> float:
    """Return the ratio of the focal length that suits best to the present one.

    Parameters
    ----------
    comparison : Comparison
        The photo, at the present focal length.
    entries : sequence of Entry
        Kernels. The one that matches best, at any focal length, decides.

    """
    camera = comparison.pyramid.camera
    shortest, longest = np.array([_S.shortest, _S.longest]) / _relative(camera)
    steps = np.arange(
        min(np.ceil(_S.steps * np.log2(shortest)), 0),
        max(np.floor(_S.steps * np.log2(longest)), 0) + 1,
    )
    ratios = 2 ** (steps / _S.steps)
    work = in_order(partial(comparison.zoomed_matches, ratios=ratios), entries, comparison.run)
    matches = np.array([curve for _, curve in work])
    return float(ratios[np.unravel_index(matches.argmax(), matches.shape)[1]])


def _relative(camera: Camera) -> float:
    """Return the focal length in diagonals of the frame."""
    return float(camera.focal_px / np.hypot(*camera.shape))
