"""The fourth generator: driven arms of other shapes, and what is wrong with their actuators.

Bodies by finite elements: silicone arms with three or four chambers, or with three tendons, of
drawn sizes and moduli. The simulated rig visits 30 to 50 poses twice and hides effects of actuation
by its own laws, one at a time and in pairs; in some sets two columns of inputs stand exchanged. A
set follows from its seed and number.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ecm.designs import Design, diagnosable_plan
from ecm.io.arrays import F
from ecm.io.cache import read_arrays, write_arrays
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table
from ecm.models import fit_model
from ecm.rig import Campaign, Hidden, RigSettings
from ecm.rig.elastic import SolvedPoses
from ecm.rig.inject import CannotHide
from ecm.rig.plan import rest_pose

BODIES = 18
_ATTEMPTS = 30
_ROWS = 110
_LARGEST_TURN_RAD = 0.8
STRENGTHS = (1.0, 1.5)
SWAPPED = "chambers swapped"
OF_CHAMBERS = (
    "pressure_offset", "pressure_gain", "pressure_cross_talk", "pressure_hysteresis",
    "chamber_leak", "regulator_lag",
)  # fmt: skip
OF_TENDONS = ("capstan_friction", "tendon_stretch")
HIDDEN = (*OF_CHAMBERS, *OF_TENDONS)
_RIG = {
    "instrument": {
        "force_noise_N": 0.03,
        "torque_noise_Nm": 1e-3,
        "camera_error_m": 5e-6,
        "camera_error_rad": 5e-5,
        "camera_jitter_m": 5e-6,
        "camera_jitter_rad": 2e-5,
    },
    "plant": {"offset_N": 0.1, "offset_Nm": 4e-3, "drift_N": 0.02},
}
_LOADS = np.array([[-2, -1.5, -1.5, -0.05, -0.06, -0.06], [4, 1.5, 1.5, 0.05, 0.06, 0.06]])
_PRESSURE_PA = 2e4
_TENSION_N = 4.0
"""Loads and inputs of an arm of the size of examples/soft_arm.toml; others have theirs in
proportion."""


# --- bodies -------------------------------------------------------------------------------------
def has_tendons(number: int) -> bool:
    """Every third arm is drawn by tendons."""
    return number % 3 == 2


def arm(number: int) -> Mechanism:
    """A drawn arm."""
    random = np.random.default_rng([number, 4])
    radius = float(random.uniform(0.015, 0.025))
    length_m = float(random.uniform(4.5, 5.5)) * radius
    if has_tendons(number):
        return Mechanism(
            builtin="cylinder",
            length_m=length_m,
            radius_m=radius,
            tendon_count=3,
            tendon_offset_m=float(random.uniform(0.7, 0.9)) * radius,
            tendon_guides=4,
            young_modulus_Pa=float(random.uniform(1.5e5, 6e5)),
        )
    return Mechanism(
        builtin="chambered",
        length_m=length_m,
        radius_m=radius,
        chamber_count=int(random.choice([3, 3, 4])),
        chamber_inner_m=float(random.uniform(0.36, 0.42)) * radius,
        chamber_outer_m=float(random.uniform(0.78, 0.84)) * radius,
        channel_radius_m=0.2 * radius,
        young_modulus_Pa=float(random.uniform(1.5e5, 6e5)),
    )


def scales(body: Mechanism) -> tuple[float, float, float]:
    """Forces and moments over those of the example, and the largest input."""
    pressure, radius = body.young_modulus_Pa / 3e5, body.radius_m / 0.02
    moment = pressure * radius**4 / (body.length_m / 0.1)
    largest = _TENSION_N * moment / radius if body.tendon_count else _PRESSURE_PA * pressure
    return moment / (body.length_m / 0.1), moment, largest


@dataclass(frozen=True)
class Body:
    """An arm solved at random loads, as a source of the rig and as candidates of a plan."""

    number: int
    solved: SolvedPoses

    @property
    def length_m(self) -> float:
        """Length, m."""
        return float(self.solved.poses[0, 0])

    @property
    def actuators(self) -> tuple[str, ...]:
        """Columns of the inputs."""
        return arm(self.number).actuators

    def key(self) -> str:
        """Name of the solutions."""
        return f"fourth-{self.number}"

    def solve(self, poses: F, grade: str, progress: Any = None) -> SolvedPoses:
        """The solutions at rows that were solved before."""
        index = {row.tobytes(): i for i, row in enumerate(self.solved.poses)}
        rows = [index[row.tobytes()] for row in poses]
        own = self.solved
        return SolvedPoses(poses, own.wrenches[rows], own.stiffness[rows], ("solved",) * len(rows))

    def surrogate(self, solved: SolvedPoses) -> None:
        """None: K and G lead from the solved rows to those beside them."""

    def table(self) -> Table:
        """The solved rows but the one at rest."""
        rows = np.hstack([self.solved.poses, self.solved.wrenches])[1:]
        columns = dict(zip((*POSE, *self.actuators, *WRENCH), rows.T.copy(), strict=True))
        return Table(columns, Meta(mechanism={"length_m": self.length_m}), self.key())


@cache
def solved(number: int, folder: Path) -> Body:
    """A body, solved once and kept in `folder`."""
    path = folder / f"fourth-{number}.npz"
    kept = read_arrays(path)
    if kept is None:
        body, random = arm(number), np.random.default_rng([number, 5])
        force, moment, largest = scales(body)
        inputs_of_body = len(body.actuators)
        loads = random.uniform(*_LOADS, (_ROWS, 6)) * np.repeat([force, moment], 3)
        inputs = random.uniform(0.0, largest, (_ROWS, inputs_of_body))
        # Each actuator is off in a quarter of the rows, so that the others are seen alone.
        inputs *= random.uniform(size=inputs.shape) > 0.25
        rest = np.zeros((1, 6 + inputs_of_body))
        found = body.fem().solve_wrenches(np.vstack([rest, np.hstack([loads, inputs])]))
        turn = np.linalg.norm(found.poses[:, 3:], axis=1)
        good = (np.array(found.status) == "solved") & (turn <= _LARGEST_TURN_RAD)
        poses = np.hstack([found.poses, np.vstack([rest[:, 6:], inputs])])[good]
        poses[0] = rest_pose(body.length_m, inputs_of_body)
        slopes = np.concatenate([found.stiffness, found.actuation_jacobians[0]], axis=2)[good]
        kept = {"poses": poses, "wrenches": found.wrenches[good], "slopes": slopes}
        kept["wrenches"][0] = 0.0
        write_arrays(path, kept)
    rows = len(kept["poses"])
    own = SolvedPoses(kept["poses"], kept["wrenches"], kept["slopes"], ("solved",) * rows)
    return Body(number, own)


# --- sets ---------------------------------------------------------------------------------------
@dataclass(frozen=True)
class FourthSet:
    """One set; no name hides nothing."""

    seed: int
    index: int
    names: tuple[str, ...]
    strength: float
    body: int
    poses: int

    def to_dict(self) -> dict[str, Any]:
        """For its file."""
        return asdict(self)


def fourth_sets(count: int, seed: int) -> list[FourthSet]:
    """The first sets of a seed: of four one hides nothing, two an effect, and one a pair."""
    return [_set(index, seed) for index in range(count)]


def _set(index: int, seed: int) -> FourthSet:
    random = np.random.default_rng([seed, index, 6])
    body = (index // 2 + 7 * seed) % BODIES
    own = OF_TENDONS if has_tendons(body) else OF_CHAMBERS
    names: tuple[str, ...] = ()
    if index % 4 == 3:
        names = tuple(sorted(random.choice(own, 2, replace=False).tolist()))
    elif index % 4:
        names = (str(random.choice([*own, SWAPPED])),)
    return FourthSet(
        seed=seed,
        index=index,
        names=names,
        strength=STRENGTHS[(index // 8) % len(STRENGTHS)],
        body=body,
        poses=int(random.integers(30, 51)),
    )


def fourth_table(case: FourthSet, folder: Path) -> Table:
    """The table that its user has."""
    body = solved(case.body, folder)
    candidates = body.table()
    random = np.random.default_rng([case.seed, case.index, 7])
    chosen = np.sort(random.choice(len(candidates), case.poses, replace=False))
    plan = diagnosable_plan(
        candidates, Design(chosen, "maximin", 0.0, 0.0, 0.0, "drawn"), seed=case.seed + case.index
    )
    hide = [Hidden(name, case.strength, plausible=True) for name in case.names if name != SWAPPED]
    campaign = _campaign(plan, body, hide, case)
    table = campaign.run()
    if SWAPPED in case.names:
        one, other = body.actuators[:2]
        table = table.with_columns({one: table[other], other: table[one]})
    return table


def _campaign(plan: Table, body: Body, hide: list[Hidden], case: FourthSet) -> Campaign:
    """The campaign with a shape that the plan can show: a base takes in what all chambers share."""
    base = fit_model(body.table(), "actuated4").base
    for attempt in range(_ATTEMPTS):
        seed = 1000 * case.seed + case.index + 100_000 * attempt
        with suppress(CannotHide):
            return Campaign(
                plan, _rig(arm(case.body)), body, hide=hide, seed=seed, base_columns=base.columns
            )
    raise RuntimeError(f"{case}: no shape of {case.names} can be hidden")


def _rig(body: Mechanism) -> RigSettings:
    """The rig of small arms, with instruments for the loads of this one."""
    force, moment, _ = scales(body)
    settings = RigSettings.from_dict(_RIG)
    own, plant = settings.instrument, settings.plant
    return replace(
        settings,
        instrument=replace(
            own,
            force_noise_N=force * own.force_noise_N,
            torque_noise_Nm=moment * own.torque_noise_Nm,
            fts_range=(*(20.0 * force,) * 3, *(moment,) * 3),
            fts_resolution=(*(1e-3 * force,) * 3, *(5e-5 * moment,) * 3),
        ),
        plant=replace(
            plant,
            offset_N=force * plant.offset_N,
            offset_Nm=moment * plant.offset_Nm,
            drift_N=force * plant.drift_N,
        ),
    )
