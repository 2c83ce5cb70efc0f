from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image


@pytest.fixture(scope="module")
def contact_sheet():
    path = Path(__file__).parents[2] / "scripts" / "contact_sheet.py"
    spec = importlib.util.spec_from_file_location("contact_sheet", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_pictures_get_the_width_asked_for(contact_sheet):
    picture = np.zeros((60, 90, 3), np.uint8)
    assert contact_sheet.resized(picture, 30).shape == (20, 30, 3)


def test_the_part_shown_is_the_one_with_detail(contact_sheet):
    picture = np.full((120, 160, 3), 90, np.uint8)
    picture[70:110, 100:150] = np.random.default_rng(1).integers(0, 256, (40, 50, 3))
    rows, columns = contact_sheet.detailed_part(picture, 50, 40)
    assert rows.stop - rows.start == 40
    assert columns.stop - columns.start == 50
    assert abs(rows.start - 70) <= 8
    assert abs(columns.start - 100) <= 8


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
