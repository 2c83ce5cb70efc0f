"""A command of the tests' own, and small photos to run the real ones on."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING

import click
import cv2
import numpy as np
import pytest
from PIL import Image

from deshake.cli import main, options

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from deshake.cli.context import Context

Trial = "Callable[[Callable[[Context], int | None]], None]"


@pytest.fixture
def trial(monkeypatch: pytest.MonkeyPatch) -> Trial:
    """Install a command named trial that calls the function it is given."""

    def install(function: Callable[[Context], int | None]) -> None:
        @click.command("trial")
        @click.option("--blur-size", type=float)
        @options.transfer_option
        @options.general_options
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


@pytest.fixture
def shaken(tmp_path: Path) -> Callable[..., Path]:
    """Save a small shaken photo under a name; a 16-bit one if asked."""

    def save(name: str, depth: int = 8) -> Path:
        # A texture with edges at every angle, blurred along a slant.
        grey = cv2.resize(
            np.random.default_rng(5).random((8, 10), np.float32), (100, 80), interpolation=3
        )
        sharp = np.clip(0.5 + 3 * (grey - 0.5), 0.05, 0.95)
        blurred = cv2.filter2D(sharp, -1, np.eye(3, dtype=np.float32) / 3)
        picture = np.stack([blurred, 0.8 * blurred + 0.1, 0.9 * blurred], -1)
        path = tmp_path / name
        if depth == 16:
            codes = np.rint(picture * 65535).astype(np.uint16)
            path.write_bytes(cv2.imencode(path.suffix, codes)[1].tobytes())
        else:
            Image.fromarray(np.rint(picture * 255).astype(np.uint8)).save(path, quality=92)
        return path

    return save
