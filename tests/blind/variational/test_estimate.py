from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
import pytest

from deshake.blind.variational import estimate, priors
from deshake.blind.variational.estimate import estimate_variational
from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur
from deshake.restore.richardson_lucy import richardson_lucy
from deshake.run import Run

if TYPE_CHECKING:
    from deshake.blind.result import BlindEstimate

BORDER = 11
BOUND = 10.0  # px
TURNS = {"Y": (0, 7, 0), "Z": (0, 0, 8)}  # grid steps from end to end
RATES = {"Y": priors.ROLL_RATE, "Z": 0.0}


class Shot(NamedTuple):
    """A sharp photo, the shaken one, and how it was shaken."""

    sharp: np.ndarray
    photo: np.ndarray
    true: RotationKernel


def shoot(sharp: np.ndarray, camera: Camera, turn: tuple[int, int, int]) -> Shot:
    """Turn at uniform speed, add a little noise, and round to 8 bits of linear light."""
    path = np.array([[-0.5], [0.5]]) * turn * grid_steps(camera)
    true = RotationKernel.from_path(path, camera)
    blur = ShakeBlur(true, kind="warps")
    photo = blur.forward(np.pad(sharp, blur.margin, mode="edge"))
    photo += np.random.default_rng(0).normal(0, 0.002, photo.shape).astype(np.float32)
    return Shot(sharp, (np.round(np.clip(photo, 0, 1) * 255) / 255).astype(np.float32), true)


@pytest.fixture(scope="module")
def shots(sharp: np.ndarray) -> dict[str, Shot]:
    reduced = cv2.resize(sharp, (195, 150), interpolation=cv2.INTER_AREA)
    camera = Camera.from_focal(195.0, 150, 195)
    return {name: shoot(reduced, camera, turn) for name, turn in TURNS.items()}


@pytest.fixture(scope="module")
def small(sharp: np.ndarray) -> Shot:
    """A shot that takes little time."""
    reduced = cv2.resize(sharp, (130, 100), interpolation=cv2.INTER_AREA)
    return shoot(reduced, Camera.from_focal(130.0, 100, 130), (0, 6, 0))


@pytest.fixture(scope="module")
def estimates(shots: dict[str, Shot]) -> dict[str, BlindEstimate]:
    return {
        name: estimate_variational(
            shot.photo, shot.true.camera, blur_px=BOUND, roll_rate=RATES[name], run=Run(2)
        )
        for name, shot in shots.items()
    }


class Watched(NamedTuple):
    """An estimate, and the reports of its progress."""

    result: BlindEstimate
    shares: list[float]
    texts: list[str]


@pytest.fixture(scope="module")
def watched(small: Shot) -> Watched:
    reports: list[tuple[float, str]] = []
    result = estimate_variational(
        small.photo,
        small.true.camera,
        blur_px=8,
        run=Run(2, lambda share, text: reports.append((share, text))),
    )
    return Watched(result, [share for share, _ in reports], [text for _, text in reports])


def psnr(restored: np.ndarray, sharp: np.ndarray) -> float:
    """PSNR of the interior in dB, the sharp photo moved to where it fits best."""
    motion = np.eye(2, 3, dtype=np.float32)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-7)
    _, motion = cv2.findTransformECC(restored, sharp, motion, cv2.MOTION_EUCLIDEAN, stop, None, 5)
    way = cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP
    moved = cv2.warpAffine(sharp, motion, sharp.shape[::-1], flags=way)
    inner = (slice(BORDER, -BORDER), slice(BORDER, -BORDER))
    return float(-10 * np.log10(np.mean((restored - moved)[inner] ** 2)))


def gain(shot: Shot, kernel: RotationKernel) -> float:
    """How much nearer to the sharp photo a kernel brings the shaken one, in dB."""
    done = richardson_lucy(shot.photo, kernel, iterations=25, accelerated=False, run=Run(2))
    return psnr(done.pixels, shot.sharp) - psnr(shot.photo, shot.sharp)


def cosine(a: RotationKernel, b: RotationKernel) -> float:
    """Agreement of two kernels on a grid twice as coarse, centred."""
    weights = []
    for kernel in (a, b):
        onto = kernel.centred().resampled(2 * a.steps)
        weights.append(dict(zip(map(tuple, onto.indices.tolist()), onto.weights, strict=True)))
    dot = sum(w * weights[1].get(i, 0.0) for i, w in weights[0].items())
    norms = [np.linalg.norm(list(each.values())) for each in weights]
    return float(dot / norms[0] / norms[1])


@pytest.mark.parametrize("name", TURNS)
def test_a_known_kernel_is_recovered(
    name: str, shots: dict[str, Shot], estimates: dict[str, BlindEstimate]
) -> None:
    shot, result = shots[name], estimates[name]
    assert result.kernel.camera is shot.true.camera
    assert cosine(shot.true, result.kernel) > 0.85
    assert gain(shot, result.kernel) > 2
    assert result.confidence > 0.8
    assert result.notes == []


def test_strong_noise_leaves_the_kernel_right(shots: dict[str, Shot]) -> None:
    photo, true = shots["Y"].photo, shots["Y"].true
    display = photo ** (1 / 2.2)
    display = display + np.random.default_rng(1).normal(0, 10 / 255, photo.shape)
    noisy = ((np.rint(255 * np.clip(display, 0, 1)) / 255) ** 2.2).astype(np.float32)
    result = estimate_variational(noisy, true.camera, blur_px=BOUND, run=Run(2))
    assert cosine(true, result.kernel) > 0.7


def test_the_kernel_is_centred(estimates: dict[str, BlindEstimate]) -> None:
    for result in estimates.values():
        assert np.all(np.abs(result.kernel.centroid) < 1e-6)


def test_scales_are_reported_from_coarse_to_fine(estimates: dict[str, BlindEstimate]) -> None:
    scales = estimates["Y"].scales
    assert (scales[-1].height, scales[-1].width) == (150, 195)
    widths = [scale.width for scale in scales]
    assert widths == sorted(widths)
    assert len(widths) > 4
    assert all(scale.rotations > 0 and scale.noise > 0 for scale in scales)
    assert np.isfinite([scale.free_energy for scale in scales]).all()


def test_a_uniform_kernel_is_recovered_by_the_uniform_model(sharp: np.ndarray) -> None:
    camera = Camera.from_focal(260.0, *sharp.shape)
    shot = shoot(sharp, Camera.uniform(*sharp.shape), (4, 8, 0))
    result = estimate_variational(shot.photo, camera, blur_px=10, uniform=True, run=Run(2))
    assert np.all(np.abs(result.kernel.theta[:, 2]) < 1e-9)
    assert result.kernel.camera.is_uniform
    assert cosine(shot.true, result.kernel) > 0.85
    assert gain(shot, result.kernel) > 2


def test_threads_do_not_change_a_byte(small: Shot, watched: Watched) -> None:
    alone = estimate_variational(small.photo, small.true.camera, blur_px=8, run=Run(1))
    for name in ("theta", "weights", "steps"):
        assert (
            getattr(alone.kernel, name).tobytes() == getattr(watched.result.kernel, name).tobytes()
        )
    assert alone.confidence == watched.result.confidence
    assert alone.scales == watched.result.scales


def test_the_kernel_of_a_reduced_photo_belongs_to_the_whole(
    shots: dict[str, Shot], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimate, "_LONGEST_SIDE", 156)
    shot = shots["Y"]
    result = estimate_variational(shot.photo, shot.true.camera, blur_px=BOUND, run=Run(2))
    assert result.scales[-1].width == 156
    assert result.kernel.camera is shot.true.camera
    spread = [np.sqrt(k.weights @ k.theta[:, 1] ** 2) for k in (result.kernel, shot.true)]
    assert spread[0] == pytest.approx(spread[1], rel=0.25)
    assert cosine(shot.true, result.kernel) > 0.75
    assert gain(shot, result.kernel) > 0.5


def test_a_region_speaks_for_the_whole_photo(shots: dict[str, Shot]) -> None:
    shot = shots["Y"]
    spoilt = shot.photo.copy()
    spoilt[:, :70] = np.random.default_rng(0).random((150, 70))
    region = (82, 30, 90, 90)
    result = estimate_variational(
        spoilt, shot.true.camera, blur_px=BOUND, region=region, run=Run(2)
    )
    same = estimate_variational(
        shot.photo, shot.true.camera, blur_px=BOUND, region=region, run=Run(2)
    )
    assert result.kernel.camera is shot.true.camera
    assert result.scales == same.scales
    assert result.scales[-1].width == 90
    assert cosine(shot.true, result.kernel) > 0.75


def test_clipped_pixels_are_not_believed(small: Shot) -> None:
    clipped = np.zeros(small.photo.shape, bool)
    clipped[30:50, 50:75] = True
    photo = np.where(clipped, np.float32(1), small.photo)
    masked = estimate_variational(photo, small.true.camera, clipped=clipped, blur_px=8, run=Run(2))
    plain = estimate_variational(photo, small.true.camera, blur_px=8, run=Run(2))
    assert cosine(small.true, masked.kernel) > 0.7
    assert cosine(small.true, masked.kernel) > cosine(small.true, plain.kernel)


def test_the_bound_is_chosen_where_none_is_given(small: Shot) -> None:
    shares: list[float] = []
    result = estimate_variational(
        small.photo,
        small.true.camera,
        run=Run(2, lambda share, _text: shares.append(share)),
    )
    assert cosine(small.true, result.kernel) > 0.75
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_the_prior_on_rolls_takes_them_away(sharp: np.ndarray) -> None:
    reduced = cv2.resize(sharp, (130, 100), interpolation=cv2.INTER_AREA)
    shot = shoot(reduced, Camera.from_focal(130.0, 100, 130), (0, 0, 6))
    spreads = []
    for rate in (0.0, 1.0):
        result = estimate_variational(
            shot.photo, shot.true.camera, blur_px=8, roll_rate=rate, run=Run(2)
        )
        spreads.append(float(np.sqrt(result.kernel.weights @ result.kernel.theta[:, 2] ** 2)))
    assert spreads[0] > 0.6 * np.sqrt(shot.true.weights @ shot.true.theta[:, 2] ** 2)
    assert spreads[1] < 0.2 * spreads[0]


def test_progress_rises_to_one(watched: Watched) -> None:
    assert watched.shares == sorted(watched.shares)
    assert watched.shares[0] >= 0
    assert watched.shares[-1] == 1
    assert len(watched.shares) > 50
    assert all(watched.texts)


def test_a_bound_too_small_is_noted(shots: dict[str, Shot]) -> None:
    shot = shots["Z"]
    region = (110, 10, 80, 80)
    result = estimate_variational(
        shot.photo, shot.true.camera, blur_px=1, region=region, run=Run(2)
    )
    assert any("--blur-size" in note for note in result.notes)


@pytest.mark.parametrize(
    ("shape", "blur", "words"),
    [
        ((40, 200), 8.0, "too few to estimate"),
        ((200, 47), 8.0, "too few to estimate"),
        ((100, 120), 51.0, "does not fit"),
        ((100, 120), 0.5, "does not fit"),
    ],
)
def test_photos_and_bounds_must_fit(shape: tuple[int, int], blur: float, words: str) -> None:
    photo = np.random.default_rng(0).random(shape, np.float32)
    with pytest.raises(EstimationError, match=words) as caught:
        estimate_variational(photo, Camera.from_focal(200.0, *shape), blur_px=blur)
    assert caught.value.hint


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_a_flat_photo_has_nothing_to_go_by(value: float) -> None:
    photo = np.full((100, 120), value, np.float32)
    with pytest.raises(EstimationError, match="no detail"):
        estimate_variational(photo, Camera.from_focal(120.0, 100, 120), blur_px=8)


def test_a_photo_all_clipped_has_nothing_to_go_by(small: Shot) -> None:
    clipped = np.ones(small.photo.shape, bool)
    with pytest.raises(EstimationError, match="clipped"):
        estimate_variational(small.photo, small.true.camera, clipped=clipped, blur_px=8)


def test_a_region_too_small_is_an_error(small: Shot) -> None:
    with pytest.raises(EstimationError, match="too few"):
        estimate_variational(small.photo, small.true.camera, blur_px=8, region=(5, 5, 40, 60))
