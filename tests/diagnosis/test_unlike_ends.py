"""A body whose ends differ is not explained by effects that the symmetric energy then lacks."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.diagnosis import Diagnosis, diagnose
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from rows import slow_ramp
from support.neck import columns_of
from support.stand_in import left_jacobian_inverse, rotate, transpose

L = 0.1
META = Meta(
    mechanism={"length_m": L},
    instrument=Instrument(
        pose_position_sd_m=1e-9, pose_rotation_sd_rad=1e-9, force_sd_N=0.2, torque_sd_Nm=0.004
    ),
)
SCALE = np.array([5e-3, 1e-2, 1e-2, 0.3, 0.3, 0.3])


def tapered(poses: F) -> F:
    """Wrench of a quartic energy whose k_y_theta is not k_y L / 2, as alike ends ask."""
    linear = np.diag([4e4, 6e3, 6e3, 2.0, 3.0, 3.0])
    linear[1, 5] = linear[5, 1] = -60.0
    linear[2, 4] = linear[4, 2] = 60.0
    p = poses - [L, 0.0, 0.0, 0.0, 0.0, 0.0]
    q, gradient = p / SCALE, p @ linear
    gradient[:, 1:3] += 0.08 * (q[:, 1:3] ** 2).sum(axis=1)[:, None] * q[:, 1:3] / SCALE[1:3]
    gradient[:, 4:] += 0.12 * (q[:, 4:] ** 2).sum(axis=1)[:, None] * q[:, 4:] / SCALE[4:]
    torque = rotate(transpose(left_jacobian_inverse(p[:, 3:])), gradient[:, 3:])
    return np.concatenate([gradient[:, :3], torque], axis=1)


def measured(extra: F | float = 0.0) -> Table:
    random = np.random.default_rng(5)
    poses = random.uniform(-1.0, 1.0, (120, 6)) * [3e-3, 8e-3, 8e-3, 0.25, 0.25, 0.25]
    poses[:, 0] += L
    noise = random.standard_normal((120, 6)) * [0.2, 0.2, 0.2, 0.004, 0.004, 0.004]
    columns = columns_of(poses, tapered(poses) + extra + noise)
    return as_table(columns | {"time_s": 30.0 * np.arange(120)}, meta=META)


EFFECTS = ("cable_drag", "payload", "fts_offset", "fts_drift")


@pytest.mark.parametrize(("name", "answer"), [("linear", "form"), ("energy6-revolution", "fits")])
def test_a_tapered_body_lacks_no_effect(name: str, answer: str) -> None:
    table = measured()
    found: Diagnosis = diagnose(fit_model(table, name), table, effects=EFFECTS)
    assert found.answer == (), found.sentence()
    assert found.verdict == "none"
    assert found.model.answer == answer
    assert any("the ends of the body differ" in text for text in found.warnings)


def test_nor_does_it_where_three_forces_are_measured() -> None:
    table = measured().drop(*WRENCH[3:])
    found = diagnose(fit_model(table, "linear"), table)
    assert (found.verdict, found.answer) == ("none", ()), found.sentence()
    assert any("the ends of the body differ" in text for text in found.warnings)


def test_what_else_is_missing_is_named_against_it() -> None:
    drift: F = np.outer(np.arange(120.0), [0.01, 0.0, 0.0, 0.0, 0.0004, 0.0])
    table = measured(drift)
    found = diagnose(fit_model(table, "linear"), table, effects=EFFECTS)
    assert [members[0] for members in found.answer] == ["fts_drift"], found.sentence()


def test_a_ramp_of_a_body_with_alike_ends_says_nothing_of_its_ends() -> None:
    """Rows held out of a growing motion are far off for every degree; that is no other body."""
    table = slow_ramp(600)
    found = diagnose(fit_model(table, "energy6"), table, effects=["payload"])
    assert not any("ends of the body" in text for text in found.warnings)
