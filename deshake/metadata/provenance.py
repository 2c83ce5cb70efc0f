"""The provenance of a photo, in its own metadata: a block of JSON in its XMP, and the Software tag.

The block is a property of simple text in deshake's own namespace. A search for its bytes works in
any format, since deshake neither compresses nor splits XMP packets.
"""

from __future__ import annotations

import json
import mmap
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from deshake.metadata import exif, xmp
from deshake.metadata.exif_editing import with_software

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping

    from deshake.metadata.metadata import Metadata

__all__ = ["NAMESPACE", "PROPERTY", "carried_provenance", "read_provenance", "with_provenance"]

NAMESPACE: Final = ("deshake", "urn:deshake:photo:1#")
"""Prefix and name of the XMP namespace."""

PROPERTY: Final = "Provenance"
"""The XMP property that holds the block."""

_KEY: Final = f"{NAMESPACE[0]}:{PROPERTY}".encode()
_MAX_TEXT: Final = 1 << 17  # bytes of the block that are read
_MAX_PLACES: Final = 16  # places read: the start tag, the end tag, and others with the same name


def with_provenance(metadata: Metadata, provenance: Mapping[str, Any]) -> Metadata:
    """Return metadata with the provenance of the photo.

    EXIF's Software becomes ``deshake VERSION``; the block keeps the former text as ``software``.
    An earlier block is replaced. If the XMP packet has no place for the block, only the Software
    tag is written.

    Parameters
    ----------
    metadata : Metadata
        The metadata of the photo.
    provenance : mapping
        JSON data; ``deshake`` is the version.

    Raises
    ------
    ValueError
        If the provenance is not JSON data.

    """
    first = exif.read_first(metadata.exif)
    former = "" if first is None else first.text(exif.SOFTWARE)
    software = f"deshake {provenance['deshake']}"
    block = dict(provenance)
    if former and former != software:
        block["software"] = former
    text = json.dumps(block, sort_keys=True, allow_nan=False)
    packet = xmp.without(metadata.xmp, NAMESPACE[0], PROPERTY)
    packet = xmp.insert(packet, NAMESPACE, PROPERTY, text) or metadata.xmp
    return replace(metadata, exif=with_software(metadata.exif, software), xmp=packet)


def carried_provenance(metadata: Metadata) -> dict[str, Any] | None:
    """Return the provenance in a photo's metadata; None if there is none."""
    return _find(metadata.xmp)


def read_provenance(path: str | os.PathLike[str]) -> dict[str, Any] | None:
    """Return the provenance in a photo that deshake wrote; None if there is none.

    No picture is decoded. It never fails, and it takes no more memory than the block: a file that
    cannot be read has no provenance.
    """
    try:
        if not Path(path).is_file():
            return None
        with (
            Path(path).open("rb") as stream,
            mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data,
        ):
            return _find(data)
    except (OSError, ValueError):  # an empty file cannot be mapped
        return None


def _find(data: mmap.mmap | bytes) -> dict[str, Any] | None:
    at = -1
    for _ in range(_MAX_PLACES):
        at = data.find(_KEY, at + 1)
        if at < 0:
            break
        text = xmp.property_of(data[at : at + _MAX_TEXT], NAMESPACE[0], PROPERTY)
        try:
            content = json.loads(text or "")
        except (ValueError, RecursionError):
            continue
        if isinstance(content, dict):
            return content
    return None
