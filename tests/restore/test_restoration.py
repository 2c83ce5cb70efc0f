from __future__ import annotations

import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.restore.restoration import check_photo

KERNEL = RotationKernel.delta(Camera.from_focal(50, 20, 30))


@pytest.mark.parametrize("shape", [(20, 30), (20, 30, 3)])
def test_takes_what_fits(shape):
    check_photo(np.zeros(shape, np.float32), KERNEL, np.zeros((20, 30), bool), 1)
    check_photo(np.zeros(shape, np.float32), KERNEL, None, None)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_refuses_what_is_not_finite(value):
    g = np.zeros((20, 30), np.float32)
    g[3, 4] = value
    with pytest.raises(ValueError, match="finite"):
        check_photo(g, KERNEL, None, None)


def test_refuses_what_does_not_fit():
    g = np.zeros((20, 30), np.float32)
    for photo, clipped, iterations, what in (
        (g.T, None, None, "does not fit a kernel"),
        (g[..., None, None], None, None, "does not fit a kernel"),
        (g, np.zeros((30, 20), bool), None, "clipped pixels"),
        (g, None, 0, "at least one"),
    ):
        with pytest.raises(ValueError, match=what):
            check_photo(photo, KERNEL, clipped, iterations)
