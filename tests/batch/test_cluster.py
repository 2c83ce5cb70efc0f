from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from PIL import Image

from deshake.batch import cluster
from deshake.batch.cluster import ClusterError, run_on_cluster
from deshake.batch.plan import Job
from deshake.batch.restoration_work import Deblur
from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel

pytestmark = [
    pytest.mark.skipif(find_spec("distributed") is None, reason="needs distributed"),
    pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals"),
    pytest.mark.long,
]

# A scheduler in a process of its own, and workers in theirs; prints its address and their numbers.
CLUSTER = """
import os, sys
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(
        n_workers=int(sys.argv[1]), threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        pids = cluster.get_client().run(os.getpid) if int(sys.argv[1]) else {}
        print(cluster.scheduler_address, *pids.values(), flush=True)
        sys.stdin.read()
"""


@pytest.fixture
def start(tmp_path_factory):
    """Start a cluster, and give its address and the numbers of its workers' processes."""
    script = tmp_path_factory.mktemp("cluster") / "cluster.py"
    script.write_text(CLUSTER)
    running = []

    def begin(workers):
        words = [sys.executable, script, str(workers)]
        process = subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=script.parent,
            env=os.environ | {"DASK_DISTRIBUTED__WORKER__MULTIPROCESSING_METHOD": "forkserver"},
        )
        running.append(process)
        address, *pids = process.stdout.readline().decode().split()
        return address, [int(pid) for pid in pids]

    yield begin
    for process in running:
        process.stdin.close()
        process.stdout.close()
        try:
            process.wait(15)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@pytest.fixture
def photos(tmp_path):
    """Make a folder of six photos and a bad one, and their kernel."""
    folder, rng = tmp_path / "in", np.random.default_rng(5)
    (folder / "sub").mkdir(parents=True)
    for number in range(6):
        codes = rng.integers(0, 256, (16, 20, 3), np.uint8)
        name = f"{'sub/' if number > 3 else ''}{number}.png"
        Image.fromarray(codes).resize((200, 160), Image.Resampling.BICUBIC).save(folder / name)
    (folder / "bad.png").touch()
    camera = Camera.from_focal(240, 160, 200)
    kernel = tmp_path / "kernel.npz"
    turn = RotationKernel.from_path([(-0.01, -0.01, 0), (0.01, 0.01, 0)], camera)
    write_kernel(kernel, KernelFile(turn))
    return folder, kernel


def test_a_killed_worker_loses_no_photo(start, photos, tmp_path, deshake):
    folder, kernel = photos
    address, pids = start(2)
    here, there = tmp_path / "here", tmp_path / "there"
    common = ("deblur", folder, "-r", "--kernel", kernel, "--method", "rl", "--iterations", 9)
    words = [*common, "-o", there, "--scheduler", address, "--json"]
    with subprocess.Popen(
        [sys.executable, "-m", "deshake", *map(str, words)], stdout=subprocess.PIPE
    ) as process:
        first = process.stdout.readline()  # the others are under way
        os.kill(pids[0], signal.SIGKILL)
        lines = [json.loads(line) for line in [first, *process.stdout.readlines()]]
        assert process.wait(120) == 1
    status = {line["input"]: line["status"] for line in lines}
    assert len(lines) == len(status) == 7
    assert status.pop(str(folder / "bad.png")) == "failed"
    assert set(status.values()) == {"done"}
    assert deshake(*common, "-o", here, "-j", 1, "--threads", 2).code == 1
    made = {path.relative_to(here): path.read_bytes() for path in here.rglob("*.png")}
    assert len(made) == 6
    assert {p.relative_to(there): p.read_bytes() for p in there.rglob("*.png")} == made
    assert not [path for path in there.rglob(".*") if path.suffix != ".part"]


def test_what_does_not_work_is_reported(start, photos, tmp_path, monkeypatch):
    folder, kernel = photos
    monkeypatch.setattr(cluster, "_TIMEOUT", 1.0)
    job = Job(folder / "0.png", tmp_path / "out.png", needs={"kernel": kernel})
    with pytest.raises(ClusterError, match="no scheduler answers"):
        next(run_on_cluster([job], Deblur(), "tcp://127.0.0.1:9"))
    with pytest.raises(ClusterError, match="no scheduler answers"):
        next(run_on_cluster([job], Deblur(), "nonsense://x"))
    address, _ = start(0)
    monkeypatch.setattr(cluster, "_TIMEOUT", 5.0)  # in which this scheduler answers
    with pytest.raises(ClusterError, match="has no workers"):
        next(run_on_cluster([job], Deblur(), address))
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match="needs dask") as caught:
        next(run_on_cluster([job], Deblur(), address))
    assert "deshake[cluster]" in caught.value.hint


class Machine:
    """Stands for a client of a cluster of one machine with another version or other files."""

    def __init__(self, version=cluster.__version__, seen=None):
        self.answer = version, seen

    def run(self, function, *words):
        if not words:
            return {"tcp://there:1": (self.answer[0], False)}
        return {"tcp://there:1": self.answer[1](function, *words)}


def test_other_versions_are_refused_and_threads_warned_of(caplog):
    for version, words in ((None, "has no deshake"), ("0.0.1", "has deshake 0.0.1, and this is")):
        with pytest.raises(ClusterError, match=words):
            cluster._check_versions(Machine(version))
    cluster._check_versions(Machine())
    assert "OMP_NUM_THREADS=1" in caplog.text


def test_other_folders_are_refused(photos, tmp_path):
    folder, kernel = photos
    job = Job(folder / "0.png", tmp_path / "out.png", needs={"kernel": kernel})

    def elsewhere(function, source, size, token):
        return function(source, size, tmp_path / "other" / token.name)

    def without_photo(function, source, size, token):
        return function(source.with_name("gone.png"), size, token)

    for seen, words in ((elsewhere, "other"), (without_photo, "gone.png")):
        with pytest.raises(ClusterError, match=f"the worker does not see .*{words} as it is here"):
            cluster._check_folders(Machine(seen=seen), [job])
    cluster._check_folders(Machine(seen=lambda function, *words: function(*words)), [job])
    assert sorted(tmp_path.iterdir()) == [folder, kernel]


def test_usage(photos, deshake):
    folder, _ = photos
    for more in (("-j", 2), ("--memory", "1G")):
        outcome = deshake("fix", folder, "--scheduler", "tcp://127.0.0.1:9", *more)
        assert (outcome.code, "cannot both be given" in outcome.err) == (2, True)
