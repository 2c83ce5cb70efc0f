"""Real photos that development dependencies ship: scikit-image and scikit-learn."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from skimage import data
from sklearn.datasets import load_sample_image

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

__all__ = ["SHIPPED"]

SHIPPED: dict[str, Callable[[], NDArray[np.uint8]]] = {
    "astronaut": data.astronaut,
    "brick": data.brick,
    "camera": data.camera,
    "chelsea": data.chelsea,
    "china": partial(load_sample_image, "china.jpg"),
    "coffee": data.coffee,
    "coins": data.coins,
    "flower": partial(load_sample_image, "flower.jpg"),
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
