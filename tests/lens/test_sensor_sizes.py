from __future__ import annotations

import math

import pytest

from deshake.lens import sensor_sizes
from deshake.lens.sensor_sizes import sensor_size


def test_names_match_to_the_letter_but_for_case() -> None:
    assert sensor_size("NIKON CORPORATION", "NIKON D90") == (23.6, 15.8)
    assert sensor_size("Nikon Corporation", "Nikon D90") == (23.6, 15.8)
    assert sensor_size("NIKON CORPORATION", "NIKON D9") is None
    assert sensor_size("Canon", "Canon EOS 5D Mark") is None
    assert sensor_size("Someone", "E-1") is None


def test_the_table_is_of_more_than_two_hundred_cameras_each_named_once() -> None:
    names = [name.casefold() for models in sensor_sizes._SENSORS.values() for name in models]
    assert len(names) == len(set(names))
    assert len(names) > 200
    for width, height in sensor_sizes._SENSORS:
        assert 1.3 < width / height < 1.55


def test_crop_factors_agree_with_lensfun() -> None:
    lensfun = pytest.importorskip("lensfunpy")
    factors: dict[str, set[float]] = {}
    for camera in lensfun.Database().cameras:
        factors.setdefault(camera.model.casefold(), set()).add(camera.crop_factor)
    compared = 0
    for model, size in sensor_sizes._BY_MODEL.items():
        known = factors.get(model, set())
        compared += len(known)
        for factor in known:
            assert math.hypot(36, 24) / math.hypot(*size) == pytest.approx(factor, rel=0.025), model
    assert compared > 200
