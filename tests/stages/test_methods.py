from __future__ import annotations

import inspect
import subprocess
import sys

import numpy as np
import pytest

from deshake.restore.richardson_lucy import richardson_lucy
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run
from deshake.stages.methods import METHODS, RestorationOptions, restore


@pytest.fixture(scope="module")
def photo(lab):
    return lab.noisy(lab.shaken(lab.kernels["uniform"], lab.scene()), 0.01)


@pytest.mark.parametrize("method", [m.name for m in METHODS.values() if not m.needs_noisy])
def test_every_method_deblurs(method, photo, lab):
    restored = restore(photo, lab.kernels["uniform"], RestorationOptions(method), run=Run(1))
    sharp = lab.frame(lab.scene())
    assert restored.pixels.shape == photo.shape
    assert lab.psnr(restored.pixels, sharp) > lab.psnr(photo, sharp) + 1


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
    np.testing.assert_array_equal(
        restore(photo, kernel).pixels, restore(photo, kernel, RestorationOptions()).pixels
    )


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


@pytest.mark.parametrize("method", METHODS.values(), ids=lambda method: method.name)
def test_the_catalogue_says_what_the_functions_take(method):
    takes = inspect.signature(method.load()).parameters
    assert {*method.options, *method.inputs} <= set(takes)
    options = RestorationOptions(method.name)
    assert set(options.arguments()) == set(method.options)
    assert options.needs_noisy == ("noisy" in takes)


def test_reading_the_catalogue_is_quick():
    code = "import sys, deshake.stages.methods; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_method_for_pairs_needs_a_noisy_photo(photo, lab):
    with pytest.raises(ValueError, match="needs a noisy photo"):
        restore(photo, lab.kernels["uniform"], RestorationOptions("fusion"))
