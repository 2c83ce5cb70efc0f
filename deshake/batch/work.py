"""What is done with each photo: a stage as an object that can be sent to another process."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from deshake.batch.plan import Job
    from deshake.formats.picture_size import PictureSize
    from deshake.run import Run


__all__ = ["Work"]


class Work(Protocol):
    """What is done with one photo."""

    def __call__(self, job: Job, run: Run) -> dict[str, Any]:
        """Do it, write the outputs, and return its figures as JSON data.

        Raises
        ------
        DeshakeError
            If it cannot be done.

        """
        ...

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:
        """Predict the bytes that a process takes for it, itself included."""
        ...

    def check(self, job: Job) -> None:
        """Check what is checked before any work, without reading a photo: for a dry run.

        Raises
        ------
        DeshakeError
            If it cannot be done.

        """
        ...

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the origin in its result's provenance, as far as it is known before the work.

        Raises
        ------
        DeshakeError, OSError
            If it cannot be done anyway.

        """
        ...
