"""What every room's tests share: the command line, a camera's RAW file, photos."""

from __future__ import annotations

import os
import signal
import struct
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.cli.main import main
from deshake.geometry.camera import Camera

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence

    from numpy.typing import NDArray

# Fixtures that the tests of several rooms share.
pytest_plugins = ["support.laboratory", "support.metadata_blocks"]


WORKER = "PYTEST_XDIST_WORKER"  # what pytest-xdist calls the process: gw0, gw1

XYZ_FROM_SRGB = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
SENSOR_FROM_XYZ = np.array(
    [[0.6446, -0.0366, -0.0864], [-0.4436, 1.2204, 0.2513], [-0.0952, 0.2496, 0.6348]]
)


def _directory(entries: dict[int, tuple[str, Sequence[float]]], at: int) -> bytes:
    """Write a TIFF directory that lies at an offset, and its values behind it."""
    kinds = {"B": 1, "c": 2, "H": 3, "I": 4, "r": 5, "i": 10}
    head, behind = struct.pack("<H", len(entries)), b""
    for tag, (kind, values) in sorted(entries.items()):
        if kind == "c":
            raw, count = bytes(values) + b"\0", len(values) + 1
        elif kind in "ri":
            parts = [part for x in values for part in (round(x * 10**6), 10**6)]
            raw, count = struct.pack(f"<{len(parts)}i", *parts), len(values)
        else:
            raw, count = struct.pack(f"<{len(values)}{kind}", *values), len(values)
        head += struct.pack("<HHI", tag, kinds[kind], count)
        if len(raw) > 4:
            head += struct.pack("<I", at + 2 + 12 * len(entries) + 4 + len(behind))
            behind += raw + bytes(len(raw) % 2)
        else:
            head += raw.ljust(4, b"\0")
    return head + bytes(4) + behind


def _dng(
    picture: NDArray[np.floating],
    *,
    neutral: Sequence[float] = (0.5, 1.0, 0.6),
    black: int = 512,
    white: int = 15000,
    orientation: int = 1,
    margin: int = 0,
    mosaic: bool = True,
    crop: tuple[int, int, int, int] | None = None,
    extra: dict[int, tuple[str, Sequence[float]]] | None = None,
    exif: dict[int, tuple[str, Sequence[float]]] | None = None,
) -> bytes:
    """Write the DNG of a sensor with a Bayer pattern (RGGB) that saw a picture.

    The picture (H, W, 3) is in linear sRGB; a grey one (H, W) is what a sensor without filters saw.
    Without a mosaic it is a DNG that was demosaiced already. Crop is left, top, width, height; the
    margin is of masked photosites, outside the picture.
    """
    height, width = picture.shape[:2]
    if picture.ndim == 3:
        response = SENSOR_FROM_XYZ @ XYZ_FROM_SRGB
        sensor = picture @ (response / response.sum(1, keepdims=True)).T * np.asarray(neutral)
        y, x = np.mgrid[:height, :width]
        seen = sensor
        if mosaic:
            seen = np.take_along_axis(sensor, (y % 2 + x % 2)[..., None], -1)[..., 0]
    else:
        seen = picture
    codes = np.clip(np.rint(black + seen * (white - black)), 0, white).astype("<u2")
    if mosaic:
        codes = np.pad(codes, margin, constant_values=black)
    samples = 1 if codes.ndim == 2 else 3
    main: dict[int, tuple[str, Sequence[float]]] = {
        254: ("I", [0]),
        256: ("I", [codes.shape[1]]),
        257: ("I", [codes.shape[0]]),
        258: ("H", [16] * samples),
        259: ("H", [1]),
        262: ("H", [32803 if picture.ndim > codes.ndim else 34892]),
        271: ("c", b"Sensor Works"),
        272: ("c", b"One"),
        274: ("H", [orientation]),
        277: ("H", [samples]),
        278: ("I", [codes.shape[0]]),
        279: ("I", [codes.nbytes]),
        50706: ("B", [1, 4, 0, 0]),
        50708: ("c", b"Sensor Works One"),
        50714: ("H", [black] * samples),
        50717: ("I", [white] * samples),
        50829: ("I", [margin, margin, margin + height, margin + width]),
    }
    if picture.ndim == 3:
        main |= {
            50721: ("i", SENSOR_FROM_XYZ.ravel().tolist()),
            50728: ("r", neutral),
            50778: ("H", [21]),
        }
    if picture.ndim > codes.ndim:
        main |= {33421: ("H", [2, 2]), 33422: ("B", [0, 1, 1, 2])}
    if crop is not None:
        main |= {50719: ("I", crop[:2]), 50720: ("I", crop[2:])}
    main |= extra or {}
    main[273] = ("I", [0])
    if exif:
        main[34665] = ("I", [8 + len(_directory(main | {34665: ("I", [0])}, 8))])
    size = len(_directory(main, 8))
    below = _directory(exif, 8 + size) if exif else b""
    main[273] = ("I", [8 + size + len(below)])
    return b"II*\0" + struct.pack("<I", 8) + _directory(main, 8) + below + codes.tobytes()


@dataclass(frozen=True)
class Outcome:
    """What a run of the command line left behind."""

    code: int
    out: str
    err: str


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Let every second process load the files backwards: it finds what the others compiled."""
    report = yield
    if isinstance(collector, pytest.Dir) and os.environ.get(WORKER, "")[-1:] in tuple("13579"):
        report.result.reverse()
    return report


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the long files, so that no process works on one alone at the end."""
    items.sort(key=lambda item: (item.get_closest_marker("long") is None, item.location[0]))


@pytest.fixture(scope="session", autouse=True)
def _interrupts():
    """Interrupts are not ignored, though the tests may run in the background of a shell."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session", autouse=True)
def _no_file_of_the_developer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Neither tests nor the programs that they start read the developer's own configuration."""
    patch = pytest.MonkeyPatch()
    patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
    yield
    patch.undo()


@pytest.fixture(scope="session", autouse=True)
def _one_thread_by_default() -> Iterator[None]:
    """By default a computation uses one thread: other files of tests run beside it."""
    cv2.setNumThreads(1)
    patch = pytest.MonkeyPatch()
    for name in ("deshake.run.available_threads", "deshake.batch.jobs.available_threads"):
        patch.setattr(name, lambda: 1)
    yield
    patch.undo()


@pytest.fixture
def environment(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Take the developer's settings out of the environment; what a test sets stays for it."""
    for name in list(os.environ):
        if name == "NO_COLOR" or name.startswith("DESHAKE_"):
            monkeypatch.delenv(name)
    return monkeypatch


@pytest.fixture
def deshake(
    capsys: pytest.CaptureFixture[str],
    environment: pytest.MonkeyPatch,  # noqa: ARG001 - without the developer's settings
) -> Callable[..., Outcome]:
    """Run the command line in this process, as its entry point does."""

    def run(*args: object) -> Outcome:
        capsys.readouterr()
        code = main([str(arg) for arg in args])
        out, err = capsys.readouterr()
        return Outcome(code, out, err)

    return run


@pytest.fixture
def make_dng() -> Callable[..., bytes]:
    return _dng


BOARD_CORNERS = (7, 5)
BOARD_CAMERA = Camera(
    np.array([[330.0, 0, 205.0], [0, 330.0, 147.0], [0, 0, 1]]), 300, 400
).with_lens(np.array([-0.2, 0.05, 0.001, -0.001, 0.0]))
BOARD_POSES = [
    ((0.5, 0.1, 0.0), (-3.2, -2.4, 9.5)),
    ((-0.5, 0.2, 0.1), (-3.0, -1.8, 10.0)),
    ((0.1, 0.6, 0.0), (-2.6, -2.2, 10.5)),
    ((0.1, -0.6, -0.1), (-3.4, -2.0, 10.0)),
    ((0.4, 0.4, 0.3), (-2.0, -2.9, 9.5)),
    ((-0.3, -0.4, -0.3), (-4.0, -1.0, 9.0)),
]


_RAYS_A_SIDE = 2


@cache
def _rays(camera: Camera) -> np.ndarray:
    height, width = (_RAYS_A_SIDE * side for side in camera.shape)
    fine = camera.scaled(height, width)
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    points = np.stack([x, y], -1).reshape(-1, 1, 2)
    rays = cv2.undistortPoints(points, fine.matrix, fine.distortion, criteria=(3, 15, 1e-7))
    return np.column_stack([rays.reshape(-1, 2), np.ones(len(points))])


def _photo_of_board(
    turn: tuple[float, float, float], place: tuple[float, float, float]
) -> np.ndarray:
    """Make the photo (h, w) uint8 of a board of unit squares, each pixel the mean of some rays."""
    height, width = BOARD_CAMERA.shape
    rays = _rays(BOARD_CAMERA)
    rotation = cv2.Rodrigues(np.array(turn))[0]
    origin = -rotation.T @ np.array(place)
    along = rays @ rotation
    board = origin[:2] - along[:, :2] * (origin[2] / along[:, 2])[:, None]
    columns, rows = BOARD_CORNERS
    inside = (board > -1).all(1) & (board < (columns, rows)).all(1)
    square = np.floor(board).astype(int).sum(1) % 2
    grey = np.where(inside & (square == 0), 25.0, 235.0).reshape(
        _RAYS_A_SIDE * height, _RAYS_A_SIDE * width
    )
    small = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
    return np.rint(cv2.GaussianBlur(small, (0, 0), 0.6)).astype(np.uint8)


@pytest.fixture(scope="session")
def boards() -> tuple[list[np.ndarray], tuple[int, int], Camera]:
    """Make photos of a chessboard; with its inner corners and the camera, whose lens distorts."""
    return [_photo_of_board(*pose) for pose in BOARD_POSES], BOARD_CORNERS, BOARD_CAMERA


@pytest.fixture(scope="session")
def sharp() -> np.ndarray:
    """A photograph in linear light, 0..1, (200, 260), sharp to the last pixel."""
    grey = data.coffee()[:, 40:560] @ np.array([0.3, 0.59, 0.11]) / 255
    small = cv2.resize(grey, (260, 200), interpolation=cv2.INTER_AREA)
    return (small**2.2).astype(np.float32)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Escape file names that are no text in the captured log: reports travel as UTF-8."""
    report = yield
    report.sections = [
        (title, text.encode("utf-8", "backslashreplace").decode())
        for title, text in report.sections
    ]
    return report
