from __future__ import annotations

import io
import pickle
import struct
import zipfile

import numpy as np
import pytest

from deshake.files.npz import Field, pack, unpack

FIELDS = {"a": Field("f", (None, 3), 300), "n": Field("i"), "t": Field("U", limit=100)}


def arrays() -> dict[str, np.ndarray]:
    return {"a": np.arange(12.0).reshape(4, 3), "n": np.array(5), "t": np.array("text é")}


def member(content: bytes, **info: int) -> bytes:
    """Make a file whose array "n" has the given bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", info.get("method", zipfile.ZIP_STORED)) as archive:
        archive.writestr("n.npy", content)
    return stream.getvalue()


def npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def test_numpy_reads_what_is_packed_and_the_other_way_round() -> None:
    with np.load(io.BytesIO(pack(arrays())), allow_pickle=False) as file:
        assert set(file) == {"a", "n", "t"}
        assert np.array_equal(file["a"], arrays()["a"])
    for save in (np.savez, np.savez_compressed):
        stream = io.BytesIO()
        save(stream, **arrays(), another=np.zeros(5))
        read = unpack(stream.getvalue(), FIELDS)
        assert np.array_equal(read["a"], arrays()["a"])
        assert (int(read["n"]), str(read["t"])) == (5, "text é")
        assert set(read) == {"a", "n", "t"}


def test_equal_arrays_make_equal_bytes() -> None:
    data = pack(arrays())
    assert data == pack(arrays())
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_orders_and_integer_types_are_accepted() -> None:
    odd = {
        "a": np.asfortranarray(arrays()["a"].astype(">f8")),
        "n": np.array(5, ">i2"),
        "t": np.array("text", ">U9"),
    }
    read = unpack(pack(odd), FIELDS)
    assert np.array_equal(read["a"], arrays()["a"])
    assert read["a"].dtype == np.float64
    assert read["a"].dtype.isnative
    assert (int(read["n"]), str(read["t"])) == (5, "text")


@pytest.mark.parametrize(
    ("key", "value", "match"),
    [
        ("a", None, "'a' is missing"),
        ("a", np.zeros(3), r"'a' has shape \(3,\), not \(K, 3\)"),
        ("a", np.zeros((4, 2)), r"shape \(4, 2\)"),
        ("a", np.zeros((4, 3), np.float32), "'a' is float32, not float64"),
        ("a", np.zeros((4, 3), complex), "'a' is complex128"),
        ("a", np.zeros((101, 3)), "more than 300 entries"),
        ("n", np.array(5.0), "'n' is float64, not integers"),
        ("n", np.array([5]), r"'n' has shape \(1,\), not \(\)"),
        ("t", np.array(b"text"), "'t' is bytes"),
        ("t", np.array("x" * 101), "more than 100 entries"),
    ],
)
def test_arrays_that_do_not_fit_are_named(key: str, value: np.ndarray | None, match: str) -> None:
    given = arrays()
    if value is None:
        del given[key]
    else:
        given[key] = value
    with pytest.raises(ValueError, match=match):
        unpack(pack(given), FIELDS)


def test_python_objects_are_never_loaded() -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (pytest.fail, ("a pickle was loaded",))

    stream = io.BytesIO()
    np.savez(stream, n=np.array([Trap()], dtype=object))
    with pytest.raises(ValueError, match="Python objects"):
        unpack(stream.getvalue(), {"n": Field("i")})
    with pytest.raises(ValueError, match="is not an"):
        unpack(pickle.dumps(Trap()), {"n": Field("i")})
    with pytest.raises(ValueError, match="damaged"):
        unpack(member(pickle.dumps([Trap()])), {"n": Field("i")})


def test_sizes_are_checked_before_anything_is_unpacked() -> None:
    bomb = member(npy(np.array(5)) + bytes(50 << 20), method=zipfile.ZIP_DEFLATED)
    assert len(bomb) < 100_000
    with pytest.raises(ValueError, match="too large"):
        unpack(bomb, {"n": Field("i")})


def test_a_header_that_claims_more_than_there_is() -> None:
    head = npy(np.zeros((4, 3)))
    claimed = head.replace(b"(4, 3), }  ", b"(99, 3), } ")
    with pytest.raises(ValueError, match="cut short"):
        unpack(member(claimed), {"n": Field("f", (None, 3), 300)})
    for shape in (
        b"((4, 3)",
        b"(4, 3",
        b"'''(4, 3)",
        b"(10**9, 3)",
        b"(-4, 3)",
        b"(" * 900 + b")" * 900,
        b"(999999999999, 99999)",
    ):
        text = b"{'descr': '<f8', 'fortran_order': False, 'shape': " + shape + b"}\n"
        lying = b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text
        with pytest.raises(ValueError, match=r"damaged|entries|cut short"):
            unpack(member(lying), {"n": Field("f", (None, None), 300)})


def test_a_directory_that_states_a_wrong_size_is_refused() -> None:
    data = bytearray(member(npy(np.array(5)) + bytes(5 << 20), method=zipfile.ZIP_DEFLATED))
    at = data.rindex(b"PK\1\2")
    struct.pack_into("<I", data, at + 24, 136)  # claim the size that is expected
    with pytest.raises(ValueError, match="damaged"):
        unpack(bytes(data), {"n": Field("i")})


def test_too_many_and_repeated_names() -> None:
    many = pack({f"key{i}": np.array(5) for i in range(3000)})
    with pytest.raises(ValueError, match="too many"):
        unpack(many, {"key1": Field("i")})
    twice = pack({"n": np.array(5), "m": np.array(6)}).replace(b"m.npy", b"n.npy")
    with pytest.raises(ValueError, match="twice"):
        unpack(twice, {"n": Field("i")})


def test_encryption_and_unknown_packing() -> None:
    for offset, value in ((8, 1), (10, 12)):
        data = bytearray(member(npy(np.array(5))))
        struct.pack_into("<H", data, data.rindex(b"PK\1\2") + offset, value)
        with pytest.raises(ValueError, match="encrypted"):
            unpack(bytes(data), {"n": Field("i")})


def test_every_truncation_and_many_flips_are_one_line() -> None:
    data = pack(arrays())
    for size in range(len(data)):
        with pytest.raises(ValueError, match=r"\A[^\n]+\Z"):
            unpack(data[:size], FIELDS)
    rng = np.random.default_rng(5)
    for _ in range(1500):
        broken = bytearray(data)
        for at in rng.integers(0, len(data), 3):
            broken[at] = rng.integers(256)
        try:
            unpack(bytes(broken), FIELDS)
        except ValueError as error:
            assert "\n" not in str(error)  # noqa: PT017
