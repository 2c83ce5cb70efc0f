"""The result of a race: its winner, and what the confidence depends on."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from deshake.blind.entry import Entry
    from deshake.signal.pyramid import ToneName

__all__ = ["Finish"]


class Finish(NamedTuple):
    """The result of a race.

    Parameters
    ----------
    winner : Entry
        The best kernel.
    margin : float
        Margin of the winner: its gain in the judge's ``-ln E`` over a still camera.
    match : float
        Correlation of the spectra of the photo with those of the winner, -1..1.
    agreement : float
        Mean agreement of the winner with the nearest kernels of other starts, 0..1.
    at_rest : bool
        Whether the race stopped early, because the winner is a small round spot.
    zoom : float
        Focal length of the winner's camera over that of the photo's; 1 if it is known.
    tones : {"linear light", "display values", "light before a tone curve"}
        What of the photo the race looked at.
    lead : float, optional
        How much better the winner explains the photo than the same kernel turned, as far as the two
        differ (`Comparison.lead`). None if the winner is a disk, or if the race ended before that
        was worth the time.

    """

    winner: Entry
    margin: float
    match: float
    agreement: float
    at_rest: bool
    zoom: float = 1.0
    tones: ToneName = "linear light"
    lead: float | None = None
