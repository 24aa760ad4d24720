"""Wrench-pose pairs by FEM: of wrenches drawn from a box, or of one's own; in batches that resume.

Only about one draw in five of the paper's Table I box stays inside |theta| <= 0.8 rad. So a
Cosserat rod, which takes microseconds a case, screens the draws before the FEM. The rod lacks the
stiffening of bonded ends (about 10 %), so its limit is the rotation limit times `screen_margin`: it
passes every draw that could be inside. From 64 cases on, the warm start of the FEM predicts the
pose within a per cent and screens what the rod has passed.

Batches end at 16, 32, 64, ..., 1024 cases and then no more. All cases of a batch have the same warm
start, fitted to the cases before the batch, and do not depend on each other. So a case depends only
on the draws before it: not on threads, workers, interruptions, or on how many cases were asked for
together. Each is stored.

A chunk of cases is solved by one Dask worker exactly as on this machine, so the result does not
depend on the number of workers. If a worker dies, Dask gives its chunks to another one; those that
are finished have been returned before.
"""

from __future__ import annotations

import math
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ecm._native import Fem, FemResults, WarmStart, rod_poses
from ecm.errors import ComputationError, FemError, InputError
from ecm.io.arguments import check_arguments
from ecm.io.arrays import B, F, I
from ecm.io.cache import Stage
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.events import Printed, with_words
from ecm.io.extras import dask_client, dask_completed, require
from ecm.io.mechanism import Mechanism
from ecm.io.settings import Checked, setting
from ecm.io.table import Table

CaseResults = dict[str, NDArray[Any]]
"""Results of some cases: one row per case in each array."""
CaseFinished = Callable[[list[int], CaseResults], None]
"""Called with rows and their results as soon as they are solved, in any order."""
CaseProgress = Callable[[int, int], object] | None
"""Called with the number of solved cases and of all cases."""

ARRAYS = (
    "loads",
    "amounts",
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
                self._body.solve_each(
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
        poses = self._body.predict_poses(np.ascontiguousarray(loads), warm_start)
        rotation: F = np.linalg.norm(poses[:, 3:], axis=1)
        return rotation

    def close(self) -> None:
        """Disconnect from the workers."""
        if self._workers is not None:
            self._workers.close()

    @cached_property
    def _body(self) -> Fem:
        return self._mechanism.fem()

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
                warm_start = self._body.fit_warm_start(loads, fields)
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
        self._client = dask_client(scheduler)
        self._workers = len(self._client.scheduler_info(n_workers=-1)["workers"])
        if self._workers == 0:
            self._client.close()
            raise InputError(
                f"--scheduler {scheduler}: no worker is there. Start some with "
                f"`dask worker {scheduler}`"
            )
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
        begun = (self._begin(wrenches, sent, chunk, 1) for chunk in chunks)
        pending = dask_completed(self._client, begun)
        killed = require("distributed", "cluster", "--scheduler").KilledWorker
        done = 0
        for future in pending:
            attempt, chunk = self._futures.pop(future)
            try:
                finished(chunk, future.result())
            except killed:  # workers died again and again
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
        future = self._client.submit(_solve_chunk, *self._body, wrenches[chunk], sent, pure=False)
        self._futures[future] = (attempt, chunk)
        return future

    def _send(self, warm_start: WarmStart | None) -> Any:
        """Send the warm start as a task, so that Dask repeats it if a worker that has it dies."""
        if self._sent[0] is not warm_start or self._sent[1] is None:
            data = b"" if warm_start is None else warm_start.to_bytes()
            self._sent = (warm_start, self._client.submit(bytes, data, pure=False))
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


TABLE_I_MIN = (-110.0, -100.0, -100.0, -5.0, -5.0, -5.0)
"""Table I of the paper: lower corner of the wrench box, N and N m; compression is negative."""
TABLE_I_MAX = (30.0, 100.0, 100.0, 5.0, 5.0, 5.0)

_DRAW_BLOCK = 2048  # wrenches drawn and screened together
_BLOCKS_WITHOUT_CASE = 50  # after so many blocks without a case the workspace is empty


@dataclass(frozen=True)
class Workspace(Checked):
    """Limits of admissible poses, and the box that wrenches are drawn from.

    Examples
    --------
    >>> Workspace(rotation_limit_rad=0.5).stretch_limit
    2.5
    >>> Workspace(rotation_limit_rad=45.0)
    Traceback (most recent call last):
    ...
    ecm.errors.InputError: rotation_limit_rad = 45.0: expected above 0 and at most 3.14159 \
(largest rotation angle of an admissible pose, in rad, not degrees)
    """

    rotation_limit_rad: float = setting(0.8, above=0.0, high=math.pi)
    """Largest rotation angle of an admissible pose, in rad, not degrees."""
    stretch_limit: float = setting(2.5, above=0.0)
    """Largest principal stretch in the body of an admissible pose."""
    wrench_min: tuple[float, ...] | None = setting(None, size=6)
    """Lower limits of the box of random wrenches: fx fy fz in N, taux tauy tauz in N m; default:
    those of the paper's neck, scaled to the bending stiffness and length of the body."""
    wrench_max: tuple[float, ...] | None = setting(None, size=6)
    """Upper limits of the same."""
    pressure_min_Pa: tuple[float, ...] = setting((0.0,), any_size=True)
    """Lower limits of the box of gauge pressures, Pa: of all chambers, or one for each."""
    pressure_max_Pa: tuple[float, ...] = setting((0.0,), any_size=True)
    """Upper limits of the same."""
    tension_min_N: tuple[float, ...] = setting((0.0,), any_size=True, low=0.0)
    """Lower limits of the box of tensions, N: of all tendons, or one for each."""
    tension_max_N: tuple[float, ...] = setting((0.0,), any_size=True, low=0.0)
    """Upper limits of the same."""
    full_box: bool = setting(False)
    """Keep every stable pose of the box; no screen, no limits."""
    screen_margin: float = setting(1.2, above=0.0)
    """FEM solves a draw where the rod predicts a rotation below the limit times this."""

    def _check_together(self) -> None:
        if self.wrench_min is not None and self.wrench_max is not None:
            _check_order(self.wrench_min, self.wrench_max)

    def box(self, mechanism: Mechanism) -> tuple[F, F]:
        """Corners (6 + m,) of the wrenches and of the inputs of a mechanism's m actuators."""
        tendons = len(mechanism.actuators) - mechanism.chambers
        corners = []
        least, most = self.wrench_min, self.wrench_max
        if least is None or most is None:
            usual = usual_wrenches(mechanism)
            least, most = least or usual[0], most or usual[1]
            _check_order(least, most)
        for name, wrench in (("min", least), ("max", most)):
            corner = list(wrench)
            for key, count, bodies in (
                (f"pressure_{name}_Pa", mechanism.chambers, "chambers"),
                (f"tension_{name}_N", tendons, "tendons"),
            ):
                given = getattr(self, key)
                if len(given) not in (1, count) and count > 0:
                    raise InputError(
                        f"{key} has {len(given)} numbers, the mechanism {count} {bodies}: give one "
                        "number for all, or one for each"
                    )
                corner += given * count if len(given) == 1 else given[:count]
            corners.append(np.array(corner, dtype=np.float64))
        low, high = corners
        if (high < low).any():
            raise InputError("[workspace]: a lower limit of pressure or tension is above the upper")
        return low, high


def usual_wrenches(mechanism: Mechanism) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Corners of Table I, which belongs to the paper's neck, scaled to a body.

    Its forces scale with E I / L^2, its moments with E I / L.
    """
    neck, section = Mechanism(), "bending_stiffness_Nm2"
    lever = mechanism.length_m / neck.length_m
    moment = mechanism.rod_sections()[section] / neck.rod_sections()[section] / lever
    factors = np.array([moment / lever] * 3 + [moment] * 3)
    low, high = (tuple((np.asarray(end) * factors).tolist()) for end in (TABLE_I_MIN, TABLE_I_MAX))
    return low, high


def _check_order(low: tuple[float, ...], high: tuple[float, ...]) -> None:
    if not all(a < b for a, b in zip(low, high, strict=True)):
        raise InputError("wrench_min must be below wrench_max in each component")


class RandomWrenches:
    """Uniform wrenches of the box that pass the rod's screen, in a fixed order."""

    def __init__(self, mechanism: Mechanism, workspace: Workspace, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 1])
        self._low, self._high = workspace.box(mechanism)
        self._limit = workspace.rotation_limit_rad * workspace.screen_margin
        # The rod knows no pressure.
        screens = not workspace.full_box and len(self._low) == len(WRENCH)
        self._sections = mechanism.rod_sections() if screens else None
        self._length_m = mechanism.length_m
        self._pending = np.empty((0, len(self._low)))
        self._serials = np.empty(0, dtype=np.int64)
        self._next_serial = 0

    def next(self, count: int, promising: Callable[[F], B]) -> tuple[F, I]:
        """Return the next `count` draws that pass, and their serial numbers among all draws."""
        taken: list[F] = []
        serials: list[I] = []
        blocks_without_case = size = 0
        while size < count:
            if len(self._pending) == 0:
                self._draw()
            passed = np.flatnonzero(promising(self._pending))[: count - size]
            taken.append(self._pending[passed])
            serials.append(self._serials[passed])
            size += len(passed)
            # Later draws are left to the next call.
            seen = int(passed[-1]) + 1 if size == count else len(self._pending)
            self._pending, self._serials = self._pending[seen:], self._serials[seen:]
            blocks_without_case = 0 if len(passed) else blocks_without_case + 1
            if blocks_without_case >= _BLOCKS_WITHOUT_CASE:
                raise ComputationError(
                    f"none of {blocks_without_case * _DRAW_BLOCK} random wrenches gives a rotation "
                    "within [workspace] rotation_limit_rad: shrink wrench_min and wrench_max"
                )
        return np.concatenate(taken), np.concatenate(serials)

    def _draw(self) -> None:
        """Draw a block; those that pass the rod are pending."""
        block = self._rng.uniform(self._low, self._high, (_DRAW_BLOCK, len(self._low)))
        serials = np.arange(self._next_serial, self._next_serial + _DRAW_BLOCK, dtype=np.int64)
        self._next_serial += _DRAW_BLOCK
        if self._sections is not None:
            poses, converged = rod_poses(block, length_m=self._length_m, **self._sections)
            rotation = np.linalg.norm(poses[:, 3:], axis=1)
            # If the rod has no equilibrium, the FEM decides.
            passed = ~converged | (rotation <= self._limit)
            block, serials = block[passed], serials[passed]
        self._pending, self._serials = block, serials


Progress = Callable[[int, int, str], object] | None
"""Called with pairs kept, all pairs, and a word for what is done."""

_CACHE_VERSION = 3  # of the stored cases; those of another version are not used
_PREDICTION_MARGIN = 1.05  # predicted rotations up to this factor times the limit are solved
_SMALLEST_BATCH = 8  # FEM cases that are solved together
_CASES_WITHOUT_PAIR = 1280  # after so many FEM cases without a pair the workspace is empty


_HARDLY_MOVED = 0.02
"""Displacement over the length, and rotation in rad, below which a box tells of no nonlinearity."""


@dataclass(frozen=True, repr=False, eq=False)
class Simulated(Printed):
    """Wrench-pose pairs by FEM, in the order of the wrenches.

    The result of `simulate`, and of `solve_wrenches`, where a wrench that has no stable pose keeps
    its row: its status says why, and its numbers are nan.

    Examples
    --------
    >>> pairs = simulate(Mechanism(), 1, seed=1)
    >>> pairs.poses.shape, bool((pairs.smallest_eigenvalue > 0.0).all())
    ((1, 6), True)
    """

    loads: F
    """(N, 6 + m), N and N m, the gauge pressure of each chamber in Pa, the tension of each tendon
    in N."""
    amounts: F
    """(N, m), change of each chamber's volume, m³, and shortening of each tendon, m."""
    poses: F
    """(N, 6), m and rad."""
    stiffness: F
    """(N, 6, 6), K = dh/dp."""
    energy_J: F
    """(N,), stored energy."""
    largest_stretch: F
    """(N,), largest principal stretch anywhere in the body."""
    smallest_jacobian: F
    """(N,), smallest volume ratio det F anywhere in the body."""
    smallest_eigenvalue: F
    """(N,), smallest eigenvalue of the Hessian H, lengths over L; positive: stable equilibrium."""
    iterations: I
    """(N,), Newton iterations."""
    newton_per_case: float
    """Mean Newton iterations of all cases that were solved for these pairs, kept or not."""
    counts: dict[str, int]
    """drawn, screened (by rod and warm start), solved, unstable, failed, kept; of given wrenches
    solved, unstable, failed."""
    mechanism: Mechanism
    status: tuple[str, ...]
    """(N,), `solved`, or why there is no pose: unstable, not_converged, inverted."""

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def wrenches(self) -> F:
        """(N, 6), N and N m."""
        return self.loads[:, :6]

    @property
    def actuation(self) -> F:
        """(N, m), gauge pressure of each chamber, Pa, then tension of each tendon, N."""
        return self.loads[:, 6:]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What looks wrong with all pairs together: a body that the box hardly moves."""
        length = self.mechanism.length_m
        moved = np.linalg.norm(self.poses[:, :3] - [length, 0.0, 0.0], axis=1) / length
        most = np.maximum(moved, np.linalg.norm(self.poses[:, 3:], axis=1)).max(initial=0.0)
        if not 0.0 < most < _HARDLY_MOVED:
            return ()
        young = self.mechanism.young_modulus_Pa
        return (
            f"these wrenches move the body by at most {most:.1g} of its length or rad: "
            f"check the length, {1e3 * length:.4g} mm, and E, {young:.3g} Pa; where both are "
            "right, widen [workspace] wrench_min and wrench_max",
        )

    def __repr__(self) -> str:
        counts = ", ".join(f"{name} {count}" for name, count in self.counts.items())
        return f"Simulated({len(self)} wrench-pose pairs: {counts})"

    def to_pandas(self) -> Any:
        """Return the solved pairs as a DataFrame."""
        return self.table().to_pandas()

    def table(self, source: str = "simulated pairs") -> Table:
        """Return the solved pairs as a measurement table that knows its mechanism."""
        solved = np.array([word == "solved" for word in self.status], dtype=np.bool_)
        columns: dict[str, F] = dict(zip(POSE, self.poses[solved].T, strict=True))
        columns |= dict(zip(WRENCH, self.wrenches[solved].T, strict=True))
        names = zip(self.mechanism.actuators, self.mechanism.amounts, strict=True)
        for k, (given, amount) in enumerate(names):
            columns |= {given: self.actuation[solved, k], amount: self.amounts[solved, k]}
        for name in ("energy_J", "largest_stretch", "smallest_jacobian"):
            columns[name] = getattr(self, name)[solved]
        return Table(columns, Meta(mechanism=self.mechanism.to_dict()), source)


def simulate(
    mechanism: Mechanism,
    n: int,
    workspace: Workspace | None = None,
    *,
    seed: int = 0,
    threads: int = 0,
    directory: Path | None = None,
    scheduler: str | None = None,
    progress: Progress = None,
) -> Simulated:
    """Simulate n admissible wrench-pose pairs by FEM; `solve_wrenches` takes wrenches of your own.

    Parameters
    ----------
    mechanism
        The elastic body.
    n
        Number of pairs.
    workspace
        Limits of admissible poses and the box of wrenches; default |theta| <= 0.8 rad and the
        paper's Table I.
    seed
        Seed of the random generator.
    threads
        0: all cores. The result does not depend on it.
    directory
        Folder that stores each solved case within 0.1 s; a later call with the same settings
        continues there.
    scheduler
        Address of a Dask scheduler (tcp://host:8786) whose workers solve the cases; the pairs are
        the same to the last bit. Needs the extra `cluster`.
    progress
        Called with pairs kept, n, and a word.

    Returns
    -------
    Simulated
        Poses, wrenches, stiffness matrices and more, one row per pair.

    Raises
    ------
    InputError
        For n < 1, a mechanism without a body, or no answer from the scheduler.
    ComputationError
        Where no pose is admissible.

    Examples
    --------
    >>> pairs = simulate(Mechanism(), 3, seed=1)
    >>> pairs
    Simulated(3 wrench-pose pairs: drawn 31, screened 11, solved 11, unstable 0, failed 0, kept 3)
    >>> pairs.stiffness.shape
    (3, 6, 6)
    >>> pairs.table().wrench_columns[:2]
    ('fx_N', 'fy_N')
    """
    _check_mechanism("simulate", mechanism)
    _check_number("simulate", n)
    check_arguments(simulate, locals())
    if n < 1:
        raise InputError(f"simulate: n = {n}, expected at least 1 pair")
    workspace = Workspace() if workspace is None else workspace
    stage = None
    if directory is not None:
        settings = {
            "mechanism": mechanism.key(),
            "workspace": workspace.__dict__,
            "seed": seed,
            "scheme": _CACHE_VERSION,
        }
        stage = Stage(directory, "simulate", settings)
    draws = RandomWrenches(mechanism, workspace, seed)
    cases = LoadCases(mechanism, threads, scheduler, stage)
    parts: list[CaseResults] = []
    counts: Counter[str] = Counter()
    kept = newton = first = drawn = 0
    with closing(cases):  # also where it ends early: no task stays with the workers
        while kept < n:
            # About as many as are still needed: a case depends only on those before its batch.
            wanted = (n - kept) * first // kept if kept > 0 else n
            count = min(batch_size(first), max(wanted, _SMALLEST_BATCH))
            wrenches, serial = draws.next(count, partial(_promising, cases, first, workspace))

            # As many of these cases are kept as of those before.
            def report(done: int, _: int, before: int = kept, cases: int = first) -> None:
                if progress is not None:
                    share = (before + 1) / (cases + 1)
                    progress(min(n, before + int(share * done)), n, "solving")

            part = cases.solve(first, wrenches, None if progress is None else report)
            first += len(wrenches)
            take = np.flatnonzero(_admissible(part, workspace))[: n - kept]
            counted = np.ones(len(serial), dtype=bool)
            if len(take) == n - kept:  # nothing drawn after the last kept pair counts
                counted = serial <= serial[take[-1]]
            drawn = int(serial[counted][-1]) + 1
            ok, unstable = part["ok"], part["unstable"]
            for name, cases_of in (
                ("solved", ok),
                ("unstable", unstable),
                ("failed", ~ok & ~unstable),
            ):
                counts[name] += int((cases_of & counted).sum())
            newton += int(part["iterations"][counted].sum())
            parts.append({name: part[name][take] for name in ARRAYS})
            kept += len(take)
            if progress is not None:
                progress(kept, n, "solved")
            if first >= _CASES_WITHOUT_PAIR and kept == 0:
                raise ComputationError(
                    f"none of {first} FEM poses is admissible (|theta| <= "
                    f"{workspace.rotation_limit_rad} rad, stretch <= {workspace.stretch_limit}): "
                    "widen the [workspace] limits or shrink the wrench box"
                )
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in ARRAYS}
    arrays["iterations"] = arrays["iterations"].astype(np.int64)
    screened = counts.total()  # whatever passes the screen is solved
    return Simulated(
        **arrays,
        newton_per_case=newton / screened,
        counts={"drawn": drawn, "screened": screened, **counts, "kept": kept},
        mechanism=mechanism,
        status=("solved",) * kept,
    )


def solve_wrenches(
    mechanism: Mechanism,
    wrenches: ArrayLike,
    *,
    pressures_Pa: ArrayLike | None = None,
    tensions_N: ArrayLike | None = None,
    volumes_m3: ArrayLike | None = None,
    lengths_m: ArrayLike | None = None,
    threads: int = 0,
    progress: Progress = None,
) -> Simulated:
    """Solve wrenches of your own by FEM: the pose at which the body carries each.

    Parameters
    ----------
    mechanism
        The elastic body.
    wrenches
        (N, 6) dead loads on the platform: force in N, moment in N m, in base axes at the top
        frame's origin.
    pressures_Pa
        (N, c) gauge pressures in the c chambers of the mechanism, Pa; default: none.
    tensions_N
        (N, t) tensions of its t tendons, N; default: none.
    volumes_m3, lengths_m
        In place of pressures or tensions: change of the chambers' volumes, and by how much the
        tendons are wound in, from the undeformed body. A tendon that is let out is slack.
    threads
        0: all cores. The result does not depend on it.
    progress
        Called with wrenches solved, N, and a word.

    Returns
    -------
    Simulated
        One row per wrench, in the same order: `status`, `poses` (N, 6) in m and rad, stiffness
        (N, 6, 6) and more. A wrench without a stable pose has a status other than `solved`, and nan
        for its numbers.

    Raises
    ------
    InputError
        For wrenches of another shape or with a number that is not finite, and for a mechanism
        without a body.

    Examples
    --------
    >>> pairs = solve_wrenches(Mechanism(), [[-20, 10, 5, 0.2, -0.3, 0.3], [-500, 0, 0, 0, 0, 0]])
    >>> pairs.status
    ('solved', 'unstable')
    >>> pairs.poses[0, :3].round(4)
    array([0.1019, 0.0105, 0.0068])
    >>> len(pairs.table())
    1
    """
    _check_mechanism("solve_wrenches", mechanism)
    loads = _six_columns("solve_wrenches", wrenches)
    chambers, actuators = mechanism.chambers, len(mechanism.actuators)
    parts, given = [loads], []
    for count, bodies, choices in (
        (chambers, "chamber", {"pressures_Pa": pressures_Pa, "volumes_m3": volumes_m3}),
        (actuators - chambers, "tendon", {"tensions_N": tensions_N, "lengths_m": lengths_m}),
    ):
        part, of_amounts = _of_actuators((len(loads), count), bodies, choices)
        parts.append(part)
        given += [of_amounts] * count
    loads = np.hstack(parts)
    fem, told = mechanism.fem(), with_words(progress, "solving")
    results = fem.solve_wrenches(loads, given=given, threads=threads, progress=told)
    status = tuple(results.status)
    lost = np.array([word != "solved" for word in status], dtype=np.bool_)
    arrays = {name: np.array(getattr(results, name)) for name in ARRAYS}
    # Those of the solver differ by its residual; inputs that it found stay.
    arrays["loads"][:, : len(WRENCH)] = loads[:, : len(WRENCH)]
    for name, values in arrays.items():
        if name not in ("loads", "iterations"):
            values[lost] = np.nan
    counts = {name: status.count(name) for name in ("solved", "unstable")}
    return Simulated(
        **arrays,
        newton_per_case=float(arrays["iterations"].mean()) if status else 0.0,
        counts={**counts, "failed": len(status) - sum(counts.values())},
        mechanism=mechanism,
        status=status,
    )


def _check_mechanism(name: str, mechanism: object) -> None:
    if not isinstance(mechanism, Mechanism):
        raise InputError(
            f"{name}: mechanism is a {type(mechanism).__name__}, expected an ecm.Mechanism, for "
            "instance ecm.Mechanism(length_m=0.1034, radius_m=0.033, young_modulus_Pa=0.65e6)"
        )


def _of_actuators(
    shape: tuple[int, int], bodies: str, choices: dict[str, ArrayLike | None]
) -> tuple[F, bool]:
    """Inputs of chambers or tendons, or their amounts, and whether it is the latter."""
    given = [(name, values) for name, values in choices.items() if values is not None]
    if len(given) > 1:
        raise InputError(f"solve_wrenches: found both {' and '.join(choices)}: give one of them")
    if not given:
        return np.zeros(shape), False
    name, values = given[0]
    found = np.asarray(values, dtype=np.float64)
    if found.shape != shape or not np.isfinite(found).all():
        raise InputError(
            f"solve_wrenches: {name} has shape {found.shape}, expected {shape} finite numbers: a "
            f"row for each wrench, a column for each {bodies}"
        )
    return found, name == list(choices)[1]


def _check_number(name: str, n: object) -> None:
    """InputError unless `n` is a whole number; wrenches have a function of their own."""
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)):
        raise InputError(
            f"{name}: n is a {type(n).__name__}, expected a whole number of pairs to draw; "
            "wrenches of your own are solved by ecm.solve_wrenches(mechanism, wrenches)"
        )


def _six_columns(name: str, wrenches: ArrayLike) -> F:
    """(N, 6) finite numbers; InputError for all else, naming the row."""
    try:
        loads = np.asarray(wrenches, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"{name}: wrenches are a {type(wrenches).__name__} that is no array of numbers, "
            "expected (N, 6): fx fy fz in N, taux tauy tauz in N m"
        ) from None
    if loads.ndim != 2 or loads.shape[1] != 6:
        one = ": put one wrench in a list of its own" if loads.shape == (6,) else ""
        raise InputError(
            f"{name}: wrenches of shape {loads.shape}, expected (N, 6): fx fy fz in N, taux tauy "
            f"tauz in N m{one}"
        )
    wrong = np.argwhere(~np.isfinite(loads))
    if len(wrong):
        row, column = wrong[0]
        raise InputError(
            f"{name}: wrenches, row {row}, {WRENCH[column]} is {loads[row, column]}, expected a "
            "finite number"
        )
    return np.ascontiguousarray(loads)


def _admissible(part: CaseResults, workspace: Workspace) -> B:
    """Whether each solved case lies inside the workspace."""
    inside: B = part["ok"].copy()
    if not workspace.full_box:
        rotation = np.linalg.norm(part["poses"][:, 3:], axis=1)
        inside &= rotation <= workspace.rotation_limit_rad
        inside &= part["largest_stretch"] <= workspace.stretch_limit
    return inside


def _promising(cases: LoadCases, first: int, workspace: Workspace, wrenches: F) -> B:
    """Whether each wrench may be admissible, predicted from the cases solved so far."""
    rotation = None if workspace.full_box else cases.predicted_rotations(first, wrenches)
    if rotation is None:
        return np.ones(len(wrenches), dtype=bool)
    return rotation <= _PREDICTION_MARGIN * workspace.rotation_limit_rad


def write_vtu(mechanism: Mechanism, wrenches: F, directory: Path) -> None:
    """Write the bodies deformed by wrenches (N, 6) as `pose_000.vtu`, ... for ParaView."""
    directory.mkdir(parents=True, exist_ok=True)
    body = mechanism.fem()
    for i, wrench in enumerate(wrenches):
        body.write_vtu(str(directory / f"pose_{i:03d}.vtu"), wrench=wrench.tolist())


def fem_poses(
    mechanism: Mechanism,
    n: int,
    *,
    seed: int = 0,
    threads: int = 0,
    rotation_limit_rad: float = 0.8,
    progress: Progress = None,
) -> tuple[F, F]:
    """Return poses (n, 6) and wrenches (n, 6) of the workspace, e.g. to train a surrogate.

    Wrenches of your own are solved by `solve_wrenches`. The wrench box is the paper's, scaled to
    the bending stiffness and length of the mechanism.

    Parameters
    ----------
    mechanism
        The elastic body.
    n
        Number of poses.
    seed
        Seed of the random generator.
    threads
        0: all cores. The result does not depend on it.
    rotation_limit_rad
        Largest rotation angle.
    progress
        Called with poses kept, n, and a word.

    Examples
    --------
    >>> poses, wrenches = fem_poses(Mechanism(), 2, rotation_limit_rad=0.3)
    >>> bool((np.linalg.norm(poses[:, 3:], axis=1) <= 0.3).all())
    True
    """
    _check_mechanism("fem_poses", mechanism)
    _check_number("fem_poses", n)
    workspace = Workspace(rotation_limit_rad=rotation_limit_rad)
    pairs = simulate(mechanism, n, workspace, seed=seed, threads=threads, progress=progress)
    return pairs.poses, pairs.wrenches
