from __future__ import annotations

import io
import os
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from deshake.formats.encoding import Decoded, Encoding
from deshake.formats.jpeg import encode_jpeg
from deshake.formats.png import encode_png
from deshake.formats.tiff import encode_tiff
from deshake.formats.webp import encode_webp
from deshake.metadata.exif_editing import with_software
from deshake.metadata.metadata import Metadata
from deshake.metadata.provenance import NAMESPACE, read_provenance, with_provenance

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

PROVENANCE = {"deshake": "1.2.3", "options": {"a": None, "b": [1, 0.1]}, "text": "<&>\"' \u00e9\n"}
ENCODERS = {"JPEG": encode_jpeg, "PNG": encode_png, "TIFF": encode_tiff, "WEBP": encode_webp}


def picture(form: Any, metadata: Metadata) -> Decoded:
    return Decoded(np.zeros((9, 8, 3), np.uint8), None, Encoding(form), metadata)


@pytest.mark.parametrize("form", ENCODERS)
@pytest.mark.parametrize("bare", [True, False])
def test_every_format_holds_the_provenance(
    make_exif: Callable[..., bytes], tmp_path: Path, form: str, *, bare: bool
) -> None:
    metadata = with_provenance(
        Metadata() if bare else Metadata(make_exif(">"), b"", b""), PROVENANCE
    )
    path = tmp_path / "photo"
    path.write_bytes(ENCODERS[form](picture(form, metadata)))
    assert read_provenance(path) == PROVENANCE
    with Image.open(io.BytesIO(path.read_bytes())) as read:
        assert read.getexif()[305] == "deshake 1.2.3"
        xmp = read.info["xmp"]
    assert NAMESPACE[1].encode() in xmp


def test_the_software_tag_of_the_camera_is_kept(tmp_path: Path) -> None:
    camera = Metadata(exif=with_software(b"", "Firmware 1.0"))
    (tmp_path / "packet").write_bytes(with_provenance(camera, PROVENANCE).xmp)
    assert read_provenance(tmp_path / "packet") == PROVENANCE | {"software": "Firmware 1.0"}


def test_an_earlier_block_is_replaced() -> None:
    once = with_provenance(Metadata(), PROVENANCE)
    assert with_provenance(once, PROVENANCE) == Metadata(
        with_provenance(Metadata(exif=once.exif), PROVENANCE).exif, once.xmp
    )


def test_bytes_that_are_no_packet_are_unchanged() -> None:
    assert with_provenance(Metadata(xmp=b"rubbish"), PROVENANCE).xmp == b"rubbish"


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xff\xd8\xff",
        b"deshake:Provenance",
        b"<deshake:Provenance>",
        b"<deshake:Provenance>{</deshake:Provenance>",
        b"<deshake:Provenance>[1]</deshake:Provenance>",
        b"<deshake:Provenance>" + b"[" * 100_000 + b"</deshake:Provenance>",
        b"<deshake:Provenance>" * 100_000,
        b'deshake:Provenance="' + b"x" * 1_000_000,
        b"<deshake:Provenance>\xff\xfe</deshake:Provenance>",
    ],
    ids=range(10),
)
def test_files_without_provenance_give_none_and_no_error(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "photo"
    path.write_bytes(data)
    assert read_provenance(path) is None


def test_names_without_a_regular_file_have_no_provenance(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in ("missing", ".", "pipe"):
        assert read_provenance(tmp_path / name) is None
