from __future__ import annotations

import numpy as np
import pytest

from deshake.errors import KernelFileError
from deshake.files.npz import pack
from deshake.files.shared_keys import (
    FORMAT,
    camera_arrays,
    camera_of,
    check_format,
    provenance_array,
    provenance_of,
    read_arrays,
    text_of,
)
from deshake.geometry.camera import Camera


def test_a_camera_goes_through_its_arrays():
    camera = Camera.from_focal(1200, 600, 800).cropped(100, 50, 300, 200)
    again = camera_of(camera_arrays(camera))
    assert np.array_equal(again.matrix, camera.matrix)
    assert again.shape == camera.shape


def test_other_versions_are_refused():
    check_format(pack({"format": np.int64(FORMAT)}))
    with pytest.raises(ValueError, match="its format is 7"):
        check_format(pack({"format": np.int64(7)}))


def test_provenance_is_json_data_in_a_fixed_order():
    text = provenance_array({"b": 1, "a": [None, "x"]})
    assert str(text) == '{"a": [null, "x"], "b": 1}'
    assert provenance_of({"provenance": text}) == {"b": 1, "a": [None, "x"]}
    with pytest.raises(ValueError, match="JSON compliant"):
        provenance_array({"a": float("inf")})
    with pytest.raises(ValueError, match="not a JSON object"):
        provenance_of({"provenance": np.array("[1]")})


def test_text_is_text():
    assert text_of(np.array("day"), "source") == "day"
    with pytest.raises(ValueError, match="'source' is not text"):
        text_of(np.array([0x110000], np.uint32).view("U1"), "source")


def test_an_error_of_a_parser_names_the_file(tmp_path):
    path = tmp_path / "a.npz"
    path.write_bytes(b"12345")

    def parse(data):
        raise ValueError(f"{len(data)} bytes")

    with pytest.raises(KernelFileError, match="no usable camera file: 5 bytes") as caught:
        read_arrays(path, "camera", parse, 100)
    assert str(caught.value).startswith(str(path))
    with pytest.raises(KernelFileError, match="larger than"):
        read_arrays(path, "camera", parse, 4)
