"""The one thread of BLAS."""
from __future__ import annotations

import contextlib
from collections.abc import Iterator

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """A block, or a function, with one thread for small algebra, as commands have it from their
    start: BLAS splits its sums by the cores, so that on one thread the bits are the same on any
    machine, and the threads of small products would only wait for each other.
    """
    with threadpool_limits(1, user_api="blas"):
        yield
