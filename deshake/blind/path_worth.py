"""What the paths along a kernel are worth in the search for a better one.

It is the margin of the judge and the match of the spectra. The margin needs a picture of edges for
each path. So paths that are near each other are compared on a few tiles, and there the match
changes in proportion to the path.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from deshake.blind.judge import mean_margin
from deshake.blind.settings import SETTINGS
from deshake.blind.spectral_match import match_of_path, mean_match

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.blind.camera_path import SmoothPath
    from deshake.blind.judge import Judge
    from deshake.blind.spectral_match import SpectralMatch
    from deshake.geometry.camera import Camera
    from deshake.geometry.kernel import RotationKernel
    from deshake.run import Run

__all__ = ["PathWorth"]


class PathWorth(NamedTuple):
    """What the paths along a kernel are worth.

    Parameters
    ----------
    batches : list of Judge
        Judges that have a few tiles each.
    spectra : list of SpectralMatch
        The scales of the match.
    match_worth : float
        What a match of 1 is worth.
    camera : Camera
        The camera of the kernel.
    run : Run
        Threads to use.

    """

    batches: list[Judge]
    spectra: list[SpectralMatch]
    match_worth: float
    camera: Camera
    run: Run

    def of(self, kernel: RotationKernel) -> float:
        """Return what a kernel is worth on the tiles of all batches."""
        if not self.batches[0].has_room(kernel):  # all have the same room
            return -SETTINGS.kernel_comparison.penalty
        match = mean_match(self.spectra, kernel)
        return mean_margin(self.batches, kernel) + self.match_worth * match

    def around(self, number: int, middle: SmoothPath) -> Callable[[SmoothPath], float]:
        """Return what paths near one are worth, on the tiles of one batch."""
        batch = self.batches[number % len(self.batches)]
        match, slope = match_of_path(self.spectra, middle, self.run)

        def worth(path: SmoothPath) -> float:
            kernel = path.kernel(self.camera)
            if not batch.has_room(kernel):
                return -SETTINGS.kernel_comparison.penalty
            change = float(np.vdot(slope, path.controls - middle.controls))
            return batch.margin(kernel) + self.match_worth * (match + change)

        return worth
