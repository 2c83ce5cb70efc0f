from __future__ import annotations

import numpy as np
import pytest
import tifffile
from PIL import Image

from deshake.errors import OutputError, PhotoError
from deshake.files.kernel_file import KernelFile, read_kernel
from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.metadata.provenance import read_provenance
from deshake.stages import outputs
from deshake.stages.finishing import AS_IT_IS, FinishingOptions
from deshake.stages.outputs import prepared, write_result

KERNEL = RotationKernel.delta(Camera.from_focal(100, 64, 80))


@pytest.fixture
def photo(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    codes = np.random.default_rng(2).integers(40, 220, (64, 80, 3)).astype(np.uint8)
    Image.fromarray(codes).save(folder / "a.png")
    return read_photo(folder / "a.png")


def test_the_photo_comes_with_its_sheet_its_kernel_and_its_provenance(photo, tmp_path):
    out, kernel = tmp_path / "out.png", tmp_path / "k.npz"
    result = photo.with_pixels(photo.pixels / 2)
    write_result(
        out,
        result,
        photo,
        None,
        KERNEL,
        finish=FinishingOptions(0.5, compare=True),
        provenance={"deshake": "1"},
        kept=(kernel, KernelFile(KERNEL)),
    )
    assert np.abs(read_photo(out).pixels - 0.75 * photo.pixels).max() < 0.01
    assert read_provenance(out)["deshake"] == "1"
    assert read_kernel(kernel).kernel.camera.shape == (64, 80)
    assert (tmp_path / "out.compare.png").exists()


@pytest.mark.parametrize("existed", [False, True])
def test_sheet_and_kernel_go_if_the_photo_cannot_be_written(photo, tmp_path, monkeypatch, existed):
    others = tmp_path / "k.npz", tmp_path / "out.compare.png"
    if existed:
        for path in others:
            path.write_text("an older one")

    def fail(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(outputs, "photo_bytes", fail)
    with pytest.raises(KeyboardInterrupt):
        write_result(
            tmp_path / "out.png",
            photo,
            photo,
            None,
            KERNEL,
            finish=FinishingOptions(compare=True),
            provenance=None,
            kept=(others[0], KernelFile(KERNEL)),
            overwrite_others=existed,
        )
    assert [path.exists() for path in others] == [existed, existed]
    if existed:
        assert {path.read_text() for path in others} == {"an older one"}


def test_what_the_result_will_lack_is_reported_and_linear_light_is_for_raw_files(
    photo, tmp_path, caplog
):
    assert prepared(photo, tmp_path / "out.png", AS_IT_IS) is photo
    assert caplog.records == []
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((64, 80), np.float32))
    prepared(read_photo(tmp_path / "a.tif"), tmp_path / "out.png", AS_IT_IS)
    assert "beyond white is cut off" in caplog.text
    with pytest.raises(PhotoError, match="--linear is for RAW files"):
        prepared(photo, tmp_path / "out.png", FinishingOptions(linear=True))


def test_a_result_that_another_process_finishes_first_keeps_its_sheet_and_its_kernel(
    photo, tmp_path, monkeypatch
):
    out, sheet, kernel = (tmp_path / name for name in ("out.png", "out.compare.png", "k.npz"))

    def meanwhile(*_):
        for path in (out, sheet, kernel):
            path.write_text("the other's")
        return b"mine"

    monkeypatch.setattr(outputs, "comparison_sheet", meanwhile)
    with pytest.raises(OutputError, match="exists already"):
        write_result(
            out,
            photo,
            photo,
            None,
            KERNEL,
            finish=FinishingOptions(compare=True),
            provenance=None,
            kept=(kernel, KernelFile(KERNEL)),
            overwrite_others=True,
        )
    assert {path.read_text() for path in tmp_path.iterdir() if path.is_file()} == {"the other's"}


def test_a_result_that_is_kept_gets_its_sheet(photo, tmp_path):
    out = tmp_path / "out.png"
    out.write_text("mine")
    finish = FinishingOptions(compare=True)
    write_result(out, photo, photo, None, KERNEL, finish=finish, provenance=None, keep_result=True)
    assert out.read_text() == "mine"
    with Image.open(tmp_path / "out.compare.png") as sheet:
        assert sheet.width > 80
