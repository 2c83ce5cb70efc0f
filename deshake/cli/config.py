"""The configuration file: defaults for the options, in TOML.

Keys are the long names of options without their dashes. Those before the first table are the
general ones; each table bears the name of a command::

    threads = 2

    [fix]
    transfer = "gamma22"
    blur-size = 40
"""

from __future__ import annotations

import tomllib
from typing import TYPE_CHECKING, Any

import click

from deshake.cli.values import Number, Region, Share

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

__all__ = ["read_config"]

_LONGEST = 40
"""Characters of a value that a message repeats."""


def read_config(ctx: click.Context, path: Path) -> dict[str, Any]:
    """Read a configuration file for the group of `ctx`.

    Parameters
    ----------
    ctx : click.Context
        The context of the command group, whose commands the tables may name.
    path : Path
        The TOML file.

    Returns
    -------
    dict
        What click takes as ``default_map``.

    Raises
    ------
    click.UsageError
        If the file cannot be read, is not TOML, or has a key that is no option, or whose value is
        of the wrong kind.

    """
    group = ctx.command
    if not isinstance(group, click.Group):
        msg = "a configuration file is read for a group of commands"
        raise TypeError(msg)
    try:
        content = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise click.UsageError(f"{path}: {error.strerror}", ctx) from None
    except UnicodeDecodeError:
        raise click.UsageError(f"{path}: not a text file in UTF-8", ctx) from None
    except tomllib.TOMLDecodeError as error:
        raise click.UsageError(f"{path}: not TOML: {error}", ctx) from None
    except ValueError:
        raise click.UsageError(f"{path}: a number in it has too many digits", ctx) from None
    except RecursionError:
        raise click.UsageError(f"{path}: too many brackets within brackets", ctx) from None
    tables = {name: value for name, value in content.items() if isinstance(value, dict)}
    general = {name: value for name, value in content.items() if name not in tables}
    defaults: dict[str, Any] = _defaults(group, general, f"{path}: ", ctx)
    for name, table in tables.items():
        command = group.get_command(ctx, name)
        if command is None:
            names = ", ".join(group.list_commands(ctx))
            msg = f"{path}: [{name}]: no such command; there are {names}"
            raise click.UsageError(msg, ctx)
        defaults[name] = _defaults(command, table, f"{path}: [{name}] ", ctx)
    return defaults


def _defaults(
    command: click.Command, table: Mapping[str, Any], where: str, ctx: click.Context
) -> dict[str, Any]:
    """Turn a table's keys into the names of the command's parameters."""
    known = {
        name[2:]: param
        for param in command.params
        # What a command only passes to the general options is set before its name.
        if isinstance(param, click.Option) and (param.expose_value or command is ctx.command)
        for name in param.opts
        if name.startswith("--") and param.name not in {"config", "version"}
    }
    unknown = [key for key in table if key not in known]
    if unknown:
        msg = f"{where}{', '.join(unknown)}: no such option; there are {', '.join(known)}"
        raise click.UsageError(msg, ctx)
    for key, value in table.items():
        if not _is_of_kind(known[key], value):
            expected = _kind(known[key])
            raise click.UsageError(f"{where}{key} = {_said(value)}: is not {expected}", ctx)
    return {known[key].name or key: value for key, value in table.items()}


def _kind(option: click.Option) -> str:
    """Say what kind of value an option takes in the file."""
    if option.is_flag or option.count:
        return "a whole number" if option.count else "true or false"
    if isinstance(option.type, type(click.INT)):
        return "a whole number"
    if isinstance(option.type, Number | Share | type(click.FLOAT)):
        return "a number"
    if isinstance(option.type, Region):
        return "four whole numbers"
    return "a text in quotes"


def _is_of_kind(option: click.Option, value: object) -> bool:
    """Return whether a value has the type of an option, or is a text as on the command line."""
    match _kind(option):
        case "true or false":
            return isinstance(value, bool)
        case "a whole number":
            whole = isinstance(value, int) and not isinstance(value, bool)
            return whole or (isinstance(value, str) and not option.count)
        case "a number":
            return isinstance(value, int | float | str) and not isinstance(value, bool)
        case "four whole numbers" if isinstance(value, list):
            return len(value) == 4 and all(type(item) is int for item in value)
        case _:
            return isinstance(value, str)


def _said(value: object) -> str:
    """Return a value of the file in one short line."""
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
