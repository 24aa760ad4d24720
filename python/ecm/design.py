"""Step 2 of the paper: the poses worth measuring, and the plan in which a rig visits them.

`design` chooses rows of a candidate table, D-optimal for a model or maximin in normalised pose
space, through the same Rust code as the binary `ecm-design`. `diagnosable_plan` turns chosen
poses into a campaign that also separates the effects: repeats, both approaches, varied dwell,
home and unloaded checks, random order. `paper_plan` is the paper's protocol.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecm import _native
from ecm.errors import InputError
from ecm.meta import Meta
from ecm.table import POSE, Table

F = NDArray[np.float64]
I = NDArray[np.int64]
Progress = Callable[[int, int], object] | None

# Weights of the wrench components in designs of energy models: one row's default noise.
_COMPONENT_SD = np.array([0.9, 0.3, 0.3, 0.010, 0.012, 0.012])

DWELLS_S = (2.0, 8.0, 30.0)
"""Rest before a reading in a diagnosable campaign: relaxation shows in their difference."""
_HOME_EVERY = 10
_UNLOAD_EVERY = 40


@dataclass(frozen=True)
class Design:
    """Chosen rows of the candidates and how good they are."""

    indices: I
    criterion: str
    value: float
    """log det(M/n)/k, or the smallest distance in coordinates normalised to [-1, 1]."""
    bound: float
    """No design of this size can exceed this value."""
    efficiency: float
    """Certified share of what is possible, at most 1."""
    status: str

    def sentence(self) -> str:
        """One line for people."""
        what = "D-efficiency" if self.criterion == "d" else "smallest distance"
        return (
            f"{len(self.indices)} poses, {what} {100.0 * self.efficiency:.1f} % of what is possible"
        )


def polynomial_degree(model: str) -> int:
    """Degree of `poly:D` or its aliases."""
    names = {"linear": 1, "quadratic": 2, "cubic": 3}
    if model in names:
        return names[model]
    if model.startswith("poly:") and model[5:].isdigit() and int(model[5:]) >= 1:
        return int(model[5:])
    raise InputError(f"model {model!r}: expected linear, quadratic, cubic or poly:D with D >= 1")


def choose(
    poses: F,
    n: int,
    *,
    criterion: str = "d",
    model: str = "cubic",
    length_m: float | None = None,
    seed: int = 0,
    threads: int = 0,
    starts: int = 10,
    iterations: int = 0,
    progress: Progress = None,
) -> Design:
    """n of the candidate poses, (N, d) in any consistent units.

    D-optimality is for `model` (`poly:D`, or `energyD` with its length); maximin is the
    Euclidean distance in coordinates normalised to [-1, 1].
    """
    low, high = poses.min(axis=0), poses.max(axis=0)
    moving = high > low
    if not moving.any():
        raise InputError("design: all candidate poses are the same")
    if criterion == "maximin":
        scaled = 2.0 * (poses[:, moving] - low[moving]) / (high - low)[moving] - 1.0
        found = _native.maximin(
            scaled, n, starts=starts, iterations=iterations, seed=seed, threads=threads,
            progress=progress,
        )  # fmt: skip
    elif criterion == "d":
        if model.startswith("energy"):
            regressor, rows = _energy_regressor(poses, model, length_m), 6
        else:
            degree = polynomial_degree(model)
            regressor = _native.polynomial_regressor(
                np.ascontiguousarray(poses[:, moving]), degree, low[moving], high[moving]
            )
            rows = 1
        found = _native.d_optimal(
            regressor, n, rows_per_pose=rows, starts=starts, iterations=iterations, seed=seed,
            threads=threads, progress=progress,
        )  # fmt: skip
    else:
        raise InputError(f"criterion {criterion!r}: expected d or maximin")
    return Design(
        indices=np.asarray(found.indices, dtype=np.int64),
        criterion=criterion,
        value=found.value,
        bound=found.bound,
        efficiency=found.efficiency,
        status=found.status,
    )


def _energy_regressor(poses: F, model: str, length_m: float | None) -> F:
    from ecm.models import parse_energy_name

    if length_m is None:
        raise InputError(
            f"a design for {model} needs the mechanism's length: give [mechanism] length_m "
            "in the candidates' TOML"
        )
    degree, symmetry = parse_energy_name(model)
    scale = np.array([length_m, 1.0])
    blocks = _native.EnergyModel.regressor(
        poses, length_m=length_m, degree=degree, symmetry=symmetry, scale=scale
    )
    weighted = blocks / _COMPONENT_SD[None, :, None]
    return np.ascontiguousarray(weighted.reshape(-1, weighted.shape[2]))


# --- plans -----------------------------------------------------------------


def paper_plan(candidates: Table, chosen: Design, *, seed: int = 0) -> Table:
    """The paper's protocol: each pose once, from the initial pose, one dwell, random order."""
    order = np.random.default_rng([seed, 2]).permutation(len(chosen.indices))
    rows = chosen.indices[order]
    return _plan(
        candidates,
        rows,
        kind=["pose"] * len(rows),
        action=["measure"] * len(rows),
        approach=["initial"] * len(rows),
        dwell_s=np.full(len(rows), DWELLS_S[0]),
    )


def diagnosable_plan(
    candidates: Table, chosen: Design, visits: int | None = None, *, seed: int = 0
) -> Table:
    """Visits, by default two a pose, that separate the effects, and the checks between them.

    Each chosen pose is visited from the initial pose and from a pose beyond it, so that the
    side of approach differs; visits left over repeat poses from the initial pose. Dwell times
    are dealt independently of pose and side. A home check after every tenth visit, the sensor
    unloaded at the beginning, the end, and after every fortieth.
    """
    rng = np.random.default_rng([seed, 3])
    poses = candidates.poses[chosen.indices]
    own = _pose_ids(candidates)
    m = len(poses)
    n = 2 * m if visits is None else visits
    if n < m:
        raise InputError(f"a diagnosable plan of {m} poses needs at least {m} visits, got {n}")
    beyond = _beyond(poses)
    legs = [(i, "initial") for i in range(m)]
    both = [i for i in rng.permutation(m) if beyond[i] >= 0][: 3 * (n - m) // 4]
    legs += [(int(i), str(int(own[chosen.indices[beyond[i]]]))) for i in both]
    again = rng.permutation(m)
    legs += [(int(again[j % m]), "initial") for j in range(n - len(legs))]
    legs = [legs[i] for i in rng.permutation(n)]
    dwells = np.resize(np.asarray(DWELLS_S), n)[rng.permutation(n)]

    rows: list[int] = []
    kind: list[str] = []
    action: list[str] = []
    approach: list[str] = []
    dwell: list[float] = []

    def check(name: str, what: str) -> None:
        rows.append(-1)
        kind.append(name)
        action.append(what)
        approach.append("")
        dwell.append(DWELLS_S[0])

    check("unloaded", "unload")
    for i, (pose, side) in enumerate(legs):
        if i and i % _UNLOAD_EVERY == 0:
            check("unloaded", "unload")
        if i % _HOME_EVERY == 0:
            check("home", "home")
        rows.append(int(chosen.indices[pose]))
        kind.append("pose")
        action.append("measure")
        approach.append(side)
        dwell.append(float(dwells[i]))
    check("home", "home")
    check("unloaded", "unload")
    return _plan(
        candidates,
        np.asarray(rows),
        kind=kind,
        action=action,
        approach=approach,
        dwell_s=np.asarray(dwell),
    )


def _pose_ids(candidates: Table) -> F:
    if candidates.has("pose_id"):
        return candidates.column("pose_id")
    return np.arange(len(candidates), dtype=np.float64)


def _beyond(poses: F) -> I:
    """For each pose the nearest pose from which it is approached from outside, or -1.

    The side of approach is a = sign((p - p_from) M (p - p0)) (interfaces.md); home gives +1,
    so a pose with (p - p_from) M (p - p0) < 0 gives the other side.
    """
    rest = np.zeros(6)
    rest[0] = _rest_x_m(poses)
    length = rest[0]
    weight = np.array([1.0, 1.0, 1.0, length**2, length**2, length**2])
    deflection = (poses - rest) * np.sqrt(weight)
    gram = deflection @ deflection.T
    own = np.diag(gram)
    distance = own[:, None] + own[None, :] - 2.0 * gram
    # (p_i - p_j) . p_i < 0 by a clear margin.
    distance[own[:, None] - gram > -0.1 * own[:, None]] = np.inf
    nearest = distance.argmin(axis=1)
    found = np.isfinite(distance[np.arange(len(poses)), nearest])
    return np.where(found, nearest, -1)


def _rest_x_m(poses: F) -> float:
    """The rest position of the top frame on the axis: the candidates scatter around it."""
    return float(np.median(poses[:, 0]))


def _plan(
    candidates: Table,
    rows: I,
    *,
    kind: list[str],
    action: list[str],
    approach: list[str],
    dwell_s: F,
) -> Table:
    """The plan's table; row -1 stands for a check at the rest pose."""
    poses = candidates.poses
    measured = rows >= 0
    rest = np.zeros(6)
    rest[0] = candidates.meta.mechanism.get("length_m", _rest_x_m(poses))
    own = _pose_ids(candidates)
    columns: dict[str, NDArray[np.float64] | NDArray[np.object_]] = {
        "pose_id": np.where(measured, own[rows], -1.0),
        "kind": np.asarray(kind, dtype=object),
        "action": np.asarray(action, dtype=object),
        "approach": np.asarray(approach, dtype=object),
        "dwell_s": dwell_s,
        "run": np.zeros(len(rows)),
    }
    for j, name in enumerate(POSE):
        columns[name] = np.where(measured, poses[rows, j], rest[j])
    meta = Meta(mechanism=candidates.meta.mechanism, scene=candidates.meta.scene)
    return Table(columns=columns, meta=meta, source="plan", warnings=())
