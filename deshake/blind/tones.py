"""Whether the blur of a photo suits its display values better than linear light.

Light adds up: in linear light a blurred pixel is a mean of sharp ones, Eq. (5). A file states the
curve from its values to light, but cameras apply tone curves of their own before, to make a
pleasing picture, and some programs write linear values without saying so. The curve of the file
then undoes too much, and the values of the file are nearer to linear light. With the wrong tones,
even the true kernel leaves dark blobs and rings beside bright things.

A kernel that is nearly right tells which tones are right: in them it matches the spectra better,
and it explains the photo by a simpler sharp picture. The margin alone often errs: a sharp picture
can be simpler in display values, whatever the blur. So the match counts more, and the score of the
comparison must agree.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from deshake.blind.bounds import check_size
from deshake.blind.entry import Entry
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.settings import SETTINGS
from deshake.errors import EstimationError
from deshake.run import Run
from deshake.signal.pyramid import Pyramid

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel

__all__ = ["gains_in_display_values", "suits_display_values"]

_S: Final = SETTINGS.tones


def suits_display_values(
    grey: NDArray[np.float32],
    kernel: RotationKernel,
    clipped: NDArray[np.bool_] | None = None,
    *,
    run: Run = Run(),
) -> bool:
    """Return whether a kernel explains the display values of a photo better than its light.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, 0..1.
    kernel : RotationKernel
        Its kernel, for this size.
    clipped : (h, w) array of bool, optional
        Clipped pixels. They do not count.
    run : Run, optional
        Threads to use; the result does not depend on them.

    """
    try:
        check_size(grey.shape[0], grey.shape[1], 1.0)
        light = Pyramid(grey, kernel.camera, clipped)
        shown = light.displayed()
    except EstimationError:  # the photo is too small, or flat
        return False
    entry = Entry("kernel", 0, 0, kernel.centred())
    silent = run.silent()
    return gains_in_display_values(
        Comparison(light, run=silent), Comparison(shown, run=silent), entry
    )


def gains_in_display_values(light: Comparison, shown: Comparison, entry: Entry) -> bool:
    """Return whether a kernel explains a photo better in display values, by enough to be sure.

    Parameters
    ----------
    light, shown : Comparison
        The photo in linear light, and in display values.
    entry : Entry
        The kernel.

    """
    match = shown.match(entry) - light.match(entry)
    score = float(shown.scores([entry])[0] - light.scores([entry])[0])
    margins = [entry.margin(one.judge(entry)) for one in (light, shown)]
    gain = match + _S.of_margin * (margins[1] - margins[0])
    return gain > _S.least_gain and score > _S.least_score
