"""The configuration file: defaults for the options, and presets of them, in TOML.

Keys are the long names of options without their dashes. Those before the first table are the
general ones; each table bears the name of a command, or of a preset::

    threads = 2

    [fix]
    transfer = "gamma22"
    blur-size = 40

    [preset.night]
    blur-size = 80

    [preset.night.fix]
    strength = "80%"
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import click

from deshake.cli.values import Count, Number, Region, Share

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

__all__ = ["Config", "ConfigError", "read_config"]

_LONGEST = 40
"""Characters of a value that a message repeats."""
_MOST_NAMED = 5
"""Unknown options that a message names."""
_PRESETS = "preset"
"""The table of presets."""
_BEFORE_THE_FILE = {"config", "no_config", "preset", "version"}
"""General options that a file cannot set."""


class ConfigError(click.UsageError):
    """A configuration file is wrong."""


Defaults = dict[str, Any]
"""What click takes as ``default_map``: general options, and a table for each command."""


@dataclass(frozen=True)
class Config:
    """The content of a configuration file.

    Parameters
    ----------
    path : Path or None
        The file; None: there is none.
    defaults : dict
        Defaults of the options: those of the general options by their names, and a dict for each
        command.
    presets : mapping of str to dict
        The same for each preset.

    """

    path: Path | None = None
    defaults: Defaults = field(default_factory=dict)
    presets: Mapping[str, Defaults] = field(default_factory=dict)

    def with_preset(self, name: str | None) -> Defaults:
        """Return the defaults; those of a preset have priority.

        Raises
        ------
        click.UsageError
            If there is no such preset.

        """
        if name is None:
            return self.defaults
        if name not in self.presets:
            raise click.UsageError(self._unknown(name))
        preset = self.presets[name]
        merged = {**self.defaults, **preset}
        for key, table in preset.items():
            if isinstance(table, dict):
                merged[key] = {**self.defaults.get(key, {}), **table}
        return merged

    def _unknown(self, name: str) -> str:
        """Return the message that there is no such preset, and which there are."""
        if self.path is None:
            return f"no preset {name!r}: there is no configuration file"
        if not self.presets:
            return f"no preset {name!r}: there is no [preset.{name}] in {self.path}"
        return f"no preset {name!r} in {self.path}, which has {', '.join(sorted(self.presets))}"


def read_config(ctx: click.Context, path: Path) -> Config:
    """Read a configuration file for the group of `ctx`.

    Parameters
    ----------
    ctx : click.Context
        The context of the command group, whose commands the tables may name.
    path : Path
        The TOML file.

    Returns
    -------
    Config
        The content of the file.

    Raises
    ------
    ConfigError
        If the file cannot be read, is not TOML, or has a key that is no option, or a value that the
        option does not take.

    """
    try:
        content = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
        repr(content)  # of a number in hexadecimal only this shows that no message can hold it
    except OSError as error:
        raise ConfigError(f"{path}: {(error.strerror or str(error)).lower()}", ctx) from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file in UTF-8", ctx) from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not TOML: {error}", ctx) from None
    except ValueError:
        raise ConfigError(f"{path}: a number in it has too many digits", ctx) from None
    except RecursionError:
        raise ConfigError(f"{path}: too many brackets within brackets", ctx) from None
    reader = _Reader(ctx, path)
    presets = content.pop(_PRESETS, {})
    if not isinstance(presets, dict) or not all(
        isinstance(each, dict) for each in presets.values()
    ):
        raise reader.error("", "a preset is a table, such as [preset.night]")
    return Config(
        path,
        reader.defaults(content),
        {name: reader.preset(name, table) for name, table in presets.items()},
    )


class _Reader:
    """Checks the tables of a file, and turns them into defaults.

    Parameters
    ----------
    ctx : click.Context
        The context of the command group.
    path : Path
        The file.

    """

    def __init__(self, ctx: click.Context, path: Path) -> None:
        if not isinstance(ctx.command, click.Group):
            msg = "a configuration file is read for a group of commands"
            raise TypeError(msg)
        self._ctx = ctx
        self._group = ctx.command
        self._path = path

    def error(self, where: str, what: str) -> ConfigError:
        """Return the error for a place of the file."""
        return ConfigError(f"{self._path}: {where}{what}", self._ctx)

    def defaults(self, content: Mapping[str, Any]) -> Defaults:
        """Return the defaults of the general options and of the commands."""
        general, tables = _parted(content)
        defaults = self._checked(_options(self._group), general, "")
        for name, table in tables.items():
            defaults[name] = self._checked(_options(self._command(name, "")), table, f"[{name}] ")
        return defaults

    def preset(self, name: str, content: Mapping[str, Any]) -> Defaults:
        """Return the defaults of a preset.

        A key that stands before its tables is a general option, or an option of each command that
        has one of this name and kind.
        """
        where = f"[{_PRESETS}.{name}] "
        plain, tables = _parted(content)
        known = _options(self._group)
        general = {key: value for key, value in plain.items() if key in known}
        defaults = self._checked(known, general, where)
        if len(general) < len(plain):
            others = {key: value for key, value in plain.items() if key not in known}
            self._spread(others, where, defaults)
        for title, table in tables.items():
            known = _options(self._command(title, f"{_PRESETS}.{name}."))
            checked = self._checked(known, table, f"[{_PRESETS}.{name}.{title}] ")
            defaults[title] = {**defaults.get(title, {}), **checked}
        return defaults

    def _spread(self, plain: Mapping[str, Any], where: str, defaults: Defaults) -> None:
        """Add options to the defaults of every command that has them."""
        names = self._group.list_commands(self._ctx)
        commands = {name: _options(self._command(name, "")) for name in names}
        for key, value in plain.items():
            having = {name: known[key] for name, known in commands.items() if key in known}
            if not having:
                every = sorted({key for known in commands.values() for key in known})
                general = ", ".join([*_options(self._group), *every])
                raise self.error(where, f"{key}: no such option; there are {general}")
            faults = {name: self._fault(option, value) for name, option in having.items()}
            if all(faults.values()):
                [fault, *_] = faults.values()
                raise self.error(where, f"{key} = {_shortened(value)}: {fault}")
            for name, fault in faults.items():
                if fault is None:
                    defaults.setdefault(name, {})[having[name].name] = value

    def _command(self, name: str, above: str) -> click.Command:
        """Return the command that a table names."""
        command = self._group.get_command(self._ctx, name)
        if command is None:
            names = ", ".join(self._group.list_commands(self._ctx))
            raise self.error(f"[{above}{name}]: ", f"no such command; there are {names}")
        return command

    def _checked(
        self, known: Mapping[str, click.Option], table: Mapping[str, Any], where: str
    ) -> Defaults:
        """Return a table by the names of the parameters."""
        unknown = [key for key in table if key not in known]
        if unknown and unknown[0] in self._group.list_commands(self._ctx):
            name = unknown[0]
            raise self.error(where, f"{name} is a command: its options stand in a table, [{name}]")
        if unknown:
            names = ", ".join(_shortened(key) for key in unknown[:_MOST_NAMED])
            more = " and others" if len(unknown) > _MOST_NAMED else ""
            raise self.error(where, f"{names}{more}: no such option; there are {', '.join(known)}")
        for key, value in table.items():
            fault = self._fault(known[key], value)
            if fault is not None:
                raise self.error(where, f"{key} = {_shortened(value)}: {fault}")
        return {known[key].name or key: value for key, value in table.items()}

    def _fault(self, option: click.Option, value: object) -> str | None:
        """Return what is wrong with a value of an option; None: nothing."""
        if not _is_of_kind(option, value):
            return f"is not {_kind(option)}"
        if isinstance(value, str) and (not value or "\0" in value):
            return "a character NUL stands in it" if value else "the text is empty"
        try:
            option.type_cast_value(self._ctx, value)
        except click.BadParameter as error:
            message = error.message.rstrip(".")
            return message.replace(value, _shortened(value)) if isinstance(value, str) else message
        return None


def _parted(content: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Part a table into its values and the tables in it."""
    tables = {name: value for name, value in content.items() if isinstance(value, dict)}
    return {name: value for name, value in content.items() if name not in tables}, tables


def _options(command: click.Command) -> dict[str, click.Option]:
    """Return the options of a command that a file can set, by their long names without dashes.

    Those that a command only passes to the general options are not among them: the file sets them
    before the command's name.
    """
    return {
        name[2:]: param
        for param in command.params
        if isinstance(param, click.Option)
        and (param.expose_value or isinstance(command, click.Group))
        and param.name not in _BEFORE_THE_FILE
        for name in param.opts
        if name.startswith("--")
    }


def _kind(option: click.Option) -> str:
    """Return the kind of value that an option takes in the file, in words."""
    if option.is_flag or option.count:
        return "a whole number" if option.count else "true or false"
    if isinstance(option.type, Count | type(click.INT)):
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


def _shortened(value: object) -> str:
    """Return a value of the file in one short line."""
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
