from __future__ import annotations

import numpy as np
import pytest
from bench.tables.lens import LENSES, bends, camera_of, psnrs


def test_lines_are_straight_where_the_lens_is_undone():
    pytest.importorskip("lensfunpy")
    before, after = bends(camera_of(LENSES[1], 200, 300))
    assert before > 3
    assert after < 0.1


def test_corners_are_scored_apart():
    sharp = np.full((200, 300, 3), 0.5, np.float32)
    wrong = sharp.copy()
    wrong[:30, :30] = 0.6
    whole, corners = psnrs(wrong, sharp)
    assert corners < whole - 5
