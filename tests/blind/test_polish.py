from __future__ import annotations

import numpy as np
import pytest
import scipy.ndimage

from deshake.blind.agreement import agreement
from deshake.blind.entry import Entry
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.polish import polished
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.run import Run

FINE = 0.1  # share of the kernel's spread: smoothing of a strict agreement


@pytest.fixture(scope="module")
def thick(shaken) -> Entry:
    """The true kernel, widened by more than a grid step."""
    kernel = shaken.kernel.resampled(shaken.kernel.steps, ALL_AXES)
    low = kernel.indices.min(0) - 3
    box = np.zeros(np.ptp(kernel.indices, axis=0) + 7)
    box[tuple((kernel.indices - low).T)] = kernel.weights
    box = scipy.ndimage.gaussian_filter(box, 1.2)
    used = np.argwhere(box > 1e-4)
    wide = RotationKernel.from_indices(used + low, box[tuple(used.T)], kernel.steps, shaken.camera)
    return Entry("thick", 2, 0, wide.centred())


def test_a_kernel_that_is_too_wide_comes_nearer_to_the_truth(thick, pyramid, shaken) -> None:
    shares: list[float] = []
    run = Run(1, lambda share, _: shares.append(share))
    (best,) = polished(Comparison(pyramid), [thick], [thick], ALL_AXES, run)
    before, after = Comparison(pyramid).scores([thick, best])
    assert after > before + 0.01
    truth = shaken.kernel
    near = agreement(best.kernel, truth, smoothing=FINE)
    assert near > agreement(thick.kernel, truth, smoothing=FINE) + 0.02
    assert best.name == "thick, polished"
    assert shares == sorted(shares)
    assert shares[-1] <= 1


def test_the_best_kernel_of_each_of_two_starts(thick, pyramid) -> None:
    point = thick._replace(name="point", start=4, kernel=RotationKernel.delta(thick.kernel.camera))
    third = point._replace(name="third", start=6)
    ranked = [point, point._replace(name="second"), thick, third]
    lines = polished(Comparison(pyramid), ranked, [thick, point, third], (True, True, False), Run())
    assert [entry.start for entry in lines] == [4, 2]
    assert lines[0] is point  # a point is not refined
    assert lines[1].name == "thick, polished"
