from __future__ import annotations

import subprocess
import sys

import pytest

import deshake


@pytest.mark.parametrize("name", deshake.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(deshake, name) is not None
    assert name in dir(deshake)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="unsharpen"):
        _ = deshake.unsharpen


def test_importing_costs_nothing() -> None:
    code = "import sys, deshake; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
