from __future__ import annotations

import io
import os
import struct
import tracemalloc
import zlib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageOps

from deshake.errors import OutputError, PhotoError
from deshake.formats.camera_curve import light_before
from deshake.formats.photo import read_photo
from deshake.formats.photo_writing import encode_photo, write_photo
from deshake.formats.transfer import LINEAR, SRGB, Power, encode
from deshake.signal.luminance import luminance

if TYPE_CHECKING:
    from collections.abc import Callable

LINEAR_CURVE = b"curv" + bytes(8)


def tiff(path: Path, codes: np.ndarray) -> Path:
    channels = codes.shape[2] if codes.ndim == 3 else 1
    options: dict[str, Any] = {"extrasamples": ["unassalpha"]} if channels in {2, 4} else {}
    options["photometric"] = "rgb" if channels > 2 else "minisblack"
    options["planarconfig"] = "contig" if channels > 1 else None
    tifffile.imwrite(path, codes, metadata=None, **options)
    return path


@pytest.mark.parametrize("transfer", ["srgb", "linear", "gamma22"])
@pytest.mark.parametrize("kind", [(c, d) for c in (1, 2, 3, 4) for d in (8, 16)], ids=str)
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_an_unchanged_photo_is_written_back_to_the_bit(
    tmp_path: Path,
    make_codes: Callable[..., np.ndarray],
    suffix: str,
    kind: tuple[int, int],
    transfer: Any,
) -> None:
    channels, depth = kind
    codes = make_codes(300, 220, channels, depth)
    source = tiff(tmp_path / "a.tif", codes)
    if suffix == ".png":
        source.with_suffix(".png").write_bytes(encode_photo(read_photo(source), "PNG"))
        source = source.with_suffix(".png")
    before = source.read_bytes()
    photo = read_photo(source, transfer=transfer)
    out = tmp_path / f"out{suffix}"
    write_photo(out, photo)
    again = read_photo(out, transfer=transfer)
    assert photo.pixels.dtype == np.float32
    assert photo.pixels.shape == (300, 220) if channels < 3 else (300, 220, 3)
    assert np.array_equal(again.pixels, photo.pixels)
    if suffix == ".tif":
        assert np.array_equal(tifffile.imread(out), codes)
    if channels in {2, 4}:
        assert photo.alpha is not None
        assert again.alpha is not None
        assert np.array_equal(photo.alpha, codes[..., -1])
        assert np.array_equal(again.alpha, codes[..., -1])
    assert again.encoding.depth == depth
    assert source.read_bytes() == before
    assert encode_photo(photo) == out.read_bytes()


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".webp", ".avif"])
def test_orientation_is_applied_once(
    save: Callable[..., Path],
    make_codes: Callable[..., np.ndarray],
    make_exif: Callable[..., bytes],
    orientation: int,
    suffix: str,
) -> None:
    codes = np.kron(make_codes(3, 5, 3), np.ones((16, 16, 1), np.uint8)).astype(np.uint8)
    options: dict[str, Any] = {"lossless": True} if suffix == ".webp" else {}
    if suffix == ".avif":
        options = {"quality": 100, "subsampling": "4:4:4"}
    if suffix == ".jpg":
        options = {"quality": 95, "subsampling": 0}
    exif = make_exif(orientation=orientation)
    source = save(f"a{suffix}", codes, exif=b"Exif\0\0" + exif, **options)
    photo = read_photo(source)
    with Image.open(source) as stored:
        assert stored.getexif().get(274, 1) == orientation
        upright = np.asarray(ImageOps.exif_transpose(stored))
    assert np.array_equal(SRGB.to_linear(upright / 255).astype(np.float32), photo.pixels)
    out = source.with_name(f"out{suffix}")
    write_photo(out, photo)
    with Image.open(out) as result:
        assert result.getexif().get(274, 1) == 1
        assert result.size == upright.shape[1::-1]
        assert np.abs(np.asarray(result).astype(int) - upright).mean() < 1
        assert result.getexif().get_ifd(0x8769)[0x927C] == b"maker\0note\1\2\3"
        if suffix not in {".tif", ".avif"}:  # Pillow writes a new block into an AVIF
            written = result.info["exif"].removeprefix(b"Exif\0\0")
            assert len(written) == len(exif)
            assert sum(a != b for a, b in zip(written, exif, strict=True)) <= 1


def test_sixteen_bits_and_alpha_are_turned_too(
    make_codes: Callable[..., np.ndarray], make_exif: Callable[..., bytes], tmp_path: Path
) -> None:
    codes = make_codes(4, 6, 4, 16)
    photo = read_photo(tiff(tmp_path / "a.tif", codes))
    object.__setattr__(photo.metadata, "exif", make_exif(orientation=6))
    for form in ("PNG", "TIFF"):
        stored = tmp_path / f"stored.{form}"
        stored.write_bytes(encode_photo(photo, form))
        turned = read_photo(stored)
        assert turned.alpha is not None
        assert np.array_equal(turned.alpha, np.rot90(codes[..., 3], -1))
        assert np.array_equal(turned.pixels, np.rot90(photo.pixels, -1))
        assert turned.metadata.orientation == 1


def test_the_profile_gives_the_curve_and_the_option_overrides_it(
    save: Callable[..., Path],
    make_codes: Callable[..., np.ndarray],
    make_icc: Callable[..., bytes],
) -> None:
    codes = make_codes(9, 9, 3)
    source = save("a.png", codes, icc_profile=make_icc(LINEAR_CURVE))
    photo = read_photo(source)
    assert photo.encoding.transfer == LINEAR
    assert np.allclose(photo.pixels, codes / 255, atol=1e-7)
    assert read_photo(source, transfer="srgb").encoding.transfer is SRGB
    assert read_photo(source, transfer="gamma22").encoding.transfer == Power(2.2)
    assert read_photo(save("b.png", codes)).encoding.transfer is SRGB


def test_only_a_curve_that_is_not_certain_may_hide_another(
    save: Callable[..., Path],
    make_codes: Callable[..., np.ndarray],
    make_icc: Callable[..., bytes],
) -> None:
    codes = make_codes(9, 9, 3)
    source = save("a.png", codes)
    assert read_photo(source).may_be_toned
    assert not read_photo(source, transfer="srgb").may_be_toned
    linear = save("b.png", codes, icc_profile=make_icc(LINEAR_CURVE))
    assert not read_photo(linear).may_be_toned
    photo = read_photo(source)
    assert not replace(photo, encoding=replace(photo.encoding, format="RAW")).may_be_toned


def test_display_values_are_those_of_the_file(
    save: Callable[..., Path], make_codes: Callable[..., np.ndarray]
) -> None:
    codes = make_codes(9, 9, 3)
    photo = read_photo(save("a.png", codes))
    shown = photo.in_display_values()
    assert np.allclose(shown.pixels, codes / 255, atol=1e-6)
    assert not shown.may_be_toned
    assert np.array_equal(shown.clipped, photo.clipped)
    back = shown.with_pixels(shown.pixels * 1.5).with_tones_of(photo)
    assert back.encoding == photo.encoding
    assert np.allclose(back.in_display_values().pixels, 1.5 * codes / 255, atol=1e-5)
    assert photo.with_tones_of(photo) is photo


def test_the_light_before_a_camera_curve_goes_back_to_the_values_of_the_file(
    save: Callable[..., Path], make_codes: Callable[..., np.ndarray]
) -> None:
    codes = make_codes(9, 9, 3)
    photo = read_photo(save("a.png", codes))
    before = photo.without_camera_curve()
    assert np.allclose(before.pixels, light_before(photo.pixels), atol=1e-6)
    assert not before.may_be_toned
    assert np.array_equal(before.clipped, photo.clipped)
    assert np.array_equal(encode(before.pixels, before.encoding.transfer, 8), codes)
    back = before.with_tones_of(photo)
    assert back.encoding == photo.encoding
    assert np.allclose(back.pixels, photo.pixels, atol=1e-5)
    brighter = before.with_pixels(before.pixels * 2).with_tones_of(photo)
    assert np.allclose(light_before(brighter.pixels), 2 * before.pixels, atol=1e-4)


def test_clipped_pixels_are_marked(save: Callable[..., Path]) -> None:
    codes = np.full((2, 3, 3), 100, np.uint8)
    codes[0, 1, 2], codes[1, 2, 0] = 254, 255
    clipped = read_photo(save("a.png", codes)).clipped
    assert clipped.tolist() == [[False, True, False], [False, False, True]]
    grey = read_photo(save("b.png", codes[..., 0])).clipped
    assert grey.tolist() == [[False] * 3, [False, False, True]]


def test_results_are_clipped_when_they_are_encoded(
    save: Callable[..., Path], tmp_path: Path
) -> None:
    photo = read_photo(save("a.png", np.full((2, 2), 100, np.uint8)))
    changed = photo.with_pixels(np.array([[-1, 0.5], [1, 7]]))
    assert changed.pixels.dtype == np.float32
    assert changed.pixels.max() == 7
    write_photo(tmp_path / "out.png", changed)
    with Image.open(tmp_path / "out.png") as result:
        assert np.asarray(result).tolist() == [[0, 188], [255, 255]]
    with pytest.raises(ValueError, match="shape"):
        photo.with_pixels(np.zeros((2, 3)))


@pytest.mark.parametrize("source", [".jpg", ".png", ".tif", ".webp", ".avif"])
@pytest.mark.parametrize("target", [".jpg", ".png", ".tif", ".webp", ".avif"])
def test_every_format_becomes_every_other_with_its_metadata(
    save: Callable[..., Path],
    make_exif: Callable[..., bytes],
    make_icc: Callable[..., bytes],
    source: str,
    target: str,
) -> None:
    y, x = np.mgrid[:40, :60]
    codes = np.stack([4 * x, 6 * y, x + y], -1).astype(np.uint8)
    icc = make_icc(b"curv" + bytes(4) + b"\0\0\0\1\2\0")
    path = save(f"a{source}", codes, exif=b"Exif\0\0" + make_exif(), icc_profile=icc)
    photo = read_photo(path)
    assert photo.encoding.transfer == Power(2.0)
    out = path.with_name(f"out{target}")
    write_photo(out, photo)
    with Image.open(out) as result:
        assert result.format == {".jpg": "JPEG", ".tif": "TIFF"}.get(target, target[1:].upper())
        assert result.info["icc_profile"] == icc
        below = dict(result.getexif().get_ifd(0x8769))
        assert below[0x920A] == pytest.approx(5.8)
        assert below[0x927C] == b"maker\0note\1\2\3"
        with Image.open(path) as before:
            assert np.abs(np.asarray(result).astype(int) - np.asarray(before)).mean() < 2.5


def test_sixteen_bits_become_eight_where_they_must(
    make_codes: Callable[..., np.ndarray], tmp_path: Path
) -> None:
    codes = make_codes(40, 40, 4, 16)
    photo = read_photo(tiff(tmp_path / "a.tif", codes))
    with Image.open(io.BytesIO(encode_photo(photo, "WEBP"))) as result:
        assert np.array_equal(np.asarray(result)[..., 3], np.rint(codes[..., 3] / 257))
    codes[..., 3] = 65535
    photo = read_photo(tiff(tmp_path / "b.tif", codes))
    with Image.open(io.BytesIO(encode_photo(photo, "JPEG"))) as result:
        assert (result.format, result.mode) == ("JPEG", "RGB")


def test_transparency_in_a_jpeg_is_refused(save: Callable[..., Path], tmp_path: Path) -> None:
    photo = read_photo(save("a.png", np.full((4, 4, 4), 9, np.uint8)))
    with pytest.raises(PhotoError, match="transparency") as caught:
        write_photo(tmp_path / "out.jpg", photo)
    assert caught.value.hint is not None
    assert not (tmp_path / "out.jpg").exists()


def test_content_decides_not_the_name(save: Callable[..., Path], tmp_path: Path) -> None:
    png = save("a.png", np.full((4, 4, 3), 9, np.uint8))
    assert read_photo(png.rename(tmp_path / "a.jpg")).encoding.format == "PNG"


def test_an_output_is_never_the_source(save: Callable[..., Path], tmp_path: Path) -> None:
    source = save("a.png", np.full((4, 4, 3), 9, np.uint8))
    before = source.read_bytes()
    (tmp_path / "link.png").symlink_to(source)
    for out in (source, tmp_path / "link.png"):
        with pytest.raises(OutputError, match="the input itself"):
            write_photo(out, read_photo(source), overwrite=True)
    assert source.read_bytes() == before


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (b"", "the file is empty"),
        (b"Dear diary, today was a fine day.\n", "not a photo of a known format"),
        (b"GIF89a\1\0\1\0", "a GIF"),
        (b"\0\0\0\x18ftypisom\0\0\0\0", "video"),
        (b"\xff\xd8\xff", "JPEG is damaged"),
        (b"\x89PNG\r\n\x1a\n", "PNG is damaged"),
        (b"II*\0\x08\0\0\0", "TIFF is damaged"),
        (b"MM\0*", "TIFF is damaged"),
        (b"RIFF\0\0\0\0WEBP", "WebP is damaged"),
    ],
)
def test_files_that_are_no_photo_are_named(tmp_path: Path, data: bytes, match: str) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(data)
    with pytest.raises(PhotoError, match=match) as caught:
        read_photo(path)
    assert caught.value.file == str(path)
    assert "\n" not in caught.value.message


def test_names_without_a_regular_file_are_named(tmp_path: Path) -> None:
    with pytest.raises(PhotoError, match="no such file"):
        read_photo(tmp_path / "no.jpg")
    with pytest.raises(PhotoError, match="is a folder"):
        read_photo(tmp_path)
    os.mkfifo(tmp_path / "pipe.jpg")
    with pytest.raises(PhotoError, match="no ordinary file"):
        read_photo(tmp_path / "pipe.jpg")


@pytest.mark.parametrize("shape", [(1, 1), (3, 5000), (5000, 3)])
def test_odd_shapes_are_read_and_written(
    save: Callable[..., Path], tmp_path: Path, shape: tuple[int, int]
) -> None:
    codes = np.full((*shape, 3), 77, np.uint8)
    for suffix in (".jpg", ".png", ".tif", ".webp", ".avif"):
        photo = read_photo(save(f"a{suffix}", codes))
        assert photo.shape == shape
        write_photo(tmp_path / f"out{suffix}", photo)
        with Image.open(tmp_path / f"out{suffix}") as result:
            assert result.size == shape[::-1]


def test_large_cameras_are_read_although_pillow_warns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = io.BytesIO()
    Image.new("L", (120, 90), 80).save(stream, "JPEG")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)
    path = Path(tmp_path / "a.jpg")
    path.write_bytes(stream.getvalue())
    assert read_photo(path).shape == (90, 120)


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("form", ["JPEG", "PNG", "TIFF", "WEBP"])
def test_a_damaged_file_is_read_or_refused_in_one_line(
    make_codes: Callable[..., np.ndarray],
    make_exif: Callable[..., bytes],
    tmp_path: Path,
    form: Any,
    depth: int,
) -> None:
    photo = read_photo(tiff(tmp_path / "a.tif", make_codes(20, 24, 3, depth)))
    object.__setattr__(photo.metadata, "exif", make_exif(orientation=6))
    data = encode_photo(photo, form)
    path = tmp_path / "damaged"
    rng = np.random.default_rng(11)
    for _ in range(150):
        broken = bytearray(data)
        for at in rng.integers(0, min(len(data), rng.choice([400, 10**9])), 3):
            broken[at] = rng.choice([0, 1, 255, rng.integers(256)])
        path.write_bytes(broken)
        try:
            encode_photo(read_photo(path), form)
        except PhotoError as error:
            assert "\n" not in str(error)  # noqa: PT017


def test_a_floating_point_tiff_is_linear_in_other_formats_too(tmp_path: Path) -> None:
    light = np.random.default_rng(0).random((40, 50, 3)).astype(np.float32) * 2
    tifffile.imwrite(tmp_path / "a.tif", light, photometric="rgb", metadata=None)
    photo = read_photo(tmp_path / "a.tif")
    assert np.array_equal(photo.pixels, light)
    assert not photo.clipped.any()
    write_photo(tmp_path / "b.tif", photo)
    assert np.array_equal(tifffile.imread(tmp_path / "b.tif"), light)
    write_photo(tmp_path / "b.png", photo)
    other = read_photo(tmp_path / "b.png")
    assert other.encoding.transfer == LINEAR
    assert np.abs(other.pixels - np.clip(light, 0, 1)).max() < 1e-5


def test_the_curve_of_a_png_becomes_a_profile_in_other_formats(tmp_path: Path) -> None:
    gamma = struct.pack(">I4sI", 4, b"gAMA", 100000)
    gamma += struct.pack(">I", zlib.crc32(gamma[4:]))
    stream = io.BytesIO()
    Image.fromarray(np.full((40, 50, 3), 99, np.uint8)).save(stream, "PNG")
    data = stream.getvalue()
    (tmp_path / "a.png").write_bytes(data[:33] + gamma + data[33:])
    photo = read_photo(tmp_path / "a.png")
    assert photo.encoding.transfer == LINEAR
    for name in ("b.tif", "b.jpg", "b.avif"):
        write_photo(tmp_path / name, photo)
        again = read_photo(tmp_path / name)
        assert again.encoding.transfer == LINEAR
        assert np.abs(again.pixels - photo.pixels).max() < 0.01


def test_luma_alone_is_the_grey_of_a_jpeg(tmp_path: Path) -> None:
    codes = np.random.default_rng(0).integers(40, 200, (6, 8, 3), np.uint8).repeat(16, 0)
    Image.fromarray(codes.repeat(16, 1)).save(tmp_path / "a.jpg", quality=95)
    colours, luma = (read_photo(tmp_path / "a.jpg", luma=luma) for luma in (False, True))
    assert (colours.pixels.ndim, luma.pixels.ndim) == (3, 2)
    assert luma.frame is None
    assert luma.sha256 == colours.sha256
    shown = np.asarray(Image.open(tmp_path / "a.jpg").convert("L")) / 255
    grey = np.where(
        luma.pixels <= 0.0031308, 12.92 * luma.pixels, 1.055 * luma.pixels ** (1 / 2.4) - 0.055
    )
    assert np.abs(grey - shown).max() < 0.02
    write_photo(tmp_path / "a.png", colours)
    assert read_photo(tmp_path / "a.png", luma=True).pixels.ndim == 3


@pytest.mark.parametrize("name", ["grey.png", "wide.png", "turned.jpg", "upright.jpg", "float.tif"])
def test_a_photo_reduced_as_it_is_read_has_the_same_light(tmp_path: Path, name: str) -> None:
    codes = np.random.default_rng(0).integers(0, 256, (300, 40, 3), np.uint8)
    path = tmp_path / name
    if name == "float.tif":
        tiff(path, codes.astype(np.float32) / 200)
    elif name == "wide.png":
        written = tiff(tmp_path / "wide.tif", codes.astype(np.uint16) * 257)
        write_photo(path, read_photo(written))
    else:
        picture = Image.fromarray(codes[..., 0] if name == "grey.png" else codes)
        exif = Image.Exif()
        exif[0x0112] = 6 if name == "turned.jpg" else 1
        picture.save(path, **({} if name == "grey.png" else {"exif": exif, "quality": 98}))
    whole, grey = read_photo(path), read_photo(path, reduction=luminance)
    assert (grey.pixels.dtype, grey.pixels.flags.c_contiguous) == (np.float32, True)
    assert np.array_equal(grey.pixels, luminance(whole.pixels))
    assert np.array_equal(grey.clipped, whole.clipped)
    assert whole.clipped.any() == (name != "float.tif")
    assert (whole.frame is not None) == (name == "upright.jpg")
    assert grey.frame is None  # it would keep the colours
    assert grey.sha256 == whole.sha256


def test_a_photo_reduced_as_it_is_read_never_has_all_its_colours(tmp_path: Path) -> None:
    codes = np.zeros((1000, 1000, 3), np.uint8)
    codes[::2] = 255
    Image.fromarray(codes).save(tmp_path / "a.png", compress_level=1)
    peaks = []
    for reduction in (None, luminance):
        tracemalloc.start()
        read_photo(tmp_path / "a.png", reduction=reduction)
        peaks.append(tracemalloc.get_traced_memory()[1] / 1e6)  # bytes a pixel
        tracemalloc.stop()
    assert peaks[0] > 15  # 3 for the codes, 12 for the light
    assert peaks[1] < 12
