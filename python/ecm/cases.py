"""FEM cases one after the other: each from a guess by those before it, each kept once solved.

Cases come in groups that end at 16, 32, 64, ..., 1024 cases and never after. Every case of a group
starts from the same guess, learned from all cases before the group, and knows nothing of the
others of its group. So a case depends on the draws before it alone: not on threads, workers,
kills, or on how many cases were asked for together.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ecm.mechanism import Mechanism
from ecm.stages import Stage

if TYPE_CHECKING:
    from ecm._native import Fem, FemResults, Guess

F = NDArray[np.float64]
Part = dict[str, NDArray[Any]]
Report = Callable[[int, int], object] | None

ARRAYS = (
    "wrenches",
    "poses",
    "stiffness",
    "energy_J",
    "largest_stretch",
    "smallest_jacobian",
    "smallest_eigenvalue",
    "iterations",
)
FLAGS = ("ok", "unstable")

_FIRST = 16
_LEARNED = 1024
_TELLS = 64  # cases from which on a guess (then quadratic) is within some percent of the pose


class Solver(Protocol):
    """Solves cases that do not depend on each other."""

    def solve(
        self,
        wrenches: F,
        guess: Guess | None,
        finished: Callable[[list[int], Part], None],
        report: Report,
    ) -> None:
        """Call `finished` with rows and results as they come, in any order."""

    def close(self) -> None:
        """Let go of what is open."""


def packed(results: FemResults) -> Part:
    """Everything that is kept of some cases."""
    return {
        "ok": np.array([s == "solved" for s in results.status], dtype=bool),
        "unstable": np.array([s == "unstable" for s in results.status], dtype=bool),
        "fields": results.fields,
        **{name: np.asarray(getattr(results, name)) for name in ARRAYS},
    }


def room(case: int) -> int:
    """How many cases from this one on share its guess."""
    return 1 << 62 if case >= _LEARNED else max(_FIRST, 2 * _learned(case)) - case


def _learned(case: int) -> int:
    """How many cases the guess of this one has learned from."""
    if case < _FIRST:
        return 0
    return min(_LEARNED, _FIRST << (case // _FIRST).bit_length() - 1)


class Here:
    """Solves cases in this process."""

    def __init__(self, fem: Fem, threads: int) -> None:
        self._fem = fem
        self._threads = threads

    def solve(
        self,
        wrenches: F,
        guess: Guess | None,
        finished: Callable[[list[int], Part], None],
        report: Report,
    ) -> None:
        """All of them, on the threads of this process."""
        self._fem.solve_each(
            wrenches,
            guess=guess,
            threads=self._threads,
            progress=report,
            finished=lambda rows, results: finished(rows, packed(results)),
        )

    def close(self) -> None:
        """Nothing is open."""


class Cases:
    """Cases by their number, solved or read from `stage`, where every solved one is kept.

    Parameters
    ----------
    scheduler
        Address of a Dask scheduler whose workers solve them; None: this process does.
    stage
        Where solved cases are kept and found again.
    """

    def __init__(
        self, mechanism: Mechanism, threads: int, scheduler: str | None, stage: Stage | None
    ) -> None:
        self._mechanism = mechanism
        self._threads = threads
        self._stage = stage
        self._known: dict[int, Part] = {}
        self._parts = 0
        self._guesses: dict[int, Guess | None] = {0: None}
        self._fem: Fem | None = None
        self._solver: Solver | None = None
        if scheduler is not None:
            from ecm.cluster import Cluster

            self._solver = Cluster(mechanism, threads, scheduler)
        if stage is not None:
            self._parts = stage.parts()
            for index in range(self._parts):
                part = stage.load_part(index)
                if part is not None:
                    self._remember(part)

    def solve(self, first: int, wrenches: F, report: Report) -> Part:
        """Cases `first`, `first` + 1, ... under these wrenches; at most `room(first)` of them."""
        missing = [i for i in range(len(wrenches)) if first + i not in self._known]
        if missing:
            if self._solver is None:
                self._solver = Here(self._body(), self._threads)

            def finished(rows: list[int], part: Part) -> None:
                self._keep([first + missing[row] for row in rows], part)

            guess = self._guess(_learned(first))
            self._solver.solve(wrenches[missing], guess, finished, report)
        rows = [self._known[first + i] for i in range(len(wrenches))]
        return {name: np.array([row[name] for row in rows]) for name in (*FLAGS, *ARRAYS)}

    def rotations(self, first: int, wrenches: F) -> F | None:
        """|theta| that the guess of case `first` expects; None where it knows too little."""
        guess = self._guess(_learned(first))
        if guess is None or _learned(first) < _TELLS:
            return None
        poses = self._body().guessed_poses(np.ascontiguousarray(wrenches), guess)
        rotation: F = np.linalg.norm(poses[:, 3:], axis=1)
        return rotation

    def close(self) -> None:
        """Let go of the workers."""
        if self._solver is not None:
            self._solver.close()

    def _body(self) -> Fem:
        if self._fem is None:
            self._fem = self._mechanism.fem()
        return self._fem

    def _guess(self, count: int) -> Guess | None:
        """Learned from the first `count` cases, or from fewer where they tell too little."""
        if count not in self._guesses:
            rows = [self._known[case] for case in range(count)]
            rows = [row for row in rows if row["ok"] or row["unstable"]]
            found = None
            if rows:
                wrenches = np.array([row["wrenches"] for row in rows])
                found = self._body().learn(wrenches, np.array([row["fields"] for row in rows]))
            if found is None:
                found = self._guess(count // 2 if count > _FIRST else 0)
            self._guesses[count] = found
        return self._guesses[count]

    def _keep(self, cases: list[int], part: Part) -> None:
        part = {"case": np.array(cases, dtype=np.int64), **part}
        if min(cases) >= _LEARNED:
            del part["fields"]
        self._remember(part)
        if self._stage is not None:
            self._stage.save_part(self._parts, part)
            self._parts += 1

    def _remember(self, part: Part) -> None:
        for row, case in enumerate(part["case"]):
            self._known[int(case)] = {
                name: values[row] for name, values in part.items() if name != "case"
            }
