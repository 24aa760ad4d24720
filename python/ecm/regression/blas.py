"""One BLAS thread for matrices of a few hundred rows.

Threads of BLAS spin on such small work: on a busy machine a diagnosis takes ten times as long, and
the last bits of a sum depend on their number. Large work has threads of its own in the Rust core,
which reads none of the variables below.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib import import_module

from threadpoolctl import ThreadpoolController

_VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
_BRING_A_BLAS = ("numpy", "scipy.linalg")
"""Each has its own, and loads it when it is first imported."""


@cache
def _controller(loaded: tuple[str, ...]) -> ThreadpoolController:
    # Finding the loaded libraries takes milliseconds, and it finds those alone.
    return ThreadpoolController()


def _limited() -> ExitStack:
    loaded = tuple(name for name in _BRING_A_BLAS if name in sys.modules)
    stack = ExitStack()
    stack.enter_context(_controller(loaded).limit(limits=1, user_api="blas"))
    return stack


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Sequential BLAS inside the block (also as a decorator); afterwards all is as before."""
    for name in _BRING_A_BLAS:  # what came later would not be limited
        import_module(name)
    with _limited():
        yield


@contextmanager
def one_blas_thread_later() -> Iterator[None]:
    """The same for a command, which loads a BLAS only where it needs one.

    A library that is loaded inside the block reads its number of threads from the environment, and
    keeps it; so do the processes that are started inside. Those loaded already are limited.
    """
    before = {name: os.environ.get(name) for name in _VARIABLES}
    os.environ.update(dict.fromkeys(_VARIABLES, "1"))
    try:
        with _limited():
            yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
