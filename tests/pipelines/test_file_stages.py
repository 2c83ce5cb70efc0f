from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from deshake.deconvolution.methods import RestorationOptions
from deshake.errors import OutputError, PhotoError
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.io.kernel_file import KernelFile, read_kernel, write_kernel
from deshake.pipelines import file_stages
from deshake.pipelines.file_stages import (
    deblur_file,
    estimate_file,
    fix_file,
    kernel_name,
)
from deshake.pipelines.stages import EstimateOptions

OPTIONS = EstimateOptions(focal_35mm=40, blur_size=3, uniform=True, region=(0, 0, 60, 50))


@pytest.fixture
def photo(tmp_path):
    coarse = np.random.default_rng(2).integers(40, 220, (8, 10)).astype(np.uint8)
    path = tmp_path / "a.png"
    Image.fromarray(coarse).resize((80, 64), Image.Resampling.BILINEAR).save(path)
    return path


@pytest.fixture
def kernel(tmp_path):
    camera = Camera.from_focal(100, 64, 80)
    turn = RotationKernel.from_path([(0, -0.01, 0), (0, 0.01, 0)], camera)
    write_kernel(tmp_path / "k.npz", KernelFile(turn))
    return tmp_path / "k.npz"


def test_kernels_are_named_after_their_photos(tmp_path):
    assert kernel_name(tmp_path / "a.b.jpg") == "a.b.kernel.npz"


def test_fixing_is_estimating_and_deblurring(photo, tmp_path):
    estimated = estimate_file(photo, tmp_path / "one.npz", OPTIONS)
    deblur_file(photo, tmp_path / "one.npz", tmp_path / "one.png")
    fixed = fix_file(photo, tmp_path / "two.png", tmp_path / "two.npz", OPTIONS)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    assert fixed.report() == estimated.report()
    kernel = read_kernel(tmp_path / "two.npz").kernel
    assert np.array_equal(kernel.weights, fixed.content.kernel.weights)


def test_progress_rises_from_estimate_to_deblurring(photo, tmp_path):
    told = []
    fix_file(
        photo,
        tmp_path / "out.png",
        None,
        OPTIONS,
        restoration=RestorationOptions(iterations=3),
        progress=lambda share, text: told.append((share, text)),
    )
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert shares[0] < 0.2
    assert shares[-1] == pytest.approx(1)
    assert len({text for _, text in told}) > 2


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("out.bmp", "no photo format"),
        ("out", "no ending"),
        ("a.png", "never touches"),
        ("none/out.png", "no such folder"),
    ],
)
def test_outputs_are_checked_before_any_work(photo, kernel, tmp_path, name, what):
    told = []
    tell = {"progress": lambda share, _: told.append(share), "overwrite": True}
    with pytest.raises(OutputError, match=what):
        deblur_file(photo, kernel, tmp_path / name, **tell)
    with pytest.raises(OutputError, match=what):
        fix_file(photo, tmp_path / name, None, OPTIONS, **tell)
    assert told == []


def test_a_format_that_cannot_hold_the_photo_is_told_before_any_work(kernel, tmp_path):
    path, told = tmp_path / "clear.png", []
    Image.new("RGBA", (80, 64), (1, 2, 3, 4)).save(path)
    tell = {"progress": lambda share, _: told.append(share)}
    with pytest.raises(PhotoError, match="transparency"):
        deblur_file(path, kernel, tmp_path / "out.jpg", **tell)
    with pytest.raises(PhotoError, match="transparency"):
        fix_file(path, tmp_path / "out.jpg", None, OPTIONS, **tell)
    assert told == []


def test_kernel_and_photo_do_not_share_a_file(photo, tmp_path):
    (tmp_path / "out.png").touch()
    with pytest.raises(OutputError):
        fix_file(
            photo, tmp_path / "out.png", tmp_path / "out.png", OPTIONS,
            overwrite=True, overwrite_others=True,
        )  # fmt: skip


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
    told, before = [], photo.read_bytes()
    with pytest.raises(OutputError, match=what):
        estimate_file(
            photo,
            tmp_path / "k.npz",
            OPTIONS,
            latent=tmp_path / name,
            overwrite=True,
            progress=lambda share, _: told.append(share),
        )
    assert told == []
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
    assert photo.read_bytes() == before


def test_tiles_are_drawn_beside_the_latent_picture(photo, tmp_path):
    pictures = {"latent": tmp_path / "l.png", "tiles": tmp_path / "t.jpg"}
    estimate_file(photo, tmp_path / "k.npz", OPTIONS, **pictures)
    with Image.open(pictures["latent"]) as latent, Image.open(pictures["tiles"]) as tiles:
        assert latent.size == (60, 50)
        assert (tiles.format, tiles.mode, tiles.width) == ("JPEG", "RGB", 80)
        assert tiles.height > 64


@pytest.mark.parametrize("step", ["tile_photo", "kernel_bytes"])
def test_kernel_and_pictures_stay_together(photo, tmp_path, monkeypatch, step):
    def fail(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(file_stages, step, fail)
    options = replace(OPTIONS, estimator="edges")
    with pytest.raises(KeyboardInterrupt):
        estimate_file(
            photo, tmp_path / "k.npz", options, latent=tmp_path / "l.png", tiles=tmp_path / "t.png"
        )
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
