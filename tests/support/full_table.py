"""Rows of the closed-form campaign with every column and key that an effect may need."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ecm.io.columns import JOINT_SIGNS, JOINTS, VELOCITY
from ecm.io.table import Table
from support.arm_joints import joints_of
from support.campaigns import campaign


@lru_cache(maxsize=1)
def full_table() -> Table:
    """A fifth of the rows, told to be a continuous test.

    Without `leds_visible`: where the camera sees the platform, effects of the encoders cannot be
    tested.
    """
    table = campaign()
    table = table.select(np.arange(0, len(table), 5)).drop("leds_visible")
    n, random = len(table), np.random.default_rng(5)
    columns = {name: random.uniform(-0.01, 0.01, n) for name in VELOCITY}
    joints = joints_of(table.poses, random.uniform(-0.4, 0.4, n))
    columns |= dict(zip(JOINTS, joints.T, strict=True))
    columns |= {name: random.choice([-1.0, 1.0], n) for name in JOINT_SIGNS}
    columns |= {f"tendon{j}_N": random.uniform(1.0, 5.0, n) for j in range(1, 4)}
    limit = np.abs(table.wrenches).max(axis=0)
    meta = replace(
        table.meta,
        file=replace(table.meta.file, kind="continuous"),
        mechanism={**table.meta.mechanism, "free_length_m": 0.1},
        instrument=replace(
            table.meta.instrument,
            fts_range=tuple((0.5 * limit).tolist()),
            fts_resolution=(0.1, 0.1, 0.1, 0.003, 0.003, 0.003),
        ),
    )
    return table.with_columns(columns).with_meta(meta)
