"""A small photo and a kernel for it, as files."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel


def _save(path, resampling):
    coarse = np.random.default_rng(2).integers(40, 220, (8, 10)).astype(np.uint8)
    Image.fromarray(coarse).resize((80, 64), resampling).save(path)
    return path


@pytest.fixture
def photo(tmp_path):
    """A sharp photo, whose estimate ends at once."""
    return _save(tmp_path / "a.png", Image.Resampling.NEAREST)


@pytest.fixture
def soft_photo(tmp_path):
    """A photo without sharp edges, for which a kernel is estimated."""
    return _save(tmp_path / "a.png", Image.Resampling.BILINEAR)


@pytest.fixture
def kernel(tmp_path):
    camera = Camera.from_focal(100, 64, 80)
    turn = RotationKernel.from_path([(0, -0.01, 0), (0, 0.01, 0)], camera)
    write_kernel(tmp_path / "k.npz", KernelFile(turn))
    return tmp_path / "k.npz"
