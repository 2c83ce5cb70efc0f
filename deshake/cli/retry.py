"""``--retry-failed``: the photos that failed in an earlier run, by its ``--json``."""

from __future__ import annotations

import json
import logging
from typing import TYPE_CHECKING

import click

from deshake.cli.json_output import readable
from deshake.cli.messages import print_note
from deshake.cli.options import FILE

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from deshake.batch.plan import Job

__all__ = ["failed_before", "retried", "retry_option"]

_log = logging.getLogger(__name__)

retry_option = click.option(
    "--retry-failed",
    type=FILE,
    metavar="FILE.jsonl",
    help="Repeat an earlier run for the photos that failed: give its photos and its options again, "
    "and the file with what its --json printed.",
)


def retried(jobs: Sequence[Job], path: Path) -> list[Job]:
    """Return those jobs whose photos failed in an earlier run.

    Parameters
    ----------
    jobs : sequence of Job
        All photos of that run, planned in the same way.
    path : Path
        The file of what ``--json`` printed.

    Raises
    ------
    click.UsageError
        If the file cannot be read, a line of it was not printed by ``--json``, or none of the
        photos that failed is among these.
    click.exceptions.Exit
        With code 0, if no photo failed.

    """
    names = failed_before(path)
    if not names:
        print_note(f"{path}: no photo failed: there is nothing to repeat")
        raise click.exceptions.Exit(0)
    chosen = [job for job in jobs if readable(str(job.source)) in names]
    here = {readable(str(job.source)) for job in chosen}
    missing = [name for name in names if name not in here]
    if not chosen:
        raise click.UsageError(
            f"{path}: none of the photos that failed, such as {missing[0]}, is among these: give "
            "the same photos as in that run"
        )
    for name in missing:
        _log.warning("%s: failed in %s, and is not among the photos given", name, path)
    return chosen


def failed_before(path: Path) -> list[str]:
    """Return the names of the photos that failed, by what ``--json`` printed.

    If a photo is there more than once, its last line counts.

    Raises
    ------
    click.UsageError
        If the file cannot be read, is empty, or has a line that ``--json`` does not print.

    """
    try:
        lines = path.read_text("utf-8").split("\n")
    except OSError as error:
        raise click.UsageError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except UnicodeDecodeError:
        raise click.UsageError(f"{path}: not a text file in UTF-8") from None
    status: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            report = json.loads(line)
            source, state = report["input"], report["status"]
        except (ValueError, RecursionError, KeyError, TypeError):
            source, state = None, None
        if not (isinstance(source, str) and isinstance(state, str)):
            raise click.UsageError(f"{path}: line {number} is not a line that --json prints")
        status[source] = state
    if not status:
        raise click.UsageError(
            f"{path}: is empty; if this run's --json goes there, let it go to another file"
        )
    return [source for source, state in status.items() if state == "failed"]
