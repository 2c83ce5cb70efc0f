from __future__ import annotations

from dataclasses import replace

import pytest
from PIL import Image

from deshake.errors import OutputError
from deshake.run import Run
from deshake.stages import estimating
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.estimating import camera_name, estimate_file, kernel_name

OPTIONS = EstimateOptions(
    camera=CameraChoice(focal_35mm=40), blur_size=3, uniform=True, region=(0, 0, 60, 50)
)


def test_kernels_are_named_after_their_photos(tmp_path):
    assert kernel_name(tmp_path / "a.b.jpg") == "a.b.kernel.npz"
    assert camera_name(tmp_path / "a.b.jpg") == "a.b.camera.npz"


@pytest.mark.parametrize(("name", "form"), [("l.png", "PNG"), ("l.jpg", "JPEG"), ("l.tif", "TIFF")])
def test_the_latent_picture_is_of_the_region_and_of_the_format_of_its_name(
    photo, tmp_path, name, form
):
    options = replace(OPTIONS, estimator="edges")
    estimate_file(photo, tmp_path / "plain.npz", options)
    estimate_file(photo, tmp_path / "k.npz", options, latent=tmp_path / name)
    assert (tmp_path / "k.npz").read_bytes() == (tmp_path / "plain.npz").read_bytes()
    with Image.open(tmp_path / name) as picture:
        assert (picture.format, picture.mode, picture.size) == (form, "L", (60, 50))


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("l.bmp", "no photo format"),
        ("l", "no ending"),
        ("a.png", "never touches"),
        ("k.npz", "never touches"),
        ("none/l.png", "no such folder"),
    ],
)
def test_the_latent_picture_is_checked_before_any_work(photo, tmp_path, name, what):
    shares, before = [], photo.read_bytes()
    with pytest.raises(OutputError, match=what):
        estimate_file(
            photo,
            tmp_path / "k.npz",
            OPTIONS,
            latent=tmp_path / name,
            overwrite=True,
            run=Run(progress=lambda share, _: shares.append(share)),
        )
    assert shares == []
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
    assert photo.read_bytes() == before


def test_tiles_are_drawn_beside_the_latent_picture(soft_photo, tmp_path):
    pictures = {"latent": tmp_path / "l.png", "tiles": tmp_path / "t.jpg"}
    estimate_file(soft_photo, tmp_path / "k.npz", OPTIONS, **pictures)
    with Image.open(pictures["latent"]) as latent, Image.open(pictures["tiles"]) as tiles:
        assert latent.size == (60, 50)
        assert (tiles.format, tiles.mode, tiles.width) == ("JPEG", "RGB", 80)
        assert tiles.height > 64


@pytest.mark.parametrize("step", ["tile_photo", "kernel_bytes"])
def test_kernel_and_pictures_stay_together(photo, tmp_path, monkeypatch, step):
    def fail(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(estimating, step, fail)
    options = replace(OPTIONS, estimator="edges")
    with pytest.raises(KeyboardInterrupt):
        estimate_file(
            photo, tmp_path / "k.npz", options, latent=tmp_path / "l.png", tiles=tmp_path / "t.png"
        )
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_a_pair_has_no_picture_of_a_blind_estimate(photo, tmp_path):
    with pytest.raises(ValueError, match="blind"):
        estimate_file(photo, tmp_path / "k.npz", OPTIONS, noisy=photo, latent=tmp_path / "l.png")
