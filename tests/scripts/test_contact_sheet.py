from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image


def run(*args):
    script = Path(__file__).parents[2] / "scripts" / "contact_sheet.py"
    command = [sys.executable, script, *args]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_photo_that_fails_is_named_on_the_sheet(tmp_path):
    flat = tmp_path / "flat.png"
    Image.new("RGB", (64, 48), "grey").save(flat)
    output = tmp_path / "sheet.png"
    done = run(flat, "-o", output, "--width", "120")
    assert done.returncode == 1
    assert "flat.png" in done.stdout
    with Image.open(output) as sheet:
        colours = np.asarray(sheet.convert("RGB")).reshape(-1, 3)
    assert (colours[:, 0] > colours[:, 1:].max(1).astype(int) + 80).any()  # in red


def test_an_output_that_exists_is_not_replaced_by_a_photo_itself(tmp_path):
    flat = tmp_path / "flat.png"
    Image.new("RGB", (64, 48), "grey").save(flat)
    before = flat.read_bytes()
    done = run(flat, "-o", flat)
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")
    assert flat.read_bytes() == before
