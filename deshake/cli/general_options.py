"""The options that every command has, before and after its name: -v, -q, --log, --threads."""

from __future__ import annotations

import os
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click
from click.core import ParameterSource

from deshake.cli.config_options import config_options, preset_option
from deshake.cli.context import Context
from deshake.cli.messages import set_verbosity
from deshake.cli.options import FILE
from deshake.cli.values import Count

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["general_options", "program_options"]

F = TypeVar("F", bound="Callable[..., Any]")

_OPENCV_THREADS = "OPENCV_FOR_THREADS_NUM"
"""The variable that OpenCV reads when it is imported, after the options are read."""


def _set_verbosity(ctx: click.Context, param: click.Parameter, value: int) -> None:
    context = ctx.ensure_object(Context)
    if _counts(ctx, param):
        if ctx.get_parameter_source(param.name or "") is not ParameterSource.COMMANDLINE:
            value -= _counted_above(ctx, param)
        context.verbosity += value if param.name == "verbose" else -value
        set_verbosity(context.verbosity)


def _set_threads(ctx: click.Context, param: click.Parameter, value: int | None) -> None:
    context = ctx.ensure_object(Context)
    if value is not None and _counts(ctx, param):
        context.threads = value
        os.environ[_OPENCV_THREADS] = str(value)


def _set_log(ctx: click.Context, param: click.Parameter, value: Path | None) -> None:
    context = ctx.ensure_object(Context)
    if value is not None and _counts(ctx, param):
        context.log = Path(os.path.expanduser(value))  # noqa: PTH111 - the file may say ~


def _set_progress(ctx: click.Context, param: click.Parameter, value: bool | None) -> None:
    context = ctx.ensure_object(Context)
    if value is not None and _counts(ctx, param):
        context.progress = value


def _counts(ctx: click.Context, param: click.Parameter) -> bool:
    """Return whether a general option's value counts: after a command's name, only if typed there.

    The environment and the configuration file set it before the command's name, so a typed value
    has priority in either place. Of values not typed there, only those of a preset count.
    """
    name = param.name or ""
    source = ctx.get_parameter_source(name)
    if ctx.parent is None or source is ParameterSource.COMMANDLINE:
        return True
    above = ctx.parent.get_parameter_source(name)
    by_file = source is ParameterSource.DEFAULT_MAP
    return by_file and above in {ParameterSource.DEFAULT, ParameterSource.DEFAULT_MAP}


def _counted_above(ctx: click.Context, param: click.Parameter) -> int:
    """Return the count of -v or -q before the command's name, from the configuration file."""
    defaults = (ctx.parent.default_map if ctx.parent else None) or {}
    return int(defaults.get(param.name or "", 0))


def general_options(command: F) -> F:
    """Add to a command the options that work before and after its name, and begin the log."""

    @wraps(command)
    def begun(*args: Any, **values: Any) -> Any:  # noqa: ANN401
        click.get_current_context().ensure_object(Context).begin()
        return command(*args, **values)

    return preset_option(_with_shared_options(cast("F", begun)))


def program_options(command: F) -> F:
    """Add to the group of commands what `general_options` adds, and the configuration file."""
    return config_options(_with_shared_options(command))


def _with_shared_options(command: F) -> F:
    """Add -v, -q, --log, --threads and --progress."""
    for option in (
        click.option(
            "--progress/--no-progress",
            default=None,
            expose_value=False,
            callback=_set_progress,
            help="Show progress bars, or none.  [default: if stderr is a terminal]",
        ),
        click.option(
            "--threads",
            type=Count(1, 1024),
            expose_value=False,
            callback=_set_threads,
            help="Threads for the work on one photo.  [default: one a processor]",
        ),
        click.option(
            "--log",
            type=FILE,
            metavar="FILE",
            expose_value=False,
            callback=_set_log,
            help="Append all that -vv prints to this file, with times, whatever -q and -v say.",
        ),
        click.option(
            "-q",
            "--quiet",
            count=True,
            expose_value=False,
            callback=_set_verbosity,
            help="Say nothing but errors.",
        ),
        click.option(
            "-v",
            "--verbose",
            count=True,
            expose_value=False,
            callback=_set_verbosity,
            help="Say what is being done; twice: everything, with tracebacks.",
        ),
    ):
        command = option(command)
    return command
