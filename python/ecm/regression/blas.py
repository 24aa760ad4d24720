"""One BLAS thread for matrices of a few hundred rows.

Threads of BLAS wait actively in such small work: on a busy machine a diagnosis takes ten times as
long, and the last bits of a sum depend on their number. The Rust core has threads of its own and
reads none of the variables below.

A file of its own: the command line loads it before it knows whether anything needs numpy.
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
_MODULES = ("numpy", "scipy.linalg")
"""Modules that load a BLAS of their own when they are first imported."""


@cache
def _controller(loaded: tuple[str, ...]) -> ThreadpoolController:
    # The controller finds loaded libraries only, which takes milliseconds.
    return ThreadpoolController()


def _limited() -> ExitStack:
    loaded = tuple(name for name in _MODULES if name in sys.modules)
    stack = ExitStack()
    stack.enter_context(_controller(loaded).limit(limits=1, user_api="blas"))
    return stack


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Sequential BLAS inside the block (also as a decorator)."""
    for name in _MODULES:  # a library that is loaded later would not be limited
        import_module(name)
    with _limited():
        yield


@contextmanager
def one_blas_thread_later() -> Iterator[None]:
    """Sequential BLAS for a command, which may load a BLAS inside the block.

    Such a library, and a process that is started inside, read their number of threads from the
    environment; libraries that are loaded already are limited.
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
