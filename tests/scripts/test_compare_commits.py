"""Differences that the comparison of two commits reports."""

from __future__ import annotations

from dataclasses import replace

import compare_commits as compare

LINES = ("calibrate a.jpg", "fix a.jpg")
RUN = compare.Run([0, 1], ['{"focal": 1, "x": 2}', ""], ["", "error: a"], {"a.npz": b"1"})


def differences(new, *, messages=False):
    return list(compare.differences(LINES, RUN, new, messages=messages))


def test_equal_runs_do_not_differ():
    assert differences(replace(RUN), messages=True) == []


def test_each_difference_is_named():
    assert differences(replace(RUN, codes=[0, 2])) == ["fix a.jpg: exit code 1 -> 2: error: a"]
    [first, *rest] = differences(replace(RUN, figures=['{"focal": 1, "x": 3}', ""]))
    assert first == "calibrate a.jpg: other figures"
    assert rest[1:] == ['-"x": 2}', '+"x": 3}']
    assert differences(replace(RUN, files={"a.npz": b"2"})) == ["a.npz: other bytes"]
    assert differences(replace(RUN, files={"b.npz": b"1"})) == [
        "a.npz: is missing",
        "b.npz: is new",
    ]


def test_messages_count_only_if_asked():
    other = replace(RUN, messages=["", "error: b"])
    assert differences(other) == []
    assert differences(other, messages=True)


def test_times_and_the_order_of_photos_do_not_count():
    one = b'{"status": "done", "seconds": 0.31, "input": "a"}\n{"input": "b"}\n2 done; 0:00:01\n'
    two = b'{"input": "b"}\n{"status": "done", "seconds": 1.2, "input": "a"}\n2 done; 0:00:12\n'
    assert compare.in_order(one) == compare.in_order(two)


def test_inputs_are_the_same_each_time(tmp_path):
    folders = [tmp_path / "one", tmp_path / "two"]
    for folder in folders:
        folder.mkdir()
        compare.write_inputs(folder)
    names = [sorted(p.relative_to(f) for p in f.rglob("*") if p.is_file()) for f in folders]
    assert names[0] == names[1]
    assert all((folders[0] / n).read_bytes() == (folders[1] / n).read_bytes() for n in names[0])
