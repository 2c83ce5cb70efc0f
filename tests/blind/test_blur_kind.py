from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.blind.blur_kind import BlurKind, Measures, blur_kind, judged, measured
from deshake.blind.edge_spread import EdgeSpread
from deshake.blind.sharpness import looks_sharp
from deshake.blind.spectrum_fit import DirectedBlur
from deshake.geometry.camera import Camera
from deshake.signal.pyramid import Pyramid

ROUND = DirectedBlur(0.05, 2.0, 10.0)
PERHAPS = Measures(
    sharp=False,
    sharpness=0.55,
    sharpness_at_half=0.55,
    directed=DirectedBlur(0.2, 3.0, 0.0),
    edges=EdgeSpread(2.0, 1.9),
)
"""The measures of a photo that is perhaps shaken."""


def of(grey: np.ndarray) -> Pyramid:
    return Pyramid(grey.astype(np.float32), Camera.from_focal(600.0, *grey.shape))


@pytest.fixture(scope="module")
def photo() -> np.ndarray:
    """A photo in linear light that is sharp to the pixel, 340 px."""
    grey = data.astronaut() @ np.array([0.3, 0.59, 0.11]) / 255
    return (cv2.resize(grey, (340, 340), interpolation=cv2.INTER_AREA) ** 2.2).astype(np.float32)


def disk(radius: int) -> np.ndarray:
    drawn = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return (drawn / drawn.sum()).astype(np.float32)


def test_says_what_blurs_a_photo(photo) -> None:
    assert blur_kind(of(photo)) == BlurKind("sharp", certain=True)
    assert blur_kind(of(cv2.GaussianBlur(photo, (0, 0), 0.9))).kind == "soft"
    assert blur_kind(of(cv2.filter2D(photo, -1, disk(4)))).kind == "out of focus"


@pytest.mark.parametrize("turned", [False, True])
def test_a_camera_that_rests_and_moves_on_leaves_steep_edges_but_no_sharp_photo(
    photo, turned
) -> None:
    def of_camera(picture: np.ndarray) -> Pyramid:
        """Sharpen a picture as cameras do."""
        finer = picture + 1.2 * (picture - cv2.GaussianBlur(picture, (0, 0), 1))
        return of(np.clip(finer, 0, 1))

    path = np.full((1, 9), 0.5 / 8, np.float32)
    path[0, 4] = 0.5
    rested = of_camera(cv2.filter2D(photo, -1, path.T if turned else path))
    assert measured(of_camera(photo)).surely_sharp
    assert looks_sharp(rested)
    assert not measured(rested).surely_sharp
    assert blur_kind(rested).kind == "shaken"


def test_steep_edges_that_are_wide_in_a_direction_are_no_reason_to_doubt_a_shake() -> None:
    steep = Measures(
        sharp=True,
        sharpness=0.72,
        sharpness_at_half=0.71,
        directed=DirectedBlur(0.32, 6.4, 5.0),
        edges=EdgeSpread(1.4, 1.0),
    )
    assert not steep.surely_sharp
    assert judged(steep).kind == "shaken"
    assert steep._replace(edges=EdgeSpread(0.9, 0.6)).surely_sharp
    assert steep._replace(edges=None).surely_sharp
    assert steep._replace(directed=DirectedBlur(0.2, 6.4, 5.0)).surely_sharp


@pytest.mark.parametrize(("slant", "direction"), [(1, 135), (-1, 45)])
def test_a_motion_has_a_width_and_a_direction(photo, slant, direction) -> None:
    way = np.eye(7, dtype=np.float32)[::slant].copy() / 7
    blur = blur_kind(of(cv2.filter2D(photo, -1, way)))
    assert (blur.kind, blur.certain) == ("shaken", True)
    assert blur.direction == pytest.approx(direction, abs=15)
    assert blur.width_px == pytest.approx(7 * 2**0.5, rel=0.5)
    assert blur.report().keys() == {"verdict", "certain", "width_px", "direction"}


def test_edges_are_evidence_beside_the_spectrum() -> None:
    round_ones = PERHAPS._replace(directed=DirectedBlur(0.14, 3.0, 60.0))
    assert judged(round_ones) == BlurKind("out of focus", certain=False)
    flat_ones = judged(round_ones._replace(edges=EdgeSpread(2.0, 0.8)))
    assert (flat_ones.kind, flat_ones.certain, flat_ones.direction) == ("shaken", True, 120)


def test_what_few_tiles_say_is_no_evidence_against_a_shake(photo) -> None:
    plain, small = measured(of(photo)), measured(of(photo[100:180, 100:200]))
    assert plain.certain_evidence == plain.evidence < 0.5
    assert small.certain_evidence == np.inf


def test_the_fine_edges_of_a_sharp_photo_need_more_evidence(photo) -> None:
    assert measured(of(photo)).hardly_shaken
    assert measured(of(cv2.GaussianBlur(photo, (0, 0), 0.9))).hardly_shaken
    assert not measured(of(cv2.blur(photo, (9, 1)))).hardly_shaken
    directed = DirectedBlur(0.3, 3.0, 0.0, certain=True)
    fine = PERHAPS._replace(directed=directed, edges=EdgeSpread(1.0, 0.9))
    assert fine.hardly_shaken
    assert not fine._replace(edges=EdgeSpread(1.4, 1.3)).hardly_shaken
    assert not fine._replace(edges=None).hardly_shaken
    assert not fine._replace(directed=directed._replace(certain=False)).hardly_shaken
    assert not fine._replace(directed=directed._replace(strength=0.5)).hardly_shaken


def test_doubt_is_part_of_the_verdict() -> None:
    assert judged(PERHAPS).kind == "shaken"
    assert not judged(PERHAPS).certain
    assert judged(PERHAPS._replace(sharpness_at_half=0.8)).kind == "out of focus"
    assert judged(PERHAPS._replace(directed=ROUND)) == BlurKind("out of focus", certain=True)
    soft = PERHAPS._replace(directed=ROUND, edges=EdgeSpread(1.0, 0.9))
    assert judged(soft) == BlurKind("soft", certain=True)
    assert judged(soft._replace(sharpness=0.7)) == BlurKind("sharp", certain=False)
    assert judged(soft._replace(edges=None)) == BlurKind("unclear", certain=False)
    assert judged(PERHAPS._replace(sharp=True)) == BlurKind("sharp", certain=True)


def test_quarters_that_are_shaken_in_several_directions(photo) -> None:
    level, upright = cv2.blur(photo, (8, 1)), cv2.blur(photo, (1, 8))
    half = len(photo) // 2
    turned = np.vstack(
        [
            np.hstack([level[:half, :half], upright[:half, half:]]),
            np.hstack([upright[half:, :half], level[half:, half:]]),
        ]
    )
    noisy = turned + 0.002 * np.random.default_rng(0).normal(size=turned.shape)
    pyramid = of(noisy)
    assert judged(measured(pyramid)).kind != "shaken"
    blur = blur_kind(pyramid)
    assert (blur.kind, blur.certain) == ("shaken", False)
    assert blur.width_px > 4
