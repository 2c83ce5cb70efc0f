"""The work of ``inspect`` on one file, as `Work`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from deshake.batch.footprint import photo_memory
from deshake.errors import PhotoError
from deshake.files.disk import check_input
from deshake.stages.inspecting import inspect_file

if TYPE_CHECKING:
    from deshake.batch.plan import Job
    from deshake.formats.picture_size import PictureSize
    from deshake.run import Run

__all__ = ["Inspect"]


@dataclass(frozen=True)
class Inspect:
    """``inspect``: report what a file is."""

    def __call__(self, job: Job, run: Run) -> dict[str, Any]:  # noqa: ARG002
        """Inspect the file of a job."""
        return inspect_file(job.source)

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:  # noqa: ARG002
        """Predict the memory of the work, in bytes."""
        return photo_memory(size)

    def check(self, job: Job) -> None:
        """Check that the file is there."""
        check_input(job.source, PhotoError)

    def origin(self, job: Job) -> dict[str, Any]:  # noqa: ARG002
        """Return nothing: there is no result."""
        return {}
