"""The cases of `bench.py shakes`: photos with a known shake, and photos without one.

Settings are chosen on the set `tune` and judged on the set `test`. The two share no scene and no
recording (`bench.cases.scenes`). The sets `night-tune` and `night-test` are photos by night, of the
same scenes and recordings. `bench.cases.rendering` makes the photos.
"""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["CASES", "KINDS", "Case", "case_file"]

KINDS = {
    "L": "large",
    "O": "ordinary",
    "X": "other",
    "S": "sharp",
    "G": "soft",
    "D": "out of focus",
    "N": "night",
    "M": "sharp night",
}
"""Classes of cases, by the first letter of their names."""


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
        One of `bench.cases.scenes.SCENES`, or four of them: `a+b+c+d`, two by two.
    size : float
        In megapixels; less, where the scene is smaller.
    blur : float
        Extent of the shake; standard deviation of a soft photo; radius of a disk. All in pixels.
    quality : int
        Of the JPEG; 0 for a 16-bit PNG.
    noise : str
        One of `bench.cases.rendering.NOISES`.
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
        return self.name[0] in "LOXN"

    @property
    def at_night(self) -> bool:
        """Whether the scene is dark and has lamps."""
        return self.name[0] in "NM"

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
NIGHT_TUNE = [
    Case("N01", "astronaut", 0.3, 14, 92, "mid", 1 / 8, 0),
    Case("N02", "china", 0.3, 18, 90, "mid", 1 / 4, 1),
    Case("N03", "manmade", 0.7, 24, 92, "mid", 1 / 2, 2),
    Case("N04", "airplane", 0.7, 16, 90, "high", 1 / 4, 0),
    Case("N05", "glow", 1, 30, 92, "mid", 1 / 2, 1),
    Case("N06", "stands", 1, 20, 90, "mid", 1 / 4, 2),
    Case("N07", "friends", 1, 35, 92, "high", 1, 0),
    Case("N08", "cups", 1, 16, 88, "mid", 1 / 4, 1),
    Case("N09", "rocket", 0.3, 12, 92, "mid", 1 / 4, 2),
    Case("N10", "aitzgorri", 1.2, 40, 90, "mid", 1, 1),
    Case("N11", "ladybird", 1.2, 22, 92, "high", 1 / 2, 0),
    Case("N12", "bridge", 1.2, 26, 90, "mid", 1 / 2, 2),
    Case("M01", "manmade", 0.7, 0, 92, "mid"),
    Case("M02", "stands", 1, 0, 90, "mid"),
    Case("M03", "cups", 1, 0, 88, "mid"),
    Case("M04", "ladybird", 1.2, 0, 92, "high"),
]
NIGHT_TEST = [
    Case("N51", "coffee", 0.3, 16, 92, "mid", 1 / 8, 0),
    Case("N52", "flower", 0.3, 12, 90, "mid", 1 / 4, 1),
    Case("N53", "boats", 0.8, 28, 92, "mid", 1 / 2, 2),
    Case("N54", "alps", 0.5, 18, 90, "high", 1 / 4, 0),
    Case("N55", "canyon", 0.8, 24, 92, "mid", 1 / 2, 1),
    Case("N56", "houses", 1, 35, 92, "high", 1, 2),
    Case("N57", "life", 1, 20, 90, "mid", 1 / 4, 0),
    Case("N58", "picos", 1.2, 40, 92, "mid", 1, 1),
    Case("N59", "wine", 1, 16, 88, "mid", 1 / 4, 2),
    Case("N60", "landing", 1.2, 26, 90, "mid", 1 / 2, 0),
    Case("M51", "boats", 0.8, 0, 92, "mid"),
    Case("M52", "canyon", 0.8, 0, 92, "mid"),
    Case("M53", "life", 1, 0, 90, "mid"),
    Case("M54", "wine", 1, 0, 88, "mid"),
]
CASES = {"tune": TUNE, "test": TEST, "night-tune": NIGHT_TUNE, "night-test": NIGHT_TEST}


def case_file(folder: Path, case: Case, ending: str) -> Path:
    """Name a file of a case beside its photo."""
    return folder / f"{case.name}{ending}"
