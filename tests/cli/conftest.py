"""A command of the tests' own, and small photos to run the real ones on."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

import click
import cv2
import numpy as np
import pytest
from PIL import Image
from skimage import data

from deshake.cli import main, options
from deshake.cli.general_options import general_options
from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.warps import Warps

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from deshake.cli.context import Context

Trial = "Callable[[Callable[[Context], int | None]], None]"


@pytest.fixture
def trial(monkeypatch: pytest.MonkeyPatch) -> Trial:
    """Install a command named trial that calls the function it is given."""

    def install(function: Callable[[Context], int | None]) -> None:
        @click.command("trial")
        @click.option("--blur-size", type=float)
        @options.transfer_option
        @general_options
        @click.pass_context
        def command(ctx: click.Context, **_: object) -> int | None:
            """Try something out."""
            return function(ctx)

        module = ModuleType("deshake_trial")
        module.command = command
        monkeypatch.setitem(sys.modules, "deshake_trial", module)
        entry = type(main.COMMANDS["fix"])("deshake_trial", "Try something out.")
        monkeypatch.setitem(main.COMMANDS, "trial", entry)

    return install


def _texture(width: int, height: int) -> NDArray[np.float32]:
    """Make a texture with edges at every angle, 0..1."""
    grey = np.random.default_rng(5).random((height // 10, width // 10), np.float32)
    grey = cv2.resize(grey, (width, height), interpolation=3)
    return np.clip(0.5 + 3 * (grey - 0.5), 0.05, 0.95)


def _save(path: Path, light: NDArray[np.float32], depth: int) -> Path:
    """Save a texture in pale colours."""
    picture = np.stack([light, 0.8 * light + 0.1, 0.9 * light], -1)
    if depth == 16:
        codes = np.rint(picture * 65535).astype(np.uint16)
        path.write_bytes(cv2.imencode(path.suffix, codes)[1].tobytes())
    else:
        Image.fromarray(np.rint(picture * 255).astype(np.uint8)).save(path, quality=92)
    return path


@pytest.fixture
def sharp_photo(tmp_path: Path) -> Callable[..., Path]:
    """Save a sharp photo of 100 x 80 under a name; a 16-bit one if asked.

    Its estimate ends at once, and the photo stays as it is: where the estimate is not what is
    tested, it takes a fortieth of the time.
    """

    def save(name: str, depth: int = 8) -> Path:
        return _save(tmp_path / name, _texture(100, 80), depth)

    return save


@pytest.fixture
def shaken(tmp_path: Path) -> Callable[..., Path]:
    """Save a small shaken photo under a name; a 16-bit one if asked.

    Those of 100 x 80 are shaken little: most estimates leave them as they are. From `large` ones,
    of 200 x 160, a kernel can be estimated with ``--blur-size 10``; from those of 140 x 112 one
    that may differ over the frame, and from those of 150 x 120 one that does not, with
    ``--blur-size 9``.
    """

    def save(
        name: str, depth: int = 8, *, large: bool = False, size: tuple[int, int] = (200, 160)
    ) -> Path:
        width, height, length = (*size, 7) if large else (100, 80, 3)
        slant = np.eye(length, dtype=np.float32) / length
        return _save(tmp_path / name, cv2.filter2D(_texture(width, height), -1, slant), depth)

    return save


@pytest.fixture
def pan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the kernel of a slanting pan, for photos of 100 x 80, outside the test's folder."""
    path = tmp_path_factory.mktemp("kernel") / "pan.npz"
    camera = Camera.from_focal(120, 80, 100)
    turn = RotationKernel.from_path([(-0.01, -0.01, 0), (0.01, 0.01, 0)], camera)
    write_kernel(path, KernelFile(turn))
    return path


@pytest.fixture
def pair(tmp_path: Path) -> list[Path]:
    """Write a photo turned by five pixels about Y, and a dark, noisy one; 140 x 100, f = 150 px."""
    camera, margin = Camera.from_focal(150.0, 100, 140), 15
    photo = cv2.resize(data.astronaut()[:370], (170, 130), interpolation=cv2.INTER_AREA)
    sharp = ((photo / 255) ** 2.2).astype(np.float32)
    steps = grid_steps(camera)
    path = np.linspace([0, -2.5, 0], [0, 2.5, 0], 20) * steps
    g = Warps(camera, path, margin=margin).blur(sharp, np.full(20, 1 / 20))
    noisy = Warps(camera, np.array([[2, -2, 1]]) * steps, margin=margin).blur(sharp, [1.0]) / 4
    noisy += 0.004 * np.random.default_rng(0).normal(size=noisy.shape)
    files = []
    for name, picture in (("blurred.png", g), ("noisy.png", noisy)):
        codes = np.rint(65535 * np.clip(picture, 0, 1) ** (1 / 2.2)).astype(np.uint16)
        cv2.imwrite(str(tmp_path / name), codes[..., ::-1])
        files.append(tmp_path / name)
    return files


@pytest.fixture
def contents() -> Callable[[Path], dict[Path, tuple[int, bytes]]]:
    """Read all files below a folder, with their times."""

    def read(folder: Path) -> dict[Path, tuple[int, bytes]]:
        return {
            path: (path.lstat().st_mtime_ns, path.read_bytes())
            for path in folder.rglob("*")
            if path.is_file()
        }

    return read


@pytest.fixture
def refused(deshake: Callable, contents: Callable, tmp_path: Path, pan: Path) -> Callable[..., str]:
    """Run a command on a photo in the test's folder, where it must fail and change nothing."""

    def run(command: str, path: Path, *args: object, kernel: Path = pan) -> str:
        before = contents(tmp_path)
        words = {
            "fix": (path, "--blur-size", 3, "--iterations", 2),
            "calibrate": (path,),
            "estimate-blind": (path, "--blur-size", 3),
            "deblur": (path, kernel),
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


@pytest.fixture
def seen(trial: Trial) -> dict[str, Any]:
    """Parameters and context that the trial command was run with."""
    parsed: dict[str, Any] = {}

    def function(ctx: click.Context) -> None:
        parsed.clear()
        parsed.update(ctx.params, threads=ctx.obj.threads, verbosity=ctx.obj.verbosity)

    trial(function)
    return parsed
