"""Load cases on the workers of a Dask scheduler.

A chunk of cases is solved by one worker exactly as on this machine, so the result does not depend
on the number of workers. If a worker dies, Dask gives its chunks to another one; finished chunks
are already here.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from ecm._native import Fem, WarmStart
from ecm.errors import ComputationError, FemError, InputError
from ecm.fem.case_results import CaseFinished, CaseProgress, CaseResults, case_results
from ecm.io.arrays import F
from ecm.io.dask import DaskClient
from ecm.io.mechanism import Mechanism

_LARGEST_CHUNK = 16
"""Most cases that a worker is given at a time."""
_MOST_DEATHS = 10
"""A chunk is given up when so many workers died while solving it."""


class DaskSolver:
    """Solver of load cases on the workers of a scheduler, each with so many threads.

    The content of a mesh file is sent along. InputError where nobody answers at the address, or no
    worker is there.
    """

    def __init__(self, mechanism: Mechanism, threads: int, scheduler: str) -> None:
        self._client = DaskClient(scheduler)
        self._workers = self._client.count_workers()
        mesh, suffix = b"", ""
        if mechanism.mesh_file is not None:
            mesh, suffix = mechanism.mesh_file.read_bytes(), mechanism.mesh_file.suffix
        self._body = (replace(mechanism, mesh_file=None), (mesh, suffix), threads)
        self._guess: tuple[WarmStart | None, Any] = (None, None)
        self._futures: dict[Any, tuple[int, list[int]]] = {}
        """Attempt and rows of each task under way."""

    def solve(
        self, wrenches: F, guess: WarmStart | None, finished: CaseFinished, report: CaseProgress
    ) -> None:
        """Solve all cases, in chunks small enough to occupy all workers to the end."""
        count = len(wrenches)
        size = max(1, min(_LARGEST_CHUNK, count // (2 * self._workers)))
        sent = self._send(guess)
        chunks = [list(range(i, min(i + size, count))) for i in range(0, count, size)]
        pending = self._client.completed(self._begin(wrenches, sent, c, 1) for c in chunks)
        done = 0
        for future in pending:
            attempt, chunk = self._futures.pop(future)
            try:
                finished(chunk, future.result())
            except self._client.killed_worker:
                if attempt == _MOST_DEATHS:
                    raise ComputationError(
                        f"{len(chunk)} cases: {attempt} workers died while solving them; do the "
                        "workers have enough memory?"
                    ) from None
                pending.add(self._begin(wrenches, sent, chunk, attempt + 1))
                continue
            done += len(chunk)
            if report is not None:
                report(done, count)

    def _begin(self, wrenches: F, guess: Any, chunk: list[int], attempt: int) -> Any:
        future = self._client.submit(_solve_chunk, *self._body, wrenches[chunk], guess)
        self._futures[future] = (attempt, chunk)
        return future

    def _send(self, guess: WarmStart | None) -> Any:
        """Send the guess as a task, so that it is computed again where a worker dies with it."""
        if self._guess[0] is not guess or self._guess[1] is None:
            data = b"" if guess is None else guess.to_bytes()
            self._guess = (guess, self._client.submit(bytes, data))
        return self._guess[1]

    def close(self) -> None:
        """Cancel tasks that are under way and disconnect."""
        for future in self._futures:
            future.cancel()
        self._client.close()


_fem: dict[str, Fem] = {}
"""On a worker: the last body, which many chunks share."""


def _solve_chunk(
    mechanism: Mechanism, mesh: tuple[bytes, str], threads: int, wrenches: F, guess: bytes
) -> CaseResults:
    """Solve a chunk on a worker; `mesh` is the content of the mesh file and its suffix."""
    key = mechanism.key() + str(hash(mesh))
    if key not in _fem:
        _fem.clear()
        _fem[key] = _make_fem(mechanism, *mesh)
    start = WarmStart(guess) if guess else None
    return case_results(_fem[key].solve_each(wrenches, warm_start=start, threads=threads))


def _make_fem(mechanism: Mechanism, mesh: bytes, suffix: str) -> Fem:
    if not mesh:
        return mechanism.fem()
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / f"body{suffix}"
        path.write_bytes(mesh)
        try:
            return replace(mechanism, mesh_file=path).fem()
        except FemError as error:
            raise InputError(str(error)) from None
