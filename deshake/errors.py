"""The errors that deshake raises on purpose.

Every one of them carries a one-line message and, where something can be done about it, a hint.
The command line prints them as ``error: FILE: what`` and ``hint: what to try``. Any other exception
that reaches the command line is a bug.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from os import PathLike

__all__ = [
    "CalibrationError",
    "DeshakeError",
    "EstimationError",
    "KernelFileError",
    "OutputError",
    "PhotoError",
    "describe",
]


_LOADER_WORDS = ("failed to map segment", "cannot allocate memory")
"""Texts of the system's loader if there is too little memory for a library."""


class DeshakeError(Exception):
    """Something that the user can understand and perhaps mend.

    Parameters
    ----------
    message : str
        What is wrong, in one line.
    hint : str, optional
        What to try, in one line.
    file : path, optional
        The file that the message is about.

    Examples
    --------
    >>> import deshake
    >>> try:
    ...     deshake.read_photo("nothing.jpg")
    ... except deshake.DeshakeError as error:
    ...     print(error)
    nothing.jpg: no such file

    """

    def __init__(
        self, message: str, *, hint: str | None = None, file: str | PathLike[str] | None = None
    ) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.file = None if file is None else str(file)

    def __str__(self) -> str:
        return self.message if self.file is None else f"{self.file}: {self.message}"


class PhotoError(DeshakeError):
    """A photo cannot be read, or cannot be used for what was asked."""


class OutputError(DeshakeError):
    """An output cannot be written."""


class KernelFileError(DeshakeError):
    """A camera, kernel or registration file is damaged, or of another kind."""


class CalibrationError(DeshakeError):
    """The focal length in pixels is unknown."""


class EstimationError(DeshakeError):
    """No blur kernel can be estimated from this photo."""


def describe(error: Exception) -> tuple[str, str | None]:
    """Return what went wrong, and what to try, whatever the error is."""
    match error:
        case DeshakeError():
            return str(error), error.hint
        case MemoryError():
            return "not enough memory", "try a smaller photo, or close other programs"
        case ImportError() if _lacks_memory(error):
            return (
                "not enough memory to load the libraries that deshake needs",
                "close other programs, or raise the limit (ulimit -v)",
            )
        case OSError(strerror=str(reason)):
            return (reason if error.filename is None else f"{error.filename}: {reason}"), None
        case _:
            return (
                f"{type(error).__name__}: {error}",
                "this is a bug in deshake: report it with what -vv prints",
            )


def _lacks_memory(error: BaseException) -> bool:
    """Return whether the system's loader had too little memory for a library."""
    text = str(error).lower()
    if any(words in text for words in _LOADER_WORDS):
        return True
    before = error.__cause__ or error.__context__
    return isinstance(before, ImportError | OSError) and _lacks_memory(before)
