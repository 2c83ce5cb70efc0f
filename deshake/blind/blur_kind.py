"""Detect in a second, without a kernel, what blurs a photo: a shake, a soft lens, focus, nothing.

A shaken photo is blurred more along the shake than across it. A photo out of focus is blurred
alike in all directions. A soft one is, too, but less. So the verdict weighs three measures:
the blur that depends on the direction (`spectrum_fit`), the spread of the sharper edges
(`edge_spread`), and the sharpness of the steepest edges (`sharpness`).

A camera that turns about a point of the frame leaves that point sharp, and blurs the rest in
different directions. So the quarters of a photo that is not shaken as a whole are judged, too.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from deshake.blind.edge_spread import EdgeSpread, edge_spread
from deshake.blind.settings import SETTINGS
from deshake.blind.sharpness import looks_sharp, sharpness
from deshake.blind.spectrum_fit import DirectedBlur, directed_blur
from deshake.errors import EstimationError
from deshake.signal.pyramid import RATIO, Pyramid

__all__ = ["BlurKind", "Kind", "Measures", "blur_kind", "judged", "measured"]

Kind = Literal["sharp", "shaken", "soft", "out of focus", "unclear"]
"""Unclear is a photo with too few edges to judge."""


_S: Final = SETTINGS.blur_kind
_HALF: Final = 2  # index of the scale of half the size


class Measures(NamedTuple):
    """What a verdict is made of: `looks_sharp`, `sharpness` at two sizes, and the two fits."""

    sharp: bool
    sharpness: float
    sharpness_at_half: float
    directed: DirectedBlur
    edges: EdgeSpread | None

    @property
    def evidence(self) -> float:
        """The evidence of a shake: blur that depends on the direction, no unit."""
        less = self.sharpness_at_half > _S.sharp_at_half
        evidence = _of_direction(self.directed, self.edges)
        return evidence - _S.less_evidence if less else evidence

    @property
    def certain_evidence(self) -> float:
        """The evidence of a shake; infinite if there is too little detail to tell."""
        return self.evidence if self.directed.certain else math.inf

    @property
    def hardly_shaken(self) -> bool:
        """Whether the evidence is so little that only a kernel can show a shake.

        The fine edges of a sharp photo may prefer a direction. So they need more evidence.
        """
        fine = self.edges is not None and self.edges.longer < _S.spread
        return self.certain_evidence < (_S.little_if_fine if fine else _S.little)

    @property
    def surely_sharp(self) -> bool:
        """Whether edges are steep and the blur does not depend on the direction.

        A camera that rests and then moves on leaves steep edges, too. But then the edges are also
        wide in one direction, and sharpness is no reason to doubt the evidence.
        """
        wide = self.edges is not None and self.edges.longer > _S.spread
        evidence = _of_direction(self.directed, self.edges) if wide else self.evidence
        return self.sharp and evidence < _S.shaken


@dataclass(frozen=True)
class BlurKind:
    """What blurs a photo.

    Parameters
    ----------
    kind : {"sharp", "shaken", "soft", "out of focus", "unclear"}
        The verdict.
    certain : bool
        Whether the measures leave little doubt.
    width_px : float, optional
        Extent of a shake along its direction, in pixels of the photo: in its middle, or in the
        quarter where it is widest.
    direction : float, optional
        Direction of a shake in degrees, 0..180: 0 is level, 90 upright, and 45 rises to the right.

    """

    kind: Kind
    certain: bool
    width_px: float | None = None
    direction: float | None = None

    def report(self) -> dict[str, Any]:
        """Return the verdict as JSON data."""
        figures: dict[str, Any] = {"verdict": self.kind, "certain": self.certain}
        if self.width_px is not None and self.direction is not None:
            figures |= {"width_px": round(self.width_px, 1), "direction": round(self.direction, 1)}
        return figures


def blur_kind(pyramid: Pyramid) -> BlurKind:
    """Detect what blurs a photo, without an estimate of its kernel."""
    measures = measured(pyramid)
    whole = judged(measures)
    if measures.surely_sharp or whole.kind == "shaken":
        return whole
    return _shaken_quarters(pyramid) or whole


def _shaken_quarters(pyramid: Pyramid) -> BlurKind | None:
    """Return the widest shake of a photo's quarters; None: too few of them are clearly shaken."""
    level = pyramid.level_of(_S.quarters_pixels)
    scale = pyramid.at(level)
    height, width = (side // 2 for side in scale.camera.shape)
    shakes: list[BlurKind] = []
    corners = itertools.product((0, scale.camera.height - height), (0, scale.camera.width - width))
    for left, (y, x) in zip((4, 3, 2, 1), corners, strict=True):
        if len(shakes) + left < _S.quarters:
            return None
        place = np.s_[y : y + height, x : x + width]
        clipped = None if scale.clipped is None else scale.clipped[place]
        camera = scale.camera.cropped(x, y, width, height)
        with contextlib.suppress(EstimationError):  # a quarter without texture
            shake = _clear_shake(Pyramid(scale.picture[place], camera, clipped))
            if shake is not None and shake.width_px is not None:
                wide = shake.width_px * RATIO**level
                shakes.append(replace(shake, certain=False, width_px=wide))
    if len(shakes) < _S.quarters:
        return None
    return max(shakes, key=lambda shake: shake.width_px or 0)


def _clear_shake(pyramid: Pyramid) -> BlurKind | None:
    """Return the shake of a picture that is certainly shaken; None: it is not.

    The sharpness is measured only where it can make a difference.
    """
    directed = directed_blur(pyramid)
    if not directed.sigma_px:
        return None
    edges = edge_spread(pyramid)
    if _of_direction(directed, edges) < _S.shaken:
        return None
    kind = judged(_with_sharpness(pyramid, directed, edges))
    return kind if kind.kind == "shaken" and kind.certain else None


def _of_direction(directed: DirectedBlur, edges: EdgeSpread | None) -> float:
    """Return the evidence of a shake, whatever the sharpness is."""
    evidence = directed.strength
    if edges is not None and edges.longer > _S.spread:
        evidence += _S.edges_worth * max(0.0, _S.round_edges - edges.shorter / edges.longer)
    return evidence


def _with_sharpness(pyramid: Pyramid, directed: DirectedBlur, edges: EdgeSpread | None) -> Measures:
    """Take the other measures of a photo."""
    at_half = sharpness(pyramid, min(_HALF, pyramid.coarsest))
    return Measures(looks_sharp(pyramid), sharpness(pyramid, 0), at_half, directed, edges)


def measured(pyramid: Pyramid) -> Measures:
    """Take the measures of a photo."""
    return _with_sharpness(pyramid, directed_blur(pyramid), edge_spread(pyramid))


def judged(measures: Measures) -> BlurKind:
    """Return the verdict on the measures of a photo."""
    directed = measures.directed
    if measures.surely_sharp:
        return BlurKind("sharp", certain=True)
    evidence = measures.evidence
    if evidence >= _S.perhaps and directed.sigma_px > 0:
        direction = (180 - directed.direction) % 180  # y points down
        return BlurKind("shaken", evidence >= _S.shaken, _S.path * directed.sigma_px, direction)
    if measures.edges is None:
        return BlurKind("unclear", certain=False)
    if measures.sharpness > _S.sharp or measures.edges.longer < _S.soft:
        return BlurKind("sharp", certain=False)
    kind: Kind = "soft" if measures.edges.longer < _S.out_of_focus else "out of focus"
    return BlurKind(kind, certain=evidence < _S.perhaps / 2)
