from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from deshake.files.kernel_file import CameraFile, read_kernel, write_camera
from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.simulation import shaken_photo

FOCAL_35MM = ("--focal-35mm", 40)


@pytest.fixture
def photo(tmp_path):
    """A JPEG of 160 x 120 with a line of EXIF, and its path."""
    rng = np.random.default_rng(0)
    small = Image.fromarray(rng.integers(0, 256, (12, 16, 3), np.uint8))
    exif = Image.Exif()
    exif[0x010E] = "a test"
    path = tmp_path / "photo.jpg"
    small.resize((160, 120), Image.Resampling.BICUBIC).save(path, quality=95, exif=exif)
    return path


def test_writes_the_photo_and_its_kernel(deshake, photo):
    outcome = deshake("simulate", photo, "--blur-size", 8, *FOCAL_35MM)
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    out = photo.with_name("photo.shaken.jpg")
    content = read_kernel(out.with_suffix(".npz"))
    shaken = read_photo(out)
    assert content.kernel.camera.shape == shaken.shape
    assert shaken.shape[0] < 120
    assert content.kernel.extent_px() == pytest.approx(8, abs=2)
    assert content.kernel.camera.focal_px == pytest.approx(40 * 200 / 43.27, rel=1e-3)
    assert content.provenance["command"] == "simulate"
    assert content.provenance["options"]["blur_px"] == 8
    assert len(content.provenance["input_sha256"]) == 64
    with Image.open(out) as image:
        assert image.getexif()[0x010E] == "a test"


@pytest.mark.parametrize("made", [False, True])
def test_an_output_with_a_slash_is_a_folder(deshake, photo, tmp_path, made):
    out = tmp_path / "out"
    if made:
        out.mkdir()
    outcome = deshake("simulate", photo, "-o", f"{out}/", "--format", "png", *FOCAL_35MM)
    assert (outcome.code, outcome.err) == (0, "")
    assert sorted(path.name for path in out.iterdir()) == ["photo.shaken.npz", "photo.shaken.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "photo.jpg"]


def test_a_folder_that_is_there_needs_no_slash(deshake, photo, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    assert deshake("simulate", photo, "-o", out, *FOCAL_35MM).code == 0
    assert (out / "photo.shaken.jpg").exists()


@pytest.mark.usefixtures("photo")
@pytest.mark.parametrize(
    ("name", "output", "message"),
    [
        ("gone.jpg", "out/", "gone.jpg: no such file"),
        ("photo.jpg", "none/out/", "the folder cannot be made: no such file or directory"),
        ("photo.jpg", "photo.jpg/", "photo.jpg: is not a folder"),
        ("photo.jpg", "out", "out: the name has no ending"),
    ],
)
def test_no_folder_appears_for_a_wrong_call(deshake, tmp_path, name, output, message):
    outcome = deshake("simulate", tmp_path / name, "-o", f"{tmp_path}/{output}", *FOCAL_35MM)
    assert outcome.code == 1
    assert message in outcome.err.splitlines()[0]
    assert [path.name for path in tmp_path.iterdir()] == ["photo.jpg"]


def test_no_folder_appears_for_wrong_usage(deshake, photo, tmp_path):
    args = ("--format", "png", "--jpeg-quality", 80, *FOCAL_35MM)
    assert deshake("simulate", photo, "-o", f"{tmp_path}/out/", *args).code == 2
    assert [path.name for path in tmp_path.iterdir()] == [photo.name]


def test_equal_seeds_give_equal_bytes(deshake, photo, tmp_path):
    written = {}
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        args = ("--seed", seed, "--noise", 0.01, "--photons", 1000, "--blur-size", 5, *FOCAL_35MM)
        out = tmp_path / f"{name}.png"
        assert deshake("simulate", photo, "-o", out, *args).code == 0
        written[name] = out.read_bytes(), out.with_suffix(".npz").read_bytes()
    assert written["a"] == written["b"]
    assert written["a"][0] != written["c"][0]
    assert written["a"][1] != written["c"][1]


def test_the_sharp_photo_is_the_input_cropped(deshake, photo, tmp_path):
    sharp, out = tmp_path / "sharp.png", tmp_path / "out.png"
    args = ("-o", out, "--sharp", sharp, "--blur-size", 5, *FOCAL_35MM)
    assert deshake("simulate", photo, *args).code == 0
    with Image.open(photo) as one, Image.open(sharp) as other:
        m = (one.width - other.width) // 2
        whole, part = np.asarray(one), np.asarray(other)
    np.testing.assert_array_equal(whole[m:-m, m:-m], part)


def test_a_path_from_a_file(deshake, photo, tmp_path):
    path, out = tmp_path / "path.csv", tmp_path / "out.png"
    path.write_text("t,rx,ry,rz\n0,0,0,0\n1,0,1,0\n3,0,2,0\n")
    outcome = deshake("simulate", photo, "-o", out, "--path", path, "--focal-px", 200)
    assert outcome.code == 0
    kernel = read_kernel(out.with_suffix(".npz")).kernel
    assert np.abs(kernel.theta[:, [0, 2]]).max() < 1e-4
    assert np.ptp(kernel.theta[:, 1]) == pytest.approx(np.deg2rad(2), abs=2 * kernel.steps[1])
    fast = kernel.weights[kernel.theta[:, 1] < np.deg2rad(1 - 7 / 6)].sum()
    assert fast == pytest.approx(1 / 3, abs=0.1)


def test_keeps_size_and_alpha(deshake, tmp_path):
    rng = np.random.default_rng(1)
    codes = rng.integers(0, 256, (60, 80, 4), np.uint8)
    source = tmp_path / "in.png"
    Image.fromarray(codes).save(source)
    args = ("--blur-size", 5, *FOCAL_35MM)
    assert deshake("simulate", source, "-o", tmp_path / "a.png", "--keep-size", *args).code == 0
    assert deshake("simulate", source, "-o", tmp_path / "b.png", *args).code == 0
    with Image.open(tmp_path / "a.png") as a, Image.open(tmp_path / "b.png") as b:
        np.testing.assert_array_equal(np.asarray(a)[..., 3], codes[..., 3])
        m = (80 - b.width) // 2
        np.testing.assert_array_equal(np.asarray(b)[..., 3], codes[m:-m, m:-m, 3])


def test_gain_clips(deshake, photo, tmp_path):
    out = tmp_path / "out.png"
    assert (
        deshake("simulate", photo, "-o", out, "--gain", 4, "--blur-size", 4, *FOCAL_35MM).code == 0
    )
    assert read_photo(out).clipped.mean() > 0.1


def test_says_that_a_focal_length_is_assumed(deshake, photo):
    outcome = deshake("simulate", photo, "--blur-size", 4)
    assert outcome.code == 0
    assert outcome.err.startswith(f"warning: {photo}: ")
    assert "50 mm-equivalent is assumed" in outcome.err
    kernel = read_kernel(photo.with_name("photo.shaken.npz")).kernel
    assert kernel.camera.focal_px == pytest.approx(50 * 200 / 43.27, rel=1e-3)


def test_takes_the_camera_of_a_file(deshake, photo, tmp_path):
    file = tmp_path / "camera.npz"
    write_camera(file, CameraFile(Camera.from_focal(333, 120, 160), "measured"))
    assert deshake("simulate", photo, "--camera", file, "--blur-size", 4).code == 0
    content = read_kernel(photo.with_name("photo.shaken.npz"))
    assert content.kernel.camera.focal_px == pytest.approx(333)
    assert content.provenance["camera"] == "measured"
    write_camera(file, CameraFile(Camera.from_focal(333, 120, 120), "measured"), overwrite=True)
    outcome = deshake("simulate", photo, "--camera", file, "--overwrite")
    assert outcome.code == 1
    assert "120 x 120" in outcome.err


@pytest.mark.parametrize(
    "args",
    [
        ("--blur-size", "0"),
        ("--blur-size", "wide"),
        ("--noise", "2"),
        ("--seed", "-1"),
        ("--gain", "inf"),
        ("--path", "p.csv", "--blur-size", "4"),
        ("--focal-px", "100", "--focal-35mm", "40"),
        ("--colour", "red"),
    ],
)
def test_wrong_options_are_wrong_usage(deshake, photo, args):
    before = sorted(photo.parent.iterdir())
    assert deshake("simulate", photo, *args).code == 2
    assert sorted(photo.parent.iterdir()) == before


@pytest.mark.parametrize(
    ("args", "what"),
    [
        (("-o", "{photo}"), "never touches"),
        (("-o", "{photo}", "--overwrite"), "never touches"),
        (("--kernel", "{photo}"), "never touches"),
        (("-o", "{folder}/a.png", "--sharp", "{folder}/a.png"), "two outputs"),
        (("-o", "{folder}/a.gif"), "'.gif'"),
        (("-o", "{folder}/none/a.png"), "no such folder"),
        (("--blur-size", "100"), "half of the frame"),
        (("--path", "{folder}/none.csv"), "no such file"),
        (("--focal-px", "1e9"), "focal length"),
    ],
)
def test_what_cannot_be_done_is_one_line(deshake, photo, args, what):
    before = photo.read_bytes()
    filled = [arg.format(photo=photo, folder=photo.parent) for arg in args]
    outcome = deshake("-q", "simulate", photo, *filled)
    assert outcome.code == 1
    error, *rest = outcome.err.splitlines()
    assert error.startswith("error: ")
    assert what in error
    assert all(line.startswith("hint: ") for line in rest)
    assert [path.name for path in photo.parent.iterdir()] == ["photo.jpg"]
    assert photo.read_bytes() == before


def test_refuses_to_replace(deshake, photo):
    args = ("--blur-size", 4, *FOCAL_35MM)
    assert deshake("simulate", photo, *args).code == 0
    out = photo.with_name("photo.shaken.jpg")
    before = out.read_bytes()
    outcome = deshake("simulate", photo, "--seed", 9, *args)
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {out}: exists already\n")
    assert out.read_bytes() == before
    assert deshake("simulate", photo, "--seed", 9, "--overwrite", *args).code == 0
    assert out.read_bytes() != before


def test_the_kernel_to_stdout(photo, tmp_path):
    args = [photo, "-o", tmp_path / "out.png", "--kernel", "-", "--blur-size", "4", "-q"]
    done = subprocess.run(
        [sys.executable, "-m", "deshake", "simulate", *map(str, args)],
        capture_output=True,
        check=True,
    )
    file = tmp_path / "kernel.npz"
    file.write_bytes(done.stdout)
    assert read_kernel(file).kernel.camera.shape == read_photo(tmp_path / "out.png").shape


@pytest.mark.skipif(os.name == "nt", reason="needs RLIMIT_FSIZE")
def test_a_full_disk_leaves_nothing(photo):
    code = (
        "import resource, sys\n"
        "from deshake.cli.main import main\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        f"sys.exit(main(['-q', 'simulate', {str(photo)!r}, '--blur-size', '4']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith(f"error: {photo.with_name('photo.shaken.jpg')}: ")
    assert [path.name for path in photo.parent.iterdir()] == ["photo.jpg"]


@pytest.mark.parametrize("size", [(160, 120), (120, 120)])
@pytest.mark.parametrize("make", [{}, {0x010F: "Canon", 0x0110: "Canon DIGITAL IXUS 70"}])
def test_calibrating_what_was_shaken_finds_the_focal_length_again(deshake, tmp_path, size, make):
    exif = Image.Exif()
    exif.update(make)
    exif.get_ifd(0x8769).update({0x920A: 5.8, 0xA405: 35, 0xA002: size[0], 0xA003: size[1]})
    sharp, out = tmp_path / "sharp.jpg", tmp_path / "out.jpg"
    Image.effect_noise(size, 60).convert("RGB").save(sharp, exif=exif)
    assert deshake("simulate", sharp, "-o", out, "--blur-size", 12).code == 0
    true = read_kernel(out.with_suffix(".npz")).kernel.camera
    assert true.width < size[0]
    calibrated = json.loads(deshake("calibrate", out, "--json").out)
    assert calibrated["focal_px"] == pytest.approx(true.focal_px, rel=1e-3)


def test_photo_and_kernel_appear_together_or_not_at_all(deshake, photo, tmp_path, monkeypatch):
    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(shaken_photo, "kernel_bytes", fail)
    outcome = deshake("simulate", photo, "--sharp", tmp_path / "sharp.jpg", *FOCAL_35MM)
    assert outcome.code == 130
    assert [path.name for path in tmp_path.iterdir()] == ["photo.jpg"]


def test_a_format_and_a_quality_can_be_chosen(deshake, photo, tmp_path):
    words = ("simulate", photo, "--blur-size", 4, *FOCAL_35MM)
    assert deshake(*words, "--format", "png", "--kernel", tmp_path / "k.npz").code == 0
    with Image.open(tmp_path / "photo.shaken.png") as image:
        assert image.format == "PNG"
    sizes = []
    for quality in ((), ("--jpeg-quality", 95), ("--jpeg-quality", 10)):
        out = tmp_path / f"{len(sizes)}.jpg"
        assert deshake(*words, "-o", out, *quality).code == 0
        sizes.append(out.stat().st_size)
    assert sizes[0] == sizes[1] > 2 * sizes[2]
    options = read_kernel(tmp_path / "2.npz").provenance["options"]
    assert options["jpeg_quality"] == 10
    assert "jpeg_quality" not in read_kernel(tmp_path / "0.npz").provenance["options"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--format", "png", "-o", "x.jpg"), "--format does not go with -o x.jpg"),
        (("--format", "png", "--jpeg-quality", 80), "no result is one: add --format jpeg"),
        (("--jpeg-quality", 80, "-o", "x.tif"), "no result is one"),
        (("--jpeg-quality", 0), "--jpeg-quality"),
        (("--format", "heic"), "'heic' is not one of"),
    ],
)
def test_formats_and_qualities_that_contradict_each_other(deshake, photo, tmp_path, *, words, says):
    outcome = deshake("simulate", photo, *words)
    assert outcome.code == 2
    assert says in outcome.err
    assert [path.name for path in tmp_path.iterdir()] == ["photo.jpg"]
