"""Step 1 of the paper: random wrenches of a box, FEM poses, kept to an admissible workspace.

Only about one draw in five of the paper's Table I box stays inside |theta| <= 0.8 rad, so a
Cosserat rod, microseconds a case, screens the draws before the FEM. The rod lacks the stiffening
of bonded ends (about 10 %), so the screen lets everything pass that could be inside after the FEM:
its limit is the admissible rotation times `screen_margin`. From 64 cases on the guess that the FEM
starts from, which knows the pose to a percent or better, screens what the rod has let pass.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ecm._native import rod_poses
from ecm.cases import ARRAYS, Cases, room
from ecm.errors import ComputationError, InputError
from ecm.mechanism import Mechanism
from ecm.meta import Meta
from ecm.stages import Stage
from ecm.table import POSE, WRENCH, Table

F = NDArray[np.float64]
Progress = Callable[[int, int, str], object] | None

# Table I of the paper: N, N m; compression negative.
TABLE_I_MIN = (-110.0, -100.0, -100.0, -5.0, -5.0, -5.0)
TABLE_I_MAX = (30.0, 100.0, 100.0, 5.0, 5.0, 5.0)

_SCHEME = 2  # of guesses and of what is kept; another one resumes nothing of this one
_GUESS_MARGIN = 1.05  # guesses let draws pass up to this factor times the rotation limit
_AT_LEAST = 8  # FEM cases that are solved together
_FRUITLESS = 1280  # so many FEM cases without an admissible one: the workspace is empty
_BLOCK = 2048  # wrenches that are drawn and screened together
_DRY_BLOCKS = 50  # so many blocks without a single case: the workspace is empty


@dataclass(frozen=True)
class Workspace:
    """Which simulated poses are admissible."""

    rotation_limit_rad: float = 0.8
    """Largest |theta|."""
    stretch_limit: float = 2.5
    """Largest principal stretch anywhere in the body."""
    wrench_min: tuple[float, ...] = TABLE_I_MIN
    """Lower corner of the wrench box, N and N m."""
    wrench_max: tuple[float, ...] = TABLE_I_MAX
    """Upper corner of the wrench box, N and N m."""
    full_box: bool = False
    """Keep every stable solution of the box."""
    screen_margin: float = 1.2
    """The rod lets draws pass up to this factor times the rotation limit."""

    def __post_init__(self) -> None:
        for name in ("rotation_limit_rad", "stretch_limit", "screen_margin"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"workspace.{name} = {value}: expected a positive number")
        if self.rotation_limit_rad > np.pi:
            raise InputError(
                f"workspace.rotation_limit_rad = {self.rotation_limit_rad}: expected at most pi; "
                "is it in degrees?"
            )
        for name in ("wrench_min", "wrench_max"):
            if len(getattr(self, name)) != 6:
                raise InputError(
                    f"workspace.{name} has {len(getattr(self, name))} entries: expected six, "
                    "fx fy fz in N and taux tauy tauz in N m"
                )
        if not all(a < b for a, b in zip(self.wrench_min, self.wrench_max, strict=True)):
            raise InputError("workspace.wrench_min must be below wrench_max in each component")


@dataclass(frozen=True)
class Simulated:
    """Wrench-pose pairs by FEM, in the order in which they were drawn."""

    wrenches: F
    poses: F
    stiffness: F
    """K = dh/dp, (N, 6, 6)."""
    energy_J: F
    largest_stretch: F
    smallest_jacobian: F
    smallest_eigenvalue: F
    iterations: NDArray[np.int64]
    newton_per_case: float
    """Mean Newton iterations of all cases that were solved for these pairs, kept or not."""
    counts: dict[str, int]
    """drawn, screened (passed the rod and the guess), solved, unstable, failed, kept."""
    mechanism: Mechanism

    def __len__(self) -> int:
        return len(self.poses)

    def table(self, source: str = "simulated pairs") -> Table:
        """The pairs as a measurement table that knows its mechanism."""
        columns: dict[str, F] = dict(zip(POSE, self.poses.T, strict=True))
        columns |= dict(zip(WRENCH, self.wrenches.T, strict=True))
        columns["energy_J"] = self.energy_J
        columns["largest_stretch"] = self.largest_stretch
        columns["smallest_jacobian"] = self.smallest_jacobian
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
    """n admissible wrench-pose pairs by FEM.

    Parameters
    ----------
    n
        Pairs to keep.
    workspace
        What is admissible; default |theta| <= 0.8 rad under wrenches of the paper's Table I.
    directory
        Where solved cases are kept, each within 0.1 s; a later call with the same settings goes
        on there.
    scheduler
        Address of a Dask scheduler (tcp://host:8786) whose workers solve the cases; the pairs
        are the same to the last bit. Needs the extra `cluster`.
    progress
        Called with pairs kept, n, and a word.
    """
    if n < 1:
        raise InputError(f"simulate: n = {n}, expected at least 1 pair")
    workspace = Workspace() if workspace is None else workspace
    stage = None
    if directory is not None:
        settings = {
            "mechanism": mechanism.key(),
            "workspace": workspace.__dict__,
            "seed": seed,
            "scheme": _SCHEME,
        }
        stage = Stage(directory, "simulate", settings)
    draws = _Draws(mechanism, workspace, seed)
    cases = Cases(mechanism, threads, scheduler, stage)
    parts: list[dict[str, F]] = []
    kept = solved = unstable = failed = newton = first = 0
    while kept < n:
        # About as many as are still needed: a case depends only on those before its group.
        wanted = (n - kept) * first // kept if kept > 0 else n
        count = min(room(first), max(wanted, _AT_LEAST))
        wrenches, serial = draws.next(count, partial(_hopeful, cases, first, workspace))

        def report(done: int, total: int, before: int = kept) -> None:
            if progress is not None:
                progress(min(n, before + done * (n - before > 0)), n, "solving")

        part = cases.solve(first, wrenches, None if progress is None else report)
        first += len(wrenches)
        ok, lost = part["ok"], part["unstable"]
        inside = ok.copy()
        if not workspace.full_box:
            rotation = np.linalg.norm(part["poses"][:, 3:], axis=1)
            inside &= rotation <= workspace.rotation_limit_rad
            inside &= part["largest_stretch"] <= workspace.stretch_limit
        take = np.flatnonzero(inside)[: n - kept]
        counted = np.ones(len(serial), dtype=bool)
        if len(take) == n - kept:
            # Only what was drawn up to the last kept pair counts.
            counted = serial <= serial[take[-1]]
            draws.stop_at(int(serial[take[-1]]))
        solved += int((ok & counted).sum())
        unstable += int((lost & counted).sum())
        failed += int((~ok & ~lost & counted).sum())
        newton += int(part["iterations"][counted].sum())
        parts.append({name: part[name][take] for name in ARRAYS})
        kept += len(take)
        if progress is not None:
            progress(kept, n, "solved")
        if first >= _FRUITLESS and kept == 0:
            raise ComputationError(
                f"none of {first} FEM poses is admissible (|theta| <= "
                f"{workspace.rotation_limit_rad} rad, stretch <= {workspace.stretch_limit}): "
                "widen the [workspace] limits or shrink the wrench box"
            )
    cases.close()
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in ARRAYS}
    counts = {
        "drawn": draws.drawn,
        "screened": draws.screened,
        "solved": solved,
        "unstable": unstable,
        "failed": failed,
        "kept": kept,
    }
    return Simulated(
        **{name: arrays[name] for name in ARRAYS if name != "iterations"},
        iterations=arrays["iterations"].astype(np.int64),
        newton_per_case=newton / (solved + unstable + failed),
        counts=counts,
        mechanism=mechanism,
    )


def _hopeful(cases: Cases, first: int, workspace: Workspace, wrenches: F) -> NDArray[np.bool_]:
    """Which wrenches may be admissible, as far as the solved cases tell."""
    rotation = None if workspace.full_box else cases.rotations(first, wrenches)
    if rotation is None:
        return np.ones(len(wrenches), dtype=bool)
    hopeful: NDArray[np.bool_] = rotation <= _GUESS_MARGIN * workspace.rotation_limit_rad
    return hopeful


class _Draws:
    """Uniform wrenches of the box that pass the rod's screen, in a fixed order."""

    def __init__(self, mechanism: Mechanism, workspace: Workspace, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 1])
        self._low = np.asarray(workspace.wrench_min)
        self._high = np.asarray(workspace.wrench_max)
        self._limit = workspace.rotation_limit_rad * workspace.screen_margin
        self._screen = not workspace.full_box
        self._sections = mechanism.rod_sections() if self._screen else None
        self._length_m = mechanism.length_m
        self._pending = np.empty((0, 6))
        self._serials = np.empty(0, dtype=np.int64)
        self._serial = 0
        self.drawn = 0
        self.screened = 0
        self._passed: list[NDArray[np.int64]] = []

    def next(
        self, count: int, hopeful: Callable[[F], NDArray[np.bool_]]
    ) -> tuple[F, NDArray[np.int64]]:
        """The next `count` draws that pass, and their serial numbers among all draws."""
        taken: list[F] = []
        serials: list[NDArray[np.int64]] = []
        dry = found = 0
        while found < count:
            if len(self._pending) == 0:
                self._draw()
            passed = np.flatnonzero(hopeful(self._pending))[: count - found]
            taken.append(self._pending[passed])
            serials.append(self._serials[passed])
            found += len(passed)
            # What lies behind the last one that is needed is judged by the next call.
            seen = int(passed[-1]) + 1 if found == count else len(self._pending)
            self._pending, self._serials = self._pending[seen:], self._serials[seen:]
            dry = 0 if len(passed) else dry + 1
            if dry >= _DRY_BLOCKS:
                raise ComputationError(
                    f"none of {dry * _BLOCK} random wrenches gives a rotation within "
                    "[workspace] rotation_limit_rad: shrink wrench_min and wrench_max"
                )
        self._passed.append(np.concatenate(serials))
        self.drawn = int(self._passed[-1][-1]) + 1
        self.screened += count
        return np.concatenate(taken), self._passed[-1]

    def _draw(self) -> None:
        """A block of draws; pending are those that pass the rod."""
        block = self._rng.uniform(self._low, self._high, (_BLOCK, 6))
        serials = np.arange(self._serial, self._serial + _BLOCK, dtype=np.int64)
        self._serial += _BLOCK
        if self._sections is not None:
            poses, converged = rod_poses(block, length_m=self._length_m, **self._sections)
            rotation = np.linalg.norm(poses[:, 3:], axis=1)
            # A rod that found no equilibrium says nothing: the FEM decides.
            passed = ~converged | (rotation <= self._limit)
            block, serials = block[passed], serials[passed]
        self._pending, self._serials = block, serials

    def stop_at(self, serial: int) -> None:
        """Count only what was drawn up to and including this serial number."""
        self.drawn = serial + 1
        self.screened = int(sum((s <= serial).sum() for s in self._passed))


def fem_poses(
    mechanism: Mechanism,
    n: int,
    *,
    seed: int = 0,
    threads: int = 0,
    rotation_limit_rad: float = 0.8,
    progress: Progress = None,
) -> tuple[F, F]:
    """Poses (n, 6) and wrenches (n, 6) of the admissible workspace, e.g. for a surrogate."""
    # Table I belongs to the neck: another body's forces scale with E I / L^2, moments with E I / L.
    neck = Mechanism()
    lever = mechanism.length_m / neck.length_m
    section = "bending_stiffness_Nm2"
    moment = mechanism.rod_sections()[section] / neck.rod_sections()[section] / lever
    factors = np.array([moment / lever] * 3 + [moment] * 3)
    workspace = Workspace(
        rotation_limit_rad=rotation_limit_rad,
        wrench_min=tuple(float(v) for v in np.asarray(TABLE_I_MIN) * factors),
        wrench_max=tuple(float(v) for v in np.asarray(TABLE_I_MAX) * factors),
    )
    found = simulate(mechanism, n, workspace, seed=seed, threads=threads, progress=progress)
    return found.poses, found.wrenches
