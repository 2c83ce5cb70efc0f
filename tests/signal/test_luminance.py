from __future__ import annotations

import numpy as np
import pytest

from deshake.signal.luminance import luminance


def test_luminance_weighs_the_colours():
    colours = np.eye(3, dtype=np.float32)[None]
    assert luminance(colours)[0] == pytest.approx([0.2126, 0.7152, 0.0722])
    assert luminance(np.ones((2, 2, 3), np.float32)) == pytest.approx(np.ones((2, 2)))
    grey = np.ones((4, 5), np.float32)
    assert luminance(grey) is grey
