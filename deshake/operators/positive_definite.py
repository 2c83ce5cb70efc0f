"""Linear equations with a positive definite matrix, solved by LAPACK while other threads work.

The functions of `scipy.linalg` hold the lock of Python for as long as LAPACK runs, so threads that
solve equations wait for each other. A call by `ctypes` releases it. The routine is the same one.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.ctypeslib import ndpointer
from numpy.typing import NDArray
from scipy import LowLevelCallable
from scipy.linalg import cython_lapack

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["solved"]

Vector = NDArray[np.float64]

_INT: Final = ctypes.POINTER(ctypes.c_int)
_MATRIX: Final = ndpointer(np.float64, ndim=2, flags=("C_CONTIGUOUS", "WRITEABLE"))
_VECTOR: Final = ndpointer(np.float64, ndim=1, flags=("C_CONTIGUOUS", "WRITEABLE"))


def solved(matrix: Vector, right: Vector) -> Vector:
    """Solve ``G x = b`` by the Cholesky factorisation of G.

    Parameters
    ----------
    matrix : (K, K) array of float64
        G, symmetric and positive definite, row after row in memory. It is overwritten.
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
    ctypes.ArgumentError
        If G is another kind of array.
    ValueError
        If G has another shape than b asks for.

    """
    count, one, failed = (ctypes.c_int(n) for n in (len(right), 1, 0))
    x = np.array(right, np.float64)
    if matrix.shape != (x.size, x.size):
        message = f"expected a matrix of {x.size} x {x.size}, not of shape {matrix.shape}"
        raise ValueError(message)
    _DPOSV(b"L", count, one, matrix, count, x, count, failed)
    if failed.value:
        message = f"row {failed.value} of the matrix shows that it is not positive definite"
        raise np.linalg.LinAlgError(message)
    return x


def _dposv() -> Callable[..., None]:
    """Return the routine DPOSV of SciPy's LAPACK."""
    routine = LowLevelCallable.from_cython(cython_lapack, "dposv")
    asked = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)
    address_of = asked(("PyCapsule_GetPointer", ctypes.pythonapi))
    address = address_of(routine.function, routine.signature.encode())
    arguments = ctypes.c_char_p, _INT, _INT, _MATRIX, _INT, _VECTOR, _INT, _INT
    return ctypes.CFUNCTYPE(None, *arguments)(address)


_DPOSV: Final = _dposv()
