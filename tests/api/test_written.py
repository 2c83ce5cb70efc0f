from __future__ import annotations

import sys

import numpy as np
import pytest
from PIL import Image

import deshake as library
from deshake.api.written import write_kernel, write_photo
from deshake.errors import DeshakeError, OutputError, PhotoError


@pytest.mark.parametrize(
    ("name", "off"), [("a.png", 2e-5), ("a.tif", 2e-5), ("a.jp2", 2e-5), ("a.jpg", 0.03)]
)
@pytest.mark.parametrize("colour", [False, True])
def test_an_array_is_written_as_srgb(tmp_path, name, off, colour):
    ramp = np.linspace(0, 1, 40 * 60).reshape(40, 60)
    light = np.stack([ramp, ramp, ramp], -1) if colour else ramp
    write_photo(tmp_path / name, light)
    assert abs(library.read_photo(tmp_path / name).pixels - light).max() < off


def test_a_jpeg_of_an_array_is_srgb_to_another_reader(tmp_path):
    write_photo(tmp_path / "a.jpg", np.full((16, 16, 3), 0.2140411))  # code 127.5 of 255
    with Image.open(tmp_path / "a.jpg") as picture:
        assert abs(np.asarray(picture).astype(int) - 127).max() <= 1


def test_files_are_kept_and_names_have_endings(tmp_path):
    grey = np.full((8, 9), 0.5)
    write_photo(tmp_path / "a.png", grey)
    with pytest.raises(OutputError, match="exists"):
        write_photo(tmp_path / "a.png", grey)
    write_photo(tmp_path / "a.png", grey, overwrite=True)
    with pytest.raises(OutputError, match="the name has no ending"):
        write_photo(tmp_path / "a", grey)
    with pytest.raises(OutputError, match=r"no photo format ends in '\.gif'"):
        write_photo(tmp_path / "a.gif", grey)
    with pytest.raises(PhotoError, match="uint8"):
        write_photo(tmp_path / "b.png", grey.astype(np.uint8))
    assert {path.name for path in tmp_path.iterdir()} == {"a.png"}


def test_a_photo_is_written_as_it_was_read(tmp_path):
    Image.new("RGB", (20, 16), (9, 90, 200)).save(tmp_path / "a.jpg")
    write_photo(tmp_path / "b.jpg", library.read_photo(tmp_path / "a.jpg"))
    one, other = (np.asarray(Image.open(tmp_path / name)) for name in ("a.jpg", "b.jpg"))
    assert np.array_equal(one, other)


def test_a_kernel_is_written_with_what_is_known_of_it(tmp_path, shaken):
    write_kernel(tmp_path / "a.npz", shaken.kernel)
    bare = library.read_kernel(tmp_path / "a.npz")
    assert (bare.confidence, bare.provenance) == (1.0, {})
    content = library.KernelFile(shaken.kernel, 0.5, {"by": "hand"})
    write_kernel(tmp_path / "b.npz", content)
    known = library.read_kernel(tmp_path / "b.npz")
    assert (known.confidence, known.provenance) == (0.5, {"by": "hand"})
    with pytest.raises(DeshakeError, match="not a RotationKernel: ndarray"):
        write_kernel(tmp_path / "c.npz", shaken.kernel.weights)
    assert not (tmp_path / "c.npz").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="has no such permissions")
def test_an_array_is_a_file_as_any_other_and_a_photo_takes_the_permissions_of_its_own(tmp_path):
    known = tmp_path / "a.png"
    write_photo(known, np.full((8, 9), 0.5))
    (tmp_path / "any").touch()
    assert known.stat().st_mode == (tmp_path / "any").stat().st_mode
    known.chmod(0o640)
    write_photo(tmp_path / "b.png", library.read_photo(known))
    assert (tmp_path / "b.png").stat().st_mode & 0o777 == 0o640
