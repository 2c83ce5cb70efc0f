from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deshake.blind.judge import Judge
from deshake.blind.settings import SETTINGS
from deshake.geometry.kernel import RotationKernel
from deshake.operators.warps import Warps
from deshake.signal.pyramid import Pyramid


@pytest.fixture(scope="module")
def kernels(shaken) -> dict[str, RotationKernel]:
    """Kernels: true, nearly, wrong ones, and none."""
    true = shaken.kernel
    return {
        "true": true,
        "near": replace(true, theta=0.85 * true.theta),
        "short": replace(true, theta=0.5 * true.theta),
        "long": replace(true, theta=1.8 * true.theta),
        "wrong": replace(true, theta=true.theta * [-1, 1, 1]),
        "still": RotationKernel.delta(shaken.camera),
    }


def margins(grey, shaken, kernels, *names: str, clipped=None, level=0) -> dict[str, float]:
    """Judge a photo's kernels of some names; all have room."""
    judge = Judge.of(Pyramid(grey, shaken.camera, clipped), level, list(kernels.values()))
    return {name: judge.margin(kernels[name]) for name in names}


@pytest.fixture(scope="module")
def plain(shaken, kernels) -> dict[str, float]:
    return margins(shaken.grey, shaken, kernels, *kernels)


def test_the_better_kernel_is_preferred(plain) -> None:
    assert plain["true"] > plain["short"] > plain["still"]
    assert plain["near"] > plain["short"]
    assert plain["near"] > plain["wrong"]
    assert plain["true"] > plain["wrong"]
    assert plain["true"] > plain["long"]
    assert plain["true"] > 0.05


def test_a_still_camera_has_no_margin(plain) -> None:
    assert plain["still"] == pytest.approx(0, abs=1e-9)


def test_no_kernel_improves_a_photo_that_was_not_shaken(shaken, kernels) -> None:
    by_kernel = margins(shaken.still, shaken, kernels, "true", "short", "wrong")
    assert max(by_kernel.values()) < 0
    assert by_kernel["true"] < by_kernel["short"]


def test_a_coarser_scale_prefers_the_same(shaken, kernels) -> None:
    by_kernel = margins(shaken.grey, shaken, kernels, "true", "short", "long", level=1)
    assert by_kernel["true"] > by_kernel["short"] > 0
    assert by_kernel["true"] > by_kernel["long"]


def test_exposure_does_not_count(shaken, kernels, plain) -> None:
    dim = margins(shaken.grey * np.float32(0.25), shaken, kernels, "true", "short")
    for name, margin in dim.items():
        assert margin == pytest.approx(plain[name], abs=3e-3)


def test_what_was_judged_before_does_not_count(shaken, kernels) -> None:
    judge = Judge.of(shaken.pyramid, 0, list(kernels.values()))
    first = [judge.energy(kernels[name]) for name in ("true", "still")]
    again = [judge.energy(kernels[name]) for name in ("still", "true")]
    assert first == again[::-1]
    assert judge.still == first[1]


def test_a_judge_near_a_kernel_judges_alike(shaken, kernels) -> None:
    judge = Judge.of(shaken.pyramid, 0, list(kernels.values()))
    near = judge.near(kernels["near"])
    assert near.margin(kernels["near"]) == judge.margin(kernels["near"])
    assert near.margin(kernels["true"]) == pytest.approx(judge.margin(kernels["true"]), abs=0.01)
    assert near.margin(kernels["true"]) > near.margin(kernels["near"])
    again = judge.near(kernels["true"])
    assert again.margin(kernels["true"]) == judge.margin(kernels["true"])  # none changes another


def test_batches_have_tiles_of_their_own_and_judge_alike(shaken, kernels) -> None:
    batches = Judge.batches(shaken.pyramid, 0, kernels["near"])
    places = [tuple(corner) for batch in batches for corner in batch.tiles.corners]
    assert len(batches) > 1
    assert len(set(places)) == len(places)
    assert all(batch.tiles.count in (2, 3) for batch in batches)
    together = {
        name: np.mean([batch.margin(kernels[name]) for batch in batches])
        for name in ("true", "near", "still")
    }
    assert together["true"] > together["near"] > together["still"]
    one = Judge.of(shaken.pyramid, 0, list(kernels.values()))
    assert together["true"] == pytest.approx(one.margin(kernels["true"]), abs=0.15)


def test_an_edge_is_cheaper_for_batches_if_there_is_less_noise(shaken, kernels) -> None:
    usual = Judge.of(shaken.pyramid, 0, list(kernels.values())).lam
    noise = np.random.default_rng(0).standard_normal(shaken.grey.shape).astype(np.float32)
    prices = []
    for sigma in (0.0, 0.003, 0.2):
        pyramid = Pyramid(shaken.grey + np.float32(sigma) * noise, shaken.camera)
        lams = {batch.lam for batch in Judge.batches(pyramid, 1, kernels["true"])}
        assert len(lams) == 1
        prices += lams
    assert usual / 8 <= prices[0] < prices[1] < prices[2] == usual


def test_a_cheap_edge_tells_kernels_better_apart_where_there_is_little_noise(shake) -> None:
    gains = []
    for noise in (0.0, 0.01):
        shaken = shake(noise=noise)
        true = shaken.kernel
        turn = Rotation.from_euler("z", 15, degrees=True).as_matrix()
        turned = replace(true, theta=true.theta @ turn.T)
        tiles = Judge.of(shaken.pyramid, 0, [true, turned]).tiles
        judges = Judge(tiles), Judge(tiles, SETTINGS.judge.lam / 8)
        gains.append([judge.margin(true) - judge.margin(turned) for judge in judges])
    (usual, cheap), (usual_noisy, cheap_noisy) = gains
    assert 0 < usual < cheap
    assert usual_noisy > cheap_noisy


@pytest.mark.parametrize("is_clipped", [False, True])
def test_batches_without_texture_do_not_count(shaken, kernels, is_clipped) -> None:
    """The left half has no texture; tiles that are all clipped belong to no batch."""
    flat = shaken.grey.copy()
    flat[:, : flat.shape[1] // 2] = 1.0
    pyramid = Pyramid(flat, shaken.camera, (flat == 1.0) if is_clipped else None)
    batches = Judge.batches(pyramid, 0, kernels["true"])
    plain = [batch for batch in batches if np.ptp(batch.tiles.g) == 0]
    assert len(plain) == (0 if is_clipped else 1)
    for batch in batches:
        margins = [batch.margin(kernels[name]) for name in ("true", "near", "still")]
        assert np.isfinite(margins).all()
        assert any(margins) == (batch not in plain)


def test_rotations_without_weight_do_not_count(shaken, kernels) -> None:
    near = kernels["near"]
    theta = np.concatenate([near.theta, 1.5 * near.theta])
    padded = replace(near, theta=theta, weights=np.append(near.weights, 0 * near.weights))
    judge = Judge.of(shaken.pyramid, 0, list(kernels.values()))
    assert judge.energy(padded) == judge.energy(near)


def test_where_the_camera_pointed_hardly_counts(shaken, kernels) -> None:
    true = kernels["true"]
    turned = replace(true, theta=true.theta + np.array([2, -1, 0]) * true.steps)
    judge = Judge.of(shaken.pyramid, 0, [turned, *kernels.values()])
    assert judge.margin(turned) == pytest.approx(judge.margin(true), abs=0.03)


def test_clipped_pixels_are_left_out(shaken, kernels, plain) -> None:
    spoilt = shaken.grey.copy()
    spoilt[100:120, 100:140] = 1.0
    clipped = np.zeros(spoilt.shape, bool)
    clipped[99:121, 99:141] = True
    by_kernel = margins(spoilt, shaken, kernels, "true", "short", clipped=clipped)
    assert by_kernel["true"] > by_kernel["short"] > 0
    assert by_kernel["true"] == pytest.approx(plain["true"], abs=0.08)


def test_lights_that_no_kernel_explains_mislead_nobody(shaken, kernels) -> None:
    lit = shaken.grey.copy()
    lit[40:180:40, 40:220:40] += np.float32(lit.max())  # lights that were not shaken
    by_kernel = margins(lit, shaken, kernels, "true", "long")
    assert by_kernel["true"] > max(by_kernel["long"], 0)


def test_it_has_room_for_the_widest_kernel(shaken, kernels) -> None:
    narrow = Judge.of(shaken.pyramid, 0, [kernels["short"]])
    wide = Judge.of(shaken.pyramid, 0, [kernels["short"], kernels["long"]])
    assert wide.tiles.far > narrow.tiles.far


def test_the_margin_is_the_gain_in_energy(shaken, kernels) -> None:
    judge = Judge.of(shaken.pyramid, 2, [kernels["true"]])
    gain = judge.energy(kernels["still"]) - judge.energy(kernels["true"])
    assert judge.margin(kernels["true"]) == pytest.approx(gain, abs=1e-12)


def test_the_true_kernel_sharpens_most(shaken, kernels) -> None:
    judge = Judge.of(shaken.pyramid, 0, list(kernels.values()))
    gains = {name: judge.sharpening(kernel) for name, kernel in kernels.items()}
    assert gains["true"] > max(gains["short"], gains["wrong"], 0.02)
    assert abs(gains["still"]) < 0.25 * gains["true"]


def test_a_black_sky_is_no_sign_of_little_noise(shaken, kernels) -> None:
    dark = shaken.sharp.copy()
    dark[:, : dark.shape[1] // 2] = 0
    warps = Warps(shaken.camera, shaken.kernel.theta, margin=shaken.margin)
    night = warps.blur(dark, shaken.kernel.weights).astype(np.float32)
    by_kernel = margins(night, shaken, kernels, "true", "wrong")
    assert by_kernel["true"] > max(by_kernel["wrong"], 0.02)
