from __future__ import annotations

import cv2
import numpy as np
import pytest
from PIL import Image

from deshake.errors import EstimationError, KernelFileError, PhotoError
from deshake.files.kernel_file import CameraFile, KernelFile, write_camera, write_kernel
from deshake.files.registration_file import RegistrationFile, write_registration
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.stages.inspecting import inspect_file, photo_blur

CAMERA = Camera.from_focal(300.0, 40, 60)


def save(path, light):
    codes = np.rint(255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 28
    Image.fromarray(codes).save(path, quality=92, exif=exif)
    return path


def test_a_sharp_and_a_shaken_photo(tmp_path, sharp):
    figures = inspect_file(save(tmp_path / "a.jpg", sharp))
    assert (figures["kind"], figures["verdict"], figures["certain"]) == ("photo", "sharp", True)
    assert (figures["width"], figures["height"], figures["format"]) == (260, 200, "JPEG")
    assert figures["focal_35mm"] == pytest.approx(28, abs=0.01)
    assert figures["focal_source"] == "EXIF FocalLengthIn35mmFilm = 28 mm"
    assert 0 < figures["noise"] < 0.02
    assert "provenance" not in figures
    shaken = save(tmp_path / "b.jpg", cv2.blur(sharp, (9, 1)))
    figures = inspect_file(shaken)
    assert figures["verdict"] == "shaken"
    assert min(figures["direction"], 180 - figures["direction"]) < 20
    assert photo_blur(shaken).report().items() <= figures.items()


def test_colours_and_luma_give_the_same_verdict(tmp_path, sharp):
    path = save(tmp_path / "a.jpg", np.stack([cv2.blur(sharp, (9, 1))] * 3, -1))
    other = tmp_path / "a.png"
    Image.open(path).save(other)
    one, two = photo_blur(path), photo_blur(other)
    assert one.kind == two.kind == "shaken"
    assert one.width_px == pytest.approx(two.width_px, rel=0.05)


def test_photos_that_cannot_be_judged(tmp_path):
    for size, words in (((30, 30), "too few"), ((80, 80), "no detail")):
        Image.new("L", size, 100).save(tmp_path / "a.png")
        with pytest.raises(EstimationError, match=words) as error:
            photo_blur(tmp_path / "a.png")
        assert error.value.file == str(tmp_path / "a.png")
    (tmp_path / "a.jpg").write_text("no photo")
    with pytest.raises(PhotoError):
        inspect_file(tmp_path / "a.jpg")


def test_a_kernel(tmp_path):
    kernel = RotationKernel.from_path([(0, -0.01, 0), (0, 0.01, 0)], CAMERA)
    write_kernel(tmp_path / "k.npz", KernelFile(kernel, 0.75, {"deshake": "1", "x": [1]}))
    figures = inspect_file(tmp_path / "k.npz")
    assert (figures["kind"], figures["model"]) == ("kernel", "rotations")
    assert figures["angles_deg"] == pytest.approx([0, 1.146, 0], abs=0.2)
    assert figures["extent_px"] == round(kernel.extent_px(), 2)
    assert figures["rotations"] == len(kernel.weights)
    assert figures["confidence"] == 0.75
    assert figures["focal_px"] == 300
    assert figures["provenance"] == {"deshake": "1", "x": [1]}
    for camera, model in ((CAMERA, "still"), (Camera.uniform(40, 60), "uniform")):
        path = [(0, 0, 0)] if model == "still" else [(0, 0, 0), (0, 5 / camera.focal_px, 0)]
        write_kernel(
            tmp_path / "k.npz", KernelFile(RotationKernel.from_path(path, camera)), overwrite=True
        )
        assert inspect_file(tmp_path / "k.npz")["model"] == model


def test_a_camera_and_a_registration(tmp_path):
    bent = CAMERA.with_lens(np.array([0.1, 0, 0, 0]))
    write_camera(tmp_path / "c.npz", CameraFile(bent, "chessboard"))
    figures = inspect_file(tmp_path / "c.npz")
    assert (figures["kind"], figures["source"]) == ("camera", "chessboard")
    assert figures["distortion"] == [0.1, 0, 0, 0]
    turn = np.radians([0.5, -1, 2])
    write_registration(tmp_path / "r.npz", RegistrationFile(turn, 4.0, CAMERA, 0.9))
    figures = inspect_file(tmp_path / "r.npz")
    assert (figures["kind"], figures["scale"]) == ("registration", 4)
    assert figures["rotation_deg"] == [0.5, -1, 2]
    (tmp_path / "r.npz").write_bytes(b"PK")
    with pytest.raises(KernelFileError):
        inspect_file(tmp_path / "r.npz")
