"""The Makefile of the documents, run as it is."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

MAKEFILE = Path(__file__).parent.parent / "docs" / "Makefile.example"
FAST = "--focal-35mm 40 --blur-size 3 --uniform --estimator edges --region 20,10,60,50"

pytestmark = [
    pytest.mark.skipif(shutil.which("make") is None, reason="needs make"),
    pytest.mark.long,
]


@pytest.fixture
def make(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    for name in ("a.jpg", "b.png", "b.deshaken.png"):
        save(folder / name)

    def run(*words, estimate=FAST, deblur=""):
        variables = {
            "IN": "in",
            "DESHAKE": f"{sys.executable} -m deshake --threads 1 -q",
            "ESTIMATE": estimate,
            "DEBLUR": deblur,
        }
        done = subprocess.run(
            ["make", "-f", MAKEFILE, *words, *(f"{k}={v}" for k, v in variables.items())],
            cwd=tmp_path,
            env={k: v for k, v in os.environ.items() if not k.startswith("MAKE")},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        runs = [
            line.split(" -q ")[1].split() for line in done.stdout.splitlines() if " -q " in line
        ]
        return sorted((words[0], Path(words[1]).name) for words in runs)

    return run


def save(path, seed=5):
    """Save a photo: a JPEG is sharp, so that its estimate ends at once, and another is not."""
    codes = np.random.default_rng(seed).integers(0, 256, (8, 10, 3), np.uint8)
    how = Image.Resampling.NEAREST if path.suffix == ".jpg" else Image.Resampling.BICUBIC
    Image.fromarray(codes).resize((100, 80), how).save(path, quality=92)


def test_only_what_has_to_be_done_is_done(make, tmp_path, deshake):
    both = [(stage, name) for stage in ("deblur", "estimate-blind") for name in ("a.jpg", "b.png")]
    assert make("-j2") == both
    results = [tmp_path / "sharp" / name for name in ("a.deshaken.jpg", "b.deshaken.png")]
    assert sorted((tmp_path / "sharp").glob("*.*")) == [tmp_path / "sharp" / ".options", *results]
    before = [path.read_bytes() for path in results]
    fixed = tmp_path / "fixed"
    assert deshake("fix", tmp_path / "in", "-o", fixed, *FAST.split(), "-q").code == 0
    assert [(fixed / path.name).read_bytes() for path in results] == before

    assert make("-j2") == []

    save(tmp_path / "in" / "a.jpg", seed=6)
    assert make("-j2") == [("deblur", "a.jpg"), ("estimate-blind", "a.jpg")]
    after = [path.read_bytes() for path in results]
    assert after[0] != before[0]
    assert after[1] == before[1]

    results[1].unlink()
    assert make("-j2") == [("deblur", "b.png")]
    assert results[1].read_bytes() == before[1]
    assert make("-j2", deblur="--quality fast") == [("deblur", "a.jpg"), ("deblur", "b.png")]
