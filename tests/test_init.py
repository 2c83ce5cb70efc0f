from __future__ import annotations

import ast
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

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
    code = "import sys, deshake; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    loaded = set(run.stdout.split())
    assert {"deshake", "deshake.version"} <= loaded
    assert not {"numpy", "cv2", "scipy", "PIL", "rawpy", "piexif", "click"} & loaded
    assert {name for name in loaded if name.startswith("deshake.")} == {"deshake.version"}


def test_a_name_stays_what_it_is_when_every_room_is_imported() -> None:
    for module in pkgutil.walk_packages(deshake.__path__, "deshake."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    rooms = {path.name for path in Path(deshake.__file__).parent.iterdir()}
    assert not rooms & set(deshake.__all__)
    assert callable(deshake.simulate)


def test_type_checkers_and_the_interpreter_are_given_the_same_homes() -> None:
    tree = ast.parse(Path(deshake.__file__).read_text("utf-8"))
    typed = {
        alias.name: node.module
        for block in tree.body
        if isinstance(block, ast.If)
        for node in block.body
        for alias in node.names
    }
    assert typed == deshake._HOMES
    assert set(typed) | {"__version__"} == set(deshake.__all__)
