from __future__ import annotations

import psutil
import pytest

from deshake.batch import memory
from deshake.batch.memory import Budget, available_memory, gigabytes
from deshake.batch.plan import Job
from deshake.errors import PhotoError

GB = 10**9


@pytest.fixture
def groups(tmp_path, monkeypatch):
    """Put this process into control groups of our own making."""
    monkeypatch.setattr(memory, "_CGROUPS", tmp_path / "cgroup")
    monkeypatch.setattr(memory, "_OWN_CGROUP", tmp_path / "self")

    def write(own, **files):
        (tmp_path / "self").write_text(own)
        for name, text in files.items():
            path = tmp_path / "cgroup" / name.replace("__", "/").replace("_", ".", 1)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)

    return write


def test_the_system_gives_the_memory_where_nothing_else_does(groups):
    groups("0::/\n")
    assert 0.5 < available_memory() / psutil.virtual_memory().available < 2


def test_the_least_that_is_left_to_a_control_group_counts(groups):
    groups(
        "0::/a/b\n",
        a__b__memory_max="max\n",
        a__b__memory_current="5\n",
        a__b__memory_stat="anon 5\n",
        a__memory_max="100000000\n",
        a__memory_current="60000000\n",
        a__memory_stat="anon 40000000\ninactive_file 15000000\n",
    )
    assert available_memory() == 55_000_000


def test_control_groups_of_the_first_version(groups):
    groups(
        "4:cpu,memory:/a\n0::/\n",
        memory__a__memory_limit_in_bytes="1000000",
        memory__a__memory_usage_in_bytes="1500000",
        memory__a__memory_stat="cache 3",
    )
    assert available_memory() == 0


def test_a_budget_admits_what_fits_and_always_a_first():
    budget = Budget(10)
    assert budget.admits(20, [])
    assert budget.admits(4, [3, 3])
    assert not budget.admits(5, [3, 3])
    assert Budget.of(7) == Budget(7, given=True)
    assert not Budget.of(None).given
    assert 0 < Budget.of(None).limit < psutil.virtual_memory().total


def test_a_photo_that_needs_more_than_was_given_is_refused(tmp_path):
    job = Job(tmp_path / "a.jpg", tmp_path / "b.jpg")
    Budget(3 * GB).check(4 * GB, job)
    Budget(3 * GB, given=True).check(2 * GB, job)
    with pytest.raises(PhotoError, match=r"needs about 4 GB of memory, more than --memory 3 GB"):
        Budget(3 * GB, given=True).check(4 * GB, job)


def test_sizes_in_words():
    assert [gigabytes(n) for n in (2.91e9, 510e6, 24e9)] == ["2.9 GB", "510 MB", "24 GB"]
