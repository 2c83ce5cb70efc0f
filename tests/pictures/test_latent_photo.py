from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from deshake.formats.photo import read_photo
from deshake.formats.photo_writing import encode_photo
from deshake.pictures.latent_photo import latent_photo


@pytest.fixture
def photo(tmp_path):
    """A colour photo with its opacity, 16 x 20, linear, whose left half is darker."""
    codes = np.full((16, 20, 4), 100, np.uint8)
    codes[:, :10, :3] = 40
    path = tmp_path / "a.png"
    Image.fromarray(codes, "RGBA").save(path)
    return read_photo(path, transfer="linear")


def edge(step):
    """Gradients of a picture of 8 x 12 pixels with one edge upright in its middle."""
    gradients = np.zeros((2, 8, 12), np.float32)
    gradients[0, :, 5] = step
    return gradients


def test_gradients_become_a_grey_photo_of_their_size(photo):
    latent = latent_photo(photo, edge(0.2))
    assert latent.shape == (8, 12)
    assert latent.pixels.mean() == pytest.approx(70 / 255, abs=1e-6)
    assert latent.pixels[:, 6:] - latent.pixels[:, :6] == pytest.approx(np.full((8, 6), 0.2))
    assert latent.alpha is None
    assert not latent.clipped.any()


@pytest.mark.parametrize(("x", "level"), [(0, 40), (10, 100)])
def test_a_region_gives_its_own_mean(photo, x, level):
    latent = latent_photo(photo, edge(0.1), (x, 2, 10, 8))
    assert latent.pixels.mean() == pytest.approx(level / 255, abs=1e-6)


def test_it_is_written_as_display_values_and_clipped(photo, tmp_path):
    path = tmp_path / "latent.png"
    path.write_bytes(encode_photo(latent_photo(photo, edge(0.1))))
    with Image.open(path) as picture:
        assert (picture.mode, picture.size) == ("L", (12, 8))
        codes = np.asarray(picture)
    light = 70 / 255 + np.array([-0.05, 0.05])
    srgb = 255 * (1.055 * light ** (1 / 2.4) - 0.055)
    assert codes[0, [0, -1]] == pytest.approx(srgb, abs=0.6)
    path.write_bytes(encode_photo(latent_photo(photo, edge(3.0))))
    with Image.open(path) as picture:
        assert picture.getextrema() == (0, 255)
