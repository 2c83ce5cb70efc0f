"""Whether results of earlier runs are what this one would make: their provenance tells."""

from __future__ import annotations

import contextlib
import json
from typing import TYPE_CHECKING, Any

from deshake.errors import DeshakeError
from deshake.files.kernel_file import read_kernel
from deshake.files.registration_file import read_registration
from deshake.metadata.provenance import read_provenance

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from deshake.batch.plan import Job
    from deshake.batch.work import Work

__all__ = ["differences", "doubt", "made_by"]

_INPUTS = {
    "input_sha256": "from another input",
    "noisy_sha256": "with another noisy photo",
    "mask_sha256": "with another mask",
    "registration": "with another registration",
}


def doubt(job: Job, work: Work) -> str | None:
    """Say why the result of a job that exists is not what the work would make; None: it may be.

    What does not tell how it was made is not doubted.
    """
    told = None if job.output is None else _told(job.output)
    if told is None:
        return None
    found = differences(told, work.origin(job))
    if not found:
        return None
    return f"{job.output} exists already, but was made {' and '.join(found)}"


def made_by(job: Job, work: Work) -> bool:
    """Say whether the provenance of an existing result is what the work would write."""
    told = None if job.output is None else _told(job.output)
    return told is not None and not differences(told, work.origin(job))


def differences(told: Mapping[str, Any], expected: Mapping[str, Any]) -> list[str]:
    """Say how a provenance differs from what is expected, as far as that goes.

    Parameters
    ----------
    told, expected : mapping
        Provenance, as JSON data. Of the expected one there may be only a part.

    """
    told, expected = json.loads(json.dumps([told, expected]))
    found: list[str] = []
    changed: list[str] = []
    _compare(told, expected, found, changed)
    if changed:
        found.append(f"with other options ({', '.join(changed)})")
    return found


def _compare(
    told: Mapping[str, Any], expected: Mapping[str, Any], found: list[str], changed: list[str]
) -> None:
    """Collect what differs: inputs by their names, options with both values."""
    for name, now in expected.items():
        before = told.get(name)
        if name in _INPUTS:
            if before != now and _INPUTS[name] not in found:
                found.append(_INPUTS[name])
        elif isinstance(now, dict):
            before = before if isinstance(before, dict) else {}
            # Of options all are known; those that are by default may be left out.
            missing = dict.fromkeys(before) if name == "options" else {}
            _compare(before, missing | now, found, changed)
        elif before != now:
            changed.append(f"{name} {_said(before)}, now {_said(now)}")


def _said(value: Any) -> str:  # noqa: ANN401 - JSON data
    return "by default" if value is None else str(value)


def _told(path: Path) -> Mapping[str, Any] | None:
    """Return the provenance of a result, if it has one."""
    if path.suffix != ".npz":
        return read_provenance(path)
    for read in (read_kernel, read_registration):
        with contextlib.suppress(DeshakeError):
            return read(path).provenance
    return None
