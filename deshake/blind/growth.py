"""Grow kernels: find the parts of the path that they lack.

A camera may rest, and then go far but fast. Then the kernel of a start is often a part of the path:
where the camera rested. At the scale of that part it scores higher than the whole path does at its
own, coarser scale. The rest of the path is faint. But in a wide room around the part, and with
every edge of the frame, the kernel step finds it.

So the kernel is estimated again on the whole frame, from coarse to fine, in a room twice as wide
(`refined_on_frame` in `wide_start`). In display values dark parts weigh more. So this is done in
the tones of the race, and in the others. All kernels are compared at one scale, which also suits a
kernel that is almost three times as wide. The best new one is refined in tiles, with roll. If it is
better than the kernel, it grows once more. At a coarse scale, wrong kernels can score high. So a
kernel that the spectra match far less than the one in its place is left out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.blind.entry import all_refined
from deshake.blind.settings import SETTINGS
from deshake.blind.wide_start import levels_on_frame, refined_on_frame
from deshake.operators.strips import in_order

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.candidate import Axes
    from deshake.blind.entry import Entry
    from deshake.blind.kernel_comparison import Comparison
    from deshake.blind.settings import FrameWay
    from deshake.signal.pyramid import Pyramid

__all__ = ["grown", "on_frame"]

_S: Final = SETTINGS.growth


def grown(
    comparison: Comparison, entry: Entry, axes: Axes, bound: float | None, *, toned: bool
) -> Entry:
    """Grow a kernel that may be a part of a wide one, as long as its score rises.

    Parameters
    ----------
    comparison : Comparison
        The photo, and the judge of its kernels.
    entry : Entry
        The kernel.
    axes : three bools
        The axes that the camera may turn about.
    bound : float or None
        Largest extent of the kernel in pixels of the photo.
    toned : bool
        Whether the kernel also grows in the other tones: display values in place of light.

    Returns
    -------
    Entry
        The best kernel; the given one if it is narrow for the frame, or if none is better.

    """
    pyramid = comparison.pyramid
    if entry.width < _S.least_share * min(pyramid.camera.shape):
        return entry
    tones = [pyramid, pyramid.in_other_tones()] if toned else [pyramid]
    best = entry
    for _ in range(_S.rounds):
        larger = _larger(comparison, best, tones, axes)
        if larger is None or not larger.keeps(bound):
            break
        best = larger
    return best


def on_frame(
    comparison: Comparison, entry: Entry, pyramid: Pyramid, way: FrameWay, axes: Axes
) -> Entry | None:
    """Refine a kernel on the whole frame; this is a piece of work for one thread.

    Parameters
    ----------
    comparison : Comparison
        The photo, and the judge of its kernels.
    entry : Entry
        The kernel.
    pyramid : Pyramid
        The photo in the tones in which the kernel is refined.
    way : FrameWay
        The scales, the room of the kernel, and the prices.
    axes : three bools
        The axes that the camera may turn about.

    Returns
    -------
    Entry or None
        The kernel; None if the photo has no scale so coarse, or if the kernel is hopeless.

    """
    kernel = refined_on_frame(pyramid, entry.kernel, comparison.level(entry), way, axes)
    if kernel is None:
        return None
    new = entry._replace(name=f"{entry.name}, frame", kernel=kernel)
    new = new._replace(level=max(new.level, comparison.level(new) - _S.finer))
    return None if comparison.hopeless(new) else new


def _larger(
    comparison: Comparison, entry: Entry, tones: Sequence[Pyramid], axes: Axes
) -> Entry | None:
    """Return a better kernel that grows from one in a round, or None.

    The first way is the cheapest. If all its kernels are far worse, or hardly wider, no other way
    is tried. A narrower kernel does not grow from one, whatever its score is.
    """

    def in_ways(ways: Sequence[FrameWay]) -> list[Entry]:
        jobs = [(pyramid, way) for pyramid in tones for way in ways]
        work = in_order(lambda job: on_frame(comparison, entry, *job, axes), jobs, comparison.run)
        return [new for _, new in work if new is not None]

    pyramid, level = comparison.pyramid, comparison.level(entry)
    coarse = min(level + _S.coarser, pyramid.coarsest)
    first, *others = _S.ways
    used = levels_on_frame(pyramid, level, first)  # in a large frame another way has the same
    others = [way for way in others if levels_on_frame(pyramid, level, way) != used]
    new = in_ways([first])
    own, *scores = comparison.scores_at(coarse, [entry, *new]).tolist()
    wider = [one.width > _S.wider * entry.width for one in new]
    if not any(wide and score >= own - _S.vain for wide, score in zip(wider, scores, strict=True)):
        return None
    new += in_ways(others)
    best = new[int(np.argmax(comparison.scores_at(coarse, new)))]
    kernels = [best, comparison.matched(best)]
    jobs = [(one, SETTINGS.polish.smooth, axes) for one in kernels]
    kernels += all_refined(pyramid, jobs, comparison.run)
    kernels = [one for one in kernels if one.width > entry.width and not comparison.hopeless(one)]
    least = _S.least_match * comparison.match(entry)
    kernels = [one for one in kernels if comparison.match(one) >= least]
    own, *scores = comparison.scores_at(coarse, [entry, *kernels]).tolist()
    if not scores or max(scores) <= own + _S.gain:
        return None
    return kernels[int(np.argmax(scores))]
