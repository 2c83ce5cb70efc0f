"""The examples in the docstrings of the public names run."""

from __future__ import annotations

import doctest
from typing import TYPE_CHECKING

import pytest

import deshake

if TYPE_CHECKING:
    from pathlib import Path

RESULTS = {"Estimate", "KernelFile", "Registration", "Simulation"}
"""Types that a user receives and never makes: the examples of the functions show them."""

NAMES = [name for name in deshake.__all__ if name != "__version__"]


def examples(name: str) -> list[doctest.Example]:
    return doctest.DocTestParser().get_examples(getattr(deshake, name).__doc__)


@pytest.mark.parametrize("name", NAMES)
def test_the_examples_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = examples(name)
    assert found or name in RESULTS
    test = doctest.DocTest(found, {}, name, None, None, None)
    said: list[str] = []
    outcome = doctest.DocTestRunner().run(test, out=said.append)
    assert outcome.failed == 0, "".join(said)
    assert outcome.attempted == len(found)


@pytest.mark.parametrize("name", NAMES)
def test_the_docstring_names_its_parameters(name: str) -> None:
    text = getattr(deshake, name).__doc__
    assert "Parameters\n" in text
    assert name in RESULTS or "Examples\n" in text


def test_a_wrong_example_would_be_seen() -> None:
    found = doctest.DocTestParser().get_examples(">>> 1 + 1\n3\n")
    test = doctest.DocTest(found, {}, "wrong", None, None, None)
    assert doctest.DocTestRunner().run(test, out=lambda _: None).failed == 1
