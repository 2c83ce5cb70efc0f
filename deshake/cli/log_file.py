"""The log in a file: everything that -vv prints, with times, whatever -q and -v say."""

from __future__ import annotations

import contextlib
import logging
import re
import stat
import sys
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["LogFile", "open_log"]

_log = logging.getLogger(__name__)

_FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"
_TIME = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} ")


class LogFile(logging.FileHandler):
    """Appends the log to a file, one line a record; a traceback has more.

    Parameters
    ----------
    path : Path
        The file. It is made if it is missing.

    Raises
    ------
    OSError
        If it cannot be written.

    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8", errors="backslashreplace")
        self.path = path
        self.setFormatter(logging.Formatter(_FORMAT))

    def format(self, record: logging.LogRecord) -> str:
        """Return the lines, all but the first indented; escape what cannot be printed."""
        text = super().format(record).replace("\n", "\n    ")
        return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        """Warn once that the log cannot be continued; the work continues."""
        error = sys.exc_info()[1]
        logging.getLogger().removeHandler(self)
        if not isinstance(error, OSError):
            super().handleError(record)
            return
        with contextlib.suppress(OSError):
            self.close()
        reason = (error.strerror or str(error)).lower()
        _log.warning("%s: the log ends here: %s", self.path, reason)


def open_log(path: Path) -> LogFile:
    """Open a log for appending.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    click.UsageError
        If it cannot be written, or is a file that is no log.

    """
    if str(path) == "-":
        raise click.UsageError("--log names a file; -vv prints the log")
    try:
        if not _may_be_log(path):
            raise click.UsageError(f"{path}: is not a log of deshake: name another file with --log")
        return LogFile(path)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise click.UsageError(f"{path}: the log cannot be written: {reason}") from None


def _may_be_log(path: Path) -> bool:
    """Return whether a log may be appended: to a new, empty or special file, or to a log.

    So a photo that is named by mistake does not change.
    """
    try:
        status = path.stat()
    except FileNotFoundError:
        return True
    if not stat.S_ISREG(status.st_mode):
        return True
    with path.open("rb") as file:
        begin = file.read(64)
    return not begin or _TIME.match(begin) is not None
