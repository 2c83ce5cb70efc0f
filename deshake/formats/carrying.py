"""Which metadata of a photo a format can hold, and in what form.

Blocks are copied byte for byte, with three changes. Thumbnails are removed, since they show the
photo before the work. Sizes become those of the picture. Blocks too long for a JPEG are shortened
or split.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from deshake.metadata import exif, exif_editing, image_resources, xmp
from deshake.metadata.provenance import NAMESPACE, PROPERTY

if TYPE_CHECKING:
    from deshake.formats.encoding import Format
    from deshake.metadata.metadata import Metadata

__all__ = ["LONGEST_XMP", "Carried", "carried"]

LONGEST_XMP: Final = 65502
"""Bytes of the longest XMP packet that a JPEG can hold."""

_LONGEST_ICC: Final = 255 * 65519
_NO_IPTC: Final = ("WEBP", "AVIF", "JPEG2000")


@dataclass(frozen=True)
class Carried:
    """Metadata for a file of some format.

    Parameters
    ----------
    metadata : Metadata
        The metadata that the file will hold.
    losses : tuple of str
        The metadata that it cannot hold, in plain words.

    """

    metadata: Metadata
    losses: tuple[str, ...]


def carried(metadata: Metadata, form: Format, height: int, width: int) -> Carried:
    """Fit a photo's metadata to the format of its file.

    Parameters
    ----------
    metadata : Metadata
        The metadata of the photo, which is upright.
    form : Format
        The format of the file.
    height, width : int
        Size of the picture.

    """
    losses: list[str] = []
    block = exif_editing.with_size(exif_editing.without_thumbnail(metadata.exif), height, width)
    packet = xmp.with_size(xmp.without_thumbnails(metadata.xmp), height, width)
    fitted = replace(
        metadata,
        exif=block,
        xmp=packet,
        resources=image_resources.without_thumbnails(metadata.resources),
    )
    if fitted.extended_xmp and form != "JPEG":
        fitted = _with_extended(fitted, losses)
    if form == "JPEG":
        block = exif_editing.complete(
            block, metadata.density, (height, width), icc=bool(fitted.icc)
        )
        fitted = _for_jpeg(replace(fitted, exif=block), losses)
    if form in _NO_IPTC and (fitted.iptc or fitted.resources):
        losses.append(f"{_title(form)} has no place for IPTC, which is left out")
        fitted = replace(fitted, iptc=b"", resources=b"")
    return Carried(fitted, tuple(losses))


def _with_extended(metadata: Metadata, losses: list[str]) -> Metadata:
    """Put a JPEG's extended XMP into the packet: in other formats one packet has room."""
    packet = xmp.merged(metadata.xmp, metadata.extended_xmp)
    if packet is None:
        losses.append("its extended XMP is damaged, and left out")
        packet = metadata.xmp
    return replace(metadata, xmp=packet, extended_xmp=b"")


def _for_jpeg(metadata: Metadata, losses: list[str]) -> Metadata:
    """Make all blocks fit into the segments of a JPEG."""
    if len(metadata.icc) > _LONGEST_ICC:
        losses.append("its colour profile is too long for a JPEG, and left out")
        metadata = replace(metadata, icc=b"")
    if len(metadata.exif) > exif.LONGEST:
        block, dropped = exif_editing.shortened(metadata.exif, exif.LONGEST)
        if exif_editing.maker_note_at(block) != exif_editing.maker_note_at(metadata.exif) and block:
            losses.append("its maker note has moved: some programs may not read all of it")
        if dropped:
            tags = ", ".join(f"0x{tag:04X}" for tag in dropped)
            losses.append(f"its EXIF is too long for a JPEG: tags {tags} are left out")
        metadata = replace(metadata, exif=block)
    return _short_xmp(metadata, losses) if len(metadata.xmp) > LONGEST_XMP else metadata


def _short_xmp(metadata: Metadata, losses: list[str]) -> Metadata:
    """Make an XMP packet fit into a JPEG; the rest becomes extended XMP."""
    packet, more = xmp.without_padding(metadata.xmp), metadata.extended_xmp
    if len(packet) > LONGEST_XMP and more:  # split already: the provenance was added since
        packet = xmp.without(packet, NAMESPACE[0], PROPERTY)
        losses.append("its XMP has no room for the provenance")
    elif len(packet) > LONGEST_XMP:
        packet, more = xmp.extended(packet, (NAMESPACE, PROPERTY)) or (packet, b"")
    if len(packet) > LONGEST_XMP:
        losses.append("its XMP is too long for a JPEG, and left out")
        packet, more = b"", b""
    return replace(metadata, xmp=packet, extended_xmp=more)


def _title(form: Format) -> str:
    return {"WEBP": "WebP", "JPEG2000": "JPEG 2000"}.get(form, form)
