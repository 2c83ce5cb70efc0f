from __future__ import annotations

import io
import os
import subprocess
import sys

import pytest
from PIL import Image

from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel


@pytest.fixture
def kernel(tmp_path):
    path = tmp_path / "shake.npz"
    camera = Camera.from_focal(900, 600, 800)
    turn = RotationKernel.from_path([(0, 0, 0), (0.01, 0.02, 0.01)], camera)
    write_kernel(path, KernelFile(turn.centred()))
    return path


def test_draws_beside_the_kernel(deshake, kernel):
    outcome = deshake("render-kernel", kernel)
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    with Image.open(kernel.with_suffix(".png")) as image:
        assert (image.format, image.mode, image.size) == ("PNG", "RGB", (640, 640))


def test_says_what_it_wrote_when_asked(deshake, kernel):
    assert "shake.png: 640 x 640 pixels" in deshake("-v", "render-kernel", kernel).err


def test_draws_filters_at_a_size(deshake, kernel, tmp_path):
    out = tmp_path / "out.png"
    assert deshake("render-kernel", kernel, "-o", out, "--filters", "3x4", "--size", 400).code == 0
    with Image.open(out) as image:
        assert image.width == 400
        assert 300 < image.height < 340


def test_an_output_with_a_slash_is_a_folder(deshake, kernel, tmp_path):
    out = tmp_path / "out"
    assert deshake("render-kernel", kernel, "-o", f"{out}/").code == 0
    assert deshake("render-kernel", kernel, "-o", out, "--filters", "2x2").code == 0
    assert sorted(path.name for path in out.iterdir()) == ["shake-filters.png", "shake.png"]


def test_no_folder_appears_for_a_kernel_without_a_name(deshake, kernel, tmp_path):
    missing = deshake("render-kernel", tmp_path / "gone.npz", "-o", f"{tmp_path}/out/")
    assert (missing.code, "gone.npz: no such file" in missing.err) == (1, True)
    piped = deshake("render-kernel", "-", "-o", f"{tmp_path}/out/")
    assert piped.code == 1
    assert "a kernel from standard input has no name" in piped.err
    assert [path.name for path in tmp_path.iterdir()] == [kernel.name]


def test_refuses_to_replace(deshake, kernel):
    deshake("render-kernel", kernel)
    before = kernel.with_suffix(".png").read_bytes()
    outcome = deshake("render-kernel", kernel, "--size", 200)
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {kernel.with_suffix('.png')}: exists already\nhint: ")
    assert kernel.with_suffix(".png").read_bytes() == before
    assert deshake("render-kernel", kernel, "--size", 200, "--overwrite").code == 0
    assert kernel.with_suffix(".png").read_bytes() != before


def test_the_kernel_is_never_the_output(deshake, kernel, tmp_path):
    link = tmp_path / "link.png"
    link.symlink_to(kernel)
    before = kernel.read_bytes()
    outcome = deshake("render-kernel", kernel, "-o", link, "--overwrite")
    assert outcome.code == 1
    assert "never touches" in outcome.err
    assert kernel.read_bytes() == before


@pytest.mark.parametrize("name", ["none.npz", ".", "text.npz", "empty.npz"])
def test_bad_input_is_one_line(deshake, tmp_path, name):
    (tmp_path / "text.npz").write_text("a kernel, honestly")
    (tmp_path / "empty.npz").touch()
    outcome = deshake("render-kernel", tmp_path / name, "-o", tmp_path / "out.png")
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {tmp_path / name}: ")
    assert "bug" not in outcome.err
    assert not (tmp_path / "out.png").exists()


@pytest.mark.parametrize(
    "args", [("--filters", "3"), ("--filters", "0x3"), ("--size", "10"), ("--size", "1e9")]
)
def test_wrong_options_are_wrong_usage(deshake, kernel, args):
    assert deshake("render-kernel", kernel, *args).code == 2
    assert not kernel.with_suffix(".png").exists()


def test_from_stdin_to_stdout(kernel):
    done = subprocess.run(
        [sys.executable, "-m", "deshake", "render-kernel", "-", "-o", "-"],
        input=kernel.read_bytes(),
        capture_output=True,
        check=True,
    )
    with Image.open(io.BytesIO(done.stdout)) as image:
        assert image.size == (640, 640)
    assert done.stderr == b""


def test_stdin_has_no_name_for_the_output(kernel):
    done = subprocess.run(
        [sys.executable, "-m", "deshake", "render-kernel", "-"],
        input=kernel.read_bytes(),
        capture_output=True,
        check=False,
    )
    assert done.returncode == 1
    assert b"hint: name a PNG with -o" in done.stderr


@pytest.mark.skipif(os.name == "nt", reason="needs RLIMIT_FSIZE")
def test_a_full_disk_leaves_nothing(kernel, tmp_path):
    out = tmp_path / "out.png"
    code = (
        "import resource, sys\n"
        "from deshake.cli.main import main\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        f"sys.exit(main(['render-kernel', {str(kernel)!r}, '-o', {str(out)!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith(f"error: {out}: ")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["shake.npz"]
