"""The messages of the command line on stderr: errors with hints, and the log.

stdout carries data only, so nothing here ever writes to it.
"""

from __future__ import annotations

import logging
import os
import sys
import warnings
from contextlib import contextmanager
from difflib import SequenceMatcher
from typing import TYPE_CHECKING, TextIO

import click
from click.exceptions import NoArgsIsHelpError, NoSuchOption

from deshake import errors
from deshake.cli.config import ConfigError
from deshake.cli.log_file import LogFile, open_log

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = [
    "describe",
    "log_to_file",
    "log_to_stderr",
    "print_error",
    "print_exception",
    "print_note",
    "set_verbosity",
]

_log = logging.getLogger(__name__)

_ROOT = logging.getLogger()
_OURS = logging.getLogger("deshake")
_WARNINGS = logging.getLogger("deshake.libraries")
_PILLOW = logging.getLogger("PIL")
_LEVELS = {-1: logging.ERROR, 0: logging.WARNING, 1: logging.INFO}
_PRINTED = {"printed": True}
"""Marks a line of the log that is on stderr already, in a form of its own."""
_ALIKE = 0.75
"""Least similarity of two names, 0..1, if one is a typing error for the other."""
_NATIVE_LOGS = "OPENCV_LOG_LEVEL"
"""OpenCV itself writes to the terminal, not through Python, unless this variable forbids it."""


def print_error(message: str, *, hint: str | None = None) -> None:
    """Print ``error: message`` and ``hint: what to try``, one line each."""
    _print_line("error", message, colour="red")
    _log.error("%s", message, extra=_PRINTED)
    if hint:
        _print_line("hint", hint, colour="cyan")
        _log.info("hint: %s", hint, extra=_PRINTED)


def print_note(text: str, *, also_quiet: bool = False) -> None:
    """Print a line that is neither an error nor a warning; with -q only if it is `also_quiet`."""
    if also_quiet or _STDERR.verbosity >= 0:
        _print_line("", text)
    _log.info("%s", text, extra=_PRINTED)


def print_exception(error: Exception) -> None:
    """Print in one line what went wrong, and in another what to try."""
    if isinstance(error, NoArgsIsHelpError):
        error.show()
    else:
        message, hint = describe(error)
        print_error(message, hint=hint)


def describe(error: Exception) -> tuple[str, str | None]:
    """Return what went wrong, and what to try."""
    match error:
        case ConfigError():
            return error.format_message(), "mend the file, or run without it: deshake --no-config"
        case NoSuchOption(option_name="--config" | "--no-config" as name):
            file = " FILE" if name == "--config" else ""
            return error.format_message(), f"it comes first, as in: deshake {name}{file} fix"
        case NoSuchOption():
            return _without_guesses(error), _usage_hint(error)
        case click.UsageError():
            return error.format_message(), _usage_hint(error)
        case click.ClickException():
            return error.format_message(), None
        case _:
            return errors.describe(error)


def _usage_hint(error: click.UsageError) -> str:
    path = error.ctx.command_path if error.ctx else "deshake"
    return f"see {path} --help"


def _without_guesses(error: NoSuchOption) -> str:
    """Return the message, with only those similar options that a typing error may have changed."""
    meant = [
        name
        for name in error.possibilities or []
        if name.startswith(error.option_name)
        or SequenceMatcher(None, name.strip("-"), error.option_name.strip("-")).ratio() >= _ALIKE
    ]
    return NoSuchOption(error.option_name, error.message, meant).format_message()


def set_verbosity(verbosity: int) -> None:
    """Show errors only (< 0), warnings (0), progress notes (1) or everything (>= 2)."""
    _STDERR.verbosity = verbosity
    if verbosity > 1:
        os.environ.pop(_NATIVE_LOGS, None)
    _set_levels()


def log_to_file(path: Path) -> None:
    """Append the log to a file, too, until `log_to_stderr` ends.

    Raises
    ------
    click.UsageError
        If it cannot be written, or is a file that is no log.

    """
    _ROOT.addHandler(open_log(path))
    _set_levels()


def _set_levels() -> None:
    """Let every record pass that any handler wants."""
    in_file = any(isinstance(handler, LogFile) for handler in _ROOT.handlers)
    verbosity = 2 if in_file else _STDERR.verbosity
    _OURS.setLevel(_LEVELS.get(max(verbosity, -1), logging.DEBUG))
    others = logging.DEBUG if verbosity > 1 else logging.CRITICAL + 1
    _ROOT.setLevel(others)
    _WARNINGS.setLevel(others)
    # Pillow's DEBUG lists every chunk and tag of a file.
    _PILLOW.setLevel(logging.INFO if verbosity > 1 else logging.NOTSET)


@contextmanager
def log_to_stderr() -> Iterator[None]:
    """Send the log, and the warnings of libraries, to stderr in deshake's form.

    Messages of libraries are for programmers, so they appear at -vv only.
    """
    handlers = list(_ROOT.handlers)
    levels = {logger: logger.level for logger in (_ROOT, _OURS, _WARNINGS, _PILLOW)}
    native = os.environ.get(_NATIVE_LOGS)
    os.environ.setdefault(_NATIVE_LOGS, "SILENT")
    _ROOT.addHandler(_STDERR)
    set_verbosity(0)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _log_warning
            yield
    finally:
        for handler in [each for each in _ROOT.handlers if each not in handlers]:
            _ROOT.removeHandler(handler)
            handler.close()
        for logger, level in levels.items():
            logger.setLevel(level)
        if native is None:
            os.environ.pop(_NATIVE_LOGS, None)
        else:
            os.environ[_NATIVE_LOGS] = native


class _StderrHandler(logging.Handler):
    """Prints ``warning: text`` above a progress bar, if there is one."""

    verbosity = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether to show the line; `print_note` and the like have shown theirs already."""
        if hasattr(record, "printed") or self.verbosity > 1:
            return not hasattr(record, "printed")
        ours = record.name.startswith("deshake") and record.name != _WARNINGS.name
        return ours and record.levelno >= _LEVELS[max(self.verbosity, -1)]

    def emit(self, record: logging.LogRecord) -> None:
        try:
            text = record.getMessage()
            if record.levelno <= logging.DEBUG or record.name == _WARNINGS.name:
                text = f"{record.name}: {text}"
            if record.exc_info:
                text += "\n" + logging.Formatter().formatException(record.exc_info)
            label = "" if record.levelno == logging.INFO else record.levelname.lower()
            colour = "yellow" if record.levelno == logging.WARNING else None
            _print_line(label, text, colour=colour, one_line=not record.exc_info)
        except Exception:  # noqa: BLE001  what logging asks of a handler
            self.handleError(record)


_STDERR = _StderrHandler()


def _log_warning(  # noqa: PLR0917  the signature of warnings.showwarning
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,  # noqa: ARG001
    line: str | None = None,  # noqa: ARG001
) -> None:
    _WARNINGS.warning("%s (%s, %s:%d)", message, category.__name__, filename, lineno)


def _print_line(label: str, text: str, *, colour: str | None = None, one_line: bool = True) -> None:
    if one_line:
        text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    if label:
        text = f"{click.style(f'{label}:', fg=colour, bold=True)} {text}"
    styled = False if os.environ.get("NO_COLOR") else None  # None: if stderr is a terminal
    tqdm = sys.modules.get("tqdm")
    if tqdm is None:
        click.echo(text, err=True, color=styled)
    else:
        with tqdm.tqdm.external_write_mode(file=sys.stderr):
            click.echo(text, err=True, color=styled)
