"""Load cases in batches: each begins from earlier ones, each is stored, here or on Dask workers.

Batches end at 16, 32, 64, ..., 1024 cases and then no more. All cases of a batch have the same warm
start, fitted to the cases before the batch, and do not depend on each other. So a case depends only
on the draws before it: not on threads, workers, interruptions, or on how many cases were asked for
together.

A chunk of cases is solved by one worker exactly as on this machine, so the result does not depend
on the number of workers. If a worker dies, Dask gives its chunks to another one; those that are
finished have been returned before.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm._native import Fem, FemResults, WarmStart
from ecm.errors import ComputationError, FemError, InputError
from ecm.io.arrays import F
from ecm.io.cache import Stage
from ecm.io.mechanism import Mechanism
from ecm.io.parallel import DaskClient

CaseResults = dict[str, NDArray[Any]]
"""Results of some cases: one row per case in each array."""
CaseFinished = Callable[[list[int], CaseResults], None]
"""Called with rows and their results as soon as they are solved, in any order."""
CaseProgress = Callable[[int, int], object] | None
"""Called with the number of solved cases and of all cases."""

ARRAYS = (
    "loads",
    "volumes_m3",
    "poses",
    "stiffness",
    "energy_J",
    "largest_stretch",
    "smallest_jacobian",
    "smallest_eigenvalue",
    "iterations",
)
FLAGS = ("ok", "unstable")


def case_results(results: FemResults) -> CaseResults:
    """Return the results to store; `fields` are the nodal displacements."""
    status = np.array(results.status, dtype=str)
    return {
        "ok": status == "solved",
        "unstable": status == "unstable",
        "fields": results.fields,
        **{name: np.asarray(getattr(results, name)) for name in ARRAYS},
    }


_FIRST_BATCH = 16
_MOST_FITTED = 1024
_ACCURATE = 64  # with so many cases the warm start is quadratic and within some per cent


def batch_size(case: int) -> int:
    """Return how many cases, beginning with this one, share its warm start."""
    if case >= _MOST_FITTED:
        return 1 << 62
    return max(_FIRST_BATCH, 2 * _fitted_cases(case)) - case


def _fitted_cases(case: int) -> int:
    """Return how many cases the warm start of this case is fitted to."""
    if case < _FIRST_BATCH:
        return 0
    return min(_MOST_FITTED, _FIRST_BATCH << (case // _FIRST_BATCH).bit_length() - 1)


class LoadCases:
    """Load cases by their number: solved, or read from `stage`.

    The workers of the Dask scheduler at the address `scheduler` solve them; None: this process.
    """

    def __init__(
        self, mechanism: Mechanism, threads: int, scheduler: str | None, stage: Stage | None
    ) -> None:
        self._mechanism = mechanism
        self._threads = threads
        self._stage = stage
        self._results: dict[int, CaseResults] = {}
        self._parts = 0
        self._warm_starts: dict[int, WarmStart | None] = {0: None}
        self._fem: Fem | None = None
        self._workers = None if scheduler is None else DaskSolver(mechanism, threads, scheduler)
        if stage is not None:
            self._parts = stage.parts()
            for part in map(stage.load_part, range(self._parts)):
                if part is not None:
                    self._add(part)

    def solve(self, first: int, loads: F, report: CaseProgress) -> CaseResults:
        """Solve N cases from `first` on under loads (N, 6 + m), N <= `batch_size(first)`."""
        missing = [i for i in range(len(loads)) if first + i not in self._results]
        if missing:
            warm_start = self._warm_start(_fitted_cases(first))

            def store(rows: list[int], part: CaseResults) -> None:
                self._store([first + missing[row] for row in rows], part)

            if self._workers is not None:
                self._workers.solve(loads[missing], warm_start, store, report)
            else:
                self._body().solve_each(
                    loads[missing],
                    warm_start=warm_start,
                    threads=self._threads,
                    progress=report,
                    finished=lambda rows, results: store(rows, case_results(results)),
                )
        rows = [self._results[first + i] for i in range(len(loads))]
        return {name: np.array([row[name] for row in rows]) for name in (*FLAGS, *ARRAYS)}

    def predicted_rotations(self, first: int, loads: F) -> F | None:
        """Return |theta| (N,) by the warm start of case `first`; None if it has too few cases."""
        count = _fitted_cases(first)
        warm_start = self._warm_start(count)
        if warm_start is None or count < _ACCURATE:
            return None
        poses = self._body().predict_poses(np.ascontiguousarray(loads), warm_start)
        rotation: F = np.linalg.norm(poses[:, 3:], axis=1)
        return rotation

    def close(self) -> None:
        """Disconnect from the workers."""
        if self._workers is not None:
            self._workers.close()

    def _body(self) -> Fem:
        if self._fem is None:
            self._fem = self._mechanism.fem()
        return self._fem

    def _warm_start(self, count: int) -> WarmStart | None:
        """Fit a warm start to the first `count` cases, or to fewer if that is not possible."""
        if count not in self._warm_starts:
            rows = [self._results[case] for case in range(count)]
            rows = [row for row in rows if row["ok"] or row["unstable"]]
            # A body that does not carry its own weight has no state.
            rows = [row for row in rows if np.isfinite(row["poses"]).all()]
            warm_start = None
            if rows:
                loads = np.array([row["loads"] for row in rows])
                fields = np.array([row["fields"] for row in rows])
                warm_start = self._body().fit_warm_start(loads, fields)
            if warm_start is None:
                warm_start = self._warm_start(count // 2 if count > _FIRST_BATCH else 0)
            self._warm_starts[count] = warm_start
        return self._warm_starts[count]

    def _store(self, cases: list[int], part: CaseResults) -> None:
        part = {"case": np.array(cases, dtype=np.int64), **part}
        if min(cases) >= _MOST_FITTED:
            del part["fields"]  # no later warm start needs them
        self._add(part)
        if self._stage is not None:
            self._stage.save_part(self._parts, part)
            self._parts += 1

    def _add(self, part: CaseResults) -> None:
        for row, case in enumerate(part["case"]):
            self._results[int(case)] = {
                name: values[row] for name, values in part.items() if name != "case"
            }


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
