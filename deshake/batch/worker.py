"""A worker: the process that works on one photo after another, and its end of the pipe."""

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

__all__ = ["LogLevels", "LogMessage", "ProgressMessage", "bind_opencv", "serve"]

_INTERVAL = 0.1
"""Least number of seconds between two reports of the progress."""


class LogLevels(NamedTuple):
    """The levels of the log: of all libraries, and of deshake."""

    root: int
    deshake: int

    @classmethod
    def here(cls) -> LogLevels:
        """Return the levels of this process."""
        return cls(logging.getLogger().level, logging.getLogger("deshake").level)


class ProgressMessage(NamedTuple):
    """The progress: the share of the work that is done, 0..1, and a text."""

    share: float
    text: str


class LogMessage(NamedTuple):
    """An entry of the log."""

    name: str
    level: int
    text: str


def serve(pipe: Connection, work: Work, threads: int, levels: LogLevels) -> None:
    """Do the work on every job that comes through the pipe, until the pipe is closed.

    The worker sends `ProgressMessage`, `LogMessage` and, for each job, a `Result`. It ignores an
    interrupt from the keyboard. The parent process ends it by SIGTERM: then unfinished outputs are
    removed. The worker also ends when the parent process ends.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    threading.Thread(target=_follow_parent, daemon=True).start()
    warnings.simplefilter("ignore")  # warnings of libraries are for programmers
    send = _Sender(pipe)
    _log_to(send, levels)
    bind_opencv(threads)
    while True:
        try:
            job: Job = pipe.recv()
        except (EOFError, OSError):
            return
        result = run_job(job, work, Run(threads, _ProgressSender(send)))
        with contextlib.suppress(OSError):  # nobody listens any more
            send(result)


class _Sender:
    """Sends one message at a time through the pipe, which threads share."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._lock = threading.RLock()

    def __call__(self, message: Result | ProgressMessage | LogMessage) -> None:
        with self._lock:
            self._pipe.send(message)


class _ProgressSender:
    """Sends the progress, at most once in `_INTERVAL`."""

    def __init__(self, send: _Sender) -> None:
        self._send = send
        self._next = 0.0

    def __call__(self, share: float, text: str) -> None:
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _INTERVAL
            self._send(ProgressMessage(share, text))


class _LogSender(logging.Handler):
    """Sends the log through the pipe."""

    def __init__(self, send: _Sender) -> None:
        super().__init__()
        self._send = send

    def emit(self, record: logging.LogRecord) -> None:
        self._send(LogMessage(record.name, record.levelno, record.getMessage()))


def _log_to(send: _Sender, levels: LogLevels) -> None:
    root = logging.getLogger()
    root.handlers = [_LogSender(send)]
    root.setLevel(levels.root)
    logging.getLogger("deshake").setLevel(levels.deshake)


def bind_opencv(threads: int) -> None:
    """Set the number of OpenCV's threads in this process, whatever it was at the import."""
    import cv2  # noqa: PLC0415 - only a worker loads it

    cv2.setNumThreads(threads)


def _leave(number: int, frame: Any) -> None:  # noqa: ANN401, ARG001
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sys.exit(128 + number)


def _follow_parent() -> None:
    """End this process as by SIGTERM when the parent process ends, for any reason."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
