"""The process that works on one photo after another, and its end of the line to the one above."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import sys
import threading
import time
import warnings
from multiprocessing import connection, parent_process
from typing import TYPE_CHECKING, Any, NamedTuple

from deshake.batch.task import Result, run_job
from deshake.run import Run

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from deshake.batch.plan import Job
    from deshake.batch.work import Work

__all__ = ["LogLevels", "Said", "Shown", "bind_opencv", "serve"]

_INTERVAL = 0.1
"""Seconds between two words on how far the work is."""


class LogLevels(NamedTuple):
    """What is logged: by everybody, and by deshake."""

    root: int
    deshake: int

    @classmethod
    def here(cls) -> LogLevels:
        """Return those of this process."""
        return cls(logging.getLogger().level, logging.getLogger("deshake").level)


class Shown(NamedTuple):
    """How far the work is, from 0 to 1, and what comes next."""

    share: float
    text: str


class Said(NamedTuple):
    """A line of the log."""

    name: str
    level: int
    text: str


def serve(line: Connection, work: Work, threads: int, levels: LogLevels) -> None:
    """Do the work on every job that comes along the line, until it is closed.

    Back go `Shown`, `Said` and, for each job, a `Result`. An interrupt from the keyboard is for
    the process above alone, which ends this one by SIGTERM: then outputs under way are removed.
    When that process ends, this one ends, too.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    threading.Thread(target=_follow_parent, daemon=True).start()
    warnings.simplefilter("ignore")  # what libraries warn of is meant for programmers
    send = _Sender(line)
    _log_to(send, levels)
    bind_opencv(threads)
    while True:
        try:
            job: Job = line.recv()
        except (EOFError, OSError):
            return
        result = run_job(job, work, Run(threads, _Shower(send)))
        with contextlib.suppress(OSError):  # nobody listens any more
            send(result)


class _Sender:
    """Sends one message at a time along the line: threads share it."""

    def __init__(self, line: Connection) -> None:
        self._line = line
        self._lock = threading.RLock()

    def __call__(self, message: Result | Shown | Said) -> None:
        with self._lock:
            self._line.send(message)


class _Shower:
    """Says how far the work is, now and then."""

    def __init__(self, send: _Sender) -> None:
        self._send = send
        self._next = 0.0

    def __call__(self, share: float, text: str) -> None:
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _INTERVAL
            self._send(Shown(share, text))


class _Sayer(logging.Handler):
    """Sends the log along the line."""

    def __init__(self, send: _Sender) -> None:
        super().__init__()
        self._send = send

    def emit(self, record: logging.LogRecord) -> None:
        self._send(Said(record.name, record.levelno, record.getMessage()))


def _log_to(send: _Sender, levels: LogLevels) -> None:
    root = logging.getLogger()
    root.handlers = [_Sayer(send)]
    root.setLevel(levels.root)
    logging.getLogger("deshake").setLevel(levels.deshake)


def bind_opencv(threads: int) -> None:
    """Limit OpenCV in this process to a number of threads, whatever the setting at its import."""
    import cv2  # noqa: PLC0415 - that it is loaded here is this process's business

    cv2.setNumThreads(threads)


def _leave(number: int, frame: Any) -> None:  # noqa: ANN401, ARG001
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sys.exit(128 + number)


def _follow_parent() -> None:
    """End this process as by SIGTERM when the one above has ended, however it did."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
