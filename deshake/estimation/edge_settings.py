"""Settings of the estimate by sharp edges."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["EAGER", "FAINT", "SETTINGS", "EdgeSetting"]


@dataclass(frozen=True)
class EdgeSetting:
    """How strong the edges are that count: the one choice no single value of which suits all.

    Too low a price and the kernel collapses to a point; too high, or too much of the shock
    filter, and it widens.

    Parameters
    ----------
    name : str
        What to call it.
    first, last : float
        Price `lam` of an edge pixel at the first and the last iteration; geometric in between.
    shocks : int
        Iterations of each scale, the first ones, that see shock-filtered edges.
    cut : float
        Weights below this share of the largest are noise.
    carried : float
        Weights that a finer scale begins with, of the largest.
    most : int
        Rotations that a finer scale begins with, before it is given room.
    roll : bool
        Whether the camera may turn about its optical axis. Most hands turn it little, and a roll
        that explains chance takes weight from the rest.
    side : int
        Longer side in pixels that the photo is reduced to. Kernels of wide blurs break up at
        sizes where they are tens of pixels wide.
    gamma : float
        Edges are looked for in light to the power of ``1 / gamma``. Blur adds up in linear light
        only; but there the lights outweigh whatever else has edges.
    uniform : bool
        Whether one blur is looked for all over the frame. It is found the more surely, also where
        the true one is not quite so.

    """

    name: str
    first: float
    last: float
    shocks: int
    cut: float = 0.05
    carried: float = 0.08
    most: int = 150
    roll: bool = True
    side: int = 640
    gamma: float = 1.0
    uniform: bool = False


SETTINGS = (
    EdgeSetting("fine", 8e-2, 2e-3, 3),
    EdgeSetting("medium", 8e-2, 5e-3, 4, cut=0.02, carried=0.03, most=200),
    EdgeSetting("level", 8e-2, 2e-3, 3, roll=False),
    EdgeSetting("display", 8e-2, 5e-3, 4, cut=0.02, carried=0.03, most=200, gamma=2.2),
    EdgeSetting("wide", 8e-2, 2e-3, 3, roll=False, side=320, gamma=2.2),
    EdgeSetting(
        "wide-medium", 8e-2, 5e-3, 4, 0.02, carried=0.03, most=200, roll=False, side=320, gamma=2.2
    ),
    EdgeSetting("uniform", 8e-2, 2e-3, 3, uniform=True),
    EdgeSetting(
        "uniform-display", 8e-2, 5e-3, 4, 0.02, carried=0.03, most=200, gamma=2.2, uniform=True
    ),
)
"""Settings that fail on different photos, for a judge to choose between their kernels."""

EAGER = frozenset(("display", "uniform", "uniform-display"))
"""Names of settings that find a blur in sharp photos, too. What the others find, most of them a
point, tells whether there was a shake."""

FAINT = EdgeSetting("faint", 4e-2, 5e-3, 3, cut=0.01, carried=0.01, most=300)
"""For shakes that rest for most of the exposure and rush for the rest of it: faint tails are
kept, at several times the cost."""
