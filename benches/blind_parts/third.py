"""The third generator: bodies, laws and protocols that share nothing with the first two.

Bodies by finite elements: a notched bar, a tube with bellows, a core in a stiffer sleeve. Laws are
other forms of every family of effects. Protocols: 20 to 60 rows, three forces only, no repeats,
poses held by hand, a room that warms. A set follows from its seed and number.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind_parts.other_bodies import drawn_poses
from blind_parts.rod import cross, turn
from blind_parts.strength import Strength
from ecm._native import Fem, Mesh
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table, as_table
from ecm.models import Model, fit_model
from ecm.models.fit import choose_base

F = NDArray[np.float64]
_POSES = 220
_LENGTH_M = 0.09
PROTOCOLS = ("campaign", "few rows", "forces only", "by hand", "warming room")
"""How the rows are taken; all but the first without a pose that comes again."""
STRENGTHS = (1.0, 3.0)
_NOISE = 0.004
"""Noise over the rms of the loads."""


# --- bodies -------------------------------------------------------------------------------------
def _mapped(mesh: Mesh, factor: Callable[[F], F]) -> Mesh:
    """The mesh with its radius times a function of x / L."""
    nodes = np.array(mesh.nodes_m)
    nodes[:, 1:] *= factor(nodes[:, 0] / mesh.length_m)[:, None]
    return Mesh.from_arrays(
        nodes, mesh.tetrahedra, base_nodes=mesh.base_nodes, top_nodes=mesh.top_nodes
    )


def _notched() -> list[tuple[Mesh, float]]:
    bar = Mesh.cylinder(length_m=_LENGTH_M, radius_m=0.022)
    return [(_mapped(bar, lambda s: 1.0 - 0.3 * np.exp(-(((s - 0.4) / 0.12) ** 2))), 1.5e6)]


def _bellows() -> list[tuple[Mesh, float]]:
    tube = Mesh.tube(length_m=_LENGTH_M, radius_m=0.024, inner_radius_m=0.017)
    return [(_mapped(tube, lambda s: 1.0 + 0.12 * np.cos(4.0 * np.pi * s)), 2.5e6)]


def _sleeved() -> list[tuple[Mesh, float]]:
    """A soft core in a stiff sleeve that touch at the end plates only: their wrenches add."""
    sleeve = Mesh.tube(length_m=_LENGTH_M, radius_m=0.024, inner_radius_m=0.019)
    return [(Mesh.cylinder(length_m=_LENGTH_M, radius_m=0.015), 0.4e6), (sleeve, 3e6)]


BODIES: dict[str, Callable[[], list[tuple[Mesh, float]]]] = {
    "notched": _notched,
    "bellows": _bellows,
    "sleeved": _sleeved,
}


@cache
def solved(body: str, folder: Path) -> tuple[F, F]:
    """Poses and wrenches (n, 6) of a body, solved once and kept in `folder`."""
    path = folder / f"third-{body}.json"
    if not path.exists():
        poses = drawn_poses(_POSES, _LENGTH_M, np.random.default_rng(11), 0.7)
        wrenches, good = np.zeros_like(poses), np.ones(len(poses), dtype=bool)
        for mesh, modulus in BODIES[body]():
            found = Fem(mesh, young_modulus_Pa=modulus, poisson_ratio=0.46).solve_poses(poses)
            good &= np.array([status == "solved" for status in found.status])
            wrenches += np.where(good[:, None], found.wrenches, 0.0)
        kept = {"poses": poses[good].tolist(), "wrenches": wrenches[good].tolist()}
        write_atomically(path, json.dumps(kept))
    kept = json.loads(path.read_text(encoding="utf-8"))
    return np.array(kept["poses"]), np.array(kept["wrenches"])


def solve_bodies(folder: Path) -> None:
    """Solve all bodies once, before several processes ask for them."""
    for body in BODIES:
        solved(body, folder)


# --- rows ---------------------------------------------------------------------------------------
@dataclass
class Made:
    """Rows before noise, in the order in which they were measured."""

    poses: F
    wrenches: F
    time_s: F
    dwell_s: F
    temperature_degC: F
    humidity: F
    random: np.random.Generator

    @property
    def share(self) -> F:
        """(N,) time from 0 to 1."""
        return np.asarray(self.time_s / self.time_s[-1])

    @property
    def scale(self) -> F:
        """(6,) spread of each wrench component."""
        return np.asarray(self.wrenches.std(axis=0))

    @property
    def way(self) -> F:
        """(N, 6) poses over their spread, from the first one on."""
        return np.asarray((self.poses - self.poses[0]) / self.poses.std(axis=0))


Law = Callable[[Made], F]


@dataclass(frozen=True)
class Hidden:
    """A law, the ids that name it, and the driver of its family; empty where that is the pose."""

    law: Law
    ids: tuple[str, ...]
    family: str


def _sliders(m: Made) -> F:
    """Prandtl-Ishlinskii: five sliders in parallel on each coordinate."""
    total = np.zeros_like(m.poses)
    for limit in (0.1, 0.3, 0.6, 1.0, 1.5):
        state = np.zeros(6)
        for i in range(1, len(total)):
            state = np.clip(state + m.way[i] - m.way[i - 1], -limit, limit)
            total[i] += state
    return total * m.scale


def _uneven_friction(m: Made) -> F:
    """Dry friction, twice as large on one way as on the other."""
    step = np.vstack([np.ones((1, 6)), np.diff(m.way, axis=0)])
    return np.where(step > 0.0, 1.0, -0.5) * np.tanh(np.abs(step) / 0.1) * m.scale


def _stretched(m: Made) -> F:
    """Relaxation by a stretched exponential of the time at rest."""
    return m.wrenches * np.exp(-((m.dwell_s / 8.0) ** 0.45))[:, None]


def _warm(m: Made) -> F:
    """A modulus that falls, and a body that grows along its axis, with the temperature."""
    change = m.temperature_degC - m.temperature_degC.mean()
    growth = np.zeros_like(m.poses)
    growth[:, 0] = m.scale[0]
    return (-0.02 * m.wrenches - 0.01 * growth) * change[:, None]


def _worn(m: Made) -> F:
    """Ogden-Roxburgh: below the largest energy so far softer by a hyperbolic tangent."""
    energy = np.abs((m.wrenches * (m.poses - m.poses.mean(axis=0))).sum(axis=1))
    largest = np.maximum.accumulate(energy)
    return -m.wrenches * np.tanh((largest - energy) / (0.5 * energy.mean()))[:, None]


def _hardened(m: Made) -> F:
    """All grows stiffer with the logarithm of the time."""
    return m.wrenches * np.log1p(20.0 * m.share)[:, None]


def _wandering(m: Made) -> F:
    """A zero of the sensor that wanders at random, in the sensor's axes."""
    steps = m.random.standard_normal((len(m.poses), 6)) + 0.3 * m.random.standard_normal(6)
    return _in_top(m, np.cumsum(steps, axis=0) * m.scale)


def _in_top(m: Made, zero: F) -> F:
    matrices = turn(m.poses[:, 3:])
    parts = [np.einsum("nij,nj->ni", matrices, zero[:, k : k + 3]) for k in (0, 3)]
    return np.hstack(parts)


def _offset(m: Made) -> F:
    return _in_top(m, np.tile(m.random.standard_normal(6) * m.scale, (len(m.poses), 1)))


def _mass(m: Made) -> F:
    force = np.tile([9.81, 0.0, 0.0], (len(m.poses), 1))
    arm = turn(m.poses[:, 3:]) @ (0.03 * m.random.uniform(-1.0, 1.0, 3))
    return np.hstack([force, cross(arm, force)])


def _tether(m: Made) -> F:
    """A spring from the platform's rim to a post beside it."""
    azimuth = m.random.uniform(0.0, 2.0 * np.pi)
    side = np.array([0.0, np.cos(azimuth), np.sin(azimuth)])
    arm = turn(m.poses[:, 3:]) @ (0.02 * side)
    way = np.array([0.8 * _LENGTH_M, 0.0, 0.0]) + 0.08 * side - m.poses[:, :3] - arm
    long = np.linalg.norm(way, axis=1, keepdims=True)
    force = -way * (1.0 - 0.03 / long)
    return np.hstack([force, cross(arm, force)])


def _bumper(m: Made) -> F:
    """A foam block that is met by one tilt, with the power 1.5 of its depth."""
    axis = int(m.random.integers(4, 6))
    angle = m.poses[:, axis] * m.random.choice([-1.0, 1.0])
    out = np.zeros_like(m.poses)
    out[:, axis] = np.maximum(0.0, angle - np.quantile(angle, 0.65)) ** 1.5
    return out * np.sign(m.poses[:, axis])[:, None]


def _gains(m: Made) -> F:
    """Axes of the sensor that read too much or too little."""
    top = turn(m.poses[:, 3:])
    gain = m.random.standard_normal(6)
    parts = [
        np.einsum("nij,j,nkj,nk->ni", top, gain[k : k + 3], top, m.wrenches[:, k : k + 3])
        for k in (0, 3)
    ]
    return np.hstack(parts)


def _humid(m: Made) -> F:
    """A stiffness that follows a humidity, which is recorded."""
    return m.wrenches * (m.humidity - m.humidity.mean())[:, None]


_WAY, _WARMTH = "the way to the pose", "the temperature of the body"
_LARGEST = "the largest deflection so far"
HIDDEN: Mapping[str, Hidden] = {
    "five sliders": Hidden(_sliders, ("hysteresis",), _WAY),
    "uneven friction": Hidden(_uneven_friction, ("hysteresis",), _WAY),
    "stretched exponential": Hidden(_stretched, ("stress_relaxation",), "the time at rest"),
    "modulus and expansion": Hidden(_warm, ("temperature_modulus", "thermal_expansion"), _WARMTH),
    "wear below the largest load": Hidden(_worn, ("mullins_softening",), _LARGEST),
    "hardening in log time": Hidden(_hardened, ("ageing",), "time"),
    "wandering zero": Hidden(_wandering, ("fts_drift",), "time"),
    "offset": Hidden(_offset, ("fts_offset",), ""),
    "mass": Hidden(_mass, ("payload",), ""),
    "tether": Hidden(_tether, ("cable_drag",), ""),
    "bumper": Hidden(_bumper, ("contact_stop",), ""),
    "gains": Hidden(_gains, ("fts_gain", "fts_crosstalk"), ""),
    "humidity": Hidden(_humid, ("unused_column:humidity",), "humidity"),
}


# --- sets ---------------------------------------------------------------------------------------
@dataclass(frozen=True)
class ThirdSet:
    """One set; an empty name hides nothing."""

    seed: int
    index: int
    name: str
    strength: float
    body: str
    protocol: str
    rows: int

    def to_dict(self) -> dict[str, Any]:
        """For its file."""
        return asdict(self)


def third_sets(count: int, seed: int) -> list[ThirdSet]:
    """The first sets of a seed: every fourth hides nothing, the others each law in turn."""
    return [_set(index, seed) for index in range(count)]


def _set(index: int, seed: int) -> ThirdSet:
    random = np.random.default_rng([seed, index, 3])
    names = list(HIDDEN)
    turn_ = index - index // 4 - 1 + 5 * seed
    protocol = PROTOCOLS[(index // 2 + seed) % len(PROTOCOLS)]
    few = protocol in ("few rows", "by hand")
    name = "" if index % 4 == 0 else names[turn_ % len(names)]
    if protocol == "forces only" and name == "bumper":  # a torque alone: forces show nothing of it
        name = ""
    return ThirdSet(
        seed=seed,
        index=index,
        name=name,
        strength=float(random.choice(STRENGTHS)),
        body=str(random.choice(list(BODIES))),
        protocol=protocol,
        rows=int(random.integers(20, 36) if few else random.integers(36, 61)),
    )


def third_table(case: ThirdSet, folder: Path) -> Table:
    """The table that its user has."""
    random = np.random.default_rng([case.seed, case.index, 4])
    poses, _ = solved(case.body, folder)
    made, ids = rows_of(case, random, folder, np.arange(len(poses)))
    sd, h = noise_of(made), made.wrenches
    if case.name:
        law = HIDDEN[case.name].law(made)
        h = h + law * factor(law, case, made, sd)
    return measured(case, made, ids, h + sd * random.standard_normal(h.shape), sd)


def noise_of(made: Made) -> F:
    """(6,) standard deviation of each reading."""
    h = made.wrenches
    return _NOISE * np.repeat([np.sqrt((h[:, k : k + 3] ** 2).mean()) for k in (0, 3)], 3)


def measured(case: ThirdSet, made: Made, ids: F, h: F, sd: F) -> Table:
    """The table of readings (N, 6) with this noise."""
    outputs = WRENCH[:3] if case.protocol == "forces only" else WRENCH
    columns: dict[str, Any] = dict(zip(POSE, made.poses.T, strict=True))
    columns |= {name: h[:, WRENCH.index(name)] for name in outputs}
    columns |= {"time_s": made.time_s, "dwell_s": made.dwell_s, "pose_id": ids}
    columns |= {"temperature_degC": made.temperature_degC, "humidity": made.humidity}
    columns["approach"] = ["initial", *(str(int(one)) for one in ids[:-1])]
    instrument = {
        "pose_position_sd_m": 1e-6,
        "pose_rotation_sd_rad": 1e-5,
        "force_sd_N": float(sd[0]),
        "torque_sd_Nm": float(sd[3]),
    }
    meta = {"mechanism": {"length_m": _LENGTH_M}, "instrument": instrument}
    return as_table(columns, meta=meta)


def rows_of(
    case: ThirdSet, random: np.random.Generator, folder: Path, places: NDArray[np.int64]
) -> tuple[Made, F]:
    """The rows of one campaign at some of the poses that were solved, and the id of each pose."""
    poses, wrenches = solved(case.body, folder)
    n = case.rows
    again = n // 5 if case.protocol == "campaign" else 0
    chosen = random.choice(places, n - again, replace=False)
    if case.protocol == "by hand":  # by hand a pose is near the one before
        left, order = list(chosen[1:]), [chosen[0]]
        while left:
            away = ((poses[left] - poses[order[-1]]) / poses.std(axis=0)) ** 2
            order.append(left.pop(int(np.argmin(away.sum(axis=1)))))
        chosen = np.array(order)
    ids = np.concatenate([np.arange(n - again), np.arange(again)])
    at = chosen[ids]
    dwell = np.exp(random.uniform(np.log(1.5), np.log(45.0), n))
    pause = random.exponential(60.0, n) if case.protocol == "by hand" else random.uniform(5, 10, n)
    time_s = np.cumsum(dwell + pause)
    swing = 6.0 if case.protocol == "warming room" else 1.0
    warm = 21.0 + swing * (time_s / time_s[-1]) ** 0.7 + 0.3 * swing * np.sin(time_s / 300.0)
    humidity = 45.0 + 8.0 * np.sin(time_s / random.uniform(200.0, 600.0)) + random.normal(0, 2, n)
    made = Made(poses[at], wrenches[at], time_s, dwell, warm, humidity, random)
    return made, ids.astype(float)


def factor(wrench: F, case: ThirdSet, made: Made, sd: F) -> float:
    """What brings the wrench of a law to the strength of the set, beside what the base takes in."""
    axes = slice(0, 3 if case.protocol == "forces only" else 6)
    columns = dict(zip(POSE, made.poses.T, strict=True))
    columns |= dict(zip(WRENCH, made.wrenches.T, strict=True))
    clean = as_table(columns, meta={"mechanism": {"length_m": _LENGTH_M}})
    base = choose_base(given_model(clean), clean)
    covariance = np.tile(np.diag(sd[axes] ** 2), (len(wrench), 1, 1))
    columns_of_base = np.asarray(base.columns(made.poses))[:, axes]
    seen = (columns_of_base**2).sum(axis=(0, 1)) > 0.0  # a pure turn does no work at the forces
    scale = Strength(covariance, columns_of_base[:, :, seen])
    return case.strength / max(scale(wrench[:, axes]), 1e-12)


def given_model(table: Table) -> Model:
    """The model of a user who knows the length alone."""
    return fit_model(table, "linear", force=True)


OUTCOMES = (
    "right", "family", "other family", "unknown", "none", "ambiguous", "wrong class", "wrong name",
    "alarm", "refused",
)  # fmt: skip


def outcome(case: ThirdSet, verdict: str, answer: list[list[str]], driver: str) -> str:
    """right, family, other family, unknown, none, wrong name or class; of nothing hidden an alarm.

    Parameters
    ----------
    driver
        That of the family that is said; empty without one.
    """
    if not case.name:
        return "right" if verdict == "none" else "alarm"
    hidden = HIDDEN[case.name]
    named = [one for one in answer if len(one) <= 3]
    if any(set(hidden.ids) & set(one) for one in named):
        return "right"
    if not named:
        other = verdict == "family" and hidden.family not in driver.split(" or ")
        return "other family" if other else verdict
    return "wrong name" if all(len(one) == 1 for one in named) else "wrong class"
