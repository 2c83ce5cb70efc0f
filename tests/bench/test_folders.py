from __future__ import annotations

import os

import pytest
from bench.tables.folders import QUICK, kills


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
def test_a_run_killed_time_and_again_makes_the_same_bytes(tmp_path, capsys):
    words = [*QUICK, "--region", "0,0,60,60"]  # estimates of a part take little time
    assert kills(tmp_path, photos=8, broken=2, times=3, words=words, spread=0)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "alone: exit 1, 6 results, 2 errors"
    assert [line.split(",")[0] for line in lines[3:6]] == [
        "SIGINT: exit 130",
        "SIGTERM: exit 143",
        "SIGKILL: exit -9",
    ]
    assert lines[3].endswith(" 0 parts")
    assert lines[4].endswith(" 0 parts")
    assert lines[-1].endswith("the same bytes: True")
