"""The provenance of a deblurred photo: its inputs, and the options of the deblurring.

`fix` and `deblur` with the same kernel write the same provenance. So their results are the same to
the byte. The provenance names the stage as the command, and has no times, paths or threads.
"""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Final

from deshake.lens.straightening import is_straightened
from deshake.metadata.provenance import NAMESPACE, with_provenance
from deshake.stages.finishing import AS_IT_IS, FinishingOptions
from deshake.version import __version__

if TYPE_CHECKING:
    from collections.abc import Mapping

    from deshake.files.kernel_file import KernelFile
    from deshake.formats.photo import Photo
    from deshake.formats.transfer import TransferName
    from deshake.pair.registration import Registration
    from deshake.stages.blending import Mask
    from deshake.stages.methods import RestorationOptions

__all__ = ["photo_origin", "photo_provenance", "registration_origin", "with_photo_provenance"]

_log = logging.getLogger(__name__)

_LONGEST_KERNEL: Final = 16_384  # characters; a photo does not carry a longer one


def photo_provenance(
    photo: Photo,
    content: KernelFile,
    restoration: RestorationOptions,
    *,
    transfer: TransferName | None = None,
    noisy: Photo | None = None,
    registration: Registration | None = None,
    finish: FinishingOptions = AS_IT_IS,
    mask: Mask | None = None,
) -> dict[str, Any] | None:
    """Return the provenance of a deblurred photo, as JSON data; None: it is not wanted.

    Parameters
    ----------
    photo : Photo
        The photo, or its result.
    content : KernelFile
        The kernel; the photo carries its provenance without the scales.
    restoration : RestorationOptions
        Method of the deblurring and its options.
    transfer : {"srgb", "linear", "gamma22"}, optional
        The given transfer curve.
    noisy : Photo, optional
        The noisy photo of the same scene.
    registration : Registration, optional
        The given registration; recorded if it differs from the kernel's.
    finish : FinishingOptions
        Options beside the deblurring.
    mask : Mask, optional
        Share of the photo that is kept.

    """
    if not finish.with_provenance:
        return None
    record = photo_origin(
        restoration,
        transfer=transfer,
        finish=finish,
        input_sha256=photo.sha256,
        noisy_sha256=None if noisy is None else noisy.sha256,
        mask_sha256=None if mask is None else mask.sha256,
    )
    if is_straightened(photo) or not (content.kernel.camera.is_pinhole or finish.keep_geometry):
        record["straightened"] = True
    other = registration_origin(registration, content.provenance)
    if other is not None:
        record["registration"] = other
    return {
        "deshake": __version__,
        "command": "deblur",
        "kernel": _short(content.provenance),
    } | record


def photo_origin(
    restoration: RestorationOptions,
    *,
    transfer: TransferName | None = None,
    finish: FinishingOptions = AS_IT_IS,
    input_sha256: str | None = None,
    noisy_sha256: str | None = None,
    mask_sha256: str | None = None,
) -> dict[str, Any]:
    """Return the origin of a result: the digests of its inputs, and the options that affect it.

    Before the work the digests come from the files; after the work they come from the bytes that
    were read. Both are the same. An input that is only in memory has no digest.
    """
    options = {"transfer": transfer} | asdict(restoration) | finish.provenance(mask_sha256)
    digests = {"input_sha256": input_sha256, "noisy_sha256": noisy_sha256}
    return {"options": options} | {name: value for name, value in digests.items() if value}


def registration_origin(
    registration: Registration | None, kernel: Mapping[str, Any]
) -> dict[str, Any] | None:
    """Return a photo's record of its registration; None if its kernel's provenance has it."""
    if registration is None or registration.report() == kernel.get("registration"):
        return None
    return registration.report()


def with_photo_provenance(result: Photo, provenance: Mapping[str, Any]) -> Photo:
    """Add the provenance to a result, in its XMP and its Software tag."""
    metadata = with_provenance(result.metadata, provenance)
    if NAMESPACE[1].encode() not in metadata.xmp:
        _log.warning(
            "%s: its XMP metadata are damaged: they do not get a note of how it was made",
            result.source,
        )
    return replace(result, metadata=metadata)


def _short(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return a kernel's provenance without its scales; empty if it is very long."""
    short = {name: value for name, value in provenance.items() if name != "scales"}
    return short if len(json.dumps(short)) <= _LONGEST_KERNEL else {}
