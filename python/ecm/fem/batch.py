"""Load cases in batches: each starts from a warm start fitted to earlier ones, each is stored.

Batches end at 16, 32, 64, ..., 1024 cases and then no more. All cases of a batch have the same warm
start, fitted to the cases before the batch, and do not depend on each other. So a case depends only
on the draws before it: not on threads, workers, interruptions, or on how many cases were asked for
together.
"""

from __future__ import annotations

import numpy as np

from ecm._native import Fem, WarmStart
from ecm.fem.case_results import ARRAYS, FLAGS, CaseProgress, CaseResults, case_results
from ecm.fem.dask import DaskSolver
from ecm.io.arrays import F
from ecm.io.cache import Stage
from ecm.io.mechanism import Mechanism

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

    def solve(self, first: int, wrenches: F, report: CaseProgress) -> CaseResults:
        """Solve cases `first`, `first` + 1, ... under wrenches (N, 6), N <= `batch_size(first)`."""
        missing = [i for i in range(len(wrenches)) if first + i not in self._results]
        if missing:
            warm_start = self._warm_start(_fitted_cases(first))

            def store(rows: list[int], part: CaseResults) -> None:
                self._store([first + missing[row] for row in rows], part)

            if self._workers is not None:
                self._workers.solve(wrenches[missing], warm_start, store, report)
            else:
                self._body().solve_each(
                    wrenches[missing],
                    warm_start=warm_start,
                    threads=self._threads,
                    progress=report,
                    finished=lambda rows, results: store(rows, case_results(results)),
                )
        rows = [self._results[first + i] for i in range(len(wrenches))]
        return {name: np.array([row[name] for row in rows]) for name in (*FLAGS, *ARRAYS)}

    def predicted_rotations(self, first: int, wrenches: F) -> F | None:
        """Return |theta| (N,) by the warm start of case `first`; None if it has too few cases."""
        count = _fitted_cases(first)
        warm_start = self._warm_start(count)
        if warm_start is None or count < _ACCURATE:
            return None
        poses = self._body().predict_poses(np.ascontiguousarray(wrenches), warm_start)
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
                wrenches = np.array([row["wrenches"] for row in rows])
                fields = np.array([row["fields"] for row in rows])
                warm_start = self._body().fit_warm_start(wrenches, fields)
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
