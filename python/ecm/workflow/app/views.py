"""The views of the page: kept as files, and computed in a process of their own.

A view depends on files that never change once a step has written them, so it is kept in `views/`
and computed once.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

from ecm.errors import InputError
from ecm.io.cache import hash_of
from ecm.workflow.app.disk import writing

SHOWN = ("poses", "residuals", "effects", "log")
"""Those that the page may ask for by name."""
NEED_MODEL = ("residuals", "effects")
_INTERRUPTED = 130


class Views:
    """The views of a session folder, and the process that computes them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        self._life: Connection | None = None
        """End of a pipe: when it closes, so does the process."""
        self._closed = False

    def file(
        self, name: str, data: Sequence[str], model: str | None, *, skip_bad_rows: bool = False
    ) -> Path:
        """Return the file of a view; computes it where it is not there yet.

        Raises
        ------
        InputError
            Where the files do not allow it.
        """
        key = hash_of(name, list(data), model, *(["skip"] if skip_bad_rows else []))
        path = self.folder / "views" / f"{name}-{key[:16]}.json"
        if not path.is_file():
            tables = [self.folder / table for table in data]
            of_model = None if model is None else self.folder / model
            given = (tables, of_model, skip_bad_rows)
            broken: ProcessPoolExecutor | None = None
            for again in (True, False):
                pool = self._process(broken)
                try:
                    with writing(path, f"the view {name}"):
                        pool.submit(_compute, name, path, *given).result()
                    break
                except BrokenProcessPool:  # killed, or out of memory
                    broken = pool
                    if not again:
                        raise
        return path

    def close(self) -> None:
        """End the process, also in the middle of a view."""
        with self._lock:
            self._closed = True
            if self._life is not None:
                self._life.close()
            if self._pool is not None:
                self._pool.shutdown(cancel_futures=True)

    def _process(self, broken: ProcessPoolExecutor | None = None) -> ProcessPoolExecutor:
        """Return the process that is there; a new one in place of a broken one."""
        with self._lock:
            if self._closed:
                raise InputError("the server is being ended")
            if self._pool is None or self._pool is broken:
                context = get_context("spawn")
                life, self._life = context.Pipe(duplex=False)
                self._pool = ProcessPoolExecutor(
                    1, mp_context=context, initializer=_end_with, initargs=(life,)
                )
            return self._pool


def _end_with(life: Connection) -> None:
    """End this process with the server, however that ends; Ctrl-C is for the server."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        with suppress(EOFError, OSError):
            life.recv()
        os._exit(_INTERRUPTED)

    threading.Thread(target=watch, daemon=True).start()


def _compute(
    name: str, path: Path, tables: Sequence[Path], model: Path | None, skip_bad_rows: bool
) -> None:
    """Compute a view and write it; called in the other process."""
    from ecm.workflow.app.view_data import Given, compute_view  # noqa: PLC0415 - the server needs no numerics

    compute_view(name, path, Given(tables, model, skip_bad_rows))
