"""What these rows can tell: effects that a plan tests, sizes from which one is seen.

The plan is laid out in time as the rig would run it, its wrenches are predicted by the nominal
base, and the Fisher information of base and effects gives the smallest size that the diagnosis
would name with chance 0.9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import special

from ecm.designs.nominal import NominalModel
from ecm.diagnosis.confusion import confusable_pairs, squares_left_after
from ecm.diagnosis.problem import Problem, assemble
from ecm.effects import Effect, Rows
from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.regression.noise import Noise
from ecm.rig.plan import OFFSET, UNLOADED, requests
from ecm.rig.settings import RigSettings
from ecm.rig.timeline import Climate, timeline_of

POWER = 0.9
"""Chance with which an effect of the limit's size is named."""


@dataclass(frozen=True)
class Identifiability:
    """What a plan can tell about one effect."""

    id: str
    parameter: str = ""
    size: float = np.inf
    """Size of the effect's best visible parameter that is named with chance 0.9."""
    unit: str = ""
    rivals: tuple[str, ...] = ()
    """Effects of the list that this plan cannot separate from it."""
    reason: str = ""
    """Why it cannot be seen at all."""
    record: str = ""
    """What to record so that it can be seen."""

    @property
    def named(self) -> bool:
        """Whether it can be seen and separated from every other of the list."""
        return not self.reason and not self.rivals

    def sentence(self) -> str:
        """Return one plain line."""
        if self.reason:
            return f"{self.id}: not visible, {self.reason} (record: {self.record})"
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        size = f"from {self.size:.2g}{unit} of {self.parameter}"
        if self.rivals:
            return f"{self.id}: seen {size}, but not told from {', '.join(self.rivals)}"
        return f"{self.id}: named {size}"

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON."""
        if self.reason:
            return {"id": self.id, "reason": self.reason, "record": self.record}
        return {
            "id": self.id,
            "parameter": self.parameter,
            "size": self.size,
            "unit": self.unit,
            "rivals": list(self.rivals),
        }


def predicted_table(plan: Table, base: NominalModel, rig: RigSettings | None = None) -> Table:
    """Return what the rig would record of a plan, without noise and without any effect."""
    settings = RigSettings() if rig is None else rig
    length = base.meta.length_m
    if length is None:
        raise InputError(f"{plan.source}: [mechanism] length_m is not known; add it to the TOML")
    timeline = timeline_of(requests(plan, settings.rig, length), settings.rig, length)
    visits = [visit for visit in timeline.visits if visit.kind != OFFSET]
    poses = np.stack([visit.pose for visit in visits])
    free = np.array([visit.kind == UNLOADED for visit in visits])
    wrenches = np.where(free[:, None], 0.0, base.base.predict(poses))
    hung_kg = np.array([visit.dead_weight_kg for visit in visits])
    wrenches[:, :3] -= hung_kg[:, None] * np.asarray(base.meta.scene.gravity_m_s2)
    time = np.array([visit.time_s for visit in visits])
    climate = Climate.build(settings, 0, timeline.end_s, timeline.heating)
    columns: dict[str, Any] = dict(zip(POSE, poses.T.copy(), strict=True))
    columns |= dict(zip(base.base.outputs, wrenches.T.copy(), strict=True))
    columns |= {
        "pose_id": np.array([visit.pose_id for visit in visits], dtype=np.float64),
        "run": np.array([visit.run for visit in visits], dtype=np.float64),
        "repeat": np.array([visit.repeat for visit in visits], dtype=np.float64),
        "time_s": time,
        "dwell_s": np.array([visit.dwell_s for visit in visits]),
        "approach": np.array([visit.approach for visit in visits], dtype=object),
        "kind": np.array([visit.kind for visit in visits], dtype=object),
        "temperature_degC": np.interp(time, climate.time_s, climate.probe_degC),
        "sensor_temperature_degC": np.interp(time, climate.time_s, climate.sensor_degC),
    }
    meta = replace(base.meta, runs=timeline.runs)
    return Table(columns, meta, plan.source)


def _a_little_noisy(table: Table, base: NominalModel, noise: Noise) -> Table:
    """Return the table with a hundredth of the noise, so that no row is exact."""
    covariance = noise.covariance(Rows(table, base.base))
    random = np.random.default_rng(0).standard_normal((len(table), 6, 1))
    added = 0.01 * (np.linalg.cholesky(covariance) @ random)[:, :, 0]
    return table.with_columns(dict(zip(WRENCH, (table.wrenches + added).T, strict=True)))


def identifiability(
    plan: Table,
    base: NominalModel,
    effects: Sequence[Effect],
    *,
    noise: Noise | None = None,
    rig: RigSettings | None = None,
) -> list[Identifiability]:
    """Return what a plan can show about each effect, those that it can name first.

    Parameters
    ----------
    plan
        Table of poses with the columns of a plan.
    base
        Nominal model: base, noise and description.
    effects
        Effects to look for.
    noise
        Noise of one row; default: that of the nominal model.
    rig
        Settings of the rig; default: those of a new rig.
    """
    table = predicted_table(plan, base, rig)
    declared = base.noise if noise is None else noise
    problem = assemble(base.base, _a_little_noisy(table, base, declared), effects, declared)
    # There is no residual here; the noise is the declared one.
    problem = replace(problem, scale=1.0)
    limits = detection_limits(problem)
    rivals: dict[str, list[str]] = {}
    for first, second in confusable_pairs(problem):
        rivals.setdefault(first, []).append(second)
        rivals.setdefault(second, []).append(first)
    results = []
    for effect in effects:
        missing = problem.untestable.get(effect.id)
        if effect.id in limits:
            known, alike = vars(limits[effect.id]), tuple(rivals.get(effect.id, ()))
            results.append(Identifiability(effect.id, **known, rivals=alike))
            continue
        reason, record = "the base absorbs it", "[mechanism]"
        if missing is not None:
            reason, record = missing.reason, missing.record
        elif effect.kind == "noise":
            reason, record = "it changes the scatter, not the mean", "repeats"
        results.append(Identifiability(effect.id, reason=reason, record=record))
    return sorted(results, key=lambda item: (bool(item.reason), bool(item.rivals)))


@dataclass(frozen=True)
class DetectionLimit:
    """Size of one parameter of an effect that is named with the chance `power`."""

    parameter: str
    size: float
    unit: str


def detection_limits(problem: Problem) -> dict[str, DetectionLimit]:
    """Return the limit of each testable effect, by its best visible parameter."""
    matrix = problem.equations[0]
    limits: dict[str, DetectionLimit] = {}
    for candidate in problem.candidates:
        if candidate.id in limits:
            continue
        needed = _noncentrality(problem, candidate.parameters)
        sizes = []
        for column, parameter in zip(candidate.columns, candidate.effect.parameters, strict=True):
            information = squares_left_after(matrix, [column], np.ones(1), problem.base_index)
            if information > 0.0:
                size = float(np.sqrt(needed / information) / problem.norms[column])
                sizes.append((size / parameter.scale, size, parameter))
        if sizes:
            _, size, parameter = min(sizes, key=lambda item: item[0])
            limits[candidate.id] = DetectionLimit(parameter.name, size, parameter.unit)
    return limits


def least_strength_seen(problem: Problem) -> float:
    """Return the rms in noise units at which an effect of one parameter is named."""
    return float(np.sqrt(_noncentrality(problem, 1) / problem.size))


def _noncentrality(problem: Problem, k: int) -> float:
    """Return the noncentrality at which delta chi² of k parameters passes the test and BIC."""
    settings = problem.settings
    by_test = float(special.chdtri(k, settings.level / max(1, len(problem.ids))))
    by_bic = settings.least_bic + k * float(np.log(problem.size))
    return float(special.chndtrinc(max(by_test, by_bic), k, 1.0 - POWER))
