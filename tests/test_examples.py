"""Examples run: those in the docstrings of the public names, and the session in docs/python.md."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import numpy as np
import pytest

import deshake

pytestmark = pytest.mark.long

WALK = Path(__file__).parent.parent / "docs" / "python.md"
RESULTS = {"Estimate", "KernelFile", "Registration", "Simulation"}
"""Types that a user receives and never makes: the examples of the functions show them."""

NAMES = [name for name in deshake.__all__ if name != "__version__"]


def examples(name: str) -> list[doctest.Example]:
    return doctest.DocTestParser().get_examples(getattr(deshake, name).__doc__)


@pytest.mark.parametrize("name", NAMES)
def test_the_examples_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    steps = examples(name)
    assert steps or name in RESULTS
    test = doctest.DocTest(steps, {}, name, None, None, None)
    report: list[str] = []
    outcome = doctest.DocTestRunner().run(test, out=report.append)
    assert outcome.failed == 0, "".join(report)
    assert outcome.attempted == len(steps)


@pytest.mark.parametrize("name", NAMES)
def test_the_docstring_names_its_parameters(name: str) -> None:
    text = getattr(deshake, name).__doc__
    assert "Parameters\n" in text
    assert name in RESULTS or "Examples\n" in text


def test_a_wrong_example_would_be_seen() -> None:
    steps = doctest.DocTestParser().get_examples(">>> 1 + 1\n3\n")
    test = doctest.DocTest(steps, {}, "wrong", None, None, None)
    assert doctest.DocTestRunner().run(test, out=lambda _: None).failed == 1


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What docs/python.md begins with: a shaken photo, its true kernel, and no photo."""
    monkeypatch.chdir(tmp_path)
    grey = np.random.default_rng(0).random((18, 22)).repeat(10, 0).repeat(10, 1)
    scene = 0.9 * grey[..., None] * (1, 0.9, 0.8)
    shaken = deshake.simulate(scene, deshake.Camera.from_focal(129.0, 180, 220), blur_px=6, seed=1)
    height, width = shaken.blurred.shape[:2]
    top, left = (height - 120) // 2, (width - 160) // 2
    deshake.write_photo("photo.jpg", shaken.blurred[top : top + 120, left : left + 160])
    deshake.write_kernel("photo.kernel.npz", shaken.kernel)
    (tmp_path / "notes.txt").write_text("no photo", "utf-8")
    return tmp_path


@pytest.mark.usefixtures("folder")
def test_the_session_in_the_document_runs(capsys: pytest.CaptureFixture[str]) -> None:
    text = WALK.read_text("utf-8")
    steps = doctest.DocTestParser().get_examples(text)
    flags = doctest.ELLIPSIS
    test = doctest.DocTest(steps, {}, WALK.name, None, None, None)
    report: list[str] = []
    outcome = doctest.DocTestRunner(optionflags=flags).run(test, out=report.append)
    assert outcome.failed == 0, "".join(report)
    assert outcome.attempted > 30
    for code in re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        exec(compile(code, WALK.name, "exec"), {"__name__": "example"})  # noqa: S102 - our own words
    printed = capsys.readouterr().out
    assert "notes.txt: " in printed
    assert "the array: has the type uint8" in printed


def test_the_session_shows_every_function() -> None:
    text = WALK.read_text("utf-8")
    for name in NAMES:
        assert name in RESULTS or re.search(rf"\b{name}\b", text), name
    for name in re.findall(r"\bdeshake\.(\w+)", text):
        assert name in {"errors", "__all__", *deshake.__all__}
