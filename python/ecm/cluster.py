"""Chunks of load cases on the workers of a Dask scheduler.

A chunk is solved by one worker as it would be here, so that the result does not depend on how
many workers there are. A worker that dies loses nothing but time: Dask gives its chunks to
another, and finished ones are already here.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ecm.cases import Part, Report, packed
from ecm.errors import ComputationError, FemError, InputError, MissingExtra
from ecm.mechanism import Mechanism

if TYPE_CHECKING:
    from ecm._native import Guess

F = NDArray[np.float64]

_CONNECT_S = 10.0
_CHUNK = 16
"""Most cases that a worker is given at a time."""
_DEATHS = 10
"""A chunk during which this many workers died is given up."""


class Cluster:
    """Solves chunks on the workers of a scheduler.

    Parameters
    ----------
    scheduler
        Address, e.g. tcp://192.0.2.1:8786.

    Errors
    ------
    MissingExtra
        Where Dask is not installed.
    InputError
        Where nobody answers at the address, or no worker is there.
    """

    def __init__(self, mechanism: Mechanism, threads: int, scheduler: str) -> None:
        try:
            from importlib import import_module

            distributed: Any = import_module("distributed")
        except ImportError:
            raise MissingExtra("distributed", "cluster", "--scheduler") from None
        try:
            self._client: Any = distributed.Client(
                scheduler, timeout=_CONNECT_S, set_as_default=False
            )
        except (OSError, ValueError) as error:
            raise InputError(
                f"--scheduler {scheduler}: no answer within {_CONNECT_S:.0f} s ({error}). Start "
                "one with `dask scheduler` and workers with `dask worker ADDRESS`"
            ) from None
        workers = len(self._client.scheduler_info(n_workers=-1)["workers"])
        if workers == 0:
            self._client.close()
            raise InputError(
                f"--scheduler {scheduler}: no worker is there. Start some with "
                f"`dask worker {scheduler}`"
            )
        self._workers = workers
        mesh = b"" if mechanism.mesh_file is None else mechanism.mesh_file.read_bytes()
        kind = "" if mechanism.mesh_file is None else mechanism.mesh_file.suffix
        self._work = (replace(mechanism, mesh_file=None), (mesh, kind), threads)
        self._guess: tuple[Guess | None, Any] = (None, None)
        self._futures: dict[Any, tuple[int, list[int]]] = {}

    def solve(
        self,
        wrenches: F,
        guess: Guess | None,
        finished: Callable[[list[int], Part], None],
        report: Report,
    ) -> None:
        """All cases, in chunks small enough to occupy all workers to the end."""
        import distributed

        size = max(1, min(_CHUNK, len(wrenches) // (2 * self._workers)))
        rows = [list(range(i, min(i + size, len(wrenches)))) for i in range(0, len(wrenches), size)]
        held = self._hold(guess)
        gather: Any = distributed.as_completed  # untyped
        begun = [self._begin(wrenches, held, chunk, 1) for chunk in rows]
        pending = gather(begun, loop=self._client.loop, raise_errors=False)
        done = 0
        for future in pending:
            deaths, chunk = self._futures.pop(future)
            try:
                finished(chunk, future.result())
            except distributed.KilledWorker:
                if deaths == _DEATHS:
                    raise ComputationError(
                        f"{len(chunk)} cases: {deaths} workers died while solving them; do the "
                        "workers have enough memory?"
                    ) from None
                pending.add(self._begin(wrenches, held, chunk, deaths + 1))
                continue
            done += len(chunk)
            if report is not None:
                report(done, len(wrenches))

    def _begin(self, wrenches: F, held: Any, chunk: list[int], attempt: int) -> Any:
        future = self._client.submit(_work, *self._work, wrenches[chunk], held, pure=False)
        self._futures[future] = (attempt, chunk)
        return future

    def _hold(self, guess: Guess | None) -> Any:
        """The guess on the workers; a task, so that it comes back where a worker dies with it."""
        if self._guess[0] is not guess or self._guess[1] is None:
            data = b"" if guess is None else guess.to_bytes()
            self._guess = (guess, self._client.submit(bytes, data, pure=False))
        return self._guess[1]

    def close(self) -> None:
        """Let go of what was begun and is not needed."""
        for future in self._futures:
            future.cancel()
        self._client.close()


_fems: dict[str, Any] = {}
"""On a worker: the last body, which many chunks share."""


def _work(
    mechanism: Mechanism, file: tuple[bytes, str], threads: int, wrenches: F, guess: bytes
) -> Part:
    from ecm._native import Guess

    key = mechanism.key() + str(hash(file))
    if key not in _fems:
        _fems.clear()
        _fems[key] = _body(mechanism, *file)
    start = Guess(guess) if guess else None
    return packed(_fems[key].solve_each(wrenches, guess=start, threads=threads))


def _body(mechanism: Mechanism, mesh: bytes, kind: str) -> Any:
    if not mesh:
        return mechanism.fem()
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / f"body{kind}"
        path.write_bytes(mesh)
        try:
            return replace(mechanism, mesh_file=path).fem()
        except FemError as error:
            raise InputError(str(error)) from None
