from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
import pytest

from deshake.blind.variational import estimate, priors, scales
from deshake.blind.variational.estimate import estimate_variational
from deshake.blind.variational.settings import SETTINGS
from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur
from deshake.restore.richardson_lucy import richardson_lucy
from deshake.run import Run

if TYPE_CHECKING:
    from deshake.blind.result import BlindEstimate

pytestmark = pytest.mark.long

HEIGHT, WIDTH = 80, 104
CAMERA = Camera.from_focal(float(WIDTH), HEIGHT, WIDTH)
BORDER = 11
BOUND = 7.0  # px
TURNS = {"Y": (0, 6, 0), "Z": (0, 0, 6)}  # grid steps from end to end
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
def reduced(sharp: np.ndarray) -> np.ndarray:
    """A photograph so small that its estimates take little time."""
    return cv2.resize(sharp, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)


@pytest.fixture(scope="module")
def shots(reduced: np.ndarray) -> dict[str, Shot]:
    return {name: shoot(reduced, CAMERA, turn) for name, turn in TURNS.items()}


@pytest.fixture(scope="module")
def shot(shots: dict[str, Shot]) -> Shot:
    """A shot turned about Y."""
    return shots["Y"]


class Watched(NamedTuple):
    """An estimate, and the reports of its progress."""

    result: BlindEstimate
    shares: list[float]
    texts: list[str]


@pytest.fixture(scope="module")
def watched(shots: dict[str, Shot]) -> dict[str, Watched]:
    """Estimate the kernel of each shot, once."""

    def watch(name: str) -> Watched:
        reports: list[tuple[float, str]] = []
        result = estimate_variational(
            shots[name].photo,
            CAMERA,
            blur_px=BOUND,
            roll_rate=RATES[name],
            run=Run(1, lambda share, text: reports.append((share, text))),
        )
        return Watched(result, [share for share, _ in reports], [text for _, text in reports])

    return {name: watch(name) for name in shots}


@pytest.fixture
def few_iterations(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let estimates take a few iterations at each scale; other tests prove the quality."""
    monkeypatch.setattr(scales, "SETTINGS", replace(SETTINGS, iterations=3))


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
    done = richardson_lucy(shot.photo, kernel, iterations=25, accelerated=False, run=Run(1))
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
    name: str, shots: dict[str, Shot], watched: dict[str, Watched]
) -> None:
    shot, result = shots[name], watched[name].result
    assert result.kernel.camera is CAMERA
    assert cosine(shot.true, result.kernel) > 0.85
    assert gain(shot, result.kernel) > 2
    assert np.all(np.abs(result.kernel.centroid) < 1e-6)
    assert result.confidence > 0.8
    assert result.notes == []


@pytest.mark.usefixtures("few_iterations")
def test_strong_noise_leaves_the_kernel_right(shot: Shot) -> None:
    display = shot.photo ** (1 / 2.2)
    display = display + np.random.default_rng(1).normal(0, 10 / 255, shot.photo.shape)
    noisy = ((np.rint(255 * np.clip(display, 0, 1)) / 255) ** 2.2).astype(np.float32)
    result = estimate_variational(noisy, CAMERA, blur_px=BOUND, run=Run(1))
    assert cosine(shot.true, result.kernel) > 0.7


def test_scales_are_reported_from_coarse_to_fine(watched: dict[str, Watched]) -> None:
    reported = watched["Y"].result.scales
    assert (reported[-1].height, reported[-1].width) == (HEIGHT, WIDTH)
    widths = [scale.width for scale in reported]
    assert widths == sorted(widths)
    assert len(widths) > 3
    assert all(scale.rotations > 0 and scale.noise > 0 for scale in reported)
    assert np.isfinite([scale.free_energy for scale in reported]).all()


@pytest.mark.usefixtures("few_iterations")
def test_a_uniform_kernel_is_recovered_by_the_uniform_model(reduced: np.ndarray) -> None:
    shot = shoot(reduced, Camera.uniform(HEIGHT, WIDTH), (2, 6, 0))
    result = estimate_variational(shot.photo, CAMERA, blur_px=BOUND, uniform=True, run=Run(1))
    assert np.all(np.abs(result.kernel.theta[:, 2]) < 1e-9)
    assert result.kernel.camera.is_uniform
    assert cosine(shot.true, result.kernel) > 0.85
    assert gain(shot, result.kernel) > 1


def test_threads_do_not_change_a_byte(shot: Shot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scales, "SETTINGS", replace(SETTINGS, iterations=1))
    how = {"blur_px": BOUND, "region": (20, 10, 60, 60)}
    one, two = (estimate_variational(shot.photo, CAMERA, **how, run=Run(n)) for n in (1, 2))
    for name in ("theta", "weights", "steps"):
        assert getattr(one.kernel, name).tobytes() == getattr(two.kernel, name).tobytes()
    assert one.confidence == two.confidence
    assert one.scales == two.scales


@pytest.mark.usefixtures("few_iterations")
def test_the_kernel_of_a_reduced_photo_belongs_to_the_whole(
    shot: Shot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimate, "SETTINGS", replace(SETTINGS, longest_side=83))
    result = estimate_variational(shot.photo, CAMERA, blur_px=BOUND, run=Run(1))
    assert result.scales[-1].width == 83
    assert result.kernel.camera is CAMERA
    spread = [np.sqrt(k.weights @ k.theta[:, 1] ** 2) for k in (result.kernel, shot.true)]
    assert spread[0] == pytest.approx(spread[1], rel=0.25)
    assert cosine(shot.true, result.kernel) > 0.75
    assert gain(shot, result.kernel) > 0.5


@pytest.mark.usefixtures("few_iterations")
def test_a_region_speaks_for_the_whole_photo(shot: Shot) -> None:
    spoilt = shot.photo.copy()
    spoilt[:, :36] = np.random.default_rng(0).random((HEIGHT, 36))
    region = (40, 10, 60, 60)
    result, same = (
        estimate_variational(photo, CAMERA, blur_px=BOUND, region=region, run=Run(1))
        for photo in (spoilt, shot.photo)
    )
    assert result.kernel.camera is CAMERA
    assert result.scales == same.scales
    assert result.scales[-1].width == 60
    assert cosine(shot.true, result.kernel) > 0.7


@pytest.mark.usefixtures("few_iterations")
def test_clipped_pixels_are_ignored(shot: Shot) -> None:
    clipped = np.zeros(shot.photo.shape, bool)
    clipped[24:40, 40:60] = True
    photo = np.where(clipped, np.float32(1), shot.photo)
    how = {"blur_px": BOUND, "region": (16, 6, 68, 68), "run": Run(1)}
    masked = estimate_variational(photo, CAMERA, clipped=clipped, **how)
    plain = estimate_variational(photo, CAMERA, **how)
    assert cosine(shot.true, masked.kernel) > 0.7
    assert cosine(shot.true, masked.kernel) > cosine(shot.true, plain.kernel)


@pytest.mark.usefixtures("few_iterations")
def test_the_bound_is_chosen_where_none_is_given(shot: Shot) -> None:
    shares: list[float] = []
    result = estimate_variational(
        shot.photo,
        CAMERA,
        region=(16, 6, 68, 68),
        run=Run(1, lambda share, _text: shares.append(share)),
    )
    assert cosine(shot.true, result.kernel) > 0.75
    assert shares == sorted(shares)
    assert shares[-1] == 1


@pytest.mark.usefixtures("few_iterations")
def test_the_prior_on_rolls_takes_them_away(
    shots: dict[str, Shot], watched: dict[str, Watched]
) -> None:
    shot = shots["Z"]
    strict = estimate_variational(shot.photo, CAMERA, blur_px=BOUND, roll_rate=1.0, run=Run(1))
    free, held, true = (
        float(np.sqrt(kernel.weights @ kernel.theta[:, 2] ** 2))
        for kernel in (watched["Z"].result.kernel, strict.kernel, shot.true)
    )
    assert free > 0.6 * true
    assert held < 0.2 * free


def test_progress_rises_to_one(watched: dict[str, Watched]) -> None:
    _, shares, texts = watched["Y"]
    assert shares == sorted(shares)
    assert shares[0] >= 0
    assert shares[-1] == 1
    assert len(shares) > 50
    assert all(texts)


@pytest.mark.usefixtures("few_iterations")
def test_a_bound_too_small_is_noted(shots: dict[str, Shot]) -> None:
    photo, region = shots["Z"].photo, (44, 10, 60, 60)
    result = estimate_variational(photo, CAMERA, blur_px=1, region=region, run=Run(1))
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
def test_a_flat_photo_is_an_error(value: float) -> None:
    photo = np.full((100, 120), value, np.float32)
    with pytest.raises(EstimationError, match="no detail"):
        estimate_variational(photo, Camera.from_focal(120.0, 100, 120), blur_px=8)


def test_a_photo_all_clipped_is_an_error(shot: Shot) -> None:
    clipped = np.ones(shot.photo.shape, bool)
    with pytest.raises(EstimationError, match="clipped"):
        estimate_variational(shot.photo, CAMERA, clipped=clipped, blur_px=BOUND)


def test_a_region_too_small_is_an_error(shot: Shot) -> None:
    with pytest.raises(EstimationError, match="too few"):
        estimate_variational(shot.photo, CAMERA, blur_px=BOUND, region=(5, 5, 40, 60))
