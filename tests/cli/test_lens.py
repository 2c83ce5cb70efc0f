"""Lenses through the commands: the stages give what `fix` gives, and nothing is lost."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from deshake.files.kernel_file import CameraFile, read_camera, read_kernel, write_camera
from deshake.files.registration_file import read_registration
from deshake.geometry.camera import Camera

BARREL = np.array([-0.25, 0.03, 0, 0, 0])
QUICK = ("--blur-size", 3, "--region", "10,10,60,50", "--uniform", "--estimator", "edges")


@pytest.fixture
def lens(tmp_path_factory):
    """A camera file for photos of 100 x 80 through a barrel."""
    path = tmp_path_factory.mktemp("lens") / "lens.npz"
    camera = Camera.from_focal(120, 80, 100).with_lens(BARREL)
    write_camera(path, CameraFile(camera, "made up"))
    return path


@pytest.fixture
def bent_pan(pan, lens, tmp_path):
    """The kernel of the pan, with the lens's camera."""
    path = tmp_path / "bent.npz"
    with np.load(pan) as file, np.load(lens) as bent:
        names = ("camera_matrix", "distortion")
        np.savez(path, **{name: (bent if name in names else file)[name] for name in file})
    return path


def test_fix_is_its_stages(deshake, shaken, lens, tmp_path):
    photo = shaken("a.png", 16)
    by = ("--camera", lens)
    kernel, one, two = tmp_path / "k.npz", tmp_path / "one.png", tmp_path / "two.png"
    assert deshake("estimate-blind", photo, "-o", kernel, *by, *QUICK).code == 0
    for keep in ((), ("--keep-geometry",)):
        assert deshake("deblur", photo, kernel, "-o", one, "--overwrite", *keep).code == 0
        kept = tmp_path / f"kept{len(keep)}"
        args = ("-o", two, "--overwrite", "--keep-kernels", kept, *by, *QUICK, *keep)
        assert deshake("fix", photo, *args).code == 0
        assert one.read_bytes() == two.read_bytes()
        assert (kept / "a.kernel.npz").read_bytes() == kernel.read_bytes()
    assert read_kernel(kernel).kernel.camera.distortion.any()


def test_both_geometries_have_the_photos_size_and_differ(deshake, shaken, bent_pan, pan, tmp_path):
    photo = shaken("a.png", 16)
    pictures = []
    ways = {"straight": (bent_pan,), "kept": (bent_pan, "--keep-geometry"), "pinhole": (pan,)}
    for name, way in ways.items():
        out = tmp_path / f"{name}.png"
        known = ("--transfer", "srgb")  # else the tones may differ, too
        assert deshake("deblur", photo, *way, "-o", out, *known).code == 0
        pictures.append(np.asarray(Image.open(out)).astype(float))
    straight, kept, plain = pictures
    assert straight.shape == kept.shape == plain.shape
    assert np.abs(kept - plain).mean() < 0.6 * np.abs(straight - plain).mean()


def test_strength_blends_with_the_straight_photo(deshake, shaken, bent_pan, tmp_path):
    photo = shaken("a.png", 16)
    still = tmp_path / "still.npz"
    with np.load(bent_pan) as file:
        np.savez(still, **dict(file) | {"theta": np.zeros((1, 3)), "weights": np.ones(1)})
    nothing, straight = tmp_path / "nothing.png", tmp_path / "straight.png"
    more = ("--strength", 0, "--compare", "--no-provenance")
    assert deshake("deblur", photo, bent_pan, "-o", nothing, *more).code == 0
    assert deshake("deblur", photo, still, "-o", straight, "--no-provenance").code == 0
    np.testing.assert_array_equal(np.asarray(Image.open(nothing)), np.asarray(Image.open(straight)))


def test_no_lens_is_undone_twice(deshake, shaken, lens, bent_pan, pan):
    photo = shaken("a.png")
    out, again = photo.with_name("one.png"), photo.with_name("two.png")
    assert deshake("deblur", photo, bent_pan, "-o", out).code == 0
    for words in (
        ("deblur", out, bent_pan, "-o", again),
        ("fix", out, "--camera", lens, "-o", again),
        ("estimate-blind", out, "--camera", lens, "-o", again),
        ("calibrate", out, "--lens"),
    ):
        outcome = deshake(*words)
        assert outcome.code == 1
        error, hint = outcome.err.splitlines()
        assert error == f"error: {out}: was straightened by deshake already"
        assert hint.startswith("hint: leave --lens out")
    assert not again.exists()
    assert deshake("deblur", out, pan, "-o", again).code == 0
    assert deshake("deblur", again, bent_pan, "-o", photo.with_name("three.png")).code == 1


def test_a_pair_through_a_lens(deshake, pair, tmp_path):
    blurred, noisy = pair
    lens, registration = tmp_path / "lens.npz", tmp_path / "r.npz"
    camera = Camera.from_focal(150, 100, 140).with_lens(np.array([-0.02, 0, 0, 0]))
    write_camera(lens, CameraFile(camera, "made up"))
    near = ("--camera", lens, "--search-angle", 4)  # a narrow search tries few rotations
    assert deshake("register", blurred, noisy, "-o", registration, *near).code == 0
    assert read_registration(registration).camera.distortion.tolist() == [-0.02, 0, 0, 0]
    blur = ("--blur-size", 7, "--uniform")
    kernel, one, two = tmp_path / "k.npz", tmp_path / "one.png", tmp_path / "two.png"
    by = ("--registration", registration)
    assert deshake("estimate-pair", blurred, noisy, "-o", kernel, *by, *blur).code == 0
    more = ("--noisy", noisy, "--keep-geometry", "--quality", "fast")
    assert deshake("deblur", blurred, kernel, "-o", one, *more, *by).code == 0
    args = (*near, *blur)
    assert deshake("fix", blurred, "-o", two, *more, *args, "--no-provenance").code == 0
    np.testing.assert_array_equal(np.asarray(Image.open(one)), np.asarray(Image.open(two)))


@pytest.fixture
def kit(tmp_path):
    """A photo through a zoom lens that lensfun knows."""
    exif = Image.Exif()
    exif[0x010F], exif[0x0110] = "SONY", "ILCE-6000"
    tags = {0x920A: 16.0, 0xA405: 24, 0xA434: "E PZ 16-50mm F3.5-5.6 OSS"}
    exif.get_ifd(0x8769).update(tags)
    path = tmp_path / "kit.jpg"
    Image.effect_noise((150, 100), 60).convert("RGB").save(path, exif=exif)
    return path


def test_calibrate_finds_the_profile(deshake, kit, tmp_path):
    pytest.importorskip("lensfunpy")
    out = tmp_path / "c.npz"
    outcome = deshake("calibrate", kit, "--lens", "--json", "-o", out)
    report = json.loads(outcome.out)
    assert report["lens"] == "E PZ 16-50mm f/3.5-5.6 OSS"
    camera = read_camera(out)
    assert camera.camera.distortion.tolist() == report["distortion"]
    assert camera.source.endswith("; lens E PZ 16-50mm f/3.5-5.6 OSS (lensfun)")
    assert "lens" not in json.loads(deshake("calibrate", kit, "--json").out)


def test_simulate_bends_and_calibrate_finds_the_same_lens_again(deshake, kit, tmp_path):
    pytest.importorskip("lensfunpy")
    out = tmp_path / "out.jpg"
    assert deshake("simulate", kit, "-o", out, "--lens", "--blur-size", 4).code == 0
    true = read_kernel(out.with_suffix(".npz")).kernel.camera
    assert not true.is_pinhole
    again = tmp_path / "c.npz"
    assert deshake("calibrate", out, "--lens", "-o", again).code == 0
    camera = read_camera(again).camera
    assert camera.focal_px == pytest.approx(true.focal_px, rel=1e-3)
    corner = np.array([[float(true.width - 1), float(true.height - 1)]])
    from deshake.geometry.distortion import undistorted  # noqa: PLC0415

    np.testing.assert_allclose(
        undistorted(corner, camera, camera), undistorted(corner, true, true), atol=0.1
    )


def test_a_lens_that_is_not_known_is_an_error(deshake, kit, shaken):
    pytest.importorskip("lensfunpy")
    outcome = deshake("calibrate", kit, "--lens-model", "Nobody's 16-50mm f/3.5-5.6")
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {kit}: lensfun has no lens")
    assert "hint: name the lens with --lens-model: " in outcome.err
    bare = shaken("bare.png")
    outcome = deshake("fix", bare, "--lens", "--focal-px", 100)
    assert outcome.code == 1
    assert f"error: {bare}: lensfun has no camera a camera without a name" in outcome.err


@pytest.mark.parametrize(
    ("command", "more"), [("calibrate", ()), ("estimate-blind", ("--camera", "c.npz"))]
)
def test_wrong_use(deshake, kit, command, more):
    wrong = ("--lens", *more) if more else ("--lens-model",)
    assert deshake(command, kit, *wrong).code == 2
