from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from deshake.errors import OutputError, PhotoError
from deshake.files.kernel_file import read_kernel
from deshake.run import Run
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.deblurring import deblur_file
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.estimating import estimate_file
from deshake.stages.fixing import fix_file
from deshake.stages.methods import RestorationOptions

OPTIONS = EstimateOptions(
    camera=CameraChoice(focal_35mm=40), blur_size=3, uniform=True, region=(0, 0, 60, 50)
)


def test_fixing_is_estimating_and_deblurring(soft_photo, tmp_path):
    estimated = estimate_file(soft_photo, tmp_path / "one.npz", OPTIONS)
    deblur_file(soft_photo, tmp_path / "one.npz", tmp_path / "one.png")
    fixed = fix_file(soft_photo, tmp_path / "two.png", tmp_path / "two.npz", OPTIONS)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    assert fixed.report() == estimated.report()
    kernel = read_kernel(tmp_path / "two.npz").kernel
    assert np.array_equal(kernel.weights, fixed.content.kernel.weights)


def test_progress_rises_from_estimate_to_deblurring(soft_photo, tmp_path):
    reports = []
    fix_file(
        soft_photo,
        tmp_path / "out.png",
        None,
        OPTIONS,
        restoration=RestorationOptions(iterations=3),
        run=Run(progress=lambda share, text: reports.append((share, text))),
    )
    shares = [share for share, _ in reports]
    assert shares == sorted(shares)
    assert shares[0] < 0.2
    assert shares[-1] == pytest.approx(1)
    assert len({text for _, text in reports}) > 2


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
    reports = []
    keywords = {"run": Run(progress=lambda share, _: reports.append(share)), "overwrite": True}
    with pytest.raises(OutputError, match=what):
        deblur_file(photo, kernel, tmp_path / name, **keywords)
    with pytest.raises(OutputError, match=what):
        fix_file(photo, tmp_path / name, None, OPTIONS, **keywords)
    assert reports == []


def test_a_format_that_cannot_hold_the_photo_fails_before_any_work(kernel, tmp_path):
    path, reports = tmp_path / "clear.png", []
    Image.new("RGBA", (80, 64), (1, 2, 3, 4)).save(path)
    keywords = {"run": Run(progress=lambda share, _: reports.append(share))}
    with pytest.raises(PhotoError, match="transparency"):
        deblur_file(path, kernel, tmp_path / "out.jpg", **keywords)
    with pytest.raises(PhotoError, match="transparency"):
        fix_file(path, tmp_path / "out.jpg", None, OPTIONS, **keywords)
    assert reports == []


def test_kernel_and_photo_do_not_share_a_file(photo, tmp_path):
    (tmp_path / "out.png").touch()
    with pytest.raises(OutputError):
        fix_file(
            photo, tmp_path / "out.png", tmp_path / "out.png", OPTIONS,
            overwrite=True, overwrite_others=True,
        )  # fmt: skip
