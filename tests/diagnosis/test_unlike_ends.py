"""A body whose ends differ is not explained by effects that the symmetric energy then lacks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ecm.diagnosis import Diagnosis, diagnose
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.io.description import Instrument, Meta, Scene
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from rows import slow_ramp
from support.neck import columns_of
from support.tapered_body import META, NOISE, random_poses, tapered


def measured(extra: F | float = 0.0) -> Table:
    random = np.random.default_rng(5)
    poses = random_poses(random, 120)
    noise = random.standard_normal((120, 6)) * NOISE
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


def bushing(poses: F) -> F:
    """Wrench of a stubby bushing of 40 mm: logs and powers of the pose in its mid frame, mm."""
    axis, length = np.array([1.0, 0.0, 0.0]), 40.0

    def energy(top: F, turn: Rotation) -> F:
        theta = turn.as_rotvec()
        middle = Rotation.from_rotvec(theta / 2.0).inv()
        x, y, z = middle.apply(top - length / 2.0 * (turn.apply(axis) + axis)).T
        aside, bend = y**2 + z**2, (theta[:, 1:] ** 2).sum(axis=1)
        shear = 4.0 * x * aside + 4000.0 * np.log1p(aside / 50.0) + 30.0 * aside**1.25
        both = 900.0 * (z * theta[:, 1] - y * theta[:, 2]) + 2500.0 * x * bend
        twist = 2600.0 * theta[:, 0] ** 2 * (1.0 + 0.3 * np.abs(theta[:, 0]))
        push = 210.0 * x**2 * (1.0 + 0.1 * np.tanh(x)) + 21000.0 * bend * (1.0 + 1.2 * bend)
        return np.asarray(shear + both + twist + push)

    top, turn = 1e3 * poses[:, :3], Rotation.from_rotvec(poses[:, 3:])
    wrench = np.empty_like(poses)
    for i, step in enumerate(1e-4 * np.eye(3)):
        by, small = Rotation.from_rotvec(0.1 * step), 0.1 * 1e-4
        wrench[:, i] = (energy(top + step, turn) - energy(top - step, turn)) / 2e-4
        turned = energy(top, by * turn) - energy(top, by.inv() * turn)
        wrench[:, 3 + i] = 1e-3 * turned / (2.0 * small)
    return wrench


def with_tool(weight_N: float) -> Table:
    """110 poses of the bushing, 30 of them twice, with a tool on it."""
    random = np.random.default_rng(4)
    visits = np.r_[np.arange(110), np.arange(30)]
    poses = random.uniform(-1.0, 1.0, (110, 6)) * [2e-3, 4e-3, 4e-3, 0.16, 0.16, 0.16]
    turn, middle = (Rotation.from_rotvec(part * poses[:, 3:]) for part in (1.0, 0.5))
    axis, weight = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -weight_N])
    poses[:, :3] = middle.apply(poses[:, :3]) + 0.02 * (turn.apply(axis) + axis)
    pull = np.tile(weight, (110, 1)), np.cross(turn.apply([0.035, 0.0, 0.006]), weight)
    true = (bushing(poses) - np.hstack(pull))[visits]
    read = true + np.repeat([0.6, 0.012], 3) * random.standard_normal((140, 6))
    seen = poses[visits] + np.repeat([3e-5, 3.5e-4], 3) * random.standard_normal((140, 6))
    rig = Instrument(
        pose_position_sd_m=3e-5, pose_rotation_sd_rad=3.5e-4, force_sd_N=0.6, torque_sd_Nm=0.012
    )
    columns = columns_of(seen, read) | {"pose_id": visits.astype(float)}
    down = Scene(gravity_m_s2=(0.0, 0.0, -9.81))
    meta = Meta(mechanism={"length_m": 0.04}, instrument=rig, scene=down)
    return as_table(columns, meta=meta)


def test_a_weight_is_named_before_symmetry_is_given_up() -> None:
    """An energy without symmetry takes in the weight; one of revolution and a weight leave less."""
    table = with_tool(9.0)
    found = diagnose(fit_model(table, "energy4-general", force=True), table)
    assert "payload" in found.answer[0]


def test_unlike_ends_are_no_moved_origin_alone() -> None:
    """By the noise of their own poses, positions from 7 mm away leave more than half of what names
    leave, and are not said; unlike ends leave no more than noise."""
    table = with_tool(0.0)
    found = diagnose(fit_model(table, "energy6-revolution", force=True), table)
    assert found.verdict == "none", found.sentence()
    assert any("the ends of the body differ" in text for text in found.warnings)
    assert not any("the positions look measured from" in text for text in found.warnings)
