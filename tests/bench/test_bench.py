"""The benchmark program: its tables, its help, and what it says where data are missing."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"
TABLES = sorted(
    path.stem.replace("_", "-")
    for path in (SCRIPTS / "bench" / "tables").glob("*.py")
    if path.stem != "__init__"
)


class Done(NamedTuple):
    """How the program ended, and what it printed."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def bench(capsys, monkeypatch):
    """Run the program in this process."""
    for library in ("OMP", "OPENBLAS", "MKL"):  # which it sets
        monkeypatch.setenv(f"{library}_NUM_THREADS", "1")
    main = runpy.run_path(str(SCRIPTS / "bench.py"))["main"]

    def run(*args):
        try:
            code = main([str(arg) for arg in args])
        except SystemExit as end:
            code = end.code
        return Done(code, *capsys.readouterr())

    return run


def test_the_help_lists_every_table_and_the_data_that_it_needs():
    command = [sys.executable, SCRIPTS / "bench.py", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    listed = [line for line in done.stdout.splitlines() if "(needs " in line]
    assert sorted(line.split()[0] for line in listed) == TABLES


@pytest.mark.parametrize("table", ["shakes", "pair-cost"])
def test_a_table_explains_itself(bench, table):
    done = bench(table, "--help")
    assert done.returncode == 0
    assert done.stdout.startswith(f"usage: bench.py {table} ")
    assert f"python scripts/bench.py {table}" in done.stdout


@pytest.mark.parametrize(
    ("args", "said"), [((), "TABLE"), (("tea",), "invalid choice: 'tea'"), (("fix", "-x"), "-x")]
)
def test_wrong_usage(bench, args, said):
    done = bench(*args)
    assert done.returncode == 2
    assert said in done.stderr


@pytest.mark.parametrize("table", ["pair", "restoration"])
def test_missing_recordings_are_reported_in_one_line(bench, table, tmp_path):
    done = bench(table, "--data", tmp_path)
    assert done.returncode == 1
    said = f"error: {tmp_path}: no orientation logs (*.txt); --data names their folder\n"
    assert (done.stdout, done.stderr) == ("", said)


def test_cases_that_cannot_be_rendered_are_left_out(bench, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    empty = tmp_path / "none"
    done = bench("shakes", "--cases", tmp_path, "--data", empty, "--only", "O12,S08,X01")
    assert done.returncode == 1
    lines = done.stderr.splitlines()
    assert len(lines) == 3
    assert any("--data names its folder (left out: O12)" in line for line in lines)
    assert all("--data names its folder" in line for line in lines)
