"""The linear algebra of NumPy and SciPy on one thread, as long as deshake works.

The order of its sums depends on the number of threads, and with it the last digits of a result.
More threads also cost more time than they save, because deshake has threads of its own.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["one_linear_thread"]


@contextmanager
def one_linear_thread() -> Iterator[None]:
    """Limit the linear algebra of the process to one thread.

    If calls overlap in several threads, the limit is that of the thread that had the first one.
    """
    with threadpool_limits(1, user_api="blas"):
        yield
