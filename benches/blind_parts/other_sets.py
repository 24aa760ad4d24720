"""The sets of the second blind benchmark: what is drawn, what is stated, and what counts as right.

Everything of a set follows from its number and the seed; its truth is fixed before it is diagnosed.
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from blind_parts.command import diagnosed
from blind_parts.miss_kinds import MISSES, UNSAID
from blind_parts.other_bodies import BODIES, Body, stated_model
from blind_parts.other_hidden import FOREIGN, KNOWN, STATEMENTS, WORDS, Law, Made
from blind_parts.strength import Strength
from ecm.effects import get_effect
from ecm.errors import ComputationError
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table, as_table
from ecm.models import Model, fit_model
from ecm.models.check import check
from ecm.models.fit import choose_base

F = NDArray[np.float64]
KINDS = ("nothing", "known", "statement", "foreign", "nothing", "known", "statement", "known",
         "statement", "foreign")  # fmt: skip
"""In turn."""
STRENGTHS = (1.0, 3.0)
NOISE = 0.004
"""Noise over the rms of the loads."""
ORIGIN_M = 0.01


@dataclass(frozen=True)
class OtherSet:
    """One set; `seed` and `index` draw all that is not named here."""

    seed: int
    index: int
    kind: str
    name: str
    body: str
    strength: float
    rows: int
    repeats: int
    declared: bool
    """Whether the noise is declared."""

    @property
    def random(self) -> np.random.Generator:
        """Generator of the rows."""
        return np.random.default_rng([self.seed, self.index, 1])

    def to_dict(self) -> dict[str, Any]:
        """Return it for its file."""
        return asdict(self)


def other_sets(count: int, seed: int) -> list[OtherSet]:
    """The first sets of a seed."""
    return [_set(index, seed) for index in range(count)]


def _set(index: int, seed: int) -> OtherSet:
    random = np.random.default_rng([seed, index, 0])
    kind = KINDS[index % len(KINDS)]
    names = {
        "nothing": {"": "any"},
        "known": {name: where for name, (_, where) in KNOWN.items()},
        "foreign": {name: where for name, (_, where) in FOREIGN.items()},
        "statement": {name: one.of for name, one in STATEMENTS.items()},
    }[kind]
    turn = sum(KINDS[i % len(KINDS)] == kind for i in range(index)) + seed
    name = list(names)[turn % len(names)]
    body = str(random.choice([b.name for b in BODIES.values() if _fits(b, names[name])]))
    rows = int(random.integers(40, 121))
    return OtherSet(
        seed=seed,
        index=index,
        kind=kind,
        name=name,
        body=body,
        strength=float(random.choice(STRENGTHS)),
        rows=rows,
        repeats=int(random.choice([0, 0, rows // 10, rows // 5])),
        declared=bool(random.random() < 0.75) or kind == "statement",
    )


def _fits(body: Body, where: str) -> bool:
    full = len(body.axes) == 6
    return {"any": True, "six": full, "few": not full, "rod": body.stated}[where]


# --- data ---------------------------------------------------------------------------------------
def table_of(case: OtherSet, folder: Path) -> tuple[Table, dict[str, Any]]:
    """Return the table and the `[mechanism]` as the user states them."""
    body, random = BODIES[case.body], case.random
    made = _visits(case, body, random, folder)
    h = made.wrenches
    sd = NOISE * np.repeat([np.sqrt((h[:, j : j + 3] ** 2).mean()) for j in (0, 3)], 3)
    sd = np.where(sd > 0.0, sd, 1.0)
    law = (MISSES if case.kind == "miss" else {**KNOWN, **FOREIGN}).get(case.name)
    if law is not None:
        h = h + _sized(law[0], case, made, sd)
    h = h + sd * random.standard_normal(h.shape)
    poses, mechanism, when = made.poses, body.mechanism(), made.time_s
    stated_sd = sd
    if case.kind == "statement":
        poses, h, when, stated_sd, mechanism = _misstated(
            case, random, poses, h, when, sd, mechanism
        )
    columns: dict[str, Any] = {n: poses[:, POSE.index(n)] for n in body.inputs}
    columns |= {n: h[:, WRENCH.index(n)] for n in body.outputs}
    columns |= {"time_s": when, "dwell_s": made.dwell_s}
    columns["temperature_degC"] = made.temperature_degC
    if case.name == "unused_column:slider":
        columns["slider"] = made.slider
    if case.repeats:
        first = case.rows - case.repeats
        columns["pose_id"] = np.r_[np.arange(first), np.arange(case.repeats)].astype(float)
    if case.kind == "miss":  # friction is testable where each way to a pose is known
        ids = columns.setdefault("pose_id", np.arange(case.rows).astype(float))
        if case.name != UNSAID:
            columns["approach"] = ["initial", *(str(int(one)) for one in ids[:-1])]
    meta: dict[str, Any] = {"mechanism": mechanism} if mechanism else {}
    if case.declared:
        meta["instrument"] = {
            "pose_position_sd_m": 1e-9,
            "pose_rotation_sd_rad": 1e-9,
            "force_sd_N": float(stated_sd[0]),
            "torque_sd_Nm": float(stated_sd[3]),
        }
    return as_table(columns, meta=meta), mechanism


def _visits(case: OtherSet, body: Body, random: np.random.Generator, folder: Path) -> Made:
    first = case.rows - case.repeats
    at = body.visited(first, random, folder)
    again = np.r_[np.arange(first), np.arange(case.repeats)]
    n = case.rows
    dwell = np.exp(random.uniform(np.log(2.0), np.log(60.0), n))
    time_s = np.cumsum(dwell + random.uniform(4.0, 12.0, n))
    phase = random.uniform(0.0, 6.28)
    slow = np.interp(time_s, np.linspace(0.0, time_s[-1], 9), random.standard_normal(9))
    warm = 22.0 + np.sin(5.0 * time_s / time_s[-1] + phase) + slow
    slider = random.choice([0.0, 5.0, 10.0], n)
    return Made(body, at.select(again), time_s, dwell, warm, slider, random)


def _sized(law: Law, case: OtherSet, made: Made, sd: F) -> F:
    """The wrench of an effect at the strength of the set, beside what the base can absorb."""
    body = made.body
    wrench = law(made)
    axes = list(body.axes)
    columns = {n: made.poses[:, POSE.index(n)] for n in body.inputs}
    columns |= {n: made.wrenches[:, WRENCH.index(n)] for n in body.outputs}
    clean = as_table(columns, meta={"mechanism": body.mechanism()} if len(axes) == 6 else None)
    base = choose_base(given_model(clean, body.mechanism()), clean)
    covariance = np.tile(np.diag(sd[axes] ** 2), (len(wrench), 1, 1))
    scale = Strength(covariance, np.asarray(base.columns(made.poses[:, axes])))
    return wrench * (case.strength / max(scale(wrench[:, axes]), 1e-12))


def _misstated(
    case: OtherSet, random: np.random.Generator, poses: F, h: F, when: F, sd: F,
    mechanism: dict[str, Any],
) -> tuple[F, F, F, F, dict[str, Any]]:  # fmt: skip
    """Rows, time, noise and body as a user writes them down wrongly."""
    sign = float(random.choice([-1.0, 1.0]))
    axis = int(random.integers(3))
    mechanism = dict(mechanism)
    if case.name == "modulus":
        factor = 1.7**sign
        for key in mechanism:
            mechanism[key] *= factor if "stiffness" in key else 1
    elif case.name == "nu":
        for key in ("shear_stiffness_N", "torsion_stiffness_Nm2"):
            mechanism[key] *= 1.15
    elif case.name == "length":
        mechanism["length_m"] *= 1.1
    elif case.name.startswith("noise"):
        sd = sd * (0.5 if case.name == "noise_small" else 2.0)
    elif case.name == "frame":
        turn = Rotation.from_rotvec(sign * np.pi / 2.0 * np.eye(3)[axis]).as_matrix()
        h = np.hstack([h[:, :3] @ turn.T, h[:, 3:] @ turn.T])
    elif case.name == "torque":
        h = h * [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]
    elif case.name == "origin":
        off = sign * ORIGIN_M * np.eye(3)[axis]
        if random.random() < 0.5:
            poses = poses + np.r_[off, 0.0, 0.0, 0.0]
        else:
            h = np.hstack([h[:, :3], h[:, 3:] + np.cross(off, h[:, :3])])
    elif case.name == "minutes":
        when = when / 60.0
    return poses, h, when, sd, mechanism


@lru_cache(maxsize=32)
def _physics(document: tuple[tuple[str, Any], ...]) -> Model | None:
    return stated_model(dict(document))


def given_model(table: Table, mechanism: dict[str, Any]) -> Model:
    """Return the model that the user has: the stated body, else a polynomial of the rows."""
    model = _physics(tuple(mechanism.items()))
    if model is not None:
        return model
    kind = "cubic" if len(table.pose_columns) < 6 else "linear"
    try:
        return fit_model(table, kind)
    except ComputationError:  # worse than the mean of the readings: a user asks what is missing
        return fit_model(table, kind, force=True)


# --- answer and score ---------------------------------------------------------------------------
def answer_of(case: OtherSet, folder: Path) -> dict[str, Any]:
    """Diagnose a set; its file."""
    table, mechanism = table_of(case, folder)
    result, found = diagnosed(case, table, partial(given_model, table, mechanism))
    warnings = [*found.warnings, *check(table).warnings] if found else []
    return result | {"said": [result["said"], *warnings]}


def truth(result: dict[str, Any]) -> set[str]:
    """Names that are right: of what is hidden, and of what the owner of the body did not say."""
    case = result["set"]
    unsaid = {"taper"} if case["body"] == "tapered" else set()
    if case["kind"] == "statement":
        return unsaid | set(STATEMENTS[case["name"]].ids)
    return unsaid | ({case["name"]} if case["kind"] == "known" else set())


def clean_wrong(result: dict[str, Any]) -> bool:
    """One or more single names, at least one of which is wrong."""
    names = {members[0] for members in result["answer"]}
    return result["verdict"] == "named" and not names <= truth(result)


def unsaid_wrong(result: dict[str, Any]) -> bool:
    """A wrong name, and the words "or anything that ..." behind it do not say the cause either."""
    words = WORDS.get(result["set"]["name"])
    names = [members[0] for members in result["answer"] if len(members) == 1]
    behind = " ".join(get_effect(id).outside.what for id in names)
    return clean_wrong(result) and not (words and re.search(words, behind))


def right(result: dict[str, Any]) -> bool:
    """Whether the answer is right, by kind; for what no catalogue has: no name at all."""
    case = result["set"]
    answer = [one for one in result["answer"] if not (case["body"] == "tapered" and "taper" in one)]
    if case["kind"] == "nothing":
        return bool(result["verdict"] == "none" or (result["answer"] and not answer))
    if case["kind"] == "known":
        return len(answer) == 1 and case["name"] in answer[0] and len(answer[0]) <= 3
    if case["kind"] == "foreign":
        return not answer
    if clean_wrong(result):
        return False
    if result["verdict"] == "refused" or any(
        set(STATEMENTS[case["name"]].ids) & set(one) for one in answer
    ):
        return True
    return bool(re.search(STATEMENTS[case["name"]].words, " ".join(result["said"])))
