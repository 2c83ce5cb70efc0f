from __future__ import annotations

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from deshake.files.kernel_file import KernelFile
from deshake.formats.photo import read_photo
from deshake.formats.photo_writing import write_photo
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.lens.straightening import is_straightened
from deshake.metadata.provenance import read_provenance
from deshake.pair.registration import Registration
from deshake.stages.finishing import FinishingOptions
from deshake.stages.methods import RestorationOptions
from deshake.stages.photo_provenance import photo_provenance, with_photo_provenance
from deshake.version import __version__


@pytest.fixture
def photo(tmp_path):
    Image.new("RGB", (12, 8), "teal").save(tmp_path / "a.png")
    return read_photo(tmp_path / "a.png")


def content(provenance):
    kernel = RotationKernel.from_path([(0, 0, 0)], Camera.from_focal(10, 8, 12))
    return KernelFile(kernel, 1.0, provenance)


def test_it_has_the_options_and_the_inputs(photo):
    written = photo_provenance(
        photo,
        content({"camera": "EXIF", "scales": [1, 2]}),
        RestorationOptions("rl", iterations=3),
        transfer="linear",
    )
    assert written == {
        "deshake": __version__,
        "command": "deblur",
        "options": {
            "transfer": "linear",
            "method": "rl",
            "quality": "default",
            "iterations": 3,
        },
        "input_sha256": hashlib.sha256(photo.source.read_bytes()).hexdigest(),
        "kernel": {"camera": "EXIF"},
    }
    json.dumps(written)
    silent = FinishingOptions(with_provenance=False)
    assert photo_provenance(photo, content({}), RestorationOptions(), finish=silent) is None


def test_a_pair_names_both_photos(photo, tmp_path):
    Image.new("RGB", (12, 8), "olive").save(tmp_path / "n.png")
    noisy = read_photo(tmp_path / "n.png")
    written = photo_provenance(photo, content({}), RestorationOptions("fusion"), noisy=noisy)
    assert written["noisy_sha256"] == hashlib.sha256(noisy.source.read_bytes()).hexdigest()
    assert written["options"]["method"] == "fusion"


def test_a_registration_is_recorded_if_the_kernel_does_not_record_it(photo):
    camera = Camera.from_focal(10, 8, 12)
    one, other = (Registration(np.array([0, y, 0.0]), 2.0, 0.9, camera) for y in (0.1, 0.2))
    kernel_file = content({"registration": one.report()})
    written = [
        photo_provenance(
            photo, kernel_file, RestorationOptions("fusion"), noisy=photo, registration=given
        )
        for given in (None, one, other)
    ]
    assert "registration" not in written[0] | written[1]
    assert written[2]["registration"] == {"theta": [0, 0.2, 0], "scale": 2, "confidence": 0.9}


def test_a_straightened_photo_says_so_in_each_later_result(photo):
    pinhole = content({})
    lens = Camera.from_focal(10, 8, 12).with_lens(np.array([-0.1, 0, 0, 0]))
    bent = KernelFile(pinhole.kernel.for_camera(lens))
    options = RestorationOptions()
    assert "straightened" not in photo_provenance(photo, pinhole, options)
    kept = photo_provenance(photo, bent, options, finish=FinishingOptions(keep_geometry=True))
    assert "straightened" not in kept
    written = photo_provenance(photo, bent, options)
    assert written["straightened"] is True
    result = with_photo_provenance(photo, written)
    assert is_straightened(result)
    assert not is_straightened(photo)
    assert photo_provenance(result, pinhole, options)["straightened"] is True


def test_a_kernel_of_many_words_does_not_swell_the_photo(photo):
    written = photo_provenance(photo, content({"text": "x" * 100_000}), RestorationOptions())
    assert written["kernel"] == {}


def test_no_path_is_recorded(photo, tmp_path):
    written = photo_provenance(photo, content({}), RestorationOptions())
    write_photo(tmp_path / "out.png", with_photo_provenance(photo, written))
    assert read_provenance(tmp_path / "out.png") == written
    assert str(tmp_path).encode() not in (tmp_path / "out.png").read_bytes()


def test_damaged_xmp_is_reported(photo, caplog):
    damaged = with_photo_provenance(photo, {"deshake": "1"})
    object.__setattr__(damaged.metadata, "xmp", b"<rubbish/>")
    assert with_photo_provenance(damaged, {"deshake": "2"}).metadata.xmp == b"<rubbish/>"
    assert "do not get a note of how it was made" in caplog.text


def test_the_digest_is_that_of_the_bytes_that_were_read(photo):
    before = hashlib.sha256(photo.source.read_bytes()).hexdigest()
    photo.source.write_bytes(b"another photo")
    written = photo_provenance(photo, content({}), RestorationOptions())
    assert written["input_sha256"] == before
    photo.source.unlink()
    assert photo_provenance(photo, content({}), RestorationOptions()) == written


def test_a_photo_in_memory_has_no_digest(photo):
    written = photo_provenance(replace(photo, sha256=None), content({}), RestorationOptions())
    assert "input_sha256" not in written
