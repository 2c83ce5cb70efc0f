from __future__ import annotations

from pathlib import Path

import pytest

from deshake import errors


@pytest.mark.parametrize("name", [name for name in errors.__all__ if name.endswith("Error")])
def test_every_error_is_a_deshake_error(name: str) -> None:
    error = getattr(errors, name)("is torn", hint="glue it", file=Path("photo.jpg"))
    assert isinstance(error, errors.DeshakeError)
    assert (error.message, error.hint, error.file) == ("is torn", "glue it", "photo.jpg")
    assert str(error) == "photo.jpg: is torn"


def test_file_and_hint_may_be_left_out() -> None:
    error = errors.DeshakeError("is torn")
    assert str(error) == "is torn"
    assert error.hint is None


def test_whatever_is_wrong_is_reported_in_a_line():
    message, hint = errors.describe(errors.PhotoError("is torn", hint="glue it", file="a.jpg"))
    assert (message, hint) == ("a.jpg: is torn", "glue it")
    assert errors.describe(FileNotFoundError(2, "No such file", "x"))[0] == "x: No such file"
    assert "memory" in errors.describe(MemoryError())[0]
    assert "bug" in errors.describe(KeyError("x"))[1]


@pytest.mark.parametrize(
    "text",
    [
        "libavcodec.so.62: failed to map segment from shared object",
        "libgomp.so.1: cannot allocate memory in static TLS block",
        "x.so: cannot create shared object descriptor: Cannot allocate memory",
    ],
)
def test_too_little_memory_for_the_libraries_is_no_bug(text):
    message, hint = errors.describe(ImportError(text))
    assert message == "not enough memory to load the libraries that deshake needs"
    assert "ulimit" in hint
    wrapped = ImportError("numpy: please read this")
    wrapped.__cause__ = ImportError(text)
    assert errors.describe(wrapped) == (message, hint)


def test_a_library_that_is_broken_otherwise_stays_a_bug():
    assert "bug" in errors.describe(ImportError("x.so: undefined symbol: y"))[1]
