"""The work on one photo of many: a stage as an object that can be sent to another process."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from deshake.batch.plan import Job
    from deshake.formats.picture_size import PictureSize
    from deshake.run import Run


__all__ = ["Work"]


class Work(Protocol):
    """The work on one photo."""

    def __call__(self, job: Job, run: Run) -> dict[str, Any]:
        """Do the work on a job, write its outputs, and return its figures as JSON data.

        Raises
        ------
        DeshakeError
            If the work cannot be done.

        """
        ...

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:
        """Predict how many bytes the process takes, with the memory that it has before the work."""
        ...

    def check(self, job: Job) -> None:
        """Check the job before the work without reading the photo, for a dry run.

        Raises
        ------
        DeshakeError
            If the work cannot be done.

        """
        ...

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the origin that the result's provenance will have, as far as it is known now.

        Raises
        ------
        DeshakeError, OSError
            If the work cannot be done anyway.

        """
        ...
