from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from deshake.restore.methods import BY_DEFAULT, Method, RestorationOptions, restore
from deshake.restore.richardson_lucy import richardson_lucy
from deshake.restore.sparse_gradients import sparse_gradients


@pytest.fixture(scope="module")
def photo(lab):
    return lab.noisy(lab.shaken(lab.kernels["uniform"], lab.scene()), 0.01)


@pytest.mark.parametrize("method", get_args(Method))
def test_every_method_deblurs(method, photo, lab):
    found = restore(photo, lab.kernels["uniform"], RestorationOptions(method), threads=2)
    sharp = lab.frame(lab.scene())
    assert found.pixels.shape == photo.shape
    assert lab.psnr(found.pixels, sharp) > lab.psnr(photo, sharp) + 1


def test_names_mean_what_they_say(photo, lab):
    kernel = lab.kernels["uniform"]
    two = RestorationOptions("rl", iterations=2)
    plain = richardson_lucy(photo, kernel, accelerated=False, iterations=2)
    np.testing.assert_array_equal(restore(photo, kernel, two).pixels, plain.pixels)
    fast = RestorationOptions(quality="fast")
    np.testing.assert_array_equal(
        restore(photo, kernel, fast).pixels,
        sparse_gradients(photo, kernel, quality="fast").pixels,
    )
    assert RestorationOptions() == BY_DEFAULT


@pytest.mark.parametrize(
    "choices",
    [
        {"method": "lucky"},
        {"quality": "best"},
        {"method": "rl", "quality": "high"},
        {"method": "wiener", "iterations": 3},
    ],
)
def test_what_does_not_go_together_is_refused(choices):
    with pytest.raises(ValueError, match=r"method|quality|iterations"):
        RestorationOptions(**choices)
