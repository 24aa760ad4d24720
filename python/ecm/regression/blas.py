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
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from threading import Lock
from typing import Any

from threadpoolctl import ThreadpoolController

_VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
_MODULES = ("numpy", "scipy.linalg")
"""Modules that load a BLAS of their own when they are first imported."""


@cache
def _libraries(loaded: tuple[str, ...]) -> list[Any]:
    # The controller finds loaded libraries only, which takes milliseconds.
    controller = ThreadpoolController()
    return [own for own in controller.lib_controllers if own.user_api == "blas"]


def _set_threads(library: Any, number: int) -> None:
    # Newer versions heed the first thread alone that sets a number, until it is cleared.
    clear = getattr(library, "clear_controlling_thread", lambda force: None)
    clear(force=True)
    library.set_num_threads(number)
    clear(force=True)


class _Limit:
    """The limit of the process: a BLAS has one number of threads for all who compute with it.

    The first to come sets it and the last to go takes it back. If each did so, one that is ready
    would give the others their threads back, and the last would leave what the first had set.
    """

    def __init__(self) -> None:
        self.lock = Lock()
        self.inside = 0
        self.loaded: tuple[str, ...] = ()
        self.before: list[tuple[Any, int]] = []

    def __enter__(self) -> None:
        loaded = tuple(name for name in _MODULES if name in sys.modules)
        with self.lock:
            if self.inside == 0 or loaded != self.loaded:
                self.loaded = loaded
                for library in _libraries(loaded):
                    self.before.append((library, library.get_num_threads()))
                    _set_threads(library, 1)
            self.inside += 1

    def __exit__(self, *error: object) -> None:
        with self.lock:
            self.inside -= 1
            while self.inside == 0 and self.before:
                _set_threads(*self.before.pop())


_limit = _Limit()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Sequential BLAS inside the block (also as a decorator)."""
    for name in _MODULES:  # a library that is loaded later would not be limited
        import_module(name)
    with _limit:
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
        with _limit:
            yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
