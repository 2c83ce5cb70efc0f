from __future__ import annotations

from pathlib import Path

import pytest

from deshake import errors


@pytest.mark.parametrize("name", errors.__all__)
def test_every_error_is_a_deshake_error(name: str) -> None:
    error = getattr(errors, name)("is torn", hint="glue it", file=Path("photo.jpg"))
    assert isinstance(error, errors.DeshakeError)
    assert (error.message, error.hint, error.file) == ("is torn", "glue it", "photo.jpg")
    assert str(error) == "photo.jpg: is torn"


def test_file_and_hint_may_be_left_out() -> None:
    error = errors.DeshakeError("is torn")
    assert str(error) == "is torn"
    assert error.hint is None
