from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
import pytest
import rawpy
import tifffile
from PIL import Image, ImageCms

from deshake.errors import OutputError, PhotoError
from deshake.formats.conversion import output_format
from deshake.formats.photo import balanced, read_pair, read_photo
from deshake.formats.photo_writing import encode_photo, write_photo
from deshake.formats.raw import decode_raw
from deshake.formats.transfer import LINEAR, SRGB

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from deshake.formats.photo import Photo

EXIF = {
    0x829A: ("r", [0.25]),
    0x8827: ("H", [400]),
    0x920A: ("r", [35.0]),
    0x927C: ("B", list(b"maker\0note")),
    0xA405: ("H", [52]),
}
WITHIN = slice(8, -8)  # pixels with neighbours on all sides for demosaicing


def smooth(height: int = 90, width: int = 120) -> NDArray[np.float64]:
    """Make a picture so smooth that a mosaic loses no detail, in linear sRGB."""
    y, x = np.mgrid[:height, :width] / 40
    colours = [0.3 + 0.2 * np.sin(a * x + b * y) for a, b in ((3, 1), (0, 2), (2, -1))]
    return np.stack(colours, -1)


def read(path: Path, data: bytes) -> Photo:
    path.write_bytes(data)
    return read_photo(path)


def light(photo: Photo) -> NDArray[np.floating]:
    """Return the photo's result as linear light in the colours of its file."""
    with io.BytesIO(encode_photo(photo)) as stream:
        codes = tifffile.imread(stream)
    assert codes.dtype == np.uint16
    return photo.encoding.transfer.to_linear(codes / 65535)


def test_the_picture_on_the_sensor_is_decoded(
    tmp_path: Path, make_dng: Callable[..., bytes]
) -> None:
    picture = smooth()
    photo = read(tmp_path / "a.dng", make_dng(picture))
    assert photo.pixels.shape == picture.shape
    error = (light(photo) - picture)[WITHIN, WITHIN]
    assert np.abs(error).max() < 0.004
    assert np.abs(error).mean() < 0.0006
    assert not photo.clipped.any()
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:  # LibRaw's own conversion to sRGB
        theirs = raw.postprocess(
            gamma=(1, 1), output_bps=16, no_auto_bright=True, use_camera_wb=True,
            adjust_maximum_thr=0,
        )  # fmt: skip
    assert np.abs(light(photo) - theirs / 65535).max() < 1e-3


def test_black_is_black_and_white_is_white(tmp_path: Path, make_dng: Callable[..., bytes]) -> None:
    picture = np.zeros((40, 40, 3))
    picture[:, 20:] = 0.999
    for black, white in ((0, 4095), (1024, 16000)):
        photo = read(tmp_path / "a.dng", make_dng(picture, black=black, white=white))
        values = light(photo)
        assert values[:, :15].max() < 1e-4
        assert np.abs(values[:, 25:] - 0.999).max() < 2e-3


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_is_applied_once(
    tmp_path: Path, make_dng: Callable[..., bytes], orientation: int
) -> None:
    upright = read(tmp_path / "a.dng", make_dng(smooth())).pixels
    photo = read(tmp_path / "a.dng", make_dng(smooth(), orientation=orientation))
    want = {
        1: upright,
        2: upright[:, ::-1],
        3: upright[::-1, ::-1],
        4: upright[::-1],
        5: upright.swapaxes(0, 1),
        6: np.rot90(upright, -1),
        7: np.rot90(upright, -1)[::-1],
        8: np.rot90(upright),
    }[orientation]
    assert np.array_equal(photo.pixels, want)
    assert photo.metadata.orientation == 1


def test_margins_and_crop_are_cut_off(tmp_path: Path, make_dng: Callable[..., bytes]) -> None:
    whole = read(tmp_path / "a.dng", make_dng(smooth())).pixels
    masked = read(tmp_path / "a.dng", make_dng(smooth(), margin=6)).pixels
    assert masked.shape == whole.shape
    assert np.array_equal(masked[WITHIN, WITHIN], whole[WITHIN, WITHIN])
    cropped = read(tmp_path / "a.dng", make_dng(smooth(), margin=6, crop=(10, 4, 100, 80))).pixels
    assert np.array_equal(cropped, masked[4:84, 10:110])
    absurd = read(tmp_path / "a.dng", make_dng(smooth(), crop=(10, 4, 500, 80))).pixels
    assert absurd.shape == whole.shape


def test_clipping_is_detected_in_each_channel(make_dng: Callable[..., bytes]) -> None:
    picture = np.full((60, 60, 3), 0.2)
    picture[20:40, 20:40] = (0.2, 3.0, 0.2)  # a green lamp
    decoded = decode_raw(make_dng(picture, neutral=(0.5, 1.0, 0.6)))
    assert decoded.saturated is not None
    assert decoded.saturated.shape == (60, 60, 3)
    inside, far = decoded.saturated[22:38, 22:38], decoded.saturated.copy()
    assert inside[..., 1].all()
    far[18:42, 18:42] = False
    assert not far.any()
    # a lamp that saturates only the red photosites, before the white balance
    red = np.full((60, 60, 3), 0.2)
    red[20:40, 20:40] = (2.0, 0.05, 0.05)
    decoded = decode_raw(make_dng(red, neutral=(1.0, 0.5, 0.4)))
    assert decoded.saturated is not None
    shares = decoded.saturated[22:38, 22:38].mean((0, 1))
    assert shares[0] == 1
    assert shares[1] == shares[2] == 0


def test_exif_names_the_camera(tmp_path: Path, make_dng: Callable[..., bytes]) -> None:
    extra = {315: ("c", b"An author"), 700: ("B", list(b"<x:xmpmeta/>"))}
    photo = read(tmp_path / "a.dng", make_dng(smooth(), exif=EXIF, extra=extra))
    tags = photo.metadata.tags()
    assert (tags.make, tags.model) == ("Sensor Works", "One")
    assert (tags.focal_mm, tags.focal_35mm, tags.iso) == (35, 52, 400)
    assert photo.metadata.xmp == b"<x:xmpmeta/>"
    write_photo(tmp_path / "out.tif", photo)
    with Image.open(tmp_path / "out.tif") as result:
        assert result.tag_v2[315] == "An author"
        assert not {50706, 33422, 50717, 50829} & set(result.tag_v2)  # the result is no DNG
        assert result.getexif().get_ifd(0x8769)[0x927C] == b"maker\0note"


def test_two_photos_of_a_scene_share_one_white_balance(
    tmp_path: Path, make_dng: Callable[..., bytes]
) -> None:
    picture = smooth()
    first, second = tmp_path / "a.dng", tmp_path / "b.dng"
    first.write_bytes(make_dng(picture, neutral=(0.5, 1.0, 0.6)))
    # the same light on the sensor, in a camera with another white balance
    balance = {50728: ("r", (0.4, 1, 0.7))}
    set_otherwise = make_dng(picture, neutral=(0.5, 1.0, 0.6), extra=balance)
    second.write_bytes(set_otherwise)
    assert np.abs(read_photo(second).pixels - read_photo(first).pixels).max() > 0.05
    one, other = read_pair(first, second)
    assert np.abs(one.pixels - other.pixels)[WITHIN, WITHIN].max() < 2e-3
    own = balanced(read_photo(second), one)
    assert np.array_equal(own.pixels, other.pixels)
    assert balanced(own, one) is own  # a second call changes nothing
    assert own.encoding.balance == one.encoding.balance


def test_the_profile_is_true(tmp_path: Path, make_dng: Callable[..., bytes]) -> None:
    picture = smooth()
    data = make_dng(picture)
    photo = read(tmp_path / "a.dng", data)
    linear = photo.in_linear_light()
    assert photo.encoding.transfer is SRGB
    assert linear.encoding.transfer is LINEAR
    results = []
    for name, each in (("a.tif", photo), ("linear.tif", linear)):
        write_photo(tmp_path / name, each)
        assert read_photo(tmp_path / name).encoding.transfer == each.encoding.transfer
        codes = tifffile.imread(tmp_path / name)
        profile = ImageCms.ImageCmsProfile(io.BytesIO(each.metadata.icc))
        to_srgb = ImageCms.buildTransform(
            profile, ImageCms.createProfile("sRGB"), "RGB", "RGB", renderingIntent=1
        )
        eight = Image.fromarray(np.rint(codes / 257).astype(np.uint8))
        results.append(np.asarray(ImageCms.applyTransform(eight, to_srgb)).astype(int))
    want = 255 * SRGB.from_linear(picture.astype(np.float32))
    for result in results:
        assert np.abs(result - want)[WITHIN, WITHIN].mean() < 1
    # linear light also holds colours outside sRGB
    assert np.allclose(light(linear), linear.pixels, atol=1e-5)


def test_a_sensor_without_filters_gives_a_grey_photo(
    tmp_path: Path, make_dng: Callable[..., bytes]
) -> None:
    picture = smooth()[..., 0]
    photo = read(tmp_path / "a.dng", make_dng(picture, neutral=(1.0,)))
    assert photo.encoding.grey
    assert photo.pixels.shape == picture.shape
    assert np.abs(photo.pixels - picture).max() < 1e-3
    write_photo(tmp_path / "out.tif", photo)
    assert tifffile.imread(tmp_path / "out.tif").shape == picture.shape


def test_raw_is_read_only_and_linear(tmp_path: Path, make_dng: Callable[..., bytes]) -> None:
    photo = read(tmp_path / "a.dng", make_dng(smooth()))
    assert output_format("out.tif", photo.source, photo.encoding) == "TIFF"
    assert output_format("out.jpg", photo.source, photo.encoding) == "JPEG"
    with pytest.raises(OutputError, match="read, but not written"):
        output_format("out.dng", photo.source, photo.encoding)
    with pytest.raises(PhotoError, match="in linear light"):
        read_photo(tmp_path / "a.dng", transfer="srgb")
    write_photo(tmp_path / "a.png", photo)
    with pytest.raises(PhotoError, match="--linear is for RAW files"):
        read_photo(tmp_path / "a.png").in_linear_light()


def test_equal_files_give_equal_bytes(tmp_path: Path, make_dng: Callable[..., bytes]) -> None:
    data = make_dng(smooth())
    first, second = (encode_photo(read(tmp_path / name, data)) for name in ("a.dng", "b.dng"))
    assert first == second


@pytest.mark.parametrize("keep", [0.1, 0.5, 0.95, 0.9999])
def test_a_file_cut_short_is_refused_and_libraw_prints_nothing(
    tmp_path: Path, make_dng: Callable[..., bytes], keep: float, capfd: pytest.CaptureFixture[str]
) -> None:
    data = make_dng(smooth())
    with pytest.raises(PhotoError, match=r"damaged|cannot be read"):
        read(tmp_path / "a.dng", data[: int(keep * len(data))])
    assert capfd.readouterr() == ("", "")


def test_pixels_beyond_the_end_of_a_dng_are_refused(
    tmp_path: Path, make_dng: Callable[..., bytes]
) -> None:
    data = make_dng(smooth(), extra={324: ("I", [60]), 325: ("I", [10**7])})
    with pytest.raises(PhotoError, match="cut short"):
        read(tmp_path / "a.dng", data)


def test_a_dng_that_was_demosaiced_already(make_dng: Callable[..., bytes]) -> None:
    picture = smooth()
    picture[20:40, 20:40] = (0.2, 3.0, 0.2)
    decoded = decode_raw(make_dng(picture, mosaic=False))
    assert decoded.codes.shape == picture.shape
    assert decoded.saturated is not None
    assert decoded.saturated[20:40, 20:40, 1].all()
    assert not np.delete(decoded.saturated, slice(20, 40), 0).any()
    colours = decoded.codes / 65535 @ np.array(decoded.encoding.matrix).T
    scale = colours[50:].mean() / picture[50:].mean()  # LibRaw's white is a little below 65535
    assert 0.95 < scale < 1.01
    assert np.abs(colours / scale - picture)[50:].max() < 0.003
