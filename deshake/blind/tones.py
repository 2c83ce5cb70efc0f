"""The tones that the blur suits: linear light, display values, or those before a tone curve.

Light adds up: in linear light a blurred pixel is a mean of sharp ones, Eq. (5). A file states the
curve from its values to light, but cameras apply tone curves of their own before, to make a
pleasing picture, and some programs write linear values without saying so. The curve of the file
then undoes too much, and the values of the file are nearer to linear light. With the wrong tones,
even the true kernel leaves dark blobs and rings beside bright things.

A kernel that is nearly right tells which tones are right: in them it matches the spectra better,
and it explains the photo by a simpler sharp picture. The margin alone often errs: a sharp picture
can be simpler in display values, whatever the blur. So the match counts more. Rings and blobs make
the restored picture vary more. So the same tiles are restored in both tones, and their total
variations are compared.

If the blur suits light better than display values, a camera may still have made its middle tones
steeper. The differences are smaller then. The match tells them, and the margin, at the scale of the
kernel and at a finer one. The variation does not: it is about as much lower before such a curve
where there was none.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from deshake.blind.bounds import check_size
from deshake.blind.entry import Entry
from deshake.blind.judge import many_tiles
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.restored_tiles import gradient_price, restored
from deshake.blind.settings import SETTINGS
from deshake.errors import EstimationError
from deshake.operators.strips import in_order
from deshake.run import Run
from deshake.signal.gradients import differences, length_of
from deshake.signal.pyramid import Pyramid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.tiles import Tiles
    from deshake.geometry.kernel import RotationKernel
    from deshake.signal.pyramid import ToneName, Tones

__all__ = ["gains_in_display_values", "suited_light", "suited_tones"]

Image = NDArray[np.float32]

_S: Final = SETTINGS.tones


def suited_tones(
    grey: Image,
    kernel: RotationKernel,
    clipped: NDArray[np.bool_] | None = None,
    *,
    before_curve: Tones,
    run: Run = Run(),
) -> ToneName:
    """Return the tones in which a kernel explains a photo best.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, 0..1.
    kernel : RotationKernel
        Its kernel, for this size.
    clipped : (h, w) array of bool, optional
        Clipped pixels. They do not count.
    before_curve : callable
        Returns the light before the tone curve that a camera may have applied.
    run : Run, optional
        Threads to use; the result does not depend on them.

    """
    silent = run.silent()
    entry = Entry("kernel", 0, 0, kernel.centred())
    try:
        check_size(grey.shape[0], grey.shape[1], 1.0)
        pyramid = Pyramid(grey, kernel.camera, clipped)
        light = Comparison(pyramid, silent)
        shown = Comparison(pyramid.displayed(), silent)
        if gains_in_display_values(light, shown, entry):
            return "display values"
        before = Comparison(pyramid.in_tones(before_curve), silent)
        if _gains_before_curve(light, before, entry):
            return "light before a tone curve"
    except EstimationError:  # the photo is too small, or flat
        pass
    return "linear light"


def gains_in_display_values(light: Comparison, shown: Comparison, entry: Entry) -> bool:
    """Return whether a kernel explains a photo better in display values, by enough to be sure.

    Parameters
    ----------
    light, shown : Comparison
        The photo in linear light, and in display values.
    entry : Entry
        The kernel.

    """
    both = light, shown
    scored = in_order(lambda one: one.scores([entry])[0], both, light.run)
    of_light, of_shown = (score for _, score in scored)
    if of_shown - of_light < _S.least_score:
        return False
    match = shown.match(entry) - light.match(entry)
    margins = [entry.margin(one.judge(entry)) for one in both]
    gain = match + _S.of_margin * (margins[1] - margins[0])
    gain += _S.of_variation * _less_variation(light, shown, entry)
    return light.match_share * gain > _S.least_gain  # a few tiles tell little


def suited_light(lights: Sequence[Comparison], entry: Entry) -> Comparison:
    """Return the light in which a kernel of a race explains a photo best.

    Parameters
    ----------
    lights : sequence of three Comparison
        The photo in the light of the file, before half of a camera's tone curve, and before all of
        it.
    entry : Entry
        The kernel, from a race in one of the first two.

    """
    none, half, whole = lights
    worth = np.array([1, _S.of_margins])
    gains = []
    for light in lights:
        gains.append(_explained(light, entry) @ worth)
        light.pyramid.forget()  # one of them at most has its scales in memory
    of_none, of_half, of_whole = gains
    if of_whole - of_none > _S.certain_curve:
        return whole
    if of_none - of_whole > _S.certain_curve and of_none > of_half:
        return none
    return half


def _gains_before_curve(light: Comparison, before: Comparison, entry: Entry) -> bool:
    """Return whether a kernel explains a photo better in the light before a camera's tone curve.

    On few tiles, a match can rise by chance. So the margins must rise, too.
    """
    both = in_order(lambda one: _explained(one, entry), (light, before), light.run)
    of_light, of_before = (one for _, one in both)
    match, margins = of_before - of_light
    return bool(margins > 0 and match + _S.of_margins * margins > _S.least_before)


def _explained(light: Comparison, entry: Entry) -> NDArray[np.float64]:
    """Return the match of a kernel in a light, and the sum of its margins there."""
    margins = entry.margin(light.judge(entry)) + light.finer_margin(entry)
    return np.array([light.match(entry), margins])


def _less_variation(light: Comparison, shown: Comparison, entry: Entry) -> float:
    """Return how much less the picture varies that is restored in display values.

    It is the logarithm of the ratio of the total variations, each of them the geometric mean of
    that in light and that in display values.
    """
    level = light.level(entry)
    tiles = many_tiles(light.pyramid, level, entry.kernel)
    other = tiles.in_other_tones(shown.pyramid.at(level))
    pictures = in_order(lambda one: _restored(one, entry.kernel), (tiles, other), light.run)
    of_light, of_shown = (picture for _, picture in pictures)
    pairs = [(of_light, np.square(of_shown)), (np.sqrt(of_light), of_shown)]
    seen = tiles.inside
    return float(np.mean([np.log(_variation(a, seen) / _variation(b, seen)) for a, b in pairs]))


def _restored(tiles: Tiles, kernel: RotationKernel) -> Image:
    """Restore tiles by a kernel, in their tones; nothing is darker than black."""
    bound = tiles.bound(kernel.for_camera(tiles.camera))
    return np.maximum(tiles.toned(restored(bound, gradient_price(tiles))), 0)


def _variation(pictures: Image, seen: NDArray[np.bool_]) -> float:
    """Return the mean length of the gradients at the given pixels."""
    return float(length_of(*differences(pictures))[seen].mean(dtype=np.float64))
