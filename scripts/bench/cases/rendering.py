"""Render the cases of `bench.cases.shakes`.

Nothing of deshake is used here, so that no error of deshake can hide. A scene is reduced in linear
light to the wanted size, with a margin. A recorded hand turns the camera, and exact warps are
averaged at about every half pixel of its path. Pixels that lack a part of the path are cropped. The
noise of photons and readout is added, and a JPEG with EXIF, or a 16-bit PNG, is written. Light
becomes display values as a file states them, or as a camera makes them (`camera_files`).
"""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures

from bench.cases.camera_paths import (
    DIAGONAL,
    Angles,
    hand_window,
    homographies,
    moved,
    path_in,
)
from bench.cases.night import by_night
from bench.cases.scenes import SCENES, Places
from bench.cases.shakes import Case, case_file
from bench.errors import MissingDataError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

__all__ = [
    "NOISES",
    "PLAIN",
    "Image",
    "Way",
    "disk",
    "is_rendered",
    "noisy",
    "render",
    "to_display",
]

Image = NDArray[np.float32]

OVERSAMPLED = 1.2e6  # pixels up to which any scene is warped at twice the size
OVERSAMPLED_LARGE = 3.2e6  # pixels up to which a scene that is large enough is, too
NOISES = {"low": (1e-4, 1.5e-3), "mid": (4e-4, 3e-3), "high": (1e-3, 6e-3)}
"""Variance at white of the photons' noise, and standard deviation of the readout's."""
FINE_COLOURS = 92  # quality from which a JPEG keeps colours at full size


class Way(NamedTuple):
    """How linear light becomes display values, 0..1: its name, for the truth, and for a photo."""

    name: str
    truth: Callable[[Image], Image]
    photo: Callable[[Image, Case], Image]


class Frame(NamedTuple):
    """The frame of a photo: its size, the scene's margins (x, y), and the camera's path."""

    height: int
    width: int
    margin: tuple[int, int]
    focal: float
    theta: Angles


def to_linear(codes: NDArray[np.uint8]) -> Image:
    """Decode sRGB."""
    shown = np.arange(256) / 255
    table = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    return table.astype(np.float32)[codes]


def to_display(light: Image) -> Image:
    """Encode as sRGB, 0..1."""
    light = np.clip(light, 0, 1)
    return np.where(
        light <= 0.0031308, 12.92 * light, np.float32(1.055) * light ** np.float32(1 / 2.4) - 0.055
    ).astype(np.float32)


def read_scene(name: str, places: Places) -> Image:
    """Read a scene in linear light, grey or BGR; or lay out four, cropped to one size."""
    parts = []
    for one in name.split("+"):
        codes = cv2.imread(str(places.scene(one)), cv2.IMREAD_ANYCOLOR)
        if codes is None:
            raise MissingDataError(f"{SCENES[one].path} is damaged")
        parts.append(codes)
    if len(parts) == 1:
        return to_linear(parts[0])
    height, width = (min(part.shape[axis] for part in parts) for axis in (0, 1))
    parts = [middle(part, height, width) for part in parts]
    return to_linear(np.vstack([np.hstack(parts[:2]), np.hstack(parts[2:])]))


def middle(codes: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    """Crop the middle."""
    top, left = (codes.shape[0] - height) // 2, (codes.shape[1] - width) // 2
    return codes[top : top + height, left : left + width]


def largest_scale(case: Case) -> float:
    """Return how far a case's scene may be enlarged; 1: not at all."""
    return SCENES[case.scene].enlarged if case.scene in SCENES else 1.0


def framed(case: Case, shape: Sequence[int], window: Angles | None) -> Frame:
    """Fit the frame, its margins and the path to each other and to a scene's shape."""
    largest = largest_scale(case)
    scale = min(largest, math.sqrt(case.size * 1e6 / (shape[0] * shape[1])))
    still = math.ceil(3 * case.blur)
    margin = (still, still) if window is None else (0, 0)
    for _ in range(8):  # each depends a little on the others
        width, height = (
            int(scale * side) - 2 * edge for side, edge in zip(shape[1::-1], margin, strict=True)
        )
        focal = case.film / DIAGONAL * math.hypot(height, width)
        theta = np.zeros((1, 3)) if window is None else path_in(window, case, focal, height, width)
        frame = Frame(height, width, margin, focal, theta)
        if window is not None:
            far = np.abs(moved(theta, focal, height, width)).max((0, 1))
            margin = (math.ceil(far[0]) + 4, math.ceil(far[1]) + 4)
        scale = min(largest, scale * math.sqrt(case.size * 1e6 / (height * width)))
    return frame


def fine_scene(scene: Image, frame: Frame, largest: float) -> tuple[Image, int]:
    """Bring a scene to the frame's size and margins, once or twice over."""
    height, width = frame.height + 2 * frame.margin[1], frame.width + 2 * frame.margin[0]
    pixels = frame.height * frame.width
    reduced = height / scene.shape[0]
    over = 1
    if len(frame.theta) > 1 and (
        pixels <= OVERSAMPLED or (pixels <= OVERSAMPLED_LARGE and reduced <= largest / 2)
    ):
        over = 2
    way = cv2.INTER_AREA if over * reduced < 1 else cv2.INTER_CUBIC
    if over * reduced == 1:
        return scene, over
    fine = cv2.resize(scene, (over * width, over * height), interpolation=way)
    return np.clip(fine, 0, 1), over


def cut(fine: Image, frame: Frame, over: int) -> Image:
    """Cut the frame out of a scene, and reduce it to the photo's pixels."""
    left, top = (over * one for one in frame.margin)
    inner = fine[top : top + over * frame.height, left : left + over * frame.width]
    return reduced_by(inner, over)


def reduced_by(image: Image, over: int) -> Image:
    """Reduce an image by a whole number."""
    if over == 1:
        return image
    size = image.shape[1] // over, image.shape[0] // over
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def shake(fine: Image, frame: Frame, over: int) -> Image:
    """Average the warps of a scene; plane by plane, which is what OpenCV does fast."""
    size = over * frame.width, over * frame.height
    half = (over - 1) / (2 * over)  # of a photo's pixel: centres of fine and of photo's pixels
    out_of = np.array([[1 / over, 0, -half], [0, 1 / over, -half], [0, 0, 1]])
    across, down = frame.margin
    into = np.array([[over, 0, over * (across + half)], [0, over, over * (down + half)], [0, 0, 1]])
    turned = homographies(frame.theta, frame.focal, frame.height, frame.width)
    ways = [into @ h @ out_of for h in turned]
    planes = []
    for plane in cv2.split(fine):
        total = np.zeros((size[1], size[0]), np.float32)
        for way in ways:
            flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
            border = cv2.BORDER_REFLECT
            cv2.accumulate(cv2.warpPerspective(plane, way, size, None, flags, border), total)
        planes.append(reduced_by(total / np.float32(len(ways)), over))
    return np.maximum(cv2.merge(planes) if len(planes) > 1 else planes[0], 0)


def disk(radius: float, fine: int = 16) -> Image:
    """Draw a disk with edges as soft as so many samples a pixel make them; its sum is 1."""
    side = 2 * math.ceil(radius) + 3
    place = (np.arange(side * fine) + 0.5) / fine - side / 2
    inside = (place[:, None] ** 2 + place**2 <= radius**2).astype(np.float32)
    drawn = inside.reshape(side, fine, side, fine).mean((1, 3))
    return drawn / drawn.sum()


def blurred(case: Case, fine: Image, frame: Frame, over: int) -> Image:
    """Blur a scene as the case says."""
    if case.shaken:
        return shake(fine, frame, over)
    if case.kind == "soft":
        fine = cv2.GaussianBlur(fine, (0, 0), case.blur)
    elif case.kind == "out of focus":
        fine = cv2.filter2D(fine, -1, disk(case.blur), borderType=cv2.BORDER_REFLECT)
    return cut(fine, frame, over)


def noisy(light: Image, case: Case) -> Image:
    """Add the noise of photons and readout."""
    photons, readout = NOISES[case.noise]
    noise = np.random.default_rng(case.seed).standard_normal(light.shape, np.float32)
    noise *= np.sqrt(np.float32(photons) * np.clip(light, 0, 1) + np.float32(readout**2))
    return light + noise


def plain(light: Image, case: Case) -> Image:
    """Return the display values of a photo whose file states its curve."""
    return to_display(noisy(light, case))


PLAIN = Way("plain", to_display, plain)


def save(path: Path, shown: Image, case: Case) -> None:
    """Write display values, as a JPEG with the focal length in its EXIF or as a 16-bit PNG."""
    if not case.quality:
        cv2.imwrite(str(path), np.rint(65535 * shown).astype(np.uint16))
        return
    codes = np.rint(255 * shown).astype(np.uint8)
    picture = Pictures.fromarray(codes if codes.ndim == 2 else codes[..., ::-1].copy())
    exif = picture.getexif()
    exif[0x010F] = "shake_cases"
    exif.get_ifd(0x8769)[0xA405] = case.film
    sampling = 0 if case.quality >= FINE_COLOURS else 2
    options = {} if shown.ndim == 2 else {"subsampling": sampling}
    picture.save(path, quality=case.quality, exif=exif, **options)


def is_rendered(case: Case, folder: Path, way: Way = PLAIN) -> bool:
    """Whether the folder has a case, with the same settings as the list."""
    file = case_file(folder, case, ".json")
    record = json.loads(file.read_text("utf-8")) if file.is_file() else {}
    return record.get("case") == list(case) and record.get("way", PLAIN.name) == way.name


def render(case: Case, split: str, places: Places, folder: Path, way: Way = PLAIN) -> bool:
    """Render a case into a folder, unless it is there; return whether it was rendered.

    Raises
    ------
    MissingDataError
        If its scene or recording is not there.

    """
    if is_rendered(case, folder, way):
        return False
    cv2.setNumThreads(1)
    window = hand_window(case, places.hand(split, case.hand)) if case.shaken else None
    scene = read_scene(case.scene, places)
    frame = framed(case, scene.shape, window)
    fine, over = fine_scene(scene, frame, largest_scale(case))
    del scene
    if case.at_night:
        fine = by_night(fine, case, over)
    folder.mkdir(parents=True, exist_ok=True)
    sharp = np.rint(255 * way.truth(cut(fine, frame, over))).astype(np.uint8)
    cv2.imwrite(str(case_file(folder, case, "_sharp.png")), sharp, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    save(folder / case.photo, way.photo(blurred(case, fine, frame, over), case), case)
    if case.shaken:
        np.savez(case_file(folder, case, "_path.npz"), theta=frame.theta, f=frame.focal)
    case_file(folder, case, "_base.json").unlink(missing_ok=True)
    record = {
        "case": list(case),
        "way": way.name,
        "shape": [frame.height, frame.width],
        "focal_px": frame.focal,
        "focal_35mm": case.film,
        "warps": len(frame.theta),
        "oversampled": over,
    }
    case_file(folder, case, ".json").write_text(json.dumps(record) + "\n", "utf-8")
    return True
