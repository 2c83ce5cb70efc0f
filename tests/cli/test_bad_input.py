"""What is wrong with a file is said in one line, and nothing is left behind."""

from __future__ import annotations

import io
import os
import pickle
import subprocess
import sys
import time
import zipfile

import numpy as np
import pytest
from PIL import Image

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.io.kernel_file import KernelFile, write_kernel

FAST = ("--blur-size", 3, "--iterations", 2)


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
    "text.jpg": (b"Dear diary, today I took a photo.\n", "not a JPEG, PNG, TIFF or WebP"),
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
"""Files that are no photos, and what is said of them."""

UNUSABLE = {
    "dot.png": (encoded(noise(size=(1, 1)), "PNG"), "1x1 pixels are too few"),
    "thread.png": (encoded(noise(size=(100_000, 3)), "PNG"), "100000x3 pixels are too few"),
    "pole.png": (encoded(noise(size=(3, 100_000)), "PNG"), "3x100000 pixels are too few"),
    "black.png": (encoded(Image.new("RGB", (100, 80)), "PNG"), "no texture"),
    "grey.jpg": (encoded(Image.new("RGB", (100, 80), (90, 90, 90)), "JPEG"), "no texture"),
    "white.png": (encoded(Image.new("RGB", (100, 80), "white"), "PNG"), ""),
}
"""Photos that hold no blur to estimate."""


@pytest.fixture
def kernel(tmp_path_factory):
    path = tmp_path_factory.mktemp("kernel") / "pan.npz"
    camera = Camera.from_focal(120, 80, 100)
    turn = RotationKernel.from_path([(-0.01, -0.01, 0), (0.01, 0.01, 0)], camera)
    write_kernel(path, KernelFile(turn))
    return path


@pytest.fixture
def refused(deshake, tmp_path, kernel):
    """Run a command on a file in the test's folder, where it must fail and leave all as it is."""

    def run(command, path, *args, kernel_file=kernel):
        before = contents(tmp_path)
        words = {
            "fix": (path, *FAST),
            "calibrate": (path,),
            "estimate-blind": (path, "--blur-size", 3),
            "deblur": (path, kernel_file),
        }[command]
        outcome = deshake(command, *words, *args)
        assert outcome.code == 1
        assert outcome.out == ""
        assert contents(tmp_path) == before
        lines = outcome.err.splitlines()
        [error] = [line for line in lines if line.startswith("error: ")]
        assert all(line.startswith(("error: ", "hint: ", "warning: ")) for line in lines)
        assert "bug" not in outcome.err
        return error

    return run


def contents(folder):
    """All files below a folder with their bytes and times."""
    return {
        path: (path.lstat().st_mtime_ns, path.read_bytes())
        for path in folder.rglob("*")
        if path.is_file()
    }


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


@pytest.mark.parametrize("command", STAGES)
def test_a_folder_is_no_photo(refused, tmp_path, command):
    path = tmp_path / "folder.jpg"
    path.mkdir()
    assert refused(command, path) == f"error: {path}: is a folder, not a file"


@pytest.mark.parametrize("command", ["fix", "estimate-blind"])
@pytest.mark.parametrize("name", UNUSABLE)
def test_what_has_no_blur_to_estimate(refused, tmp_path, command, name):
    data, what = UNUSABLE[name]
    path = tmp_path / name
    path.write_bytes(data)
    error = refused(command, path)
    assert error.startswith(f"error: {path}: ")
    assert what in error


@pytest.mark.parametrize("size", [(1, 1), (3, 9000), (9000, 3)])
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
def test_one_colour_stays_as_it_is(deshake, tmp_path, kernel, name):
    path, out = tmp_path / name, (tmp_path / "out").with_suffix(name[-4:])
    path.write_bytes(UNUSABLE[name][0])
    assert deshake("deblur", path, kernel, "-o", out).code == 0
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


LIMITED = """
import resource, sys
from deshake.cli.main import main
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
sys.exit(main({words!r}))
"""


@pytest.mark.skipif(os.name == "nt", reason="needs RLIMIT_FSIZE")
@pytest.mark.parametrize("command", ["fix", *STAGES])
def test_a_full_disk_leaves_nothing(shaken, tmp_path, kernel, command):
    path, k = shaken("a.png", 16), tmp_path / "k"
    k.mkdir()
    words, out, limit = {
        "fix": ((path, *FAST, "-q", "--keep-kernels", k), tmp_path / "a.deshaken.png", 20_000),
        "calibrate": ((path, "--focal-35mm", 40), tmp_path / "a.camera.npz", 100),
        "estimate-blind": ((path, "--blur-size", 3, "-q"), tmp_path / "a.kernel.npz", 100),
        "deblur": ((path, kernel, "--iterations", 1), tmp_path / "a.deshaken.png", 1000),
    }[command]
    before = contents(tmp_path)
    code = LIMITED.format(limit=limit, words=[command, *map(str, words)])
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith(f"error: {out}: cannot be written: larger than the allowed file")
    assert done.stderr.count("error: ") == 1
    assert "\nhint: " in done.stderr
    assert contents(tmp_path) == before


def arrays(**changes):
    """The arrays of a good kernel file, with changes; None takes one out."""
    good = {
        "format": np.int64(1),
        "theta": np.zeros((2, 3)),
        "weights": np.full(2, 0.5),
        "steps": np.full(3, 0.01),
        "camera_matrix": np.array([[120.0, 0, 49.5], [0, 120, 39.5], [0, 0, 1]]),
        "image_size": np.array([80, 100]),
        "distortion": np.zeros(0),
        "confidence": np.float64(1),
        "provenance": np.array("{}"),
    }
    return {key: value for key, value in (good | changes).items() if value is not None}


def npz(**changes):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays(**changes))
    return stream.getvalue()


def huge():
    """A file that says it holds 10^9 weights, which take some kilobytes."""
    stream = io.BytesIO(npz(weights=None))
    with zipfile.ZipFile(stream, "a", zipfile.ZIP_DEFLATED) as archive:
        head = io.BytesIO()
        shape = {"descr": "<f8", "fortran_order": False, "shape": (10**9,)}
        np.lib.format.write_array_header_1_0(head, shape)
        archive.writestr("weights.npy", head.getvalue() + bytes(10**6))
    return stream.getvalue()


def pickled():
    stream = io.BytesIO(npz(weights=None))
    with zipfile.ZipFile(stream, "a") as archive:
        inner = io.BytesIO()
        np.save(inner, np.array([{"a": 1}], dtype=object), allow_pickle=True)
        archive.writestr("weights.npy", inner.getvalue())
    return stream.getvalue()


KERNELS = {
    "no theta": (lambda: npz(theta=None), "'theta'"),
    "no format": (lambda: npz(format=None), "'format'"),
    "flat theta": (lambda: npz(theta=np.zeros(6)), "'theta'"),
    "one weight": (lambda: npz(weights=np.ones(1)), "2 rotations in 'theta', 1 in 'weights'"),
    "no weights": (lambda: npz(theta=np.zeros((0, 3)), weights=np.zeros(0)), "0 rotations"),
    "nan": (lambda: npz(weights=np.array([np.nan, 1])), "'weights' is not finite"),
    "nan angle": (lambda: npz(theta=np.full((2, 3), np.nan)), "'theta' is not finite"),
    "negative": (lambda: npz(weights=np.array([-0.5, 1.5])), "negative weight"),
    "sum": (lambda: npz(weights=np.array([0.5, 0.6])), "sum to 1.1, not 1"),
    "version": (lambda: npz(format=np.int64(2)), "its format is 2"),
    "truncated": (lambda: npz()[:-30], ""),
    "pickle": (lambda: pickle.dumps({"weights": [1.0]}), ""),
    "pickle within": (pickled, "'weights'"),
    "huge": (huge, "'weights'"),
    "empty": (bytes, ""),
    "text": (lambda: b"half of it here, half of it there\n", ""),
    "wide": (lambda: npz(theta=np.array([[0, -1.5, 0], [0, 1.5, 0]])), "sweep more than half"),
    "photo": (lambda: PHOTOS["truncated.jpg"][0], ""),
}
"""Files that are no kernels, and what is said of them."""


@pytest.mark.parametrize("name", KERNELS)
def test_what_is_no_kernel(refused, shaken, tmp_path, name):
    make, what = KERNELS[name]
    path = tmp_path / "k.npz"
    path.write_bytes(make())
    photo = shaken("a.jpg")
    start = time.perf_counter()
    error = refused("deblur", photo, "-o", tmp_path / "out.jpg", kernel_file=path)
    assert time.perf_counter() - start < 1
    assert error.startswith(f"error: {path}: ")
    assert what in error


def test_a_good_kernel_like_those_is_taken(deshake, shaken, tmp_path):
    path = tmp_path / "k.npz"
    path.write_bytes(npz())
    assert deshake("deblur", shaken("a.jpg"), path, "--iterations", 1).code == 0


def test_a_kernel_that_is_a_folder_or_missing(deshake, shaken, tmp_path):
    for path, what in ((tmp_path, "is a folder, not a file"), (tmp_path / "k", "no such file")):
        outcome = deshake("deblur", shaken("a.jpg"), path)
        assert outcome.code == 1
        assert outcome.err.startswith(f"error: {path}: {what}\n")


@pytest.mark.skipif(os.name == "nt", reason="needs RLIMIT_AS")
def test_a_huge_kernel_eats_no_memory(shaken, tmp_path):
    path = tmp_path / "k.npz"
    path.write_bytes(huge())
    code = (
        "import resource, sys, time\n"
        "import deshake.pipelines.file_stages\n"
        "from deshake.cli.main import main\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "start = time.perf_counter()\n"
        f"code = main(['deblur', {str(shaken('a.jpg'))!r}, {str(path)!r}])\n"
        "grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before\n"
        "print(code, grown, time.perf_counter() - start)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    code, grown, took = done.stdout.split()
    assert int(code) == 1
    assert int(grown) < 100_000 * (1024 if sys.platform == "darwin" else 1)
    assert float(took) < 1


def test_bad_photos_in_a_folder_are_each_told(deshake, tmp_path):
    for name, (data, _) in PHOTOS.items():
        (tmp_path / name).write_bytes(data)
    before = contents(tmp_path)
    outcome = deshake("fix", tmp_path)
    assert outcome.code == 1
    photos = [name for name in PHOTOS if not name.endswith(".gif")]  # whose ending is no photo's
    assert outcome.err.count("error: ") == len(photos)
    assert all(f"error: {tmp_path / name}: " in outcome.err for name in photos)
    assert contents(tmp_path) == before
