from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.blind.variational.coarse_to_fine import turn
from deshake.geometry.camera import Camera
from deshake.pair.rotation_search import Candidate, distance_px, distinct, exhaustive_search
from deshake.run import Run

SHAPE = (48, 64)


def texture(seed=0, sigma=1.5):
    noise = np.random.default_rng(seed).normal(size=SHAPE).astype(np.float32)
    return cv2.GaussianBlur(noise, (0, 0), sigma)


@pytest.mark.parametrize(
    ("focal", "degrees"),
    [
        (45.0, (6, -3, 2)),
        (45.0, (-2, 9, -9)),
        (64.0, (0, 0, 0)),
        (64.0, (0, 0, 9.5)),
        (150.0, (9, 0, 0)),
        (150.0, (-7, -7, 7)),
    ],
)
def test_the_rotation_is_right_to_about_a_pixel(focal, degrees):
    camera = Camera.from_focal(focal, *SHAPE)
    theta = np.radians(degrees) * min(1, 90 / focal)
    a = texture()
    b = turn(a[None], camera, theta)[0]  # a(x) = b(H^-1 x)
    best = exhaustive_search(a, b, camera, np.radians(10), run=Run(1))[0]
    assert distance_px(camera, best.theta, theta) < 1.6
    assert best.score > 0.75


def test_rotations_beyond_the_range_score_low():
    camera = Camera.from_focal(64, *SHAPE)
    theta = np.radians([0, 8, 0])
    a = texture()
    b = turn(a[None], camera, theta)[0]
    near = exhaustive_search(a, b, camera, np.radians(3), run=Run(1))[0]
    assert near.score < 0.5
    assert exhaustive_search(a, b, camera, np.radians(8.5), run=Run(1))[0].score > 0.75


def test_unlike_pictures_score_low():
    camera = Camera.from_focal(64, *SHAPE)
    candidates = exhaustive_search(texture(1), texture(2), camera, np.radians(5), run=Run(1))
    assert candidates[0].score < 0.4


def test_threads_change_nothing_and_progress_ends_at_one():
    camera, shares = Camera.from_focal(64, *SHAPE), []
    runs = [
        exhaustive_search(
            texture(1),
            texture(2),
            camera,
            np.radians(5),
            run=Run(n, lambda share, _: shares.append(share)),
        )
        for n in (1, 3)
    ]
    one, other = ([(*c.theta, c.score) for c in run] for run in runs)
    assert one == other
    assert shares[-1] == 1
    assert shares[: len(shares) // 2] == sorted(shares[: len(shares) // 2])


def test_distinct_candidates_keep_their_distance():
    camera = Camera.from_focal(64, *SHAPE)
    angles = [0, 0.01, 0.2, 0.21, 0.4]
    candidates = [Candidate(np.array([0, a, 0]), 1 - a) for a in angles]
    kept = distinct(candidates, camera, 2, 3.0)
    assert [c.theta[1] for c in kept] == [0, 0.2]
    assert len(distinct(candidates, camera, 9, 3.0)) == 3


def test_distance_of_a_small_pan_is_its_shift():
    camera = Camera.from_focal(1000, *SHAPE)
    pan = np.array([0, 0.003, 0])
    assert distance_px(camera, np.zeros(3), pan) == pytest.approx(3, rel=1e-2)
    assert distance_px(camera, pan, pan) == pytest.approx(0, abs=1e-9)
