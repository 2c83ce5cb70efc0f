"""The house's one rule: imports run downward only, also those inside functions."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import deshake

PACKAGE = Path(deshake.__file__).parent
MODULES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py"))

PIPELINES = {"estimation", "blind", "deconvolution", "signal", "operators", "geometry", "io"}
# What each room may import, itself and the package's own name and errors aside.
ALLOWED = {
    "geometry": set(),
    "operators": {"geometry"},
    "signal": {"operators", "geometry"},
    "blind": {"signal", "operators", "geometry"},
    "estimation": {"blind", "signal", "operators", "geometry"},
    "deconvolution": {"signal", "operators", "geometry"},
    "io": {"geometry"},
    "pipelines": PIPELINES,
    "batch": {"pipelines", *PIPELINES},
    "cli": {"batch", "pipelines", *PIPELINES},
}
ANYWHERE = {"errors", ""}


def imported_rooms(source: str, home: tuple[str, ...]) -> set[str]:
    """Rooms of deshake that a module imports; `home` is the package the module lies in."""
    names = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                base = [*home[: len(home) - node.level + 1], *filter(None, [node.module])]
            else:
                base = [node.module]
            # Of "from deshake import x" the x may be a room.
            names += [".".join([*base, alias.name]) for alias in node.names]
    parts = [name.split(".") for name in names]
    rooms = {part[1] if len(part) > 1 else "" for part in parts if part[0] == "deshake"}
    files = {path.stem for path in PACKAGE.iterdir() if path.suffix == ".py" or path.is_dir()}
    return {room if room in files else "" for room in rooms}


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_imports_run_downward(module: Path) -> None:
    room = module.parts[0] if len(module.parts) > 1 else ""
    if not room and module.stem in {"__init__", "__main__"}:
        return  # the front door names what lies in every room
    home = ("deshake", *module.parts[:-1])
    rooms = imported_rooms((PACKAGE / module).read_text("utf-8"), home)
    allowed = ANYWHERE | ({room} | ALLOWED[room] if room else set())
    assert rooms <= allowed, f"{module} imports {sorted(rooms - allowed)}"


def test_every_room_has_its_rule() -> None:
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    assert rooms <= set(ALLOWED)


@pytest.mark.parametrize(
    "source",
    [
        "import deshake.cli.main",
        "from deshake.cli import main",
        "from deshake import cli",
        "from ..cli.main import main",
        "from .. import cli",
        "def f():\n    from deshake.cli.main import main",
    ],
)
def test_an_import_upward_is_seen(source: str) -> None:
    assert imported_rooms(source, ("deshake", "geometry")) == {"cli"}


@pytest.mark.parametrize("source", ["import numpy", "from deshake import __version__"])
def test_other_imports_are_no_rooms(source: str) -> None:
    assert imported_rooms(source, ("deshake", "geometry")) <= {""}


def test_tests_mirror_the_package() -> None:
    tests = Path(__file__).parent
    missing = [
        str(module)
        for module in MODULES
        if not module.stem.startswith("__")
        and not (tests / module.parent / f"test_{module.name}").exists()
    ]
    assert not missing, f"modules without a test file of their name: {missing}"
