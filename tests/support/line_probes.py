"""Measure which lines of deshake the tests run, by probes that go away once they are hit.

A plugin of pytest, for ``-p tests.support.line_probes``. Each process leaves a file for
``coverage combine``. A tracer would slow every line of Python, those of other packages too.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from coverage import CoverageData
from slipcover import FileMatcher, ImportManager, Slipcover

TOP = Path(__file__).parents[2]
PACKAGE = TOP / "deshake"

_probes = Slipcover()
ImportManager(_probes, FileMatcher(sources=[PACKAGE])).__enter__()


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish() -> None:
    """Write the lines that this process ran."""
    files = _probes.get_coverage()["files"]
    seen = {str(TOP / name): each["executed_lines"] for name, each in files.items()}
    data = CoverageData(str(TOP / ".coverage"), suffix=True)
    data.add_lines({str(path): seen.get(str(path), []) for path in PACKAGE.rglob("*.py")})
    data.write()
