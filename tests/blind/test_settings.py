"""The constants of the estimate by sharp edges stand in one frozen object, and nowhere else."""

from __future__ import annotations

import ast
import importlib
import re
from dataclasses import FrozenInstanceError, fields, is_dataclass
from pathlib import Path

import pytest

import deshake
from deshake.blind.settings import SETTINGS, EdgesSettings

PACKAGE = Path(deshake.__file__).parent
MODULES = {path.stem: path.read_text("utf-8") for path in (PACKAGE / "blind").glob("*.py")}
PARTS = [field.name for field in fields(EdgesSettings)]

# Numbers of a module that nobody tunes: names of things, guards against zero, neighbourhoods, and
# how much work is done at once, which changes no result.
STRUCTURE = {
    "agreement._PLACES",
    "blur_kind._HALF",
    "camera_path._ALONG",
    "camera_path._NEIGHBOURS",
    "course._OF_SPECTRA",
    "course._OF_WIDE",
    "latent_picture._NO_LIMIT",
    "evolution._SEED",
    "judge._SEED",
    "spectral_start._SEED",
    "streak_light.SIDE",
    "streaks.BLOCK",
    "streaks._AROUND",
    "tile_choice._TINY",
    "tiles._GROUP",
}


def all_parts(part):
    """Yield a part of the settings and the parts within it."""
    yield part
    for field in fields(part):
        inner = getattr(part, field.name)
        if is_dataclass(inner):
            yield from all_parts(inner)


def numbers(source: str) -> list[str]:
    """Return the names at the top of a module that get a number."""
    names = []
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            values = [at.value for at in ast.walk(node.value) if isinstance(at, ast.Constant)]
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if any(isinstance(value, int | float) for value in values):
                names += [at.id for t in targets for at in ast.walk(t) if isinstance(at, ast.Name)]
    return names


def test_nothing_in_the_settings_can_change() -> None:
    hash(SETTINGS)  # no list within
    parts = list(all_parts(SETTINGS))
    assert len(parts) > len(PARTS)
    for part in parts:
        for field in fields(part):
            with pytest.raises(FrozenInstanceError):
                setattr(part, field.name, None)


def test_no_module_has_a_tuned_constant_of_its_own() -> None:
    found = {f"{stem}.{name}" for stem, source in MODULES.items() for name in numbers(source)}
    assert found == STRUCTURE


@pytest.mark.parametrize(
    "source", ["_A = 0.3", "_A, _B = 1, 2", "_A: Final = -1.0", "A = Budget(1e5)", "A = (1, 2)"]
)
def test_a_constant_is_seen(source: str) -> None:
    assert numbers(source)


def test_each_module_reads_its_own_part() -> None:
    takers = {stem for stem, source in MODULES.items() if "_S: Final = SETTINGS." in source}
    assert takers == set(PARTS)
    for name in PARTS:
        module = importlib.import_module(f"deshake.blind.{name}")
        assert module._S is getattr(SETTINGS, name), name


def test_every_constant_is_used() -> None:
    everything = "".join(path.read_text("utf-8") for path in PACKAGE.rglob("*.py"))
    unused = [
        f"{part}.{field.name}"
        for part in PARTS
        for field in fields(getattr(SETTINGS, part))
        if not re.search(rf"\b_S\.{field.name}\b", MODULES[part])
        and not re.search(rf"\bSETTINGS\.{part}\.{field.name}\b", everything)
    ]
    assert unused == []


def test_every_constant_is_described() -> None:
    for part in all_parts(SETTINGS):
        text = (type(part).__doc__ or "").partition("Parameters\n")[2]
        heads = re.findall(r"^    (\w[\w, ]*?)(?: : .*)?$", text, re.MULTILINE)
        described = [name for head in heads for name in head.split(", ")]
        assert described == [field.name for field in fields(part)], type(part).__name__
