"""The rules of the house: imports run downward only, and never in a circle."""

from __future__ import annotations

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import deshake

PACKAGE = Path(deshake.__file__).parent
MODULES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py"))
TESTS = Path(__file__).parent

# The rooms that each room may import, beside itself and the modules that all may import.
SIDE = {"formats", "metadata", "files", "geometry"}
ESTIMATORS = {"signal", "operators", "geometry"}
PAIR = {"lens", "blind", "restore", *ESTIMATORS, *SIDE}
STAGES = {"pair", "pictures", *PAIR}
ALLOWED = {
    "geometry": set(),
    "files": {"geometry"},
    "metadata": {"files", "geometry"},
    "formats": {"metadata", "files", "geometry"},
    "operators": {"geometry"},
    "signal": {"operators", "geometry"},
    "blind": ESTIMATORS,
    "restore": ESTIMATORS,
    "lens": {*ESTIMATORS, *SIDE},
    "pictures": {"blind", "lens", *ESTIMATORS, *SIDE},
    "pair": PAIR,
    "stages": STAGES,
    "simulation": {"stages", *STAGES},
    "batch": {"stages", *STAGES},
    "api": {"simulation", "stages", *STAGES},
    "cli": {"batch", "simulation", "stages", *STAGES},
}
ANYWHERE = {"errors", "run", "version", ""}


@cache
def imported(source: str, home: tuple[str, ...]) -> set[str]:
    """Dotted names that a module imports, also within functions; `home` is its package."""
    names = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                base = [*home[: len(home) - node.level + 1], *filter(None, [node.module])]
            else:
                base = [node.module]
            # Of "from deshake import x" the x may be a room or a module.
            names += [".".join([*base, alias.name]) for alias in node.names]
    return {name for name in names if name.split(".")[0] == "deshake"}


def imported_rooms(source: str, home: tuple[str, ...]) -> set[str]:
    """Rooms of deshake that a module imports."""
    parts = [name.split(".") for name in imported(source, home)]
    rooms = {part[1] if len(part) > 1 else "" for part in parts}
    files = {path.stem for path in PACKAGE.iterdir() if path.suffix == ".py" or path.is_dir()}
    return {room if room in files else "" for room in rooms}


def home_of(module: Path) -> tuple[str, ...]:
    return ("deshake", *module.parts[:-1])


def module_graph(sources: dict[str, tuple[str, tuple[str, ...]]]) -> dict[str, set[str]]:
    """Modules that each module imports; `sources` has a module's text and package by its name."""
    graph = {}
    for name, (source, home) in sources.items():
        full = imported(source, home)
        graph[name] = {
            known
            for target in full
            for known in (target, target.rpartition(".")[0])
            if known in sources and known != name
        }
        # A name of a package's own module is not an import of the package itself.
        graph[name] -= {target.rpartition(".")[0] for target in full if target in sources}
    return graph


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Return the modules of one circle of imports; empty: there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


@pytest.fixture(scope="module")
def graph() -> dict[str, set[str]]:
    return module_graph(
        {
            ".".join(("deshake", *module.with_suffix("").parts)).removesuffix(".__init__"): (
                (PACKAGE / module).read_text("utf-8"),
                home_of(module),
            )
            for module in MODULES
        }
    )


def test_imports_run_downward() -> None:
    upward = {}
    for module in MODULES:
        room = module.parts[0] if len(module.parts) > 1 else ""
        if not room and module.stem in {"__init__", "__main__"}:
            continue  # the front door names what lies in every room
        rooms = imported_rooms((PACKAGE / module).read_text("utf-8"), home_of(module))
        allowed = ANYWHERE | ({room} | ALLOWED[room] if room else set())
        upward[str(module)] = sorted(rooms - allowed)
    assert len(upward) > 200
    assert {name: rooms for name, rooms in upward.items() if rooms} == {}


def test_rules_run_downward() -> None:
    assert circle(ALLOWED) == []


def test_the_floors_are_those_of_the_drawing() -> None:
    """The rooms by what they import in fact; `pytest -s` draws the floors."""
    rooms: dict[str, set[str]] = {room: set() for room in ALLOWED}
    for module in MODULES:
        if (room := module.parts[0]) in rooms:
            source = (PACKAGE / module).read_text("utf-8")
            rooms[room] |= imported_rooms(source, home_of(module)) & set(rooms) - {room}
    order = TopologicalSorter(rooms)
    order.prepare()
    floors: list[tuple[str, ...]] = []
    while ready := order.get_ready():
        floors.append(ready)
        order.done(*ready)
    for floor in reversed(floors):
        lines = [f"{room} -> {' '.join(sorted(rooms[room]))}" for room in sorted(floor)]
        print(*lines, "-" * 40, sep="\n")  # noqa: T201 - the drawing
    assert set(floors[0]) == {"geometry", "metadata"}
    assert set(floors[-1]) == {"api", "cli"}
    design = (TESTS.parent / "DESIGN.md").read_text("utf-8")
    [first] = re.findall(r"^    (cli -> .*)$", design, re.MULTILINE)
    drawn = [re.findall(r"[a-z]+", floor) for floor in first.split("->")]
    assert len(drawn) == 6
    for number, floor in enumerate(drawn):
        above = {room for higher in drawn[:number] for room in higher}
        for room in floor:
            assert not rooms[room] & above, room


def test_every_room_has_its_rule() -> None:
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    assert rooms == set(ALLOWED)


def test_imports_form_no_circle(graph: dict[str, set[str]]) -> None:
    graph = {name: targets for name, targets in graph.items() if name != "deshake"}
    assert circle(graph) == []
    assert sum(map(len, graph.values())) > len(graph)


def test_rooms_do_not_import_the_package_itself(graph: dict[str, set[str]]) -> None:
    # The cluster asks its workers which deshake they have.
    above = [name for name, targets in graph.items() if "deshake" in targets]
    assert above == ["deshake.batch.cluster"]


def test_a_circle_is_seen_also_within_functions_and_for_types() -> None:
    one = "if TYPE_CHECKING:\n    from deshake.a.two import f"
    two = "def f():\n    from deshake.a import one"
    home = ("deshake", "a")
    sources = {"deshake.a": ("", home), "deshake.a.one": (one, home), "deshake.a.two": (two, home)}
    assert set(circle(module_graph(sources))) == {"deshake.a.one", "deshake.a.two"}
    sources["deshake.a.two"] = ("import numpy", home)
    assert circle(module_graph(sources)) == []


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


def test_no_name_stands_in_two_rooms() -> None:
    rooms: dict[str, set[str]] = {}
    for module in MODULES:
        if not module.stem.startswith("__"):
            rooms.setdefault(module.stem, set()).add(module.parts[0])
    assert {stem: homes for stem, homes in rooms.items() if len(homes) > 1} == {}


def test_every_room_has_tests() -> None:
    without = [room for room in ALLOWED if not any((TESTS / room).rglob("test_*.py"))]
    assert not without
    # A room that is gone leaves no tests behind; the programs beside the package have theirs.
    folders = {path.parts[len(TESTS.parts)] for path in TESTS.rglob("test_*.py")}
    rooms = {name for name in folders if not name.endswith(".py")}
    assert rooms - {"bench", "scripts"} == set(ALLOWED)
