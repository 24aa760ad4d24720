"""Measurement tables of the rod, with an effect of a wanted strength inside."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from blind_parts.rod import Section, turn, turn_back
from blind_parts.rod_effects import BODY
from blind_parts.rod_instruments import INSTRUMENTS, occluded
from blind_parts.rod_state import (
    COUNT,
    FORCE_SD_N,
    POSITION_SD_M,
    RANGE,
    ROTATION_SD_RAD,
    SENSOR_IN_TOP,
    TORQUE_SD_NM,
    Physics,
    RodState,
    measured,
)
from blind_parts.rod_visits import Planned, Visits, gone_on, lay_out
from blind_parts.strength import Strength
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import FileMeta, Instrument, Meta, Scene
from ecm.io.table import Table

F = NDArray[np.float64]
EFFECTS = {**BODY, **INSTRUMENTS}
"""What the rod can hide."""


@dataclass(frozen=True)
class Made:
    """A table, the same without noise, and the sizes of what was hidden."""

    table: Table
    quiet: Table
    sizes: dict[str, float]
    covariance: F
    """(n, 6, 6) of the noise of rows that measure a pose, outliers aside."""


def rod_table(
    plan: Table,
    hidden: Sequence[tuple[str, float]],
    seed: int,
    *,
    base_columns: Callable[[F], F],
    uneven_noise: float = 0.0,
    sizes: Mapping[str, float] | None = None,
    before: Table | None = None,
) -> Made:
    """A campaign on the rod.

    Parameters
    ----------
    hidden
        (id, s) pairs.
    base_columns
        (N, 6) poses to the (N, 6, k) change of the wrench per base parameter.
    sizes
        Of what is hidden, where it is that of an earlier campaign.
    before
        Plan of that campaign: the same rod goes on where it ended, what it remembers included;
        noise and weather are new.
    """
    visit = 0 if before is None else 1
    rest = np.array([Section().length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
    visits = lay_out(planned_visits(plan), rest, np.random.default_rng([seed, 77, visit]))
    first = visits
    if before is not None:
        first = lay_out(planned_visits(before), rest, np.random.default_rng([seed, 77, 0]))
        visits = gone_on(first, visits)
    own_rows = slice(0 if before is None else len(first.poses), None)
    lens_azimuth_rad = float(np.random.default_rng(seed).uniform(0.0, 6.28))
    rod_state = RodState(visits, Section(), first, lens_azimuth_rad)
    rows = np.asarray([kind == "pose" for kind in visits.planned.kind])
    covariance = rod_state.covariance()[rows[rod_state.loaded]]
    strength = Strength(covariance, base_columns(visits.poses[rows]))
    plain = _excess(rod_state, Physics())[rows]
    physics, found = Physics(), {}
    for id, s in hidden:
        own = np.random.default_rng([seed, 79, sorted(EFFECTS).index(id)])
        start, make = EFFECTS[id](own, rod_state)

        def change(size: float, make: Callable[[float], Physics] = make) -> F:
            return np.asarray(_excess(rod_state, make(size))[rows] - plain)

        known = sizes is not None and id in sizes
        found[id] = sizes[id] if sizes and known else strength.size(change, start, s)
        physics = _joined(physics, make(found[id]))
    noise = np.random.default_rng([seed, 78, visit])
    poses, wrenches = measured(rod_state, physics, noise, uneven_noise=uneven_noise)
    meta = _meta(plan)
    quiet_poses, quiet_wrenches = rod_state.readings(physics)
    build = _Build(visits, own_rows, meta, lens_azimuth_rad)
    return Made(build(poses, wrenches), build(quiet_poses, quiet_wrenches), found, covariance)


def planned_visits(plan: Table) -> Planned:
    """The columns of a plan; actions other than measure, home and unload change what follows."""
    n = len(plan)
    action = [str(a) for a in plan.text("action")] if plan.has("action") else ["measure"] * n
    words = {"measure": "pose", "home": "home", "unload": "unloaded", "dead_weight": "unloaded"}
    mount, payload, run, shift, hung = 0.0, True, 0, 0, False
    keep, kinds, mounts, payloads, dead, runs = [], [], [], [], [], []
    own = plan.column("run") if plan.has("run") else np.zeros(n)
    for i, text in enumerate(action):
        name, _, value = text.partition(":")
        if name in ("remount", "remove_payload", "warm_up"):
            mount += np.deg2rad(float(value)) if name == "remount" else 0.0
            payload = payload and name != "remove_payload"
            shift += name != "warm_up"
            continue
        # A dead weight is a run of its own: what hangs there is told by run.
        shift += hung or name == "dead_weight"
        hung = name == "dead_weight"
        run = int(own[i]) + shift
        keep.append(i)
        kinds.append(words[name])
        mounts.append(mount)
        payloads.append(payload)
        dead.append(float(value) if name == "dead_weight" else 0.0)
        runs.append(run)
    at = np.asarray(keep)
    dwell = plan.column("dwell_s")[at] if plan.has("dwell_s") else np.full(len(at), 2.0)
    return Planned(
        poses=plan.poses[at],
        pose_id=plan.column("pose_id")[at].astype(np.int64),
        approach=[str(a) for a in plan.text("approach")[at]],
        dwell_s=np.where(np.isfinite(dwell), dwell, 2.0),
        run=np.asarray(runs),
        kind=kinds,
        mount_rad=np.asarray(mounts),
        payload_on=np.asarray(payloads),
        dead_weight_kg=np.asarray(dead),
    )


def _excess(rod_state: RodState, physics: Physics) -> F:
    """Readings without noise minus the ideal rod at the pose that was seen, first order."""
    poses, wrenches = rod_state.readings(physics)
    ideal = np.zeros_like(wrenches)
    ideal[rod_state.loaded] = rod_state.elastic
    true = rod_state.visits.poses
    angle = turn_back(turn(poses[:, 3:]) @ np.swapaxes(turn(true[:, 3:]), 1, 2))
    step = np.concatenate([poses[:, :3] - true[:, :3], angle], axis=1)[rod_state.loaded]
    ideal[rod_state.loaded] += np.einsum("nij,nj->ni", rod_state.screw, step)
    return wrenches - ideal


def _joined(a: Physics, b: Physics) -> Physics:
    return Physics(
        {**a.section, **b.section},
        a.felt + b.felt,
        a.wrench + b.wrench,
        a.load + b.load,
        a.sensor + b.sensor,
        a.seen + b.seen,
    )


class _Build:
    """The columns that a table has whatever was measured."""

    def __init__(self, visits: Visits, rows: slice, meta: Meta, lens_azimuth_rad: float) -> None:
        self._rows = rows
        planned = visits.planned
        seen: dict[tuple[str, int], int] = {}
        repeat = []
        for kind, id in zip(planned.kind, planned.pose_id, strict=True):
            repeat.append(seen.get((kind, int(id)), 0))
            seen[kind, int(id)] = repeat[-1] + 1
        approach = [
            source if kind == "pose" else "initial"
            for source, kind in zip(planned.approach, planned.kind, strict=True)
        ]
        hidden = occluded(visits.poses, lens_azimuth_rad)
        self._columns: dict[str, Any] = {
            "pose_id": planned.pose_id.astype(np.float64),
            "run": planned.run.astype(np.float64),
            "repeat": np.asarray(repeat, dtype=np.float64),
            "time_s": visits.time_s,
            "dwell_s": visits.dwell_s,
            "approach": np.asarray(approach, dtype=object),
            "kind": np.asarray(planned.kind, dtype=object),
            "temperature_degC": visits.temperature_degC,
            "sensor_temperature_degC": visits.sensor_degC,
            "leds_visible": 9.0 - hidden,
        }
        runs: dict[int, dict[str, Any]] = {}
        for i in range(*rows.indices(len(planned.run))):
            run = planned.run[i]
            different: dict[str, Any] = {}
            if planned.mount_rad[i]:
                different["mount_angle_rad"] = float(planned.mount_rad[i])
            if not planned.payload_on[i]:
                different["payload_mass_kg"] = 0.0
            if planned.dead_weight_kg[i]:
                different["payload_mass_kg"] = float(planned.dead_weight_kg[i])
            if different:
                runs[int(run)] = different
        self._meta = Meta(
            file=meta.file, mechanism=meta.mechanism, instrument=meta.instrument,
            scene=meta.scene, runs=runs,
        )  # fmt: skip

    def __call__(self, poses: F, wrenches: F) -> Table:
        columns = dict(self._columns)
        columns |= {name: poses[:, j].copy() for j, name in enumerate(POSE)}
        columns |= {name: wrenches[:, j].copy() for j, name in enumerate(WRENCH)}
        own = {name: values[self._rows] for name, values in columns.items()}
        return Table(own, self._meta, "rod campaign")


def _meta(plan: Table) -> Meta:
    lever, angle = SENSOR_IN_TOP
    quaternion = Rotation.from_rotvec(angle).as_quat(scalar_first=True)
    return Meta(
        file=FileMeta(),
        mechanism=plan.meta.mechanism,
        instrument=Instrument(
            pose_position_sd_m=POSITION_SD_M,
            pose_rotation_sd_rad=ROTATION_SD_RAD,
            force_sd_N=FORCE_SD_N,
            torque_sd_Nm=TORQUE_SD_NM,
            fts_range=tuple(RANGE.tolist()),
            fts_resolution=tuple(COUNT.tolist()),
            top_from_sensor=(*lever.tolist(), *quaternion.tolist()),
        ),
        scene=Scene(),
    )
