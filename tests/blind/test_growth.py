from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.blind import growth
from deshake.blind.agreement import agreement
from deshake.blind.entry import Entry
from deshake.blind.growth import grown, on_frame
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.settings import SETTINGS
from deshake.blind.wide_start import levels_on_frame, refined_on_frame
from deshake.geometry.camera import Camera

if TYPE_CHECKING:
    from deshake.blind.candidate import Axes
    from deshake.blind.settings import Refinement
    from deshake.run import Run
    from deshake.signal.pyramid import Pyramid

FLAT = True, True, False
PATH = np.array([[-24.0, -34, 0], [-12, -20, 0], [2, -14, 0], [10, 8, 0], [-2, 24, 0], [14, 36, 0]])


@pytest.fixture(scope="module")
def wide(shake):
    """A photo of 360 x 420 pixels, shaken by a fifth of its shorter side, without roll."""
    return shake(Camera.from_focal(3300.0, 360, 420), path=PATH)


@pytest.fixture(scope="module")
def part(wide) -> Entry:
    """The first 60 percent of the kernel, and where the camera was then."""
    order = np.argsort(wide.kernel.theta[:, 1])
    first = order[: round(0.6 * len(order))]
    weights = wide.kernel.weights[first]
    kernel = replace(wide.kernel, theta=wide.kernel.theta[first], weights=weights / weights.sum())
    return Entry("part", 3, 2, kernel.centred())


@pytest.fixture(scope="module")
def comparison(wide) -> Comparison:
    return Comparison(wide.pyramid)


@pytest.fixture
def refinements(monkeypatch):
    """The tones and ways in which kernels are refined on the frame."""
    made = []

    def refined(pyramid, kernel, level, way, axes):
        made.append((pyramid.is_displayed, way))
        return refined_on_frame(pyramid, kernel, level, way, axes)

    monkeypatch.setattr(growth, "refined_on_frame", refined)
    return made


def test_a_part_of_a_wide_path_grows_to_the_whole(wide, part, comparison) -> None:
    whole = grown(comparison, part, FLAT, None, toned=False)
    truth = wide.kernel
    assert agreement(part.kernel, truth) < 0.85
    assert agreement(whole.kernel, truth) > 0.97
    assert whole.width > 1.4 * part.width
    assert whole.start == part.start
    level = comparison.level(whole)
    after, before = comparison.scores_at(level, [whole, part])
    assert after > before + SETTINGS.growth.gain


def test_the_true_kernel_stays(wide, comparison) -> None:
    true = Entry("true", 3, 2, wide.kernel)
    assert grown(comparison, true, FLAT, None, toned=False) is true


def test_a_kernel_that_is_narrow_for_the_frame_stays_without_any_work(
    wide, part, comparison, refinements
) -> None:
    least = SETTINGS.growth.least_share * min(wide.camera.shape)
    kernel = part.kernel
    narrow = part._replace(kernel=replace(kernel, theta=kernel.theta * 0.9 * least / part.width))
    assert grown(comparison, narrow, FLAT, None, toned=False) is narrow
    assert refinements == []


def test_a_kernel_grows_in_both_tones_and_all_ways(part, comparison, refinements) -> None:
    grown(comparison, part, FLAT, None, toned=True)
    first, *others = SETTINGS.growth.ways
    ordered = [(False, first), (True, first)]
    ordered += [(shown, way) for shown in (False, True) for way in others]
    assert refinements[: len(ordered)] == ordered


def test_a_kernel_does_not_grow_beyond_its_bound(part, comparison) -> None:
    bound = 1.2 * part.kernel.extent_px()
    assert grown(comparison, part, FLAT, bound, toned=False) is part


@pytest.mark.parametrize("limit", [{"vain": -1.0}, {"wider": 3.0}])
def test_if_the_first_way_is_far_worse_or_hardly_wider_no_other_is_tried(
    part, comparison, refinements, monkeypatch, limit
) -> None:
    hard = replace(SETTINGS.growth, **limit)
    monkeypatch.setattr(growth, "_S", hard)
    assert grown(comparison, part, FLAT, None, toned=False) is part
    assert [way for _, way in refinements] == [hard.ways[0]]


def test_a_better_kernel_that_is_narrower_does_not_grow_from_one(
    wide, comparison, monkeypatch
) -> None:
    true, path = wide.kernel, wide.kernel.theta
    near = Entry("near", 3, 2, replace(true, theta=1.1 * path))
    broad = replace(true, theta=1.25 * path)

    def refined(_: Pyramid, jobs: list[tuple[Entry, Refinement, Axes]], __: Run) -> list[Entry]:
        return [entry._replace(kernel=true) for entry, *_ in jobs]

    monkeypatch.setattr(growth, "refined_on_frame", lambda *_: broad)
    monkeypatch.setattr(growth, "all_refined", refined)
    monkeypatch.setattr(growth, "_S", replace(SETTINGS.growth, vain=np.inf, wider=1.1))
    narrower, wider = (near._replace(kernel=one) for one in (true, broad))
    assert not comparison.hopeless(wider)
    level = comparison.level(near) + SETTINGS.growth.coarser
    better, own, worse = comparison.scores_at(level, [narrower, near, wider])
    assert better > own + SETTINGS.growth.gain > worse
    assert grown(comparison, near, FLAT, None, toned=False).width >= near.width


def test_kernels_that_are_too_wide_for_the_photo_are_left_out(
    wide, part, comparison, monkeypatch
) -> None:
    huge = replace(wide.kernel, theta=wide.kernel.theta * 3)
    monkeypatch.setattr(growth, "refined_on_frame", lambda *_: huge)
    assert comparison.hopeless(part._replace(kernel=huge))
    assert grown(comparison, part, FLAT, None, toned=False) is part


def test_a_kernel_that_the_spectra_match_far_less_does_not_grow_from_one(
    part, comparison, monkeypatch
) -> None:
    matches = (
        comparison.match(part),
        comparison.match(grown(comparison, part, FLAT, None, toned=False)),
    )
    share = matches[1] / matches[0]
    assert share > SETTINGS.growth.least_match
    monkeypatch.setattr(growth, "_S", replace(SETTINGS.growth, least_match=1.5 * share))
    assert grown(comparison, part, FLAT, None, toned=False) is part


def test_in_a_large_frame_no_two_ways_have_the_same_scales(
    wide, part, comparison, refinements, monkeypatch
) -> None:
    few = float(np.prod(wide.camera.shape)) / 8
    ways = tuple(replace(way, pixels=few) for way in SETTINGS.growth.ways)
    monkeypatch.setattr(growth, "_S", replace(SETTINGS.growth, ways=ways))
    level = comparison.level(part)
    first, second, third = ways
    assert level + first.last == wide.pyramid.level_of(few)
    assert levels_on_frame(wide.pyramid, level, first) == levels_on_frame(
        wide.pyramid, level, third
    )
    grown(comparison, part, FLAT, None, toned=False)
    assert [way for _, way in refinements][:2] == [first, second]
    assert third not in [way for _, way in refinements[:3]]


def test_a_kernel_that_grew_is_taken_for_one_of_a_scale_that_suits_it(
    wide, part, comparison
) -> None:
    fine = part._replace(level=0)
    new = on_frame(comparison, fine, wide.pyramid, SETTINGS.growth.ways[1], FLAT)
    assert new.level == comparison.level(new) - SETTINGS.growth.finer > 0
    coarse = part._replace(level=wide.pyramid.coarsest)
    new = on_frame(comparison, coarse, wide.pyramid, SETTINGS.growth.ways[1], FLAT)
    assert new.level == coarse.level
