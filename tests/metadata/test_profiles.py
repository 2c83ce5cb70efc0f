from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image, ImageCms

from deshake.errors import PhotoError
from deshake.formats.icc import profile_transfer
from deshake.formats.transfer import LINEAR, SRGB, Power
from deshake.metadata.profiles import (
    GREY_PROFILE,
    SRGB_PROFILE,
    XYZ_FROM_SRGB,
    cicp_profile,
    linear_profile,
)

CAMERA = np.array([[2.05, -1.27, 0.22], [-0.22, 1.78, -0.56], [-0.01, -0.59, 1.6]])


def to_srgb(codes, profile, mode="RGB"):
    """Turn codes to sRGB as LittleCMS does."""
    source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
    transform = ImageCms.buildTransform(
        source, ImageCms.createProfile("sRGB"), mode, "RGB", renderingIntent=1
    )
    return np.asarray(ImageCms.applyTransform(Image.fromarray(codes), transform))


@pytest.fixture
def codes():
    return np.random.default_rng(0).integers(0, 256, (40, 40, 3)).astype(np.uint8)


def test_srgb_is_srgb(codes):
    assert np.abs(to_srgb(codes, SRGB_PROFILE).astype(int) - codes).max() <= 1
    assert profile_transfer(SRGB_PROFILE) is SRGB
    assert profile_transfer(GREY_PROFILE) is SRGB
    grey = to_srgb(codes[..., 0], GREY_PROFILE, "L")
    assert np.abs(grey.astype(int) - codes[..., :1]).max() <= 1


@pytest.mark.parametrize("matrix", [None, CAMERA], ids=["sRGB", "camera"])
def test_linear_light_in_the_cameras_colours(codes, matrix):
    profile = linear_profile(matrix)
    assert profile_transfer(profile) is LINEAR
    whites = 1 if matrix is None else CAMERA.sum(1, keepdims=True)
    turn = np.eye(3) if matrix is None else CAMERA / whites
    light = np.clip(codes / 255 @ turn.T, 0, 1)
    want = 255 * SRGB.from_linear(light.astype(np.float32))
    inside = ((codes / 255 @ turn.T >= 0) & (codes / 255 @ turn.T <= 1)).all(-1)
    error = np.abs(to_srgb(codes, profile) - want)[inside]
    assert inside.mean() > 0.2
    assert error.max() < 2.5


def test_white_is_white():
    white = np.full((2, 2, 3), 255, np.uint8)
    for profile in (SRGB_PROFILE, linear_profile(), linear_profile(CAMERA)):
        assert to_srgb(white, profile).min() >= 254
    assert np.allclose(XYZ_FROM_SRGB.sum(1), (0.9505, 1, 1.089), atol=2e-3)


def test_a_profile_does_not_depend_on_the_day():
    assert linear_profile(CAMERA) == linear_profile(CAMERA)
    header = SRGB_PROFILE[:128]
    assert len(SRGB_PROFILE) == int.from_bytes(header[:4], "big")
    assert len(SRGB_PROFILE) % 4 == 0
    assert header[24:36] == bytes(12)  # no time of day
    assert header[36:40] == b"acsp"
    assert linear_profile(grey=True)[16:20] == b"GRAY"


def test_profiles_by_code_points():
    assert cicp_profile(1, 13) == cicp_profile(2, 2) == cicp_profile(1, 1) == b""
    assert profile_transfer(cicp_profile(12, 13)) is SRGB
    assert profile_transfer(cicp_profile(1, 8)) is LINEAR
    assert profile_transfer(cicp_profile(9, 4)) == Power(pytest.approx(2.2, abs=1e-5))
    # Apple's Display P3 states these columns
    profile = ImageCms.ImageCmsProfile(io.BytesIO(cicp_profile(12, 13))).profile
    red, green, blue = (
        c[0] for c in (profile.red_colorant, profile.green_colorant, profile.blue_colorant)
    )
    assert np.allclose(red, (0.51512, 0.24120, -0.00105), atol=3e-4)
    assert np.allclose(green, (0.29198, 0.69225, 0.04189), atol=3e-4)
    assert np.allclose(blue, (0.15710, 0.06657, 0.78407), atol=3e-4)
    for transfer in (16, 18):
        with pytest.raises(PhotoError, match="HDR"):
            cicp_profile(9, transfer)
