from __future__ import annotations

import hashlib

import numpy as np
import pytest
from PIL import Image

from deshake.errors import OutputError
from deshake.formats.photo import read_photo
from deshake.stages.finishing import AS_IT_IS, FinishingOptions


@pytest.fixture
def photo(tmp_path):
    codes = np.random.default_rng(0).integers(0, 256, (1000, 1600)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "a.png")
    return read_photo(tmp_path / "a.png")


@pytest.fixture
def mask(tmp_path):
    halves = np.zeros((1000, 1600), np.uint8)
    halves[:, 800:] = 255
    Image.fromarray(halves).save(tmp_path / "m.png")
    return tmp_path / "m.png"


def test_by_default_a_result_is_taken_as_it_is(photo):
    assert AS_IT_IS.prepare(photo) == (photo, None)
    result = photo.with_pixels(photo.pixels / 2)
    assert AS_IT_IS.blend(photo, result, None) is result
    assert AS_IT_IS.provenance() == {}
    assert AS_IT_IS.sheet(photo.source) is None


def test_a_preview_reduces_photo_and_mask(photo, mask):
    finish = FinishingOptions(mask=mask, preview=True)
    small, kept = finish.prepare(photo)
    assert small.shape == kept.share.shape == (400, 640)
    assert kept.sha256 == hashlib.sha256(mask.read_bytes()).hexdigest()
    result = small.with_pixels(np.zeros_like(small.pixels))
    mixed = finish.blend(small, result, kept).pixels
    assert np.array_equal(mixed[:, 320:], small.pixels[:, 320:])
    assert not mixed[:, :320].any()


def test_provenance_has_what_differs_from_the_default(mask):
    provenance = FinishingOptions(0.5, mask, preview=True, compare=True).provenance("ab12")
    assert provenance == {"strength": 0.5, "mask_sha256": "ab12", "preview": True}
    assert FinishingOptions(linear=True, with_provenance=False).provenance() == {"linear": True}


@pytest.mark.parametrize("strength", [-0.1, 1.1, float("nan")])
def test_a_strength_is_a_share(strength):
    with pytest.raises(ValueError, match="not from 0 to 1"):
        FinishingOptions(strength)


def test_outputs_are_neither_mask_nor_input(photo, mask, tmp_path):
    with pytest.raises(OutputError, match="the input itself"):
        FinishingOptions(mask=mask).check(mask, photo.source, overwrite=True)
    finish = FinishingOptions(compare=True)
    out = tmp_path / "out.png"
    finish.check(out, photo.source, overwrite=False)
    sheet = finish.sheet(out)
    assert sheet == tmp_path / "out.compare.png"
    with pytest.raises(OutputError, match="the input itself"):
        finish.check(out, sheet, overwrite=True)
    sheet.touch()
    with pytest.raises(OutputError, match="exists already"):
        finish.check(out, photo.source, overwrite=False)
    finish.check(out, photo.source, overwrite=True)
