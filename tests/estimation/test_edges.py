from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.errors import EstimationError
from deshake.estimation import edges
from deshake.estimation.edges import FAINT, SETTINGS, EdgeSetting, estimate_edges
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur


def photograph() -> np.ndarray:
    """A face and a rocket in linear light, (256, 256)."""
    grey = data.astronaut() @ np.array([0.3, 0.59, 0.11]) / 255
    return (cv2.resize(grey, (256, 256), interpolation=cv2.INTER_AREA) ** 2.2).astype(np.float32)


def shaken(camera: Camera, path: np.ndarray) -> tuple[np.ndarray, RotationKernel]:
    """Blur the photograph by a path in grid steps; cut off what saw beyond it; add noise."""
    sharp = photograph()
    margin = (sharp.shape[0] - camera.height) // 2
    kernel = RotationKernel.from_path(path * grid_steps(camera), camera).centred()
    blurred = ShakeBlur(kernel, margin=margin, kind="warps").forward(sharp)
    noise = np.random.default_rng(0).normal(scale=0.003, size=blurred.shape)
    return (blurred + noise).astype(np.float32), kernel


def blur_of(kernel: RotationKernel, margin: int) -> np.ndarray:
    return ShakeBlur(kernel, margin=margin, kind="warps").forward(photograph())


def misfit(found: RotationKernel, true: RotationKernel) -> float:
    """How differently two kernels blur, in what the true one blurs; over small turns the least."""
    margin = (256 - true.camera.height) // 2
    want = blur_of(true, margin)
    still = blur_of(RotationKernel.delta(true.camera), margin)
    turns = [np.array([x, y, 0]) * true.steps for x in (-1, 0, 1) for y in (-1, 0, 1)]
    got = [
        blur_of(RotationKernel(found.theta + t, found.weights, found.steps, found.camera), margin)
        for t in turns
    ]
    least = min(np.square(g - want).mean() for g in got)
    return float(np.sqrt(least / np.square(still - want).mean()))


@pytest.fixture(scope="module")
def uniform() -> tuple[np.ndarray, RotationKernel]:
    path = np.array([[-3.0, -4, 0], [0, -1, 0], [1, 2, 0], [-1, 4, 0]])
    return shaken(Camera.uniform(232, 232), path)


@pytest.fixture(scope="module")
def rolled() -> tuple[np.ndarray, RotationKernel]:
    path = np.array([[-1.0, -3, -4], [0, 0, -1], [2, 1, 1], [1, 3, 4]])
    return shaken(Camera.from_focal(250.0, 232, 232), path)


def test_finds_a_uniform_blur(uniform) -> None:
    grey, true = uniform
    found = estimate_edges(grey, true.camera, axes=(True, True, False), threads=1).kernel
    assert np.abs(found.theta[:, 2]).max() < 1e-9
    assert misfit(found, true) < 0.3
    np.testing.assert_allclose(found.weights @ found.theta, 0, atol=1e-3 * found.steps.max())


def test_the_last_steps_bring_a_uniform_blur_nearer_the_truth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = np.array([[5.0, -5, 0], [-5, -2, 0], [3, 1, 0], [3, 6, 0]])
    grey, true = shaken(Camera.uniform(232, 232), path)
    how = {"axes": (True, True, False), "setting": SETTINGS[1], "threads": 1}
    noise = np.random.default_rng(1).normal(scale=0.02, size=grey.shape).astype(np.float32)
    finished = estimate_edges(grey, true.camera, **how).kernel
    noisy = estimate_edges(grey + noise, true.camera, **how).kernel
    monkeypatch.setattr(edges, "_FINISHING", 0)
    before = estimate_edges(grey, true.camera, **how).kernel
    assert misfit(finished, true) < 0.7 * misfit(before, true)
    noisy_before = estimate_edges(grey + noise, true.camera, **how).kernel
    np.testing.assert_array_equal(noisy.weights, noisy_before.weights)


def test_finds_a_rotation_about_all_axes(rolled) -> None:
    grey, true = rolled
    found = estimate_edges(grey, true.camera, threads=1).kernel
    assert found.camera.shape == grey.shape
    assert misfit(found, true) < 0.4
    roll = np.sqrt(found.weights @ found.theta[:, 2] ** 2)
    assert 0.6 < roll / np.sqrt(true.weights @ true.theta[:, 2] ** 2) < 1.4


def test_wide_kernels_are_estimated_at_a_coarser_scale(
    rolled, monkeypatch: pytest.MonkeyPatch
) -> None:
    grey, true = rolled
    monkeypatch.setattr(edges, "_WIDEST", 6.0)
    found = estimate_edges(grey, true.camera, threads=1)
    assert found.kernel.camera is true.camera
    assert found.kernel.steps[0] > 1.3 * true.steps[0]
    assert found.latent.shape[1] < grey.shape[0] / 1.3
    assert misfit(found.kernel, true) < 0.4


def test_threads_and_exposure_change_nothing(rolled) -> None:
    grey, true = rolled
    small = cv2.resize(grey, (120, 120), interpolation=cv2.INTER_AREA)
    camera = true.camera.scaled(120, 120)
    one = estimate_edges(small, camera, threads=1)
    three = estimate_edges(small, camera, threads=3)
    assert one.kernel.theta.tobytes() == three.kernel.theta.tobytes()
    assert one.kernel.weights.tobytes() == three.kernel.weights.tobytes()
    darker = estimate_edges(small / 4, camera, threads=1)  # by a power of two, exactly
    assert darker.kernel.weights.tobytes() == one.kernel.weights.tobytes()


def test_the_blur_stays_within_its_bound(rolled) -> None:
    grey, true = rolled
    found = estimate_edges(grey, true.camera, blur_px=2, threads=1).kernel
    assert np.ptp(np.rint(found.theta / found.steps), axis=0).max() <= 2 * 3


def test_clipped_lights_are_left_out(rolled) -> None:
    grey, true = rolled
    most = np.quantile(grey, 0.97)
    clipped = (grey >= most).astype(np.uint8)
    usable = cv2.dilate(clipped, np.ones((3, 3), np.uint8)) == 0
    found = estimate_edges(np.minimum(grey, most), true.camera, usable=usable, threads=1).kernel
    assert misfit(found, true) < 0.45


def test_a_steady_photo_has_no_shake() -> None:
    camera = Camera.from_focal(280.0, 256, 256)
    found = estimate_edges(photograph(), camera, threads=1).kernel
    assert found.extent_px() < 4


def test_faint_tails_are_kept() -> None:
    camera = Camera.uniform(232, 232)
    rest = np.repeat([[0.0, 2, 0]], 24, 0)  # three steps in four at rest, then away
    path = np.concatenate([rest, [[0.0, 1, 0], [0, -8, 0]]]) * grid_steps(camera)
    durations = np.concatenate([np.ones(24), [8.0]])
    true = RotationKernel.from_path(path, camera, durations=durations).centred()
    blurred = ShakeBlur(true, margin=12, kind="warps").forward(photograph())
    plain, faint = (
        estimate_edges(blurred, camera, setting=setting, threads=1).kernel
        for setting in (SETTINGS[0], FAINT)
    )
    assert misfit(faint, true) < misfit(plain, true)


def test_progress_runs_to_one(uniform) -> None:
    grey, true = uniform
    small = cv2.resize(grey, (100, 100), interpolation=cv2.INTER_AREA)
    seen: list[tuple[float, str]] = []
    setting = EdgeSetting("any", 4e-2, 5e-3, 1)
    camera = true.camera.scaled(100, 100)
    estimate_edges(
        small, camera, setting=setting, threads=1, progress=lambda *now: seen.append(now)
    )
    shares = [share for share, _ in seen]
    assert shares[0] == 0
    assert shares[-1] == 1
    assert shares == sorted(shares)


def test_flat_photos_are_refused() -> None:
    with pytest.raises(EstimationError):
        estimate_edges(np.zeros((64, 64), np.float32), Camera.from_focal(64.0, 64, 64))


def in_display(grey: np.ndarray) -> np.ndarray:
    return np.clip(grey, 0, 1) ** (1 / 2.2)


def with_jpeg(grey: np.ndarray) -> np.ndarray:
    codes = np.rint(255 * in_display(grey)).astype(np.uint8)
    quality = [cv2.IMWRITE_JPEG_QUALITY, 75]
    return cv2.imdecode(cv2.imencode(".jpg", codes, quality)[1], cv2.IMREAD_GRAYSCALE) / 255


@pytest.mark.parametrize(
    ("file", "exposure"),
    [(in_display, 1.0), (with_jpeg, 1.0), (in_display, 1.6)],
    ids=["8 bit", "jpeg", "clipped"],
)
def test_finds_a_shake_in_files_as_cameras_write_them(rolled, file, exposure) -> None:
    grey, true = rolled
    codes = np.clip(np.rint(255 * file(exposure * grey)), 0, 255)
    read = ((codes / 255) ** 2.2).astype(np.float32)
    usable = codes < 255
    assert (exposure > 1) == (usable.mean() < 0.97)
    how = {"usable": usable, "blur_px": 10, "setting": SETTINGS[1], "threads": 1}
    assert misfit(estimate_edges(read, true.camera, **how).kernel, true) < 0.35
