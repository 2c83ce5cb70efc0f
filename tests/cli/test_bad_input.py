"""What is wrong with a file is reported in one line, and no file is left."""

from __future__ import annotations

import io
import os
import resource
import sys

import cv2
import numpy as np
import pytest
from PIL import Image

from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel

FAST = ("--blur-size", 3, "--estimator", "edges", "--uniform", "--iterations", 2)


def encoded(image, form, **options):
    stream = io.BytesIO()
    image.save(stream, form, **options)
    return stream.getvalue()


def noise(mode="RGB", size=(100, 80)):
    bands = len(Image.new(mode, (1, 1)).getbands())
    codes = np.random.default_rng(1).integers(0, 256, (size[1], size[0], bands)).astype(np.uint8)
    return Image.merge(mode, [Image.fromarray(codes[..., band]) for band in range(bands)])


PHOTOS = {
    "empty.jpg": (b"", "the file is empty"),
    "text.jpg": (b"Dear diary, today I took a photo.\n", "not a photo of a known format"),
    "truncated.jpg": (encoded(noise(), "JPEG")[:-2000], "cut short"),
    "truncated.png": (encoded(noise(), "PNG")[:-2000], "cut short"),
    "cmyk.jpg": (encoded(noise("CMYK"), "JPEG"), "CMYK"),
    "animated.gif": (
        encoded(noise("L"), "GIF", save_all=True, append_images=[Image.new("L", (100, 80))]),
        "GIF",
    ),
    "animated.webp": (
        encoded(noise(), "WEBP", save_all=True, append_images=[Image.new("RGB", (100, 80))]),
        "an animated WebP",
    ),
}
"""Files that are no photos, and their errors."""

UNUSABLE = {
    "dot.png": (encoded(noise(size=(1, 1)), "PNG"), "1x1 pixels are too few"),
    "thread.png": (encoded(noise(size=(100_000, 3)), "PNG"), "100000x3 pixels are too few"),
    "pole.png": (encoded(noise(size=(3, 100_000)), "PNG"), "3x100000 pixels are too few"),
    "black.png": (encoded(Image.new("RGB", (100, 80)), "PNG"), "no detail"),
    "grey.jpg": (encoded(Image.new("RGB", (100, 80), (90, 90, 90)), "JPEG"), "no detail"),
    "white.png": (encoded(Image.new("RGB", (100, 80), "white"), "PNG"), ""),
}
"""Photos that hold no blur to estimate."""


STAGES = ("calibrate", "estimate-blind", "deblur")


@pytest.mark.parametrize("command", ["fix", *STAGES])
@pytest.mark.parametrize("name", PHOTOS)
def test_what_is_no_photo(refused, tmp_path, command, name):
    data, what = PHOTOS[name]
    path = tmp_path / name
    path.write_bytes(data)
    error = refused(command, path)
    assert error.startswith(f"error: {path}: ")
    assert what in error


@pytest.mark.parametrize("command", ["fix", *STAGES])
def test_no_such_file(refused, tmp_path, command):
    path = tmp_path / "none.jpg"
    assert refused(command, path) == f"error: {path}: no such file"


@pytest.mark.parametrize("command", ["fix", "calibrate", "estimate-blind"])
def test_a_folder_without_photos(refused, tmp_path, command):
    path = tmp_path / "folder.jpg"
    path.mkdir()
    assert refused(command, path) == f"error: {path}: there are no photos in this folder"


@pytest.mark.parametrize("command", ["fix", "estimate-blind"])
@pytest.mark.parametrize("name", UNUSABLE)
def test_what_has_no_blur_to_estimate(refused, tmp_path, command, name):
    data, what = UNUSABLE[name]
    path = tmp_path / name
    path.write_bytes(data)
    error = refused(command, path)
    assert error.startswith(f"error: {path}: ")
    assert what in error


@pytest.mark.parametrize("size", [(1, 1), (3, 2000), (2000, 3)])
def test_odd_sizes_are_deblurred_like_any_other(deshake, tmp_path, size):
    path, kernel, out = tmp_path / "a.png", tmp_path / "k.npz", tmp_path / "out.png"
    path.write_bytes(encoded(noise(size=size), "PNG"))
    camera = Camera.from_focal(max(size), size[1], size[0])
    turn = RotationKernel.from_path([(-1e-4, -1e-4, 0), (1e-4, 1e-4, 0)], camera)
    write_kernel(kernel, KernelFile(turn))
    assert deshake("deblur", path, kernel, "-o", out, "--iterations", 1).code == 0
    with Image.open(out) as image:
        assert image.size == size


@pytest.mark.parametrize("name", ["black.png", "grey.jpg", "white.png"])
def test_one_colour_stays_as_it_is(deshake, tmp_path, pan, name):
    path, out = tmp_path / name, (tmp_path / "out").with_suffix(name[-4:])
    path.write_bytes(UNUSABLE[name][0])
    assert deshake("deblur", path, pan, "-o", out).code == 0
    with Image.open(path) as before, Image.open(out) as after:
        difference = np.asarray(before).astype(int) - np.asarray(after)
    assert np.abs(difference).max() <= 1


@pytest.mark.parametrize("link", ["itself", "symlink", "hard link", "folder link"])
@pytest.mark.parametrize("command", ["fix", "deblur"])
def test_the_output_is_never_the_input(refused, shaken, tmp_path, command, link):
    path = shaken("a.jpg")
    other = tmp_path / "b.jpg"
    match link:
        case "itself":
            other = path
        case "symlink":
            other.symlink_to(path)
        case "hard link":
            os.link(path, other)
        case "folder link":
            (tmp_path / "here").symlink_to(tmp_path)
            other = tmp_path / "here" / "a.jpg"
    error = refused(command, path, "-o", other, "--overwrite")
    assert error == (f"error: {other}: the output is the input itself, which deshake never touches")


@pytest.mark.parametrize("command", ["fix", *STAGES])
@pytest.mark.parametrize("where", ["missing", "file"])
def test_an_output_folder_that_is_none(refused, shaken, tmp_path, command, where):
    path = shaken("a.jpg")
    folder = tmp_path / "missing" if where == "missing" else path
    error = refused(command, path, "-o", folder / "out.jpg")
    what = "no such folder" if where == "missing" else "is not a folder"
    assert error == f"error: {folder}: {what}"


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="needs a user that is not root"
)
@pytest.mark.parametrize("command", ["fix", *STAGES])
def test_an_output_folder_without_permission(refused, shaken, tmp_path, command):
    path, folder = shaken("a.jpg"), tmp_path / "closed"
    folder.mkdir(mode=0o500)
    error = refused(command, path, "-o", folder / "out.jpg")
    assert error == f"error: {folder}: the folder is not writable"


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs /proc")  # noqa: PTH112
def test_a_file_system_that_takes_no_files(refused, shaken):
    error = refused("deblur", shaken("a.jpg"), "-o", "/proc/self/out.jpg", "--iterations", 1)
    assert error.startswith("error: /proc/self")


@pytest.mark.skipif(os.name == "nt", reason="needs RLIMIT_FSIZE")
@pytest.mark.parametrize("command", ["fix", *STAGES])
def test_a_full_disk_leaves_nothing(deshake, sharp_photo, pan, contents, command):
    path = sharp_photo("a.png", 16)
    folder, k = path.parent, path.parent / "k"
    k.mkdir()
    if command == "fix":  # noise, so that the photo is larger than the kernel
        noise = np.random.default_rng(0).integers(0, 1 << 16, (80, 100, 3), np.uint16)
        path.write_bytes(cv2.imencode(".png", noise)[1].tobytes())
    words, out, limit = {
        "fix": ((path, *FAST, "-q", "--keep-kernels", k), folder / "a.deshaken.png", 20_000),
        "calibrate": ((path, "--focal-35mm", 40), folder / "a.camera.npz", 100),
        "estimate-blind": ((path, *FAST[:-2], "-q"), folder / "a.kernel.npz", 100),
        "deblur": ((path, pan, "--iterations", 1), folder / "a.deshaken.png", 1000),
    }[command]
    before = contents(folder)
    at_most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, at_most[1]))
    try:
        outcome = deshake(command, *words)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, at_most)
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {out}: cannot be written: larger than the allowed file")
    assert outcome.err.count("error: ") == 1
    assert "\nhint: " in outcome.err
    assert contents(folder) == before


def test_bad_photos_in_a_folder_are_each_reported(deshake, contents, tmp_path):
    for name, (data, _) in PHOTOS.items():
        (tmp_path / name).write_bytes(data)
    before = contents(tmp_path)
    outcome = deshake("fix", tmp_path)
    assert outcome.code == 1
    photos = [name for name in PHOTOS if not name.endswith(".gif")]  # whose ending is no photo's
    assert outcome.err.count("error: ") == len(photos)
    assert all(f"error: {tmp_path / name}: " in outcome.err for name in photos)
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    "words",
    [
        ("fix", "-", "-o", "out.jpg"),
        ("fix", "a.jpg", "--noisy", "-"),
        ("fix", "a.jpg", "--mask", "-"),
        ("deblur", "-", "k.npz"),
        ("deblur", "-", "--kernel", "k.npz"),
        ("estimate-blind", "a.jpg", "-"),
        ("estimate-pair", "-", "a.jpg"),
        ("register", "a.jpg", "-"),
        ("calibrate", "-"),
        ("simulate", "-"),
    ],
    ids=" ".join,
)
def test_photos_do_not_come_from_standard_input(deshake, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    outcome = deshake(*words)
    assert outcome.code == 2
    assert "photos are not read from standard input: name a file" in outcome.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="needs symbolic links")
@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("-o", "loop"), "loop: is not a folder"),
        (("-o", "loop/sub"), "loop/sub: the folder cannot be made: too many levels of"),
        (("-o", "out", "--keep-kernels", "loop"), "loop: is not a folder"),
    ],
    ids=str,
)
def test_an_output_folder_that_links_to_itself(deshake, tmp_path, monkeypatch, words, what):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "in").mkdir()
    noise().save(tmp_path / "in" / "a.png")
    for dry in ((), ("--dry-run",)):
        outcome = deshake("fix", "in", *words, *dry)
        assert outcome.code == 1
        assert f"error: {what}" in outcome.err
        assert "bug" not in outcome.err


@pytest.mark.skipif(sys.platform == "win32", reason="needs symbolic links")
def test_an_output_in_a_folder_that_links_to_itself(deshake, tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    noise().save(tmp_path / "a.png")
    outcome = deshake("fix", tmp_path / "a.png", "-o", tmp_path / "loop" / "b.png")
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {tmp_path / 'loop'}: no such folder\nhint: ")
