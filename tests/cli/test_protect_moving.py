from __future__ import annotations

import base64
import io
import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image
from skimage import data

import deshake as library
from deshake.files.kernel_file import KernelFile, read_kernel, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.metadata.provenance import read_provenance
from deshake.operators.shake_blur import ShakeBlur

HEIGHT, WIDTH = 150, 180
CAMERA = Camera.from_focal(300.0, HEIGHT, WIDTH)
OBJECT = np.s_[40:120, 20:80]
FAR = np.s_[:, 130:]
PROTECT = ("--protect-moving", "--keep-masks")


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """Write a shaken photo whose one object is sharp, of 16 bits, and the kernel of the shake."""
    folder = tmp_path_factory.mktemp("followed")
    path = [(-0.01, -0.017, 0), (0.008, 0.0, 0.01), (-0.002, 0.017, 0)]
    kernel = RotationKernel.from_path(path, CAMERA).centred()
    light = (data.astronaut()[:240, 60:300].astype(np.float32) / 255) ** 2.2
    blur = ShakeBlur(kernel)
    g = blur.forward(light[: HEIGHT + 2 * blur.margin, : WIDTH + 2 * blur.margin])
    thing = (data.coffee()[100:250, 150:330].astype(np.float32) / 255) ** 2.2
    g[OBJECT] = thing[OBJECT]
    codes = np.rint(65535 * np.clip(g, 0, 1) ** (1 / 2.2)).astype(np.uint16)
    file = folder / "street.png"
    file.write_bytes(cv2.imencode(".png", codes[..., ::-1])[1].tobytes())
    write_kernel(folder / "street.kernel.npz", KernelFile(kernel))
    return file, folder / "street.kernel.npz"


def codes(path):
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(float)


def test_the_object_keeps_the_photo_and_the_rest_is_deblurred(deshake, followed, tmp_path):
    photo, kernel = followed
    plain, out = tmp_path / "plain.png", tmp_path / "out.png"
    assert deshake("deblur", photo, kernel, "-o", plain).code == 0
    outcome = deshake("deblur", photo, kernel, "-o", out, *PROTECT, tmp_path, "--json")
    assert outcome.code == 0, outcome.err
    before, without, result = (codes(path) for path in (photo, plain, out))
    assert np.abs(result - before)[OBJECT].mean() < 0.5 * np.abs(without - before)[OBJECT].mean()
    assert np.abs(result - without)[FAR].max() < 0.01 * 65535
    assert "protect_moving" not in read_provenance(plain)["options"]
    assert read_provenance(out)["options"]["protect_moving"] is True
    line = json.loads(outcome.out)
    mask = np.asarray(Image.open(tmp_path / "street.mask.png"))
    assert line["moving_mask"] == str(tmp_path / "street.mask.png")
    assert line["moving"] == pytest.approx(mask.mean() / 255, abs=2e-3)
    assert mask.shape == (HEIGHT, WIDTH)
    assert mask[OBJECT].mean() > 100
    assert mask[FAR].max() < 5


def test_the_written_mask_gives_the_same_picture_as_a_mask(deshake, followed, tmp_path):
    photo, kernel = followed
    out, again = tmp_path / "out.png", tmp_path / "again.png"
    assert deshake("deblur", photo, kernel, "-o", out, *PROTECT, tmp_path / "masks").code == 0
    by_mask = ("--mask", tmp_path / "masks")
    assert deshake("deblur", photo, kernel, "-o", again, *by_mask).code == 0
    assert np.abs(codes(out) - codes(again)).max() < 0.01 * 65535


def test_the_report_shows_where_the_photo_is_kept(deshake, followed, tmp_path):
    photo, kernel = followed
    page = tmp_path / "look.html"
    words = ("-o", tmp_path / "out.png", "--protect-moving", "--report", page)
    assert deshake("deblur", photo, kernel, *words).code == 0
    shown = r'<img [^>]*keeps the photo"[^>]*src="data:image/jpeg;base64,([^"]*)"'
    [picture] = re.findall(shown, page.read_text())
    tinted = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture))), float)
    colour = tinted[..., 0] - tinted[..., 2]
    assert tinted.shape[:2] == (HEIGHT, WIDTH)
    assert colour[OBJECT].mean() > 50
    assert abs(colour[FAR].mean()) < 5
    assert "--protect-moving" in page.read_text()


def test_fix_gives_the_bytes_of_its_stages_and_can_be_resumed(deshake, shaken, tmp_path):
    photo, folder = shaken("a.png", large=True, size=(150, 120)), tmp_path / "k"
    one, two = tmp_path / "one.png", tmp_path / "two.png"
    fast = ("--blur-size", 9, "--uniform", "--region", "20,10,110,100")
    words = (*PROTECT, folder, "--keep-kernels", folder)
    outcome = deshake("fix", photo, *fast, "-o", one, *words, "--json")
    assert outcome.code == 0, outcome.err
    assert json.loads(outcome.out)["verdict"] != "left"
    kernel = folder / "a.kernel.npz"
    assert deshake("deblur", photo, kernel, "-o", two, "--protect-moving").code == 0
    assert one.read_bytes() == two.read_bytes()
    again = ("fix", photo, *fast, "-o", one, "--skip-existing", "--json")
    assert json.loads(deshake(*again, *words).out)["status"] == "skipped"
    warned = json.loads(deshake(*again).out)
    assert any("other options" in note for note in warned["warnings"]), warned
    (folder / "a.mask.png").unlink()
    assert json.loads(deshake(*again, *words, "--dry-run").out)["status"] != "skipped"
    before = one.stat().st_mtime_ns
    assert deshake(*again, *words).code == 0
    assert (folder / "a.mask.png").is_file()
    assert one.stat().st_mtime_ns == before


def test_a_photo_that_is_left_as_it_is_has_a_black_mask(deshake, followed, tmp_path):
    photo, _ = followed
    still, out = tmp_path / "still.npz", tmp_path / "out.png"
    write_kernel(still, KernelFile(RotationKernel.delta(CAMERA)))
    outcome = deshake("deblur", photo, still, "-o", out, *PROTECT, tmp_path, "--json")
    assert outcome.code == 0, outcome.err
    assert "moving" not in json.loads(outcome.out)
    assert not np.asarray(Image.open(tmp_path / "street.mask.png")).any()
    assert np.array_equal(codes(out), codes(photo))


def test_the_mask_of_a_lens_that_bends_belongs_to_the_photo(deshake, followed, tmp_path):
    photo, kernel = followed
    bent = CAMERA.with_lens(np.array([-0.3, 0.0, 0.0, 0.0]))
    lens = tmp_path / "lens.npz"
    write_kernel(lens, KernelFile(read_kernel(kernel).kernel.for_camera(bent)))
    masks = []
    for keep in ((), ("--keep-geometry",)):
        out = ("-o", tmp_path / f"{len(masks)}.png", "--overwrite")
        words = (*out, *PROTECT, tmp_path, *keep)
        assert deshake("deblur", photo, lens, *words).code == 0
        masks.append(np.asarray(Image.open(tmp_path / "street.mask.png"), float))
    assert masks[0].shape == masks[1].shape == (HEIGHT, WIDTH)
    for mask in masks:
        assert mask[OBJECT].mean() > mask[FAR].mean() + 50


def test_from_python(followed):
    photo, kernel = library.read_photo(followed[0]), library.read_kernel(followed[1]).kernel
    # an array clips where a channel is 1; a file of 16 bits clips a little below, too
    white = np.where(photo.clipped[..., None], np.float32(1), photo.pixels)
    photo = replace(photo, pixels=white)
    plain = library.deblur(photo, kernel)
    kept = library.deblur(photo, kernel, protect_moving=True)
    assert np.abs(kept.pixels - photo.pixels)[OBJECT].mean() < (
        0.5 * np.abs(plain.pixels - photo.pixels)[OBJECT].mean()
    )
    array = library.deblur(photo.pixels, kernel, protect_moving=True)
    assert np.abs(array - kept.pixels).mean() < 1e-4


def test_every_method_and_a_noisy_photo(deshake, followed, tmp_path):
    photo, kernel = followed
    noisy = tmp_path / "noisy.png"
    Image.fromarray(np.rint(codes(photo)[..., ::-1] / 257).astype(np.uint8)).save(noisy)
    for words in (("--method", "rl", "--iterations", 8), ("--noisy", noisy, "--search-angle", 2)):
        out = ("-o", tmp_path / "out.png", "--overwrite", "--json")
        outcome = deshake("deblur", photo, kernel, *words, *out, "--protect-moving")
        assert outcome.code == 0, outcome.err
        assert 0 <= json.loads(outcome.out)["moving"] <= 1


def test_wrong_use(deshake, followed, tmp_path):
    photo, kernel = followed
    out = ("-o", tmp_path / "out.png")
    outcome = deshake("deblur", photo, kernel, *out, "--keep-masks", tmp_path)
    assert outcome.code == 2
    assert "--keep-masks needs --protect-moving" in outcome.err
    (tmp_path / "street.mask.png").write_bytes(b"mine")
    outcome = deshake("deblur", photo, kernel, *out, *PROTECT, tmp_path)
    assert outcome.code == 1
    assert (tmp_path / "street.mask.png").read_bytes() == b"mine"
    assert not (tmp_path / "out.png").exists()
    settings = tmp_path / "settings.toml"
    settings.write_text(f"[deblur]\nkeep-masks = {str(tmp_path)!r}\n")
    assert deshake("--config", settings, "deblur", photo, kernel, *out).code == 0
