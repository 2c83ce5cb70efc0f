from __future__ import annotations

import pytest

from deshake.stages.progress import part


def test_a_part_tells_its_share_of_the_whole():
    reports = []
    second = part(lambda share, text: reports.append((share, text)), 0.25, 0.75)
    second(0.0, "begun")
    second(0.5, "half")
    second(1.0, "done")
    assert [text for _, text in reports] == ["begun", "half", "done"]
    assert [share for share, _ in reports] == pytest.approx([0.25, 0.5, 0.75])


def test_nobody_need_listen():
    assert part(None, 0, 1) is None
