"""Linear equations with a positive definite matrix, solved by LAPACK while other threads work.

The functions of `scipy.linalg` hold the lock of Python for as long as LAPACK runs, so threads that
solve equations wait for each other. A call by `ctypes` releases it. The routine is the same one.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Final

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy import LowLevelCallable
from scipy.linalg import cython_lapack

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["solved"]

Vector = NDArray[np.float64]


def solved(matrix: Vector, right: Vector) -> Vector:
    """Solve ``G x = b`` by the Cholesky factorisation of G.

    Parameters
    ----------
    matrix : (K, K) array of float64
        G, symmetric and positive definite, in contiguous memory. It is overwritten.
    right : (K,) array of float64
        b.

    Returns
    -------
    (K,) array
        x.

    Raises
    ------
    numpy.linalg.LinAlgError
        If G is not positive definite.

    """
    count, one, failed = (ctypes.c_int(n) for n in (len(right), 1, 0))
    x = right.copy()
    where = ctypes.byref
    _DPOSV(
        b"L",
        where(count),
        where(one),
        matrix.ctypes.data,
        where(count),
        x.ctypes.data,
        where(count),
        where(failed),
    )
    if failed.value:
        message = f"row {failed.value} of the matrix shows that it is not positive definite"
        raise scipy.linalg.LinAlgError(message)
    return x


def _routine(name: str, arguments: int) -> Callable[..., None]:
    """Return a routine of SciPy's LAPACK; all of its arguments are addresses."""
    capsule = LowLevelCallable.from_cython(cython_lapack, name).function
    ask = ctypes.pythonapi
    ask.PyCapsule_GetName.restype = ctypes.c_char_p
    ask.PyCapsule_GetName.argtypes = [ctypes.py_object]
    ask.PyCapsule_GetPointer.restype = ctypes.c_void_p
    ask.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    address = ask.PyCapsule_GetPointer(capsule, ask.PyCapsule_GetName(capsule))
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(address)


_DPOSV: Final = _routine("dposv", 8)
