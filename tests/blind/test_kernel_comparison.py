from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.entry import Entry
from deshake.blind.judge import Judge
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.narrowing import narrower
from deshake.blind.settings import SETTINGS
from deshake.blind.spectral_match import SpectralMatch
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.run import Run
from deshake.signal.pyramid import Pyramid

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.fixture(scope="module")
def entries(shaken) -> list[Entry]:
    """The true kernel, its mirror image, twice the kernel, and a camera at rest."""
    true = shaken.kernel
    mirrored = replace(true, theta=true.theta * [1, -1, 1])
    twice = replace(true, theta=2 * true.theta)
    point = RotationKernel.delta(shaken.camera)
    return [Entry(str(i), i, 0, k) for i, k in enumerate((true, mirrored, twice, point))]


@pytest.fixture(scope="module")
def nearly(shake):
    """A photo, and a kernel that is nearly right, judged at a coarser scale."""
    path = np.array([[0.0, -17, 0], [8, -11, 0], [-4, 3, 0], [4, 17, 0]])
    moves = np.array([[-2, 2, 0], [2, 1, 0], [-2, -1, 0], [2, -2, 0]])
    photo = shake(Camera.from_focal(500.0, 360, 560), path=path)
    turned = (path + moves) * grid_steps(photo.camera)
    return photo, Entry("wrong", 3, 1, RotationKernel.from_path(turned, photo.camera).centred())


def test_the_true_kernel_has_the_highest_score(entries, pyramid) -> None:
    scores = Comparison(pyramid).scores(entries)
    assert scores.shape == (4,)
    assert np.argmax(scores) == 0


def test_a_point_is_penalised(entries, pyramid) -> None:
    assert Comparison(pyramid).scores(entries)[3] < 1 - SETTINGS.kernel_comparison.penalty


def test_a_kernel_as_wide_as_the_photo_is_penalised(entries, pyramid) -> None:
    true = entries[0].kernel
    wide = entries[0]._replace(kernel=replace(true, theta=5 * true.theta))
    assert not Comparison(pyramid).hopeless(entries[0])
    assert Comparison(pyramid).hopeless(wide)
    assert Comparison(pyramid).scores([wide])[0] < 1 - SETTINGS.kernel_comparison.penalty


def test_a_match_is_the_mean_over_the_scales_that_have_tiles_enough(shake) -> None:
    photo = shake(Camera.from_focal(420.0, 360, 420), path=[[0.0, -12, 0], [0, 12, 0]])
    entry = Entry("one", 0, 0, photo.kernel)
    spectra = [SpectralMatch(photo.pyramid, level, "apart") for level in range(3)]
    assert [len(one.centres) >= 3 for one in spectra] == [True, False, False]
    comparison = Comparison(photo.pyramid)
    assert not comparison.is_wide(entry)
    assert comparison.match(entry) == pytest.approx(spectra[0].value(photo.kernel))


def test_the_tiles_for_a_wide_kernel_are_wide(shake) -> None:
    """At the scales with tiles enough, a tile of 128 px is hardly wider than such a kernel."""
    path = [[0.0, -50, 0], [12, -10, 0], [3, 20, 0], [-6, 55, 0]]
    wide = shake(Camera.from_focal(900.0, 640, 720), path=path)
    entry = Entry("wide", 0, 5, wide.kernel)
    comparison = Comparison(wide.pyramid)
    level = comparison.level(entry)
    assert comparison.is_wide(entry)
    assert not comparison.is_wide(entry._replace(kernel=RotationKernel.delta(wide.camera)))
    narrow = [SpectralMatch(wide.pyramid, n, "apart") for n in range(level)]
    narrow = [one for one in narrow if len(one.centres) >= 3]
    match = comparison.match(entry)
    assert match > 1.1 * np.mean([one.value(wide.kernel) for one in narrow])
    turned = entry._replace(kernel=replace(wide.kernel, theta=wide.kernel.theta[:, [1, 0, 2]]))
    assert match > comparison.match(turned) + 0.1


def test_matches_at_other_focal_lengths(entries, pyramid) -> None:
    comparison = Comparison(pyramid)
    ratios = np.array([0.6, 1.0, 1.7])
    matches = comparison.zoomed_matches(entries[0], ratios)
    assert matches[1] == pytest.approx(comparison.match(entries[0]))
    longer = comparison.zoomed(1.7)
    assert longer.pyramid.camera.focal_px == pytest.approx(1.7 * pyramid.camera.focal_px)
    assert longer.match(entries[0].zoomed(1.7)) == pytest.approx(matches[2], abs=0.02)


def test_the_score_of_a_kernel_alone_does_not_depend_on_others(entries, pyramid) -> None:
    comparison = Comparison(pyramid)
    alone = comparison.scores(entries[:1])[0]
    assert comparison.scores(entries)[0] == pytest.approx(alone, abs=0.02)


def test_margin_sharpness_and_spectra_count(entries, pyramid) -> None:
    comparison = Comparison(pyramid)
    true = entries[0]
    judge = comparison.judge(true)
    match = comparison.match(true)
    height, width = pyramid.camera.shape
    assert height * width < 3 * 128**2
    worth = 0.7 * (1 + 15 / 24) / (1 + 15 / 3)
    score = true.margin(judge) + 0.15 * judge.sharpening(true.kernel) + worth * match
    assert 0 < match < 1
    assert comparison.scores(entries[:1])[0] == pytest.approx(score)


def test_a_match_counts_less_in_a_small_frame() -> None:
    random = np.random.default_rng(0)
    shapes = (128, 128), (256, 256), (512, 512), (800, 900)
    shares = [
        Comparison(Pyramid(one, Camera.from_focal(600.0, *one.shape))).match_share
        for one in (random.random(shape, np.float32) for shape in shapes)
    ]
    expected = [(1 + 15 / 24) / (1 + 15 / tiles) for tiles in (3, 4, 16, 24)]
    assert shares == pytest.approx(expected)
    assert shares[3] == pytest.approx(1)


@pytest.fixture(scope="module")
def pair(shake):
    """A photo of a camera that rested most of the time and then went far, and two kernels.

    They are the kernel, and the part of it where the camera rested.
    """
    time = np.linspace(0, 1, 120)
    rest = np.stack([3 * np.sin(9 * time), 8 * time - 4 + 1.5 * np.cos(13 * time), 0 * time], 1)
    away = rest[-1] + np.linspace(0, 1, 40)[:, None] * [21.0, 70, 0]
    photo = shake(Camera.from_focal(600.0, 480, 600), path=np.concatenate([rest, away]))
    part = RotationKernel.from_path(rest * photo.kernel.steps, photo.camera).centred()
    pyramid = photo.pyramid
    return pyramid, Entry("whole", 0, 0, photo.kernel), Entry("part", 1, 0, part)


def test_a_wide_kernel_is_compared_with_a_part_of_it_at_its_own_scale(pair) -> None:
    pyramid, whole, part = pair
    comparison = Comparison(pyramid)
    assert comparison.level(whole) > comparison.level(part)
    scores = comparison.scores([whole, part])
    assert scores[0] < scores[1]  # that of the part is the score of a finer scale
    assert comparison.foremost([part, whole]) == [whole, part]


def test_a_wide_kernel_that_is_wrong_stays_behind(pair) -> None:
    pyramid, whole, part = pair
    comparison = Comparison(pyramid)
    kernel = whole.kernel
    turned = whole._replace(name="turned", kernel=replace(kernel, theta=kernel.theta[:, [1, 0, 2]]))
    vast = whole._replace(name="vast", kernel=replace(kernel, theta=3 * kernel.theta))
    assert comparison.hopeless(vast)
    assert comparison.level(turned) > comparison.level(part)
    ranked = [part, turned, vast]
    assert comparison.foremost(ranked) == ranked
    assert comparison.foremost([part, turned, whole, vast]) == [whole, part, turned, vast]


def test_kernels_of_one_scale_stay_in_their_order(entries, pyramid) -> None:
    comparison = Comparison(pyramid)
    assert comparison.foremost(entries[:2]) == entries[:2]
    assert comparison.foremost(entries[1::-1]) == entries[1::-1]
    assert comparison.foremost([]) == []


def test_a_path_through_a_kernel_matches_the_spectra_better(entries, pyramid) -> None:
    rough = entries[0]._replace(kernel=entries[0].kernel.resampled(entries[0].kernel.steps * 2))
    path = Comparison(pyramid).matched(rough)
    assert (path.name, path.start, path.level) == ("0, path", 0, 0)
    match = SpectralMatch(pyramid, 0, "fitted")
    assert match.value(path.kernel) > match.value(rough.kernel)


def test_paths_are_traced_where_there_are_finer_scales_and_enough_tiles(nearly) -> None:
    photo, entry = nearly
    comparison = Comparison(photo.pyramid)
    assert comparison.level(entry) == 1
    early, late = comparison.traced(entry)
    assert (late.name, late.start, late.level) == ("wrong, traced", 3, 1)
    assert min(comparison.matches([early, late])) > comparison.match(entry) + 0.02
    for factor, wide in ((1 / 3, False), (3.0, True)):
        other = entry._replace(kernel=replace(entry.kernel, theta=entry.kernel.theta * factor))
        assert comparison.is_wide(other) == wide
        assert comparison.traced(other) == []


def test_a_path_is_searched_along_a_kernel_unless_it_is_very_wide_or_narrow(nearly) -> None:
    photo, entry = nearly
    comparison = Comparison(photo.pyramid)
    judge = comparison.judge(entry)
    found = comparison.searched(entry, Run())
    assert (found.name, found.start, found.level) == ("wrong, path", 3, 1)
    before, after = comparison.scores_by([(entry, judge), (found, judge)])
    assert after > before + 0.02
    near = [agreement(one.kernel, photo.kernel, smoothing=0.1) for one in (entry, found)]
    assert near[1] > near[0] + 0.02
    wide = entry._replace(kernel=replace(entry.kernel, theta=entry.kernel.theta * 3))
    assert comparison.is_wide(wide)
    assert comparison.searched(wide, Run()) is wide
    narrow = entry._replace(kernel=replace(entry.kernel, theta=entry.kernel.theta / 8))
    assert 3 < narrow.width < 8
    assert comparison.searched(narrow, Run()) is narrow
    point = entry._replace(kernel=RotationKernel.delta(photo.camera))
    assert comparison.searched(point, Run()) is point


def shrunk(entry: Entry, share: float) -> Entry:
    return entry._replace(kernel=replace(entry.kernel, theta=share * entry.kernel.theta))


def test_a_path_that_is_worse_does_not_win(entries, pyramid, monkeypatch) -> None:
    comparison, true = Comparison(pyramid), entries[0]
    half, short, nearer = (shrunk(true, share) for share in (0.5, 0.85, 0.95))
    monkeypatch.setattr("deshake.blind.kernel_comparison.searched", lambda *_, **__: half.kernel)
    assert comparison.searched(true, Run()) is true
    monkeypatch.setattr("deshake.blind.kernel_comparison.searched", lambda *_, **__: nearer.kernel)
    assert comparison.searched(short, Run()).kernel is nearer.kernel
    much = replace(SETTINGS.kernel_comparison, gain=2.0)
    monkeypatch.setattr("deshake.blind.kernel_comparison._S", much)
    assert comparison.searched(short, Run()) is short


def worth_in_the_search(comparison: Comparison, kernel: RotationKernel, entry: Entry) -> float:
    """Return what the search takes a kernel for that lies along an entry."""
    judges = Judge.batches(comparison.pyramid, comparison.level(entry), entry.kernel)
    margin = float(np.mean([judge.margin(kernel) for judge in judges]))
    worth = SETTINGS.kernel_comparison.search_match_worth * comparison.match_share
    return margin + worth * comparison.match(entry._replace(kernel=kernel), comparison.level(entry))


@pytest.mark.parametrize("scales", [0, 1, 2])
def test_the_worth_the_score_and_a_finer_margin_decide_on_a_path(
    nearly, monkeypatch, scales
) -> None:
    photo, entry = nearly
    comparison, true = Comparison(photo.pyramid), entry._replace(kernel=photo.kernel)
    level = comparison.level(entry)
    assert level == 1
    pair = entry.kernel, photo.kernel
    finer = Judge.batches(photo.pyramid, max(level - scales, 0), entry.kernel)
    gains = [
        np.diff([worth_in_the_search(comparison, kernel, entry) for kernel in pair]),
        np.diff(comparison.scores_at(level, [entry, true])),
        np.diff([np.mean([judge.margin(kernel) for judge in finer]) for kernel in pair]),
    ]
    assert min(gains) > 0.005
    monkeypatch.setattr("deshake.blind.kernel_comparison.searched", lambda *_, **__: photo.kernel)
    for limit, wins in ((sum(gains) - 1e-3, True), (sum(gains) + 1e-3, False)):
        changed = replace(SETTINGS.kernel_comparison, confirming=scales, gain=float(limit[0]))
        monkeypatch.setattr("deshake.blind.kernel_comparison._S", changed)
        found = Comparison(photo.pyramid).searched(entry, Run())
        assert found.kernel is (photo if wins else entry).kernel


def test_a_right_kernel_leads_over_turned_ones(entries, pyramid, still) -> None:
    """On a photo of a camera at rest no direction is better than another."""
    comparison, true = Comparison(pyramid), entries[0]
    lead = comparison.lead(true)
    assert lead > 0.1
    assert comparison.lead(true._replace(kernel=true.kernel.turned(90))) < 0
    assert comparison.lead(entries[3]) == pytest.approx(0, abs=1e-6)
    assert Comparison(still).lead(true) < lead / 4


def blotted(kernel: RotationKernel, width: int) -> RotationKernel:
    """The kernel, blurred by a round spot of a width in grid steps."""
    place = np.arange(-3 * width, 3 * width + 1)
    spot = np.stack(np.meshgrid(place, place, [0], indexing="ij"), -1).reshape(-1, 3)
    shares = np.exp(-np.square(spot).sum(1) / (2 * width**2))
    indices = (kernel.indices[:, None] + spot).reshape(-1, 3)
    weights = np.outer(kernel.weights, shares).ravel()
    return RotationKernel.from_indices(indices, weights, kernel.steps, kernel.camera)


def test_the_lead_of_a_long_kernel_is_its_gain_over_turned_ones(entries, pyramid) -> None:
    comparison = Comparison(pyramid)
    assert comparison.lead(entries[0]) == comparison.gain_over_turned(entries[0]) > 0.1


def test_the_lead_of_a_nearly_round_kernel_counts_for_more(entries, pyramid, monkeypatch) -> None:
    """It hardly changes if it is turned, so it can gain little."""
    comparison = Comparison(pyramid)
    kernel = blotted(entries[0].kernel, 5)
    entry = entries[0]._replace(kernel=kernel)
    unlike = 1 - np.mean([agreement(kernel, kernel.turned(angle)) for angle in (60, 90, 120)])
    assert 0.002 < unlike < 0.1
    for gain in (0.02, -0.01):
        monkeypatch.setattr(Comparison, "gain_over_turned", lambda *_, gain=gain: gain)
        assert comparison.lead(entry) == pytest.approx(gain / max(unlike / 0.2, 0.1))


def filled_disk(camera: Camera) -> RotationKernel:
    """The kernel of a photo out of focus."""
    place = np.arange(-7, 8)
    indices = np.stack(np.meshgrid(place, place, [0], indexing="ij"), -1).reshape(-1, 3)
    indices = indices[np.linalg.norm(indices, axis=1) < 6.5]
    even = np.full(len(indices), 1 / len(indices))
    return RotationKernel.from_indices(indices, even, grid_steps(camera), camera)


def test_a_disk_has_no_direction_and_no_lead(entries, pyramid) -> None:
    disk = filled_disk(pyramid.camera)
    assert Comparison(pyramid).lead(entries[0]._replace(kernel=disk)) is None


def test_a_search_is_vain_if_it_begins_far_below_the_kernel(entries, pyramid, monkeypatch) -> None:
    true, asked, known = entries[0], [], []

    def searched(
        *_: object, worth: Callable[[RotationKernel], float], least: float, **__: object
    ) -> None:
        asked.extend(worth(shrunk(true, share).kernel) >= least for share in (1.0, 0.98, 0.5, 2.0))
        known.append(least)

    monkeypatch.setattr("deshake.blind.kernel_comparison.searched", searched)
    comparison = Comparison(pyramid)
    assert comparison.searched(true, Run()) is true
    assert asked == [True, True, False, False]
    own = worth_in_the_search(comparison, true.kernel, true)
    assert known == pytest.approx([own - SETTINGS.kernel_comparison.vain])


def widened(kernel: RotationKernel, sigma: float) -> RotationKernel:
    """A kernel as wide as a round spot of a standard deviation in grid steps makes it."""
    random = np.random.default_rng(4)
    places = kernel.theta[:, None] + random.standard_normal((1, 60, 3)) * sigma * kernel.steps
    weights = np.repeat(kernel.weights, 60) / 60
    cloud = replace(kernel, theta=places.reshape(-1, 3), weights=weights)
    return cloud.resampled(kernel.steps).centred()


def test_a_kernel_that_is_too_wide_across_its_path_becomes_narrower(shake) -> None:
    photo = shake(Camera.from_focal(500.0, 360, 560), path=np.array([[-9.0, -4, 0], [9, 4, 0]]))
    comparison = Comparison(photo.pyramid)
    wide = Entry("wide", 3, 0, widened(photo.kernel, 1.0))
    narrow = comparison.narrowed(wide, Run())
    assert (narrow.name, narrow.start, narrow.level) == ("wide, narrower", 3, 0)
    near = [agreement(one.kernel, photo.kernel, smoothing=0.1) for one in (wide, narrow)]
    assert near[1] > near[0] + 0.01
    again = comparison.narrowed(wide, Run(2))
    np.testing.assert_array_equal(again.kernel.weights, narrow.kernel.weights)


def test_a_kernel_whose_width_the_photo_shows_stays(nearly) -> None:
    photo, entry = nearly
    true = entry._replace(kernel=photo.kernel)
    assert Comparison(photo.pyramid).narrowed(true, Run()) is true


def test_the_worth_and_the_score_decide_how_narrow_a_kernel_becomes(nearly, monkeypatch) -> None:
    photo, wrong = nearly
    entry = wrong._replace(kernel=photo.kernel)
    comparison = Comparison(photo.pyramid)
    monkeypatch.setattr("deshake.blind.narrowing._S", replace(SETTINGS.narrowing, shares=(0.3,)))
    [kernel] = narrower(entry.kernel)
    narrow = entry._replace(kernel=kernel)
    losses = [
        worth_in_the_search(comparison, entry.kernel, entry)
        - worth_in_the_search(comparison, kernel, entry),
        -np.diff(comparison.scores_at(comparison.level(entry), [entry, narrow]))[0],
    ]
    assert min(losses) > 0.01
    for tolerance, changes in ((sum(losses) + 1e-3, True), (sum(losses) - 1e-3, False)):
        changed = replace(SETTINGS.narrowing, shares=(0.3,), tolerance=tolerance)
        monkeypatch.setattr("deshake.blind.narrowing._S", changed)
        found = Comparison(photo.pyramid).narrowed(entry, Run())
        assert (found is not entry) == changes


def test_disks_spots_and_very_wide_kernels_do_not_become_narrower(nearly) -> None:
    photo, entry = nearly
    comparison = Comparison(photo.pyramid)
    wide = shrunk(entry, 3)
    assert comparison.is_wide(wide)
    assert comparison.narrowed(wide, Run()) is wide
    disk = entry._replace(kernel=filled_disk(photo.camera))
    assert comparison.narrowed(disk, Run()) is disk
    point = entry._replace(kernel=RotationKernel.delta(photo.camera))
    assert comparison.narrowed(point, Run()) is point
