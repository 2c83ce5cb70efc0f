"""The general options of a run, for every command: verbosity, threads, progress, configuration."""

from __future__ import annotations

import logging
import os
import shlex
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Never, Self

from deshake.cli.config import Config
from deshake.cli.messages import log_to_file
from deshake.run import Progress, Run
from deshake.version import __version__

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tqdm import tqdm

__all__ = ["Context", "ProgressBar"]

_log = logging.getLogger(__name__)


def _stderr_is_terminal() -> bool:
    return sys.stderr.isatty()


def _has_known_size() -> bool:
    """Return whether stderr is not a terminal of size 0, as some serial lines and CI logs are."""
    try:
        return all(os.get_terminal_size(sys.stderr.fileno()))
    except (OSError, ValueError):  # no terminal at all
        return True


@dataclass
class Context:
    """The general options, handed to each command by ``@click.pass_obj``.

    Parameters
    ----------
    verbosity : int
        Count of -v less count of -q.
    threads : int or None
        Threads for the work on one photo, >= 1; None: the photos at once share all processors.
    progress : bool
        Whether progress bars are wanted; by default if stderr is a terminal.
    arguments : sequence of str
        The arguments after the program's name.
    config : Config
        The content of the configuration file.
    preset : str or None
        The chosen preset of that file.
    log : Path or None
        A file that the log is appended to.

    """

    verbosity: int = 0
    threads: int | None = None
    progress: bool = field(default_factory=_stderr_is_terminal)
    arguments: Sequence[str] = ()
    config: Config = field(default_factory=Config)
    preset: str | None = None
    log: Path | None = None

    def begin(self) -> None:
        """Begin the log, once all options are known.

        Raises
        ------
        click.UsageError
            If the log cannot be written.

        """
        if self.log is not None:
            log_to_file(self.log)
        _log.debug("deshake %s: %s", __version__, shlex.join(self.arguments))
        if self.config.path is not None:
            preset = "" if self.preset is None else f", preset {self.preset}"
            _log.info("options are read from %s%s", self.config.path, preset)

    def bar(self, text: str = "") -> ProgressBar:
        """Make a progress bar; it shows nothing if none is wanted."""
        return ProgressBar(text, shown=self.progress and self.verbosity >= 0)

    def run(self, progress: Progress) -> Run:
        """Return the run of a command: the threads that the user wants, and its progress."""
        return Run(self.threads, progress)


class ProgressBar:
    """A progress bar on stderr, as a context manager and a function.

    Call it with the share of the work that is done, 0..1, and a short text. It never runs
    backwards, shows the time left, and vanishes at the end.

    Parameters
    ----------
    text : str
        The first text.
    shown : bool
        Whether to show the bar.

    """

    def __init__(self, text: str = "", *, shown: bool) -> None:
        self._text = text
        self._shown = shown
        self._bar: tqdm[Never] | None = None

    def __enter__(self) -> Self:
        if self._shown:
            from tqdm import tqdm

            tqdm.monitor_interval = 0  # no thread to watch over one bar
            self._bar = tqdm(
                total=1.0,
                desc=self._text,
                file=sys.stderr,
                leave=False,
                miniters=0,  # steps are uneven: only the time decides when to update
                **({"dynamic_ncols": True} if _has_known_size() else {"ncols": 79, "nrows": 24}),
                bar_format="{desc} {percentage:3.0f}%|{bar}| {elapsed}, {remaining} left",
            )
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def __call__(self, fraction: float, text: str = "") -> None:
        """Show that `fraction` of the work is done, and `text`."""
        if self._bar is None:
            return
        if text and text != self._text:
            self._text = text
            self._bar.set_description_str(text, refresh=False)
        forward = min(fraction, 1.0) - self._bar.n
        self._bar.update(max(0, forward))
