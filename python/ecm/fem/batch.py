"""Load cases in batches: each starts from a guess learned from earlier ones, each is kept.

Batches end at 16, 32, 64, ..., 1024 cases and then no more. All cases of a batch start from the
same guess, learned from all cases before the batch, and do not depend on each other. So a case
depends only on the draws before it: not on threads, workers, interruptions, or on how many cases
were asked for together.
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
_MOST_LEARNED = 1024
_PREDICTIVE = 64  # from so many cases on, the (then quadratic) guess is within some per cent


def batch_size(case: int) -> int:
    """Return how many cases, beginning with this one, share its guess."""
    if case >= _MOST_LEARNED:
        return 1 << 62
    return max(_FIRST_BATCH, 2 * _learned(case)) - case


def _learned(case: int) -> int:
    """Return how many cases the guess of this case is learned from."""
    if case < _FIRST_BATCH:
        return 0
    return min(_MOST_LEARNED, _FIRST_BATCH << (case // _FIRST_BATCH).bit_length() - 1)


class LoadCases:
    """Load cases by their number: solved, or read from `stage`.

    The workers of the Dask scheduler at address `scheduler` solve them; None: this process.
    """

    def __init__(
        self, mechanism: Mechanism, threads: int, scheduler: str | None, stage: Stage | None
    ) -> None:
        self._mechanism = mechanism
        self._threads = threads
        self._stage = stage
        self._known: dict[int, CaseResults] = {}
        self._parts = 0
        self._guesses: dict[int, WarmStart | None] = {0: None}
        self._fem: Fem | None = None
        self._workers = None if scheduler is None else DaskSolver(mechanism, threads, scheduler)
        if stage is not None:
            self._parts = stage.parts()
            for part in map(stage.load_part, range(self._parts)):
                if part is not None:
                    self._remember(part)

    def solve(self, first: int, wrenches: F, report: CaseProgress) -> CaseResults:
        """Solve cases `first`, `first` + 1, ... under wrenches (N, 6), N <= `batch_size(first)`."""
        missing = [i for i in range(len(wrenches)) if first + i not in self._known]
        if missing:
            guess = self._guess(_learned(first))

            def keep(rows: list[int], part: CaseResults) -> None:
                self._keep([first + missing[row] for row in rows], part)

            if self._workers is not None:
                self._workers.solve(wrenches[missing], guess, keep, report)
            else:
                self._body().solve_each(
                    wrenches[missing],
                    warm_start=guess,
                    threads=self._threads,
                    progress=report,
                    finished=lambda rows, results: keep(rows, case_results(results)),
                )
        rows = [self._known[first + i] for i in range(len(wrenches))]
        return {name: np.array([row[name] for row in rows]) for name in (*FLAGS, *ARRAYS)}

    def guessed_rotations(self, first: int, wrenches: F) -> F | None:
        """Return |theta| (N,) by the guess of case `first`; None where it knows too few cases."""
        guess = self._guess(_learned(first))
        if guess is None or _learned(first) < _PREDICTIVE:
            return None
        poses = self._body().predict_poses(np.ascontiguousarray(wrenches), guess)
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

    def _guess(self, count: int) -> WarmStart | None:
        """Learn a guess from the first `count` cases, or from fewer where none can be learned."""
        if count not in self._guesses:
            rows = [self._known[case] for case in range(count)]
            rows = [row for row in rows if row["ok"] or row["unstable"]]
            guess = None
            if rows:
                wrenches = np.array([row["wrenches"] for row in rows])
                fields = np.array([row["fields"] for row in rows])
                guess = self._body().fit_warm_start(wrenches, fields)
            if guess is None:
                guess = self._guess(count // 2 if count > _FIRST_BATCH else 0)
            self._guesses[count] = guess
        return self._guesses[count]

    def _keep(self, cases: list[int], part: CaseResults) -> None:
        part = {"case": np.array(cases, dtype=np.int64), **part}
        if min(cases) >= _MOST_LEARNED:
            del part["fields"]  # no later guess needs them
        self._remember(part)
        if self._stage is not None:
            self._stage.save_part(self._parts, part)
            self._parts += 1

    def _remember(self, part: CaseResults) -> None:
        for row, case in enumerate(part["case"]):
            self._known[int(case)] = {
                name: values[row] for name, values in part.items() if name != "case"
            }
