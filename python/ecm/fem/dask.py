"""Load cases on the workers of a Dask scheduler.

A chunk of cases is solved by one worker exactly as on this machine, so the result does not depend
on the number of workers. If a worker dies, Dask gives its chunks to another one; those that are
finished have been returned before.
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
"""Number of workers that may die while solving a chunk."""


class DaskSolver:
    """Solver of load cases on the workers of a scheduler.

    The content of a mesh file is sent to them. InputError if the scheduler does not answer or has
    no worker.
    """

    def __init__(self, mechanism: Mechanism, threads: int, scheduler: str) -> None:
        self._client = DaskClient(scheduler)
        self._workers = self._client.count_workers()
        mesh, suffix = b"", ""
        if mechanism.mesh_file is not None:
            mesh, suffix = mechanism.mesh_file.read_bytes(), mechanism.mesh_file.suffix
        self._body = (replace(mechanism, mesh_file=None), (mesh, suffix), threads)
        self._sent: tuple[WarmStart | None, Any] = (None, None)
        self._futures: dict[Any, tuple[int, list[int]]] = {}
        """Attempt and rows of each running task."""

    def solve(
        self,
        wrenches: F,
        warm_start: WarmStart | None,
        finished: CaseFinished,
        report: CaseProgress,
    ) -> None:
        """Solve all cases, in chunks small enough to occupy all workers to the end."""
        count = len(wrenches)
        size = max(1, min(_LARGEST_CHUNK, count // (2 * self._workers)))
        sent = self._send(warm_start)
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

    def _begin(self, wrenches: F, sent: Any, chunk: list[int], attempt: int) -> Any:
        future = self._client.submit(_solve_chunk, *self._body, wrenches[chunk], sent)
        self._futures[future] = (attempt, chunk)
        return future

    def _send(self, warm_start: WarmStart | None) -> Any:
        """Send the warm start as a task, so that Dask repeats it if a worker that has it dies."""
        if self._sent[0] is not warm_start or self._sent[1] is None:
            data = b"" if warm_start is None else warm_start.to_bytes()
            self._sent = (warm_start, self._client.submit(bytes, data))
        return self._sent[1]

    def close(self) -> None:
        """Cancel running tasks and disconnect."""
        for future in self._futures:
            future.cancel()
        self._client.close()


_fem: dict[str, Fem] = {}
"""On a worker: the last body, used by many chunks."""


def _solve_chunk(
    mechanism: Mechanism, mesh: tuple[bytes, str], threads: int, wrenches: F, warm_start: bytes
) -> CaseResults:
    """Solve a chunk on a worker; `mesh` is the content of the mesh file and its suffix."""
    key = mechanism.key() + str(hash(mesh))
    if key not in _fem:
        _fem.clear()
        _fem[key] = _make_fem(mechanism, *mesh)
    start = WarmStart(warm_start) if warm_start else None
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
