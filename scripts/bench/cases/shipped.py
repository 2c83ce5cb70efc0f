"""Real photos that development dependencies ship: scikit-image and scikit-learn."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image
from skimage import data

from bench.cases.scenes import packaged
from bench.errors import MissingDataError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

__all__ = ["SHIPPED"]


def _sample(name: str) -> NDArray[np.uint8]:
    """Read a photo of scikit-learn from its file: the import of its code would take long."""
    for folder in packaged("sklearn"):
        with Image.open(folder / "datasets" / "images" / name) as picture:
            return np.asarray(picture)
    raise MissingDataError(f"{name} is missing: it is in scikit-learn")


SHIPPED: dict[str, Callable[[], NDArray[np.uint8]]] = {
    "astronaut": data.astronaut,
    "brick": data.brick,
    "camera": data.camera,
    "chelsea": data.chelsea,
    "china": partial(_sample, "china.jpg"),
    "coffee": data.coffee,
    "coins": data.coins,
    "flower": partial(_sample, "flower.jpg"),
    "grass": data.grass,
    "hubble": data.hubble_deep_field,
    "ihc": data.immunohistochemistry,
    "moon": data.moon,
    "motorcycle": lambda: data.stereo_motorcycle()[0],
    "page": data.page,
    "retina": data.retina,
    "rocket": data.rocket,
    "text": data.text,
}
