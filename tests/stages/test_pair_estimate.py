from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.errors import KernelFileError, OutputError
from deshake.files.kernel_file import read_kernel
from deshake.files.registration_file import RegistrationFile, write_registration
from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.warps import Warps
from deshake.pair.registration import Registration
from deshake.run import Run
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.estimating import estimate_file
from deshake.stages.pair_estimate import estimate_pair

pytestmark = pytest.mark.long

SHAPE = (150, 210)
MARGIN = 25
CAMERA = Camera.from_focal(220.0, *SHAPE)
STEPS = grid_steps(CAMERA)
TURN = np.array([3, -4, 2]) * STEPS  # from the blurred photo to the noisy one
LENS = EstimateOptions(camera=CameraChoice(focal_px=220.0), blur_size=14, search_angle=4)
RATIO = 5.0
SIGMA = 0.02
FILES = ("blurred", "noisy")


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Write a photo shaken by ten pixels, and a noisy, dark one turned by some; 16 bits each."""
    folder = tmp_path_factory.mktemp("pair")
    height, width = SHAPE[0] + 2 * MARGIN, SHAPE[1] + 2 * MARGIN
    photo = cv2.resize(data.coffee()[:, 30:], (width, height), interpolation=cv2.INTER_AREA)
    sharp = ((photo / 255) ** 2.2).astype(np.float32)
    nodes = np.array([[-3, -4, -1], [1, 0, 1], [2, 4, 0]]) * STEPS
    path = np.stack([np.interp(np.linspace(0, 2, 60), range(3), axis) for axis in nodes.T], 1)
    path -= path.mean(0)
    g = Warps(CAMERA, path, margin=MARGIN).blur(sharp, np.full(60, 1 / 60))
    noisy = Warps(CAMERA, TURN[None], margin=MARGIN).blur(sharp, [1.0])
    rng = np.random.default_rng(0)
    noisy = np.clip((noisy + SIGMA * rng.normal(size=noisy.shape)) / RATIO, 0, 1)
    for name, picture in (("blurred.tif", g), ("noisy.tif", noisy)):
        codes = np.rint(65535 * np.clip(picture, 0, 1)).astype(np.uint16)
        cv2.imwrite(str(folder / name), codes[..., ::-1])
    return folder, RotationKernel.from_path(path, CAMERA)


def options(**changes):
    return EstimateOptions(**(vars(LENS) | {"transfer": "linear"} | changes))


def test_a_pair_of_files_gives_the_kernel(pair, tmp_path):
    folder, truth = pair
    shares = []
    estimate = estimate_file(
        folder / "blurred.tif",
        tmp_path / "k.npz",
        options(),
        noisy=folder / "noisy.tif",
        run=Run(1, lambda share, _: shares.append(share)),
    )
    content = read_kernel(tmp_path / "k.npz")
    kernel = content.kernel
    np.testing.assert_array_equal(kernel.weights, estimate.content.kernel.weights)
    assert kernel.camera.shape == SHAPE
    assert content.confidence > 0.8
    assert estimate.scale == pytest.approx(RATIO, rel=0.03)
    # the noisy photo's frame is that of the blur's centroid, as registration finds it
    assert np.abs(kernel.centroid / STEPS).max() < 2
    steps = kernel.centred().theta / STEPS
    spread, true_spread = (
        np.sqrt(w @ (theta**2))
        for w, theta in ((kernel.weights, steps), (truth.weights, truth.centred().theta / STEPS))
    )
    np.testing.assert_allclose(spread, true_spread, atol=0.5)
    assert shares == sorted(shares)
    assert shares[-1] == 1
    report = estimate.report()
    assert report["rotations"] == len(kernel.weights)
    assert report["scale"] == pytest.approx(estimate.scale, rel=1e-3)


def test_where_the_photos_agree_badly_the_photo_is_left_as_it_is(pair):
    folder, _ = pair
    blurred, noisy = (read_photo(folder / f"{name}.tif", transfer="linear") for name in FILES)
    other = np.ascontiguousarray(noisy.pixels[::-1, ::-1])
    known = Registration(np.zeros(3), RATIO, 1.0, CAMERA)
    estimate = estimate_pair(
        blurred, noisy.with_pixels(other), options(uniform=True), registration=known, run=Run(1)
    )
    assert not estimate.trusted
    assert not estimate.report()["trusted"]
    assert estimate.content.kernel.extent_px() == 0
    assert any("is left as it is" in note for note in estimate.notes)
    insisting = options(uniform=True, least_confidence=0.0)
    kept = estimate_pair(
        blurred, noisy.with_pixels(other), insisting, registration=known, run=Run(1)
    )
    assert kept.confidence == estimate.confidence
    assert not kept.trusted
    assert kept.content.kernel.extent_px() > 1
    assert not any("is left as it is" in note for note in kept.notes)


def test_the_kernel_file_has_its_provenance(pair, tmp_path):
    folder, _ = pair
    blurred, noisy = folder / "blurred.tif", folder / "noisy.tif"
    estimate_file(blurred, tmp_path / "k.npz", options(uniform=True), noisy=noisy, run=Run(1))
    provenance = read_kernel(tmp_path / "k.npz").provenance
    assert provenance["command"] == "estimate-pair"
    assert provenance["options"] == {
        "transfer": "linear",
        "blur_size": 14,
        "max_angle": None,
        "uniform": True,
        "search_angle": 4,
    }
    assert provenance["input_sha256"] != provenance["noisy_sha256"]
    assert provenance["camera"] == "--focal-px 220"
    assert len(provenance["registration"]["theta"]) == 3
    assert provenance["scales"][-1]["width"] == SHAPE[1]
    assert str(tmp_path) not in str(provenance)


def test_a_given_registration_is_used(pair, tmp_path):
    folder, _ = pair
    blurred, noisy = folder / "blurred.tif", folder / "noisy.tif"
    file = tmp_path / "r.npz"
    off = TURN + np.array([0, 2, 0]) * STEPS
    write_registration(file, RegistrationFile(off, RATIO, CAMERA, 0.9))
    estimate = estimate_file(
        blurred, tmp_path / "k.npz", options(), noisy=noisy, registration=file, run=Run(1)
    )
    np.testing.assert_array_equal(estimate.registration.theta, off)
    assert estimate.camera.source == "the registration"
    # the kernel has absorbed its error
    centroid = estimate.content.kernel.centroid / STEPS
    np.testing.assert_allclose(np.abs(centroid), [0, 2, 0], atol=0.5)


def test_a_registration_of_another_size_is_refused(pair, tmp_path):
    folder, _ = pair
    file = tmp_path / "r.npz"
    other = Camera.from_focal(220.0, 160, 210)
    write_registration(file, RegistrationFile(TURN, RATIO, other, 0.9))
    with pytest.raises(KernelFileError, match="for pictures of 210 x 160 pixels"):
        estimate_file(
            folder / "blurred.tif",
            tmp_path / "k.npz",
            options(),
            noisy=folder / "noisy.tif",
            registration=file,
        )
    assert not (tmp_path / "k.npz").exists()


@pytest.mark.parametrize("name", ["blurred.tif", "noisy.tif"])
def test_no_input_is_overwritten(pair, name):
    folder, _ = pair
    with pytest.raises(OutputError, match="the output is the input itself"):
        estimate_file(
            folder / "blurred.tif",
            folder / name,
            options(),
            noisy=folder / "noisy.tif",
            overwrite=True,
        )


@pytest.mark.parametrize("grey", [False, True])
def test_tone_curves_are_matched(pair, grey):
    """Photos whose tones differ by more than a factor: it is detected, and the kernel is right."""
    folder, truth = pair
    blurred, noisy = (read_photo(folder / f"{name}.tif", transfer="linear") for name in FILES)
    curve = 2.5 * np.maximum(noisy.pixels, 0) ** np.array([0.6, 0.7, 0.5], np.float32)
    noisy = noisy.with_pixels(np.clip(curve, 0, 1))
    if grey:
        noisy = replace(noisy, pixels=np.ascontiguousarray(noisy.pixels[..., 1]))
    estimate = estimate_pair(blurred, noisy, options(), run=Run(1))
    assert estimate.content.provenance["tone_curves"]
    assert (
        "the two photos were developed with different tone curves, which were matched"
        in estimate.notes
    )
    kernel = estimate.content.kernel
    spread, true_spread = (
        np.sqrt(k.weights @ (k.centred().theta / STEPS) ** 2) for k in (kernel, truth)
    )
    np.testing.assert_allclose(spread, true_spread, atol=0.8)
