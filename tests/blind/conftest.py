"""A photograph that was shaken exactly by a known kernel, and the result of its race."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
import scipy.ndimage
from skimage import data

from deshake.blind.course import Course
from deshake.blind.race import race
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.warps import Warps
from deshake.run import Run
from deshake.signal.pyramid import Pyramid

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from deshake.blind.finish import Finish

SHAPE = 150, 180
MARGIN = 16
PATH = np.array([[-1.0, -4, -2], [0, 0, 0], [2, 1, 0], [1, 4, 3]])  # in grid steps
NOISE = 0.003


@dataclass(frozen=True)
class Shaken:
    """A shaken photo, its sharp picture and its kernel.

    The sharp picture lies around the photo: it is larger by a margin on every side.
    """

    grey: np.ndarray
    camera: Camera
    kernel: RotationKernel
    sharp: np.ndarray
    margin: int

    @property
    def still(self) -> np.ndarray:
        """The photo that a still camera would take."""
        return self.sharp[self.margin : -self.margin, self.margin : -self.margin]

    @property
    def pyramid(self) -> Pyramid:
        return Pyramid(self.grey, self.camera)


def _shake(camera: Camera | None = None, path: np.ndarray = PATH, noise: float = NOISE) -> Shaken:
    camera = camera or Camera.from_focal(float(SHAPE[1]), *SHAPE)
    margin = MARGIN
    grey = data.coffee() @ np.array([0.3, 0.59, 0.11]) / 255
    size = camera.width + 2 * margin, camera.height + 2 * margin
    sharp = (cv2.resize(grey, size, interpolation=cv2.INTER_AREA) ** 2.2).astype(np.float32)
    kernel = RotationKernel.from_path(path * grid_steps(camera), camera).centred()
    blurred = Warps(camera, kernel.theta, margin=margin).blur(sharp, kernel.weights)
    grain = np.random.default_rng(0).normal(scale=noise, size=camera.shape)
    return Shaken((blurred + grain).astype(np.float32), camera, kernel, sharp, margin)


@pytest.fixture(scope="session")
def shake() -> Callable[..., Shaken]:
    """Shake the photograph by a path (T, 3) in grid steps of a camera."""
    return _shake


def _widened(kernel: RotationKernel, width: float) -> RotationKernel:
    """Smooth a kernel on its grid by a Gaussian of a width in grid steps."""
    kernel = kernel.resampled(kernel.steps, ALL_AXES)
    low = kernel.indices.min(0) - 4
    box = np.zeros(np.ptp(kernel.indices, axis=0) + 9)
    box[tuple((kernel.indices - low).T)] = kernel.weights
    sigma = [width if turns else 0.0 for turns in np.ptp(kernel.indices, axis=0) > 0]
    box = scipy.ndimage.gaussian_filter(box, sigma)
    used = np.argwhere(box > 1e-4)
    wide = RotationKernel.from_indices(used + low, box[tuple(used.T)], kernel.steps, kernel.camera)
    return wide.centred()


@pytest.fixture(scope="session")
def widened() -> Callable[..., RotationKernel]:
    """Smooth a kernel on its grid by a Gaussian of a width in grid steps."""
    return _widened


@pytest.fixture(scope="session")
def shaken() -> Shaken:
    """A photo shaken by some twelve pixels, the roll being a third of it."""
    return _shake()


@pytest.fixture(scope="session")
def photo() -> Shaken:
    """A photo of 300 x 400 pixels: the spectra need three tiles of 64."""
    path = np.array([[0.0, -8, -3], [3, -2, 0], [-1, 3, 1], [2, 9, 3]])
    return _shake(Camera.from_focal(400.0, 300, 400), path=path)


@pytest.fixture(scope="session")
def pyramid(shaken) -> Pyramid:
    return shaken.pyramid


@pytest.fixture(scope="session")
def still(shaken) -> Pyramid:
    """The same photo of a camera that stood still."""
    return Pyramid(np.ascontiguousarray(shaken.still), shaken.camera)


@pytest.fixture(scope="session")
def soft(photo) -> Pyramid:
    """A photo that is a little soft, with little noise."""
    grain = np.random.default_rng(0).normal(0, 0.01, photo.still.shape)
    picture = (cv2.GaussianBlur(photo.still, (0, 0), 0.7) + grain).clip(0, 1)
    return Pyramid(picture.astype(np.float32), photo.camera)


@pytest.fixture(scope="session")
def grainy(still) -> Pyramid:
    """The same photo with so much noise that no kernel can be trusted."""
    grain = np.random.default_rng(0).normal(0, 0.1, still.camera.shape)
    picture = np.clip(still.at(0).picture + grain, 0, 1).astype(np.float32)
    return Pyramid(picture, still.camera)


@pytest.fixture(scope="session")
def shares() -> list[float]:
    """Shares of the work done that the race of `ended` reports."""
    return []


@pytest.fixture(scope="session")
def ended(shaken, shares) -> Finish:
    """How the race for the shaken photo ends."""
    return race(shaken.pyramid, run=Run(1, lambda share, _: shares.append(share)))


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[str | int]:
    """The first scales of the starts that a race runs, and "others" for those without edges."""
    log: list[str | int] = []
    start, begin_others = Course.start, Course.begin_others

    def logged(self: Course, starts: Sequence[int], run: Run) -> None:
        log.extend(starts)
        start(self, starts, run)

    def others_logged(self: Course, run: Run) -> None:
        log.append("others")
        begin_others(self, run)

    monkeypatch.setattr(Course, "start", logged)
    monkeypatch.setattr(Course, "begin_others", others_logged)
    return log
