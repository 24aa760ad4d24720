"""The arm with a driven mechanism: it gives way until nothing pushes it, then perturbs it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import JOINTS, POSE
from ecm.io.se3 import displaced
from ecm.io.table import Table
from ecm.rig import RigSettings
from support.driven import PRESSURES, SMALL_RIG, DrivenArm, arm_model, arm_plan

pytest.importorskip("mujoco", reason="mujoco is missing: pip install 'ecm-stiffness[robot]'")

from ecm.rig.arm.campaign import RobotCampaign
from ecm.rig.arm.mechanism import controller_document, fit_surrogate
from support.programs import need_program

FREE_N = 0.02
REST = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])


def campaign(cache_of: Path, plan: Table, **plant: float) -> RobotCampaign:
    """Of a quick arm on the small rig."""
    need_program("cc", "gcc")
    rig = {"mode": "robot", "speed_rad_s": 0.6, "speed_m_s": 0.08, "free_N": FREE_N}
    settings = {**SMALL_RIG, "rig": rig, "plant": SMALL_RIG["plant"] | plant}
    return RobotCampaign(
        plan, RigSettings.from_dict(settings), DrivenArm(), seed=3, folder=cache_of
    )


@cache
def short_plan(count: int = 3, *, offsets: bool = True) -> Table:
    """Some poses, each twice, with short rests."""
    plan = arm_plan(count, offsets=offsets)
    return plan.with_columns({"dwell_s": np.full(len(plan), 0.2)})


def followed(of: RobotCampaign) -> tuple[F, F]:
    """True poses (n, 6) at the end of each phase follow, and what the regulators were set to."""
    poses, inputs = [], []
    for stop in of.stops:
        ends = [end for name, _, end in stop.phases if name == "follow"]
        if ends:
            poses.append(stop.trace[np.searchsorted(stop.trace_s, ends[0]) - 1])
            inputs.append(of.planned.visits[stop.visit].pose[6:])
    return np.stack(poses), np.stack(inputs)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("arm")


def test_the_arm_follows_the_mechanism_and_goes_on_by_the_offset(folder: Path) -> None:
    driven = campaign(folder, short_plan(8))
    table = driven.run(threads=1)
    # A passive energy of degree 6 fits what the pushes err, and throws the arm off some ways.
    assert [stop.reason for stop in driven.stops] == [""] * 16
    poses, inputs = followed(driven)
    own = [v.approach == "initial" for v in driven.visits if v.kind == "pose"]
    assert len(poses) == sum(own) < len(own) == 16
    # Its own mechanism is an energy fitted to FEM: what that errs is left of the wrench.
    left = np.abs(arm_model().predict(poses, inputs)).max(axis=0)
    floor = FREE_N * np.repeat([1.0, 0.033], 3)
    assert (left < 3.0 * floor + 5.0 * driven.mechanism.rms).all()
    at_rest = np.abs(arm_model().predict(np.tile(REST, (len(inputs), 1)), inputs)).max(axis=0)
    assert at_rest[0] > 5.0 * left[0]
    assert (at_rest[4:] > 1.5 * left[4:]).all()
    for stop in driven.stops:
        visit = driven.planned.visits[stop.visit]
        np.testing.assert_allclose(stop.reached, stop.goal, atol=1e-5)
        away = np.abs(stop.reached - visit.pose[:6])
        assert (away < np.repeat([1e-3, 0.015], 3)).all()
    assert table.actuation_columns == PRESSURES
    assert table.has(*JOINTS)
    rows = table.measured()
    off = arm_model().predict(rows.poses, rows.matrix(PRESSURES)) - rows.wrenches
    # Along the axis 37 um of the camera are 0.12 N, of a spread of 0.6 N.
    assert (off.std(axis=0) < 0.25 * rows.wrenches.std(axis=0)).all()
    assert driven.record()["reached"] == 16


def test_it_follows_what_acts_and_not_what_was_set(folder: Path) -> None:
    quiet, off = (campaign(folder, short_plan(), **p) for p in ({}, {"regulator_offset_Pa": 3e3}))
    ends = []
    for one in (quiet, off):
        one.drive(threads=1)
        ends.append(followed(one)[0])
    found = ends[1] - ends[0]
    free = [
        np.stack([arm_model().free_pose(row)[0] for row in followed(quiet)[1] + more])
        for more in (0.0, 3e3)
    ]
    np.testing.assert_allclose(found[:, 0], (free[1] - free[0])[:, 0], atol=3e-5)
    assert (found[:, 0] > 3e-5).all()


def test_without_offsets_it_drives_to_the_poses_of_the_plan(folder: Path) -> None:
    plan = short_plan(offsets=False)
    straight = campaign(folder, plan)
    rows = straight.run(threads=1).measured()
    assert len(rows) == 6
    assert not any(name == "follow" for stop in straight.stops for name, *_ in stop.phases)
    measured = plan.select(np.flatnonzero(plan.text("action") == "measure"))
    assert np.abs(rows.poses[:, :3] - measured.matrix(POSE)[:, :3]).max() < 2e-3


def test_a_controller_that_takes_inputs_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "arm.json"
    arm_model().save(path)
    with pytest.raises(InputError, match="it takes the inputs of actuators"):
        controller_document(str(path), np.zeros((1, 6)), np.zeros((1, 6)), 0.1)


def test_the_arms_own_mechanism_takes_the_inputs() -> None:
    """A passive energy, and of each actuator the energy whose wrench its input multiplies."""
    source = DrivenArm()
    inputs = np.random.default_rng(0).uniform(0.0, 2e4, (80, 3))
    random = np.random.default_rng(1).uniform(-1.0, 1.0, (80, 6))
    free = source.free_poses(inputs).poses
    moved = displaced(free[:, :6], random * np.repeat([2e-3, 0.1], 3))
    solved = source.solve(np.hstack([moved, inputs]), "plain")
    own = fit_surrogate(solved.poses[:60], solved.wrenches[:60], 0.1, solved.stiffness[:60, :, 6:])
    left = own.wrench()(solved.poses[60:]) - solved.wrenches[60:]
    spread = solved.wrenches[60:].std(axis=0)
    assert (left.std(axis=0) < 0.05 * spread).all()
    passive = own.model().predict(np.ascontiguousarray(solved.poses[60:, :6]))
    without = (passive - solved.wrenches[60:]).std(axis=0)
    assert (without > 3.0 * left.std(axis=0)).all()
