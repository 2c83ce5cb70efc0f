from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.settings import SETTINGS
from deshake.blind.spectral_match import SpectralMatch
from deshake.blind.spectral_start import _distance, _random_path, spectral_starts
from deshake.geometry.camera import Camera
from deshake.run import Run
from deshake.signal.pyramid import Pyramid

ALL_AXES = True, True, True
PATH = np.array([[0.0, -8, -3], [3, -2, 0], [-1, 3, 1], [2, 9, 3]])  # in grid steps


@pytest.fixture(scope="module")
def photo(shake):
    """A photo of 300 x 400 pixels, shaken by 17 pixels with roll."""
    return shake(Camera.from_focal(400.0, 300, 400), path=PATH)


@pytest.fixture(scope="module")
def starts(photo):
    return spectral_starts(photo.pyramid, ALL_AXES, Run(1))


@pytest.fixture(scope="module")
def spectra(photo):
    return SpectralMatch(photo.pyramid, 0, "all")


def test_a_known_shake_is_recovered_up_to_its_reflection(photo, starts) -> None:
    """Nothing but the spectra is used; a path that is not the true one agrees by .8 at most."""
    alike = [
        agreement(one.kernel(photo.camera), photo.kernel)
        for _, path in starts
        for one in (path, path.reflected)
    ]
    assert max(alike) > 0.9


def test_a_shake_as_wide_as_an_eighth_of_the_frame_is_recovered(shake) -> None:
    path = np.array([[0.0, -50, 0], [12, -10, 0], [3, 20, 0], [-6, 55, 0]])
    photo = shake(Camera.from_focal(900.0, 640, 720), path=path)
    wide = spectral_starts(photo.pyramid, ALL_AXES, Run(1), SETTINGS.spectral_start.wide)
    sides = {min(photo.pyramid.at(level).camera.shape) for level, _ in wide}
    assert sides == {113, 160, 226}
    alike = [
        agreement(one.kernel(photo.camera), photo.kernel)
        for _, path in wide
        for one in (path, path.reflected)
    ]
    assert max(alike) > 0.85


def test_a_path_lies_on_the_grid_of_its_scale(photo, starts) -> None:
    levels = [level for level, _ in starts]
    assert levels == sorted(levels, reverse=True)
    for level, path in starts:
        assert path.camera.shape == photo.pyramid.at(level).camera.shape


def test_the_paths_of_a_scale_are_distinct(photo, starts) -> None:
    for level in {level for level, _ in starts}:
        spectra = SpectralMatch(photo.pyramid, level, "fitted")
        paths = [path for at, path in starts if at == level]
        for n, path in enumerate(paths):
            assert all(_distance(spectra, path, other) > 0.9 for other in paths[:n])


def test_threads_change_nothing(photo, starts) -> None:
    again = spectral_starts(photo.pyramid, ALL_AXES, Run(2))
    for (_, one), (_, two) in zip(starts, again, strict=True):
        assert one.controls.tobytes() == two.controls.tobytes()


@pytest.mark.parametrize("axes", [(False, True, True), (True, True, False)])
def test_a_camera_does_not_turn_about_a_forbidden_axis(photo, axes) -> None:
    for _, path in spectral_starts(photo.pyramid, axes, Run(1)):
        turned = np.ptp(path.controls, axis=0) > 0
        assert not turned[~np.array(axes)].any()


def test_a_tiny_photo_has_none(photo) -> None:
    small = Pyramid(photo.grey[:64, :80], Camera.from_focal(400.0, 64, 80))
    assert spectral_starts(small, ALL_AXES, Run(1)) == []


def test_random_paths_differ_and_are_some_pixels_wide(spectra) -> None:
    rng = np.random.default_rng(1)
    paths = [_random_path(rng, spectra, ALL_AXES, SETTINGS.spectral_start.usual) for _ in range(20)]
    for path in paths:
        boxes = np.linalg.norm(np.ptp(spectra.tracks(path, 24), axis=1), axis=1)
        assert 7.9 < boxes.mean() < 21.1
        np.testing.assert_allclose(path.controls.mean(0), 0, atol=1e-9)
    assert min(_distance(spectra, paths[0], other) for other in paths[1:]) > 1


def test_a_path_is_as_far_from_another_as_from_its_reflection(spectra) -> None:
    rng = np.random.default_rng(2)
    one, other = (
        _random_path(rng, spectra, ALL_AXES, SETTINGS.spectral_start.usual) for _ in range(2)
    )
    backwards = one._replace(controls=one.controls[::-1])
    for same in (one, one.reflected, backwards, backwards.reflected):
        assert _distance(spectra, one, same) == pytest.approx(0, abs=1e-6)
        assert _distance(spectra, same, other) == pytest.approx(_distance(spectra, one, other))
