"""A prediction of a row depends on no row after it: a controller steps row by row."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ecm.effects import Effect, Rows, all_effects, effects_of, get_effect
from ecm.effects.protocol import correction_of, missing_beside_columns
from ecm.effects.registry import effects_of_actuators
from ecm.effects.robot import Backlash, JointOffset, RobotCompliance
from ecm.io.columns import POSE
from ecm.io.description import FileMeta
from ecm.io.table import Table
from ecm.models import Model, fit_model, load_model
from effects.test_old_files import FILES, rows
from support.campaigns import campaign
from support.driven import arm_model, arm_table, tendon_table
from support.one_angle import one_angle

LOOKS_AHEAD = {"viscous_damping": 1, "time_skew": 2, "inertia": 2}
"""Rows before the end that more rows change: velocities are those of the rows on both sides."""
Case = tuple[Table, Model, Sequence[Effect]]


def forms(table: Table, name: str | Model) -> Case:
    """Each form of each effect that a table can be predicted with."""
    model = name if isinstance(name, Model) else fit_model(table, name)

    def usable(effect: Effect) -> bool:
        lacking = effect.missing(table)
        known = lacking is None or not lacking.absent
        return known and missing_beside_columns(effect, table) is None and effect.kind != "noise"

    return table, model, [f for e in effects_of(table) if usable(e) for f in e.variants(table)]


def visits() -> Table:
    """In order of time; `approach` would name poses whose place is the mean of their readings."""
    table = campaign(seed=3).measured().drop("approach")
    return table.select(np.argsort(table.column("time_s"), kind="stable"))


def log() -> Table:
    table = visits()
    return replace(table, meta=replace(table.meta, file=FileMeta(kind="continuous")))


def driven(table: Table) -> Table:
    time = np.arange(float(len(table)))
    return table.with_columns({"time_s": 9.0 * time, "dwell_s": 2.0 + time % 3.0})


def driven_angle() -> Table:
    table = one_angle("hysteresis")
    return table.with_columns({"pressure_1_Pa": 1e4 + 20.0 * (np.arange(len(table)) % 350)})


def of_arm() -> Case:
    """What the joints of an arm and tendons do; the tool is known, as after a fit."""
    t, tool = np.arange(60.0), dict(zip(POSE, (0.0, 0.0, 0.1, 0.1, 0.0, 0.2), strict=True))
    table = rows().with_columns({f"tendon{j}_N": 5.0 + np.cos(j * t) for j in (1, 2, 3)})
    joints = RobotCompliance(**tool), Backlash(**tool), JointOffset(**tool)
    return table, load_model(FILES / "six_and_six.json"), (*joints, get_effect("tendon_friction"))


def cases() -> Iterator[Case]:
    yield forms(visits(), "energy4")
    yield forms(log(), "energy4")
    yield forms(one_angle("hysteresis"), "cubic")
    yield forms(driven_angle(), "cubic")
    yield forms(driven(arm_table()), arm_model())
    yield forms(driven(tendon_table()), "actuated3")
    yield of_arm()


def test_a_prediction_depends_on_no_later_row() -> None:
    looks_ahead, tested = set(), set()
    for table, model, effects in cases():
        n = 3 * len(table) // 5
        head = table.select(np.arange(n))
        for effect in effects:
            values = np.array([p.scale if p.allows(1.0) else -p.scale for p in effect.parameters])
            fitted = Rows(table, model.base)
            whole = correction_of(effect, fitted, values)
            alone = correction_of(effect, Rows(head, model.base, fitted.of_fit), values)
            same = n - LOOKS_AHEAD.get(effect.id, 0)
            off = np.abs(alone - whole[:n])
            if off[:same].max() > 1e-9 * np.abs(whole).max():
                looks_ahead.add((effect.id, str(effect.shape)))
            tested.add(effect.id)
    assert not looks_ahead
    every = {e.id for e in (*all_effects(), *effects_of_actuators()) if e.kind != "noise"}
    assert every <= tested
