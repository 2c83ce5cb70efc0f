"""The verdict on a photo in one word, and its confidence in words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Literal

from deshake.blind.settings import SETTINGS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from deshake.geometry.kernel import RotationKernel

__all__ = [
    "UNSHAKEN",
    "Verdict",
    "blur_words",
    "confidence_words",
    "summary_words",
    "verdict_figures",
]

Verdict = Literal["improved", "left", "doubtful"]
"""Deblurred by a kernel that is not doubtful; left as it is; deblurred by a doubtful kernel."""

UNSHAKEN: Final = "unshaken"
"""Verdict on a photo that is passed over, because it is not shaken."""

_LEFT: Final = "left as it is"
_STILL: Final = "by its kernel, the camera stood still"
_SEEN_TO_MOVE: Final = 0.005  # share of the frame
_WORDS: Final = ((0.9, "confident"), (SETTINGS.estimate.doubtful, "fairly confident"))


def verdict_figures(kernel: RotationKernel, confidence: float, notes: object) -> dict[str, Any]:
    """Return the verdict on a photo as JSON data, with the ``reason`` if it was left as it is.

    Parameters
    ----------
    kernel : RotationKernel
        The kernel of the deblurring.
    confidence : float
        Confidence of the kernel, 0..1.
    notes : list of str
        Notes of the estimate. Anything else, as a kernel file may have, is ignored.

    """
    if not kernel.is_still:
        return {"verdict": "improved" if confidence >= SETTINGS.estimate.doubtful else "doubtful"}
    texts = [str(note) for note in notes] if isinstance(notes, list) else []
    reasons = [note.partition(_LEFT)[0] for note in texts if _LEFT in note]
    # "the photo looks sharp: it is left as it is" has its reason before the colon.
    reason = reasons[0].rpartition(":")[0] if reasons else ""
    return {"verdict": "left", "reason": reason or _STILL}


def confidence_words(confidence: float) -> str:
    """Return the words for the confidence of a kernel, 0..1."""
    return next((words for least, words in _WORDS if confidence >= least), "doubtful")


def summary_words(figures: Mapping[str, Any]) -> str:
    """Describe in a few words what was done to a photo, by the figures of its result."""
    if figures["verdict"] == UNSHAKEN:
        return f"passed over: {figures['reason']}"
    if figures["verdict"] == "left":
        return f"{_LEFT}: {figures['reason']}"
    extent, words = figures["extent_px"], confidence_words(figures["confidence"])
    moving = figures.get("moving", 0)
    kept = f", {moving:.0%} kept where something moved" if moving >= _SEEN_TO_MOVE else ""
    return f"shake of {extent:.{0 if extent >= 10 else 1}f} px, {words}{kept}"


def blur_words(figures: Mapping[str, Any]) -> str:
    """Describe in a few words what blurs a photo, by the figures of `BlurKind.report`."""
    if figures["verdict"] == "unclear":
        return "unclear: too little detail"
    words = str(figures["verdict"]) if figures["certain"] else f"perhaps {figures['verdict']}"
    if figures["verdict"] != "shaken":
        return words
    width = figures["width_px"]
    shown = f"{width:.{0 if width >= 10 else 1}f}"
    return f"{words}, about {shown} px at {figures['direction']:.0f} degrees"
