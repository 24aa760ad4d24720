"""One BLAS thread for matrices of a few hundred rows.

Threads of BLAS spin on such small work: on a busy machine a diagnosis takes ten times as long, and
the last bits of a sum depend on their number. Large work has threads of its own in the Rust core.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _controller(scipy_loaded: bool) -> ThreadpoolController:
    # Finding the loaded libraries takes milliseconds. Scipy brings a BLAS of its own, later.
    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Sequential BLAS inside the block (also as a decorator)."""
    with _controller("scipy.linalg" in sys.modules).limit(limits=1, user_api="blas"):
        yield
