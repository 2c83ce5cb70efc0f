from __future__ import annotations

import json
import sys

import cv2
import numpy as np
import pytest
from PIL import Image
from skimage import data

from deshake.files.kernel_file import KernelFile, read_kernel, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.metadata.provenance import read_provenance

pytestmark = pytest.mark.long

FAST = ("--blur-size", 9, "--estimator", "edges", "--uniform", "--iterations", 2)
NARROW = ("--search-angle", 4)  # quick: a narrow search tries few rotations
PAIR = ("--focal-px", 150, "--blur-size", 8, "--iterations", 2, *NARROW)


@pytest.fixture
def portrait(tmp_path):
    """Save a photo that was shaken by 7 pixels along a slant, under a name.

    One of 140 x 112 is enough for an estimate of its kernel.
    """

    def save(name, width=100, height=80):
        path = tmp_path / name
        blurred = cv2.filter2D(data.astronaut(), -1, np.eye(7) / 7)
        Image.fromarray(blurred[30 : height + 30, 150 : width + 150]).save(path, quality=95)
        return path

    return save


@pytest.fixture
def mask(tmp_path):
    """Save a mask that keeps the upper half of a photo of 100 x 80, under a name."""

    def save(name="mask.png", size=(100, 80)):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        halves = np.zeros(size[::-1], np.uint8)
        halves[: size[1] // 2] = 255
        Image.fromarray(halves).save(path)
        return path

    return save


@pytest.fixture
def words(pan):
    """Words after a photo with which a command deblurs it, quickly."""
    return {"fix": FAST, "deblur": (pan, "--iterations", 2)}


def codes(path):
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize(("name", "depth"), [("a.png", 8), ("b.tif", 8), ("c.png", 16)])
def test_what_the_mask_keeps_keeps_its_codes(deshake, shaken, pan, mask, *, name, depth):
    photo = shaken(name, depth)
    whole, out = photo.with_stem("whole"), photo.with_stem("out")
    assert deshake("deblur", photo, pan, "-o", whole).code == 0
    assert deshake("deblur", photo, pan, "-o", out, "--mask", mask()).code == 0
    before, after, result = (codes(path) for path in (photo, whole, out))
    assert np.array_equal(result[:40], before[:40])
    assert np.array_equal(result[40:], after[40:])
    assert not np.array_equal(after[:40], before[:40])


def test_strength_goes_from_the_photo_to_the_result(deshake, shaken, words, tmp_path):
    photo, whole = shaken("a.png"), tmp_path / "whole.png"
    for strength in (0, 0.5, 1):
        out = ("-o", tmp_path / f"{strength}.png", "--strength", strength)
        assert deshake("deblur", photo, *words["deblur"], *out).code == 0
    assert deshake("deblur", photo, *words["deblur"], "-o", whole).code == 0
    assert (tmp_path / "1.png").read_bytes() == whole.read_bytes()
    before, half, after = (
        codes(tmp_path / name).astype(float) for name in ("a.png", "0.5.png", "1.png")
    )
    assert np.array_equal(codes(tmp_path / "0.png"), before)
    low, high = np.minimum(before, after), np.maximum(before, after)
    assert ((half >= low - 1) & (half <= high + 1)).all()
    assert 0.3 < np.abs(half - before).mean() / np.abs(after - before).mean() < 0.7


def test_a_jpeg_that_is_wholly_kept_has_its_own_codes(deshake, portrait, pan, tmp_path):
    photo, white = portrait("a.jpg"), tmp_path / "white.png"
    Image.new("L", (100, 80), 255).save(white)
    for name, args in {"b.jpg": ("--strength", 0), "c.jpg": ("--mask", white)}.items():
        out = tmp_path / name
        assert deshake("deblur", photo, pan, "--iterations", 1, "-o", out, *args).code == 0
        assert np.array_equal(codes(out), codes(photo))
        assert read_provenance(out)["command"] == "deblur"


def test_fix_blends_as_deblur_does(deshake, portrait, mask, tmp_path):
    photo, kernels, out = portrait("a.jpg", 140, 112), tmp_path / "k", tmp_path / "out.jpg"
    finish = ("--mask", mask(size=(140, 112)), "--strength", 0.8)
    outcome = deshake("fix", photo, *FAST, *finish, "--keep-kernels", kernels, "--json")
    assert outcome.code == 0
    assert json.loads(outcome.out)["mask"] == str(tmp_path / "mask.png")
    args = (kernels / "a.kernel.npz", "--iterations", 2, "-o", out)
    assert deshake("deblur", photo, *args, *finish).code == 0
    assert out.read_bytes() == (tmp_path / "a.deshaken.jpg").read_bytes()
    assert not np.array_equal(codes(out)[64:], codes(photo)[64:])
    options = read_provenance(out)["options"]
    assert options["strength"] == 0.8
    assert len(options["mask_sha256"]) == 64


def test_a_folder_of_masks_is_for_many_photos(deshake, portrait, mask, tmp_path):
    one, two = portrait("one.png", 140, 112), portrait("two.png", 140, 112)
    mask("masks/one.png", (100, 80))
    folder = tmp_path / "masks"
    outcome = deshake("fix", one, two, *FAST, "--mask", folder, "--json")
    assert outcome.code == 0
    lines = [json.loads(line) for line in outcome.out.splitlines()]
    masks = {line["input"]: line.get("mask") for line in lines}
    assert masks == {str(one): str(folder / "one.png"), str(two): None}
    before, kept, whole = (
        codes(tmp_path / name) for name in ("one.png", "one.deshaken.png", "two.deshaken.png")
    )
    assert np.array_equal(kept[:55], before[:55])
    assert np.array_equal(kept[57:], whole[57:])
    assert not np.array_equal(whole[:55], before[:55])


def test_one_mask_is_not_for_many_photos(deshake, sharp_photo, mask):
    outcome = deshake("fix", sharp_photo("a.png"), sharp_photo("b.png"), "--mask", mask())
    assert outcome.code == 2
    assert "for several photos, --mask names a folder of masks" in outcome.err


def test_a_photo_with_two_masks_fails_alone(deshake, sharp_photo, mask, tmp_path):
    one, two = sharp_photo("one.png"), sharp_photo("two.png")
    mask("masks/one.png")
    mask("masks/one.jpg")
    outcome = deshake("fix", one, two, *FAST, "--mask", tmp_path / "masks")
    assert outcome.code == 1
    assert f"error: {one}: one.jpg and one.png could both be its mask\nhint: " in outcome.err
    assert not (tmp_path / "one.deshaken.png").exists()
    assert (tmp_path / "two.deshaken.png").exists()


@pytest.mark.parametrize("command", ["fix", "deblur"])
@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("none.png", "no such file"),
        ("cropped.png", "the mask has 90 x 80 pixels, and "),
        ("colour.png", "a mask is grey"),
        ("text.png", "not a photo"),
    ],
)
def test_a_wrong_mask_is_refused(
    deshake, shaken, words, mask, contents, *, tmp_path, command, name, says
):
    photo = shaken("a.png")
    mask("cropped.png", (90, 80))
    shaken("colour.png")
    (tmp_path / "text.png").write_text("white")
    before = contents(tmp_path)
    outcome = deshake(command, photo, *words[command], "--mask", tmp_path / name)
    assert outcome.code == 1
    assert f"error: {tmp_path / name}: " in outcome.err
    assert says in outcome.err
    assert "hint: " in outcome.err
    assert contents(tmp_path) == before


def test_a_strength_in_percent_gives_the_same_bytes(deshake, shaken, words, monkeypatch, tmp_path):
    photo, config = shaken("a.png"), tmp_path / "config.toml"
    config.write_text("[deblur]\nstrength = '50%'\n", "utf-8")
    runs = {
        "share.png": ((), ("--strength", "0.5")),
        "percent.png": ((), ("--strength", "50%")),
        "file.png": (("--config", config), ()),
        "environment.png": ((), ()),
        "whole.png": ((), ()),
    }
    for name, (before, after) in runs.items():
        run = (*before, "deblur", photo, *words["deblur"], *after, "-o", tmp_path / name)
        if name == "environment.png":
            monkeypatch.setenv("DESHAKE_DEBLUR_STRENGTH", "50 %")
        assert deshake(*run).code == 0
        monkeypatch.delenv("DESHAKE_DEBLUR_STRENGTH", raising=False)
    share, percent, file, environment, whole = ((tmp_path / name).read_bytes() for name in runs)
    assert share == percent == file == environment != whole


@pytest.mark.parametrize("share", ["-0.1", "1.5", "half", "nan", "101%"])
@pytest.mark.parametrize("command", ["fix", "deblur"])
def test_a_strength_is_from_0_to_1(deshake, shaken, words, command, share):
    outcome = deshake(command, shaken("a.png"), *words[command], "--strength", share)
    assert outcome.code == 2
    assert "is not a share: a number from 0 to 1, or 0% to 100%" in outcome.err


def test_a_sheet_lies_beside_the_result(deshake, shaken, words, contents, tmp_path):
    photo = shaken("a.jpg")
    assert deshake("deblur", photo, *words["deblur"]).code == 0
    plain = (tmp_path / "a.deshaken.jpg").read_bytes()
    outcome = deshake("deblur", photo, *words["deblur"], "--compare", "-o", tmp_path / "out.jpg")
    assert outcome.code == 0
    assert (tmp_path / "out.jpg").read_bytes() == plain
    sheet = tmp_path / "out.compare.png"
    assert codes(sheet).shape[2] == 3
    drawn = sheet.read_bytes()
    (tmp_path / "out.jpg").unlink()
    before = contents(tmp_path)
    outcome = deshake("deblur", photo, *words["deblur"], "--compare", "-o", tmp_path / "out.jpg")
    assert outcome.code == 1
    assert f"error: {sheet}: exists already" in outcome.err
    assert contents(tmp_path) == before
    overwrite = ("--compare", "-o", tmp_path / "out.jpg", "--overwrite")
    assert deshake("deblur", photo, *words["deblur"], *overwrite).code == 0
    assert sheet.read_bytes() == drawn


def test_sheets_are_planned_and_passed_over(deshake, sharp_photo, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    sharp_photo("a.png").rename(folder / "a.png")
    outcome = deshake("fix", folder, "--compare", "--json", *FAST)
    assert json.loads(outcome.out)["sheet"] == str(folder / "a.deshaken.compare.png")
    again = deshake("fix", folder, "--compare", "--skip-existing", "--json", *FAST)
    assert [json.loads(line)["status"] for line in again.out.splitlines()] == ["skipped"]


def test_a_preview_is_small_and_its_kernel_fits_the_photo(deshake, shaken, tmp_path):
    photo, kernels, out = shaken("a.jpg"), tmp_path / "k", tmp_path / "small.jpg"
    with Image.open(photo) as image:
        image.resize((700, 350), Image.Resampling.BICUBIC).save(photo, quality=92)
    args = ("--preview", "--blur-size", 20, "--focal-35mm", 40, "--uniform", "--iterations", 1)
    region = ("--region", "200,50,240,240")
    args = (*args, "--json")
    outcome = deshake("fix", photo, "-o", out, "--keep-kernels", kernels, *args, *region)
    assert outcome.code == 0, outcome.err
    assert json.loads(outcome.out)["preview"] is True
    assert codes(out).shape == (320, 640, 3)
    provenance = read_provenance(out)
    assert provenance["options"]["preview"] is True
    assert provenance["kernel"]["options"]["preview"] is True
    kernel = kernels / "a.kernel.npz"
    assert read_kernel(kernel).kernel.camera.shape == (320, 640)
    again = tmp_path / "again.jpg"
    args = ("--preview", "--iterations", 1, "--json")
    outcome = deshake("deblur", photo, kernel, *args, "-o", again)
    assert json.loads(outcome.out)["preview"] is True
    assert again.read_bytes() == out.read_bytes()
    args = ("--quality", "fast", "--iterations", 1, "-o", tmp_path / "whole.jpg")
    assert deshake("deblur", photo, kernel, *args).code == 0
    assert codes(tmp_path / "whole.jpg").shape == (350, 700, 3)


def test_the_metadata_of_a_preview_are_true(deshake, make_exif, tmp_path):
    photo, out, still = (tmp_path / name for name in ("a.jpg", "small.jpg", "still.npz"))
    below = {0xA002: 800, 0xA003: 1000, 0xA20E: 200.0, 0xA20F: 200.0, 0xA210: 3, 0x9214: (40, 60)}
    exif = b"Exif\0\0" + make_exif(orientation=6, below=below | {0x920A: 4.0})
    Image.new("RGB", (1000, 800), "teal").save(photo, exif=exif)
    kernel = RotationKernel.from_path([(0, 0, 0)], Camera.from_focal(900, 1000, 800))
    write_kernel(still, KernelFile(kernel))
    assert deshake("deblur", photo, still, "--preview", "-o", out).code == 0
    with Image.open(out) as picture:
        tags = picture.getexif().get_ifd(0x8769)
        assert picture.size == (512, 640) == (tags[0xA002], tags[0xA003])
        assert (tags[0xA20E], tags[0xA20F]) == (128, 128)
        assert tuple(tags[0x9214]) == (26, 38)
    assert deshake("deblur", photo, still, "--preview", "--max-size", 320, "-o", out, "--overwrite")
    with Image.open(out) as picture:
        tags = picture.getexif().get_ifd(0x8769)
        assert picture.size == (256, 320) == (tags[0xA002], tags[0xA003])
        assert (tags[0xA20E], tags[0xA20F]) == (64, 64)
    large, little = (
        json.loads(deshake("calibrate", path, "-o", path.with_suffix(".npz"), "--json").out)
        for path in (photo, out)
    )
    assert little["focal_px"] == pytest.approx(large["focal_px"] * 0.32, rel=1e-3)


def test_a_region_beyond_the_photo_is_refused_in_its_pixels(deshake, shaken):
    photo = shaken("a.jpg")
    for more in ((), ("--preview",)):
        outcome = deshake("fix", photo, "--region", "50,0,60,80", *more)
        assert outcome.code == 1
        assert f"error: {photo}: the region 50,0,60,80 reaches beyond its 100 x 80" in outcome.err


def test_pairs_are_finished_likewise(deshake, pair, mask, tmp_path):
    blurred, noisy = pair
    kept = mask(size=(140, 100))
    finish = ("--mask", kept, "--strength", 0.9, "--compare")
    out, kernels = tmp_path / "out.png", tmp_path / "k"
    args = ("--noisy", noisy, *PAIR, *finish, "-o", out, "--keep-kernels", kernels)
    outcome = deshake("fix", blurred, *args)
    assert outcome.code == 0, outcome.err
    assert (tmp_path / "out.compare.png").exists()
    again, kernel = tmp_path / "again.png", kernels / "blurred.kernel.npz"
    args = ("--noisy", noisy, "--iterations", 2, *NARROW, *finish, "-o", again)
    assert deshake("deblur", blurred, kernel, *args).code == 0
    assert again.read_bytes() == out.read_bytes()
    before, after = codes(blurred), codes(out)
    assert np.array_equal(after[:50], before[:50])
    assert not np.array_equal(after[50:], before[50:])


def test_a_pair_has_a_preview(deshake, pair, tmp_path):
    blurred, noisy = pair
    for path in pair:
        large = cv2.resize(codes(path), (700, 500), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(path), large[175:325])
    registration, out = tmp_path / "pair.npz", tmp_path / "out.png"
    focal = ("--focal-px", 750, *NARROW)
    args = ("--preview", "--iterations", 1, *focal, "--keep-kernels", tmp_path / "k")
    args = (*args, "--blur-size", 35, "--uniform")
    assert deshake("fix", blurred, "--noisy", noisy, "-o", out, *args).code == 0
    assert codes(out).shape[:2] == (137, 640)
    assert read_provenance(out)["options"]["preview"] is True
    assert deshake("register", blurred, noisy, "-o", registration, *focal).code == 0
    args = ("--noisy", noisy, "--registration", registration, "--preview", "--iterations", 1)
    again = tmp_path / "again.png"
    kernel = tmp_path / "k" / "blurred.kernel.npz"
    assert deshake("deblur", blurred, kernel, *args, "-o", again).code == 0
    change = np.abs(codes(again).astype(int) - codes(out))
    assert np.median(change) < 6


@pytest.mark.skipif(sys.platform == "win32", reason="has no such permissions")
def test_outputs_take_the_permissions_of_the_photo(deshake, sharp_photo, pan, tmp_path):
    permissions = 0o660  # the group may write and others may not read: no default gives that
    photo, out, kernels = sharp_photo("a.jpg"), tmp_path / "out", tmp_path / "k"
    photo.chmod(permissions)
    kernels.mkdir()
    commands = {
        "fix": (*FAST, "--keep-kernels", kernels, "--compare", "-o", out / "fix.jpg"),
        "deblur": (pan, "--iterations", 1, "-o", out / "deblur.png"),
        "estimate-blind": (*FAST[:-2], "-q", "-o", out / "k.npz", "--latent", out / "latent.png"),
        "calibrate": ("--focal-35mm", 40, "-o", out / "camera.npz"),
        "simulate": ("--focal-35mm", 40, "-o", out / "simulated.jpg", "--blur-size", 3),
    }
    out.mkdir()
    for command, words in commands.items():
        assert deshake(command, photo, *words).code == 0, command
    made = [*out.iterdir(), *kernels.iterdir()]
    assert len(made) == 9
    assert {oct(path.stat().st_mode & 0o777) for path in made} == {oct(permissions)}
