from __future__ import annotations

import argparse
from dataclasses import replace

import cv2
import numpy as np
import pytest
from bench.errors import MissingDataError
from bench.tables.replayed import Result, kernel_of_pair, line, run
from skimage import data

from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.warps import Warps

CAMERA = Camera.from_focal(500.0, 160, 200)
STEPS = grid_steps(CAMERA)
INDICES = np.array([[0, n, 0] for n in range(-4, 5)])
TILT = RotationKernel.from_indices(INDICES, np.full(9, 1 / 9), STEPS, CAMERA)
PAN = replace(TILT, theta=TILT.theta[:, [1, 0, 2]])


def test_a_line_compares_the_blind_kernel_with_that_of_the_pair():
    good, bad = Result(TILT, TILT, 0.876, 12.3), Result(PAN, TILT, 0.9, 1)
    cells = line("1_8", good, [bad]).strip("| ").split(" | ")
    assert cells == ["1_8", "8 px", "1.00", "8 px", "1.00", "0.88", "12"]
    assert float(line("1_8", bad, []).split(" | ")[4]) < 0.8


def test_a_photo_that_is_left_has_no_confidence():
    still = Result(RotationKernel.delta(CAMERA), TILT, 0.1, 1)
    cells = [cell.strip() for cell in line("1_8", still, []).split("|")[1:-1]]
    assert cells[2:4] == ["", "left"]
    assert cells[5] == ""


def test_the_kernel_of_a_pair_is_that_of_the_shake(tmp_path):
    """The shake is wider than the pair looks for at first: a tenth of the frame."""
    camera = Camera.from_focal(900.0, 320, 400)
    path = np.array([[0.0, -25, 0], [6, -5, 0], [2, 10, 0], [-3, 27, 0]]) * grid_steps(camera)
    kernel = RotationKernel.from_path(path, camera).centred()
    sharp = cv2.resize(data.astronaut(), (640, 560), interpolation=cv2.INTER_AREA) / 255
    margin = 120
    light = (sharp**2.2).astype(np.float32)
    blurred = Warps(camera, kernel.theta, margin=margin).blur(light, kernel.weights)
    photos = []
    for name, pixels in {
        "blurred": blurred,
        "sharp": light[margin:-margin, margin:-margin],
    }.items():
        codes = np.rint(255 * np.clip(pixels, 0, 1) ** (1 / 2.2)).astype(np.uint8)
        cv2.imwrite(str(tmp_path / f"{name}.png"), codes[..., ::-1])
        photos.append(read_photo(tmp_path / f"{name}.png"))
    result = Result(kernel_of_pair(*photos), kernel, 1.0, 1)
    assert float(line("1_1", result, []).split(" | ")[4]) > 0.9


def test_missing_photos_are_named(tmp_path):
    with pytest.raises(MissingDataError, match="has no Blurry"):
        run(argparse.Namespace(data=tmp_path, jobs=1))
