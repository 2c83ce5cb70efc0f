from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.errors import OutputError, PhotoError
from deshake.files.kernel_file import read_kernel
from deshake.formats.photo import read_photo
from deshake.run import Run
from deshake.stages import fixing, outputs
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.fixing import fix_file
from deshake.stages.methods import RestorationOptions

HEIGHT, WIDTH = 110, 150
OPTIONS = EstimateOptions(
    camera=CameraChoice(focal_px=160),
    transfer="linear",
    blur_size=9,
    uniform=True,
    search_angle=4,
)
QUICK = RestorationOptions("fusion", iterations=2)


@pytest.fixture(scope="module")
def photos():
    """A photo blurred by seven pixels, a noisy one at a quarter of the light, and the truth."""
    light = cv2.resize(data.coffee(), (WIDTH + 16, HEIGHT), interpolation=cv2.INTER_AREA) / 255.0
    blurred = cv2.blur(light, (7, 1))[:, 8:-8]
    noisy = light[:, 8:-8] / 4
    noisy += np.random.default_rng(0).normal(0, 0.01, noisy.shape)
    return blurred, noisy, light[:, 8:-8]


@pytest.fixture
def pair(photos, tmp_path):
    paths = tmp_path / "long.png", tmp_path / "short.png"
    for path, image in zip(paths, photos[:2], strict=True):
        codes = np.rint(65535 * np.clip(image, 0, 1)).astype(np.uint16)
        cv2.imwrite(str(path), codes[..., ::-1])
    return paths


def squared(photo, sharp):
    """Mean squared error at the best shift by whole pixels."""
    inner = sharp[6:-6, 6:-6].astype(np.float32)
    error = cv2.matchTemplate(photo.pixels, inner, cv2.TM_SQDIFF)
    return float(error.min()) / inner.size


def test_a_sharp_photo_comes_out(pair, photos, tmp_path):
    reports = []
    estimate = fix_file(
        pair[0],
        tmp_path / "out.png",
        tmp_path / "k.npz",
        OPTIONS,
        noisy=pair[1],
        restoration=RestorationOptions("fusion"),
        run=Run(1, lambda share, text: reports.append((share, text))),
    )
    out = read_photo(tmp_path / "out.png", transfer="linear")
    blurred, noisy = (read_photo(path, transfer="linear") for path in pair)
    noisy = noisy.with_pixels(4 * noisy.pixels)
    assert squared(out, photos[2]) < 0.25 * min(squared(p, photos[2]) for p in (blurred, noisy))
    content = read_kernel(tmp_path / "k.npz")
    assert np.array_equal(content.kernel.weights, estimate.content.kernel.weights)
    shares = [share for share, _ in reports]
    assert shares == sorted(shares)
    assert shares[-1] == 1
    report = estimate.report()
    assert report["camera_source"] == "--focal-px 160"
    assert report["scale"] == pytest.approx(4, rel=0.05)
    assert report["notes"] == []


def test_the_kernel_goes_with_the_photo(pair, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(outputs, "photo_bytes", fail)
    out, kernel = tmp_path / "out.png", tmp_path / "k.npz"
    with pytest.raises(KeyboardInterrupt):
        fix_file(pair[0], out, kernel, OPTIONS, noisy=pair[1], restoration=QUICK, run=Run(1))
    assert {path.name for path in tmp_path.iterdir()} == {"long.png", "short.png"}


@pytest.mark.parametrize("name", ["long.png", "short.png", "out.png"])
def test_the_kernel_is_no_photo(pair, tmp_path, name):
    out, kernel = tmp_path / "out.png", tmp_path / name
    with pytest.raises(OutputError, match="the output is the input itself"):
        fix_file(
            pair[0],
            out,
            kernel,
            OPTIONS,
            noisy=pair[1],
            restoration=QUICK,
            overwrite=True,
            overwrite_others=True,
        )


def test_what_cannot_be_written_fails_before_the_work(pair, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise AssertionError

    monkeypatch.setattr(fixing, "find_registration", fail)
    (tmp_path / "k.npz").write_text("mine")
    for out, kernel in ((tmp_path / "no" / "out.png", None), (tmp_path / "out.gif", None)):
        with pytest.raises(OutputError):
            fix_file(pair[0], out, kernel, OPTIONS, noisy=pair[1], restoration=QUICK)
    with pytest.raises(OutputError, match="exists already"):
        fix_file(
            pair[0],
            tmp_path / "out.png",
            tmp_path / "k.npz",
            OPTIONS,
            noisy=pair[1],
            restoration=QUICK,
        )
    assert (tmp_path / "k.npz").read_text() == "mine"


def test_a_missing_photo_is_named(pair, tmp_path):
    gone = tmp_path / "gone.png"
    with pytest.raises(PhotoError, match="no such file") as error:
        fix_file(pair[0], tmp_path / "out.png", None, OPTIONS, noisy=gone, restoration=QUICK)
    assert error.value.file == str(gone)


def test_an_assumed_lens_is_noted_once(pair, tmp_path, caplog):
    options = replace(OPTIONS, camera=CameraChoice())
    estimate = fix_file(
        pair[0], tmp_path / "out.png", None, options, noisy=pair[1], restoration=QUICK, run=Run(1)
    )
    assert sum("50 mm" in note for note in estimate.report()["notes"]) == 1
    assert caplog.text.count("50 mm-equivalent is assumed") == 1
