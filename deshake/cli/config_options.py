r"""The options that choose the configuration file and its preset.

The user's own file is read if it is there::

    $XDG_CONFIG_HOME/deshake/config.toml    if that is set
    %APPDATA%\deshake\config.toml            on Windows
    ~/.config/deshake/config.toml           elsewhere, also on macOS

``--config FILE`` names another file, which is read instead of it. ``--no-config`` reads none.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from deshake.cli.config import Config, read_config
from deshake.cli.context import Context

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["config_options", "preset_option", "user_config"]

F = TypeVar("F", bound="Callable[..., Any]")

_SWITCHED_OFF = "deshake.no_config"
"""Key of click's context that records --no-config."""


def user_config() -> Path | None:
    """Return the path of the user's own configuration file, whether it exists or not.

    None: the system has no place for it.
    """
    windows = sys.platform == "win32"
    named = [os.environ.get("XDG_CONFIG_HOME"), os.environ.get("APPDATA") if windows else None]
    for folder in [*filter(None, named), "~/.config"]:
        path = Path(os.path.expanduser(folder))  # noqa: PTH111 - leaves ~ where there is no home
        if path.is_absolute():
            return path / "deshake" / "config.toml"
    return None


def config_options(command: F) -> F:
    """Add --config, --no-config and --preset to the group of commands."""
    for option in (
        _preset(is_eager=False),  # after --config and --no-config, wherever they are typed
        click.option(
            "--config",
            type=click.Path(path_type=Path),
            metavar="FILE",
            is_eager=True,
            expose_value=False,
            callback=_load,
            help="Read the options' defaults from this TOML file, and not from the user's own.",
        ),
        click.option(
            "--no-config",
            is_flag=True,
            is_eager=True,
            expose_value=False,
            callback=_switch_off,
            help="Read no configuration file.",
        ),
    ):
        command = option(command)
    return command


def preset_option(command: F) -> F:
    """Add --preset to a command."""
    return _preset(is_eager=True)(command)  # before the options that it sets


def _preset(*, is_eager: bool) -> Callable[[F], F]:
    return click.option(
        "--preset",
        metavar="NAME",
        is_eager=is_eager,
        expose_value=False,
        callback=_choose_preset,
        shell_complete=_begun_presets,
        help="Take the defaults from this preset of the configuration file.",
    )


def _switch_off(ctx: click.Context, param: click.Parameter, value: bool) -> None:  # noqa: ARG001
    """Read no file; the command line has priority over the environment."""
    ctx.meta[_SWITCHED_OFF] = value
    _refuse_both(ctx)


def _load(ctx: click.Context, param: click.Parameter, value: Path | None) -> None:  # noqa: ARG001
    """Read the file that is named, or the user's own."""
    _refuse_both(ctx)
    off = ctx.meta.get(_SWITCHED_OFF, False)
    path = None if off else value if value is not None else _existing(user_config())
    config = Config() if path is None else read_config(ctx, path)
    ctx.ensure_object(Context).config = config
    ctx.default_map = config.defaults


def _refuse_both(ctx: click.Context) -> None:
    if _typed(ctx, "config") and _typed(ctx, "no_config"):
        raise click.UsageError("--config and --no-config cannot both be given.", ctx)


def _existing(path: Path | None) -> Path | None:
    """Return a path if it exists, readable or not."""
    try:
        return path if path is not None and path.exists() else None
    except PermissionError:
        return path


def _choose_preset(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
    """Give the preset's defaults priority over those of the file.

    After a command's name only a typed preset counts: the environment is already applied.
    """
    context = ctx.ensure_object(Context)
    if value is None or (ctx.parent is not None and not _typed(ctx, param.name)):
        return
    defaults = context.config.with_preset(value)
    context.preset = value
    if ctx.parent is None:
        ctx.default_map = defaults
    else:
        general = {name: each for name, each in defaults.items() if not isinstance(each, dict)}
        ctx.default_map = {**general, **defaults.get(ctx.info_name or "", {})}


def _begun_presets(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:  # noqa: ARG001
    """Return the presets whose names begin with `incomplete`, for the shell."""
    presets = ctx.ensure_object(Context).config.presets
    return sorted(name for name in presets if name.startswith(incomplete))


def _typed(ctx: click.Context, name: str | None) -> bool:
    return ctx.get_parameter_source(name or "") is ParameterSource.COMMANDLINE
