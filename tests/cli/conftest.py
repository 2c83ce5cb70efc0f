"""A command of the tests' own, to see what the frame around commands does."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING

import click
import pytest

from deshake.cli import main, options

if TYPE_CHECKING:
    from collections.abc import Callable

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
