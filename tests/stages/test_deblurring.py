from __future__ import annotations

import cv2
import numpy as np
import pytest
from PIL import Image

from deshake.errors import EstimationError, KernelFileError, OutputError
from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.files.registration_file import RegistrationFile, write_registration
from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import homographies
from deshake.operators.shake_blur import ShakeBlur
from deshake.pair.registration import Registration
from deshake.run import Run
from deshake.stages.deblurring import deblur, deblur_file
from deshake.stages.methods import RestorationOptions

HEIGHT, WIDTH, BEYOND = 130, 170, 20
CAMERA = Camera.from_focal(200, HEIGHT, WIDTH)
TURNED = np.array([0.01, -0.015, 0.03])
RATIO = 4.0


def save(path, light, depth=16):
    top = 2**depth - 1
    codes = np.rint(np.clip(light, 0, 1) * top).astype(np.uint16 if depth == 16 else np.uint8)
    path.write_bytes(cv2.imencode(path.suffix, codes[..., ::-1])[1].tobytes())
    return path


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Files of a pair in linear light, with the kernel, the registration and the sharp frame."""
    folder = tmp_path_factory.mktemp("pair")
    rng = np.random.default_rng(5)
    scene = np.full((HEIGHT + 2 * BEYOND, WIDTH + 2 * BEYOND, 3), 0.3, np.float32)
    for _ in range(150):
        place = tuple(int(rng.integers(side)) for side in scene.shape[1::-1])
        colour = rng.uniform(0.05, 0.7, 3).tolist()
        cv2.circle(scene, place, int(rng.integers(2, 14)), colour, -1, cv2.LINE_AA)
    path = [(-0.012, -0.01, -0.01), (0.012, 0.01, 0.012)]
    kernel = RotationKernel.from_path(path, CAMERA).centred()
    g = ShakeBlur(kernel, margin=BEYOND, kind="warps").forward(scene)
    g = g + rng.normal(0, 0.002, g.shape)
    [h] = homographies(CAMERA.padded(BEYOND), TURNED[None])
    seen = cv2.warpPerspective(scene, h, scene.shape[1::-1], flags=cv2.INTER_CUBIC | 16)
    short = seen[BEYOND:-BEYOND, BEYOND:-BEYOND]
    short = (short + rng.normal(0, 0.05, short.shape)) / RATIO
    write_kernel(folder / "k.npz", KernelFile(kernel))
    write_registration(folder / "r.npz", RegistrationFile(TURNED, 1.03 * RATIO, CAMERA))
    save(folder / "g.png", g)
    save(folder / "n.png", short)
    sharp = np.ascontiguousarray(scene[BEYOND:-BEYOND, BEYOND:-BEYOND])
    return folder, kernel, sharp


def read(path):
    return read_photo(path, transfer="linear")


def psnr(a, b):
    return float(-10 * np.log10(np.mean(np.square(a.astype(float) - b))))


def test_the_kernel_of_a_still_camera_leaves_the_photo_as_it_is(pair):
    folder, _, _ = pair
    g, noisy = read(folder / "g.png"), read(folder / "n.png")
    restored = deblur(
        g, RotationKernel.delta(CAMERA), RestorationOptions("fusion"), noisy=noisy
    ).photo
    np.testing.assert_array_equal(restored.pixels, g.pixels)


def test_a_file_of_linear_values_that_does_not_say_so_is_deblurred_in_them(pair, caplog):
    folder, kernel, sharp = pair
    assumed = read_photo(folder / "g.png")
    with caplog.at_level("INFO"):
        result = deblur(assumed, kernel).photo
    assert "suits display values" in caplog.text
    assert result.encoding == assumed.encoding
    values = result.in_display_values().pixels
    known = deblur(read(folder / "g.png"), kernel).photo.pixels
    np.testing.assert_allclose(values, known, atol=2e-3)
    stated = deblur(read_photo(folder / "g.png", transfer="srgb"), kernel).photo
    best = psnr(values[8:-8, 8:-8], sharp[8:-8, 8:-8])
    assert best > psnr(stated.in_display_values().pixels[8:-8, 8:-8], sharp[8:-8, 8:-8]) + 1


def test_a_photo_in_linear_light_is_deblurred_in_it(pair, tmp_path, caplog):
    folder, kernel, _ = pair
    shown = read(folder / "g.png").pixels ** (1 / 2.2)
    photo = read_photo(save(tmp_path / "shown.png", shown))
    with caplog.at_level("INFO"):
        result = deblur(photo, kernel).photo
    assert "display values" not in caplog.text
    stated = deblur(read_photo(tmp_path / "shown.png", transfer="srgb"), kernel).photo
    np.testing.assert_array_equal(result.pixels, stated.pixels)


@pytest.mark.parametrize("method", ["fusion", "residual"])
def test_makes_a_sharper_photo(pair, method):
    folder, kernel, sharp = pair
    blurred, noisy = read(folder / "g.png"), read(folder / "n.png")
    registration = Registration(TURNED, 1.03 * RATIO, 1.0, CAMERA)
    options = RestorationOptions(method)
    done = deblur(blurred, kernel, options, noisy=noisy, registration=registration).photo
    assert psnr(done.pixels, sharp) > psnr(blurred.pixels, sharp) + 3
    assert psnr(done.pixels, sharp) > 24
    assert done.encoding == blurred.encoding


def test_a_factor_that_is_a_little_off_is_corrected(pair):
    folder, kernel, _ = pair
    blurred, noisy = read(folder / "g.png"), read(folder / "n.png")
    restored = [
        deblur(
            blurred,
            kernel,
            RestorationOptions("fusion", iterations=2),
            noisy=noisy,
            registration=Registration(TURNED, factor * RATIO, 1.0, CAMERA),
        ).photo.pixels
        for factor in (0.95, 1.05)
    ]
    np.testing.assert_allclose(restored[0], restored[1], atol=2e-3)


def test_grey_noisy_photos_pass(pair, tmp_path):
    folder, kernel, _ = pair
    noisy = read(folder / "n.png").pixels.mean(-1)
    path = tmp_path / "grey.png"
    path.write_bytes(cv2.imencode(".png", np.rint(noisy * 65535).astype(np.uint16))[1].tobytes())
    registration = Registration(TURNED, RATIO, 1.0, CAMERA)
    for one, other in (("g.png", path), (path, folder / "n.png")):
        options = RestorationOptions("fusion", iterations=1)
        photo = read(folder / one)
        done = deblur(photo, kernel, options, noisy=read(other), registration=registration).photo
        assert done.pixels.shape == photo.pixels.shape


def test_from_file_to_file(pair, tmp_path):
    folder, _, _ = pair
    content = deblur_file(
        folder / "g.png",
        folder / "k.npz",
        tmp_path / "out.png",
        noisy=folder / "n.png",
        restoration=RestorationOptions("fusion", iterations=2),
        registration=folder / "r.npz",
        transfer="linear",
    )
    assert content.kernel.camera.shape == (HEIGHT, WIDTH)
    with Image.open(tmp_path / "out.png") as image:
        assert image.size == (WIDTH, HEIGHT)


def test_the_photos_are_registered_if_no_registration_is_given(pair):
    folder, kernel, sharp = pair
    blurred, noisy = read(folder / "g.png"), read(folder / "n.png")
    reports = []
    done = deblur(
        blurred,
        kernel,
        RestorationOptions("fusion"),
        noisy=noisy,
        run=Run(progress=lambda share, text: reports.append((share, text))),
    ).photo
    assert psnr(done.pixels, sharp) > psnr(blurred.pixels, sharp)
    shares = [share for share, _ in reports]
    assert shares == sorted(shares)
    assert any("registering" in text for _, text in reports)


def test_another_scene_is_refused(pair):
    folder, kernel, _ = pair
    blurred, noisy = read(folder / "g.png"), read(folder / "n.png")
    other = np.random.default_rng(1).random((9, 12, 3), np.float32)
    other = cv2.resize(other, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    with pytest.raises(EstimationError) as error:
        deblur(blurred, kernel, RestorationOptions("fusion"), noisy=noisy.with_pixels(other))
    assert error.value.file == str(folder / "g.png")


def test_a_registration_of_another_size_is_refused(pair, tmp_path):
    folder, _, _ = pair
    content = RegistrationFile(TURNED, RATIO, Camera.from_focal(100, 65, 85))
    write_registration(tmp_path / "r.npz", content)
    with pytest.raises(KernelFileError, match="85 x 65"):
        deblur_file(
            folder / "g.png",
            folder / "k.npz",
            tmp_path / "out.png",
            noisy=folder / "n.png",
            restoration=RestorationOptions("fusion"),
            registration=tmp_path / "r.npz",
        )


@pytest.mark.parametrize("name", ["g.png", "n.png", "k.npz", "r.npz"])
def test_inputs_are_never_the_output(pair, name):
    folder, _, _ = pair
    before = (folder / name).read_bytes()
    with pytest.raises(OutputError):
        deblur_file(
            folder / "g.png",
            folder / "k.npz",
            folder / name,
            noisy=folder / "n.png",
            restoration=RestorationOptions("fusion"),
            registration=folder / "r.npz",
            overwrite=True,
        )
    assert (folder / name).read_bytes() == before


@pytest.mark.parametrize(
    ("method", "what"),
    [
        ("sparse", "sparse takes no noisy photo"),
        ("residual", "residual needs a noisy photo"),
    ],
)
def test_the_method_goes_with_the_noisy_photo(pair, method, what):
    folder, kernel, _ = pair
    blurred, noisy = read(folder / "g.png"), read(folder / "n.png")
    with pytest.raises(ValueError, match=what):
        deblur(
            blurred,
            kernel,
            RestorationOptions(method),
            noisy=None if "needs" in what else noisy,
        )
