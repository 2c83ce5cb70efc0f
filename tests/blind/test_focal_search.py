from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.blind.entry import Entry
from deshake.blind.focal_search import best_zoom
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.settings import SETTINGS
from deshake.geometry.camera import Camera

if TYPE_CHECKING:
    from deshake.signal.pyramid import Pyramid

SHAPE = 300, 400
PATH = np.array([[0.0, -10, -1], [4, -3, 0], [-1, 4, 1], [3, 12, 1]])
WIDE = 0.65 * np.hypot(*SHAPE)  # 28 mm on 35 mm film


@pytest.fixture(scope="module")
def wide(shake) -> tuple[Pyramid, Entry]:
    """A photo through a wide lens, and the true kernel."""
    photo = shake(Camera.from_focal(WIDE, *SHAPE), path=PATH)
    return photo.pyramid, Entry("true", 0, 0, photo.kernel)


def assumed(wide: tuple[Pyramid, Entry], ratio: float) -> tuple[Comparison, Entry]:
    """The photo and the kernel, with a focal length that is wrong by a factor."""
    pyramid, entry = wide
    return Comparison(pyramid.zoomed(ratio)), entry.zoomed(ratio)


@pytest.mark.parametrize("ratio", [1.0, 1.8, 3.6])
def test_a_wrong_focal_length_comes_near_to_the_true_one(wide, ratio) -> None:
    comparison, entry = assumed(wide, ratio)
    assert ratio * best_zoom(comparison, [entry]) == pytest.approx(1, rel=0.25)


def test_the_kernel_that_matches_best_decides(wide) -> None:
    comparison, entry = assumed(wide, 1.8)
    bent = replace(entry.kernel, theta=entry.kernel.theta * [1, -1, 1])
    wrong = entry._replace(name="bent", start=1, kernel=bent)
    ratio = best_zoom(comparison, [entry])
    assert best_zoom(comparison, [wrong, entry]) == best_zoom(comparison, [entry, wrong]) == ratio


@pytest.mark.parametrize("ratio", [0.5, 1.0, 30.0])
def test_the_search_stays_in_its_range(wide, ratio) -> None:
    comparison, entry = assumed(wide, ratio)
    focal = comparison.pyramid.camera.focal_px / np.hypot(*SHAPE)
    found = focal * best_zoom(comparison, [entry])
    settings = SETTINGS.focal_search
    assert min(settings.shortest, focal) <= found <= max(settings.longest, focal)
