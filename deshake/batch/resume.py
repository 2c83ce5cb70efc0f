"""Compare the provenance of existing results with what this run would write."""

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
    """Return why an existing result is not what the work would make; None: it may be the same.

    A result without provenance raises no doubt.
    """
    written = None if job.output is None else _provenance(job.output)
    if written is None:
        return None
    differing = differences(written, work.origin(job))
    if not differing:
        return None
    return f"{job.output} exists already, but was made {' and '.join(differing)}"


def made_by(job: Job, work: Work) -> bool:
    """Return whether the provenance of an existing result is what the work would write."""
    written = None if job.output is None else _provenance(job.output)
    return written is not None and not differences(written, work.origin(job))


def differences(written: Mapping[str, Any], expected: Mapping[str, Any]) -> list[str]:
    """List the differences of a provenance from the expected one.

    Parameters
    ----------
    written, expected : mapping
        Provenance, as JSON data. The expected one may be only a part.

    """
    written, expected = json.loads(json.dumps([written, expected]))
    differing: list[str] = []
    changed: list[str] = []
    _compare(written, expected, differing, changed)
    if changed:
        differing.append(f"with other options ({', '.join(changed)})")
    return differing


def _compare(
    written: Mapping[str, Any],
    expected: Mapping[str, Any],
    differing: list[str],
    changed: list[str],
) -> None:
    """Collect the differences: inputs by their names, options with both values."""
    for name, now in expected.items():
        before = written.get(name)
        if name in _INPUTS:
            if before != now and _INPUTS[name] not in differing:
                differing.append(_INPUTS[name])
        elif isinstance(now, dict):
            before = before if isinstance(before, dict) else {}
            # The expected options are complete, but may omit defaults.
            missing = dict.fromkeys(before) if name == "options" else {}
            _compare(before, missing | now, differing, changed)
        elif before != now:
            changed.append(f"{name} {_as_text(before)}, now {_as_text(now)}")


def _as_text(value: Any) -> str:  # noqa: ANN401 - JSON data
    return "by default" if value is None else str(value)


def _provenance(path: Path) -> Mapping[str, Any] | None:
    """Return the provenance of a result, if it has one."""
    if path.suffix != ".npz":
        return read_provenance(path)
    for read in (read_kernel, read_registration):
        with contextlib.suppress(DeshakeError):
            return read(path).provenance
    return None
