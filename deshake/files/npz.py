"""The ``.npz`` container: strict reading, and equal bytes for equal arrays.

A file may come from a stranger. Names, sizes and types are checked in the zip directory and in each
array's header before any array is read. No Python object is unpickled. Reading uses no more memory
than the caller's limits allow.
"""

from __future__ import annotations

import io
import math
import struct
import tokenize
import zipfile
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.lib import format as npy

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

__all__ = ["Field", "pack", "unpack"]

_HEADER_ROOM: Final = 4096  # bytes of an .npy header beyond its data
_MAX_DIRECTORY: Final = 1 << 16  # bytes of the zip directory
_END: Final = b"PK\x05\x06"
_ZIP64: Final = b"PK\x06\x07"
_ENCRYPTED: Final = 1
_METHODS: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_KINDS: Final = {"f": "float64", "i": "integers", "U": "text"}
_DATE: Final = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Field:
    """The required form of an array.

    Parameters
    ----------
    kind : {"f", "i", "U"}
        float64, an integer type, or text.
    shape : tuple of int or None
        Its shape; None for a free length.
    limit : int
        The largest number of entries; for text, of characters.

    """

    kind: str
    shape: tuple[int | None, ...] = ()
    limit: int = 64


def unpack(data: bytes, fields: Mapping[str, Field]) -> dict[str, NDArray[Any]]:
    """Read the named arrays of an ``.npz`` file; other arrays are ignored.

    Parameters
    ----------
    data : bytes
        The file.
    fields : mapping of str to Field
        The wanted arrays; all of them must be in the file.

    Returns
    -------
    dict of str to array
        The arrays, float64 and integers in native byte order.

    Raises
    ------
    ValueError
        If the file is damaged, or an array is missing or differs from its field. The message is
        one line.

    """
    _check_end(data)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = _members(archive, fields)
            return {key: _read(archive, members[key], key, fields[key]) for key in fields}
    except _RefusalError:
        raise
    except _DAMAGE as error:
        raise ValueError("is damaged or cut short") from error


def pack(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Make an ``.npz`` file. Equal arrays make equal bytes: dates and modes are fixed."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for key, array in arrays.items():
            member = io.BytesIO()
            npy.write_array(member, np.asarray(array), allow_pickle=False)
            info = zipfile.ZipInfo(f"{key}.npy", _DATE)
            info.create_system = 3
            info.external_attr = 0o644 << 16
            archive.writestr(info, member.getvalue())
    return stream.getvalue()


class _RefusalError(ValueError):
    """An error of the file, in one line."""


_DAMAGE: Final = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    OSError,
    EOFError,
    ValueError,
    TypeError,
    SyntaxError,
    tokenize.TokenError,  # NumPy's second attempt at a header that is no literal
    LookupError,
    OverflowError,
    RecursionError,
    MemoryError,
    NotImplementedError,
    RuntimeError,
)


def _check_end(data: bytes) -> None:
    """Check the end record of the zip, which locates the directory."""
    if not data:
        raise ValueError("is empty")
    if data[:4] != b"PK\x03\x04":
        raise ValueError("is not an .npz file")
    end = data.rfind(_END, max(0, len(data) - 22 - 65535))
    if end < 0 or end + 22 > len(data):
        raise ValueError("is damaged or cut short")
    size = struct.unpack_from("<I", data, end + 12)[0]
    if size > _MAX_DIRECTORY or data[max(0, end - 20) : end].startswith(_ZIP64):
        raise ValueError("holds too many arrays")


def _members(archive: zipfile.ZipFile, wanted: Iterable[str]) -> dict[str, zipfile.ZipInfo]:
    """Return the wanted arrays' entries in the zip's directory; refuse a name that occurs twice."""
    members: dict[str, zipfile.ZipInfo] = {}
    for info in archive.infolist():
        key = info.filename.removesuffix(".npy")
        if key in members:
            raise _RefusalError(f"{_show(key)} is there twice")
        members[key] = info
    for key in wanted:
        if key not in members:
            raise _RefusalError(f"{key!r} is missing")
    return members


def _read(archive: zipfile.ZipFile, info: zipfile.ZipInfo, key: str, field: Field) -> NDArray[Any]:
    """Read one array after its entry in the directory and its header have been checked."""
    width = 4 if field.kind == "U" else 8
    room = field.limit * width
    if info.flag_bits & _ENCRYPTED or info.compress_type not in _METHODS:
        raise _RefusalError(f"{key!r} is encrypted, or packed in an unknown way")
    if info.file_size > room + _HEADER_ROOM:
        raise _RefusalError(f"{key!r} is too large ({info.file_size} bytes)")
    with archive.open(info) as member:
        head = member.read(_HEADER_ROOM)
        shape, fortran, dtype, start = _read_header(head, info.file_size, key, field)
        values = (head + member.read())[start:]
    native = dtype.newbyteorder("=") if field.kind != "i" else np.dtype(np.int64)
    array = np.frombuffer(values, dtype).reshape(shape, order="F" if fortran else "C")
    return np.array(array, native, order="C")


def _read_header(
    head: bytes, file_size: int, key: str, field: Field
) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    """Check the header of one ``.npy`` against its field; return where the data begins."""
    stream = io.BytesIO(head)
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, fortran, dtype = read(stream)
    if dtype.hasobject:
        raise _RefusalError(f"{key!r} holds Python objects, which are never read")
    if dtype.kind != field.kind or (field.kind == "f" and dtype.itemsize != 8):
        raise _RefusalError(f"{key!r} is {dtype.name}, not {_KINDS[field.kind]}")
    fits = len(shape) == len(field.shape) and all(
        want is None or have == want for have, want in zip(shape, field.shape, strict=True)
    )
    if not fits:
        raise _RefusalError(f"{key!r} has shape {_show(shape)}, not {_shape_text(field.shape)}")
    count = math.prod(shape)
    if count * dtype.itemsize > field.limit * (4 if field.kind == "U" else 8):
        raise _RefusalError(f"{key!r} has more than {field.limit} entries")
    if stream.tell() + count * dtype.itemsize != file_size:
        raise _RefusalError(f"{key!r} is cut short")
    return shape, fortran, dtype, stream.tell()


def _shape_text(shape: tuple[int | None, ...]) -> str:
    names = ["K" if side is None else str(side) for side in shape]
    return f"({', '.join(names)}{',' if len(names) == 1 else ''})"


def _show(value: object) -> str:
    """Show something from a file in one short line."""
    return repr(value)[:40]
