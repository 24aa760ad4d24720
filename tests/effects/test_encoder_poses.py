"""Effects of the arm where poses come from its joints; the truth is MuJoCo's arm, not the fit's."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from ecm import _native
from ecm.diagnosis import diagnose
from ecm.effects import Missing, Rows, get_effect
from ecm.effects.registry import with_shape
from ecm.effects.robot import flange_from_top, top_jacobian
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import JOINT_SIGNS, JOINTS, POSE
from ecm.io.description import Meta
from ecm.io.se3 import compose
from ecm.io.table import Table
from ecm.rig import CampaignOptions, run_campaign
from support.campaigns import campaign, found_in, model, physics, workspace_poses
from support.neck import columns_of
from support.stand_in import L, StandIn, wrench

pytest.importorskip("mujoco", reason="mujoco is missing: pip install 'ecm-stiffness[robot]'")

from ecm.rig.arm.simulation import Simulation, scene
from support.arm_joints import joints_of
from support.arm_rig import plan, settings
from support.programs import need_program

YIELD_RAD_NM = 2e-5


@lru_cache(maxsize=1)
def simulation() -> Simulation:
    return Simulation(scene(settings(), L), wrench)


def top_of(joints: F) -> tuple[F, F]:
    """(N, 6) poses and (N, 6, 7) Jacobians in base axes of MuJoCo's site `top`."""
    sim = simulation()
    poses, jacobians = np.empty((len(joints), 6)), np.empty((len(joints), 6, 7))
    for i, q in enumerate(joints):
        sim.reset(q)
        poses[i], jacobians[i] = sim.pose, sim.jacobian
    return poses, jacobians


@lru_cache(maxsize=1)
def poses_and_joints() -> tuple[F, F]:
    """150 poses of the mechanism, each with another elbow."""
    poses = workspace_poses(150, 3)
    return poses, joints_of(poses, np.random.default_rng(0).uniform(-0.4, 0.4, 150))


def table_of(poses: F, joints: F) -> Table:
    columns = dict(zip((*POSE, *JOINTS), np.concatenate([poses, joints], axis=1).T, strict=True))
    return Table(columns, Meta(), "encoders")


# --- kinematics ---------------------------------------------------------------


def test_the_jacobian_is_that_of_mujocos_top_frame() -> None:
    """A tool turned, mirrored or of another length would show: the arm's own is 70 mm, x back."""
    poses, joints = poses_and_joints()
    tool = flange_from_top(table_of(poses, joints))
    assert not isinstance(tool, Missing)
    rotation = _native.rotation_matrices(np.ascontiguousarray(poses[:, 3:]))
    found = top_jacobian(joints, tool)
    step = 1e-6
    for j in range(7):
        (up, _), (down, _) = (top_of(joints + s * step * np.eye(7)[j]) for s in (1.0, -1.0))
        moved = np.einsum("nji,nj->ni", rotation, up[:, :3] - down[:, :3]) / (2.0 * step)
        ups, downs = (_native.rotation_matrices(np.ascontiguousarray(p[:, 3:])) for p in (up, down))
        turned = _native.rotation_vectors(np.ascontiguousarray(np.swapaxes(downs, 1, 2) @ ups))
        np.testing.assert_allclose(found[:, :3, j], moved, atol=1e-8)
        np.testing.assert_allclose(found[:, 3:, j], turned / (2.0 * step), atol=1e-8)


def test_foot_and_tool_of_another_rig_are_found_through_noise_and_bad_rows() -> None:
    poses, joints = poses_and_joints()
    own = flange_from_top(table_of(poses, joints))
    assert not isinstance(own, Missing)
    tool = np.array([0.02, -0.05, 0.11, 0.3, -0.9, 0.5])
    moved = compose(np.array([1.0, 2.0, -0.4, *(-2.0 * tool[3:])]), compose(poses, tool))
    random = np.random.default_rng(1)
    noisy = moved + random.standard_normal(moved.shape) * ([4e-5] * 3 + [4e-4] * 3)
    noisy[random.choice(len(noisy), 5, replace=False)] += [0.02, -0.01, 0.0, 0.2, 0.0, 0.1]
    found = flange_from_top(table_of(noisy, joints))
    assert not isinstance(found, Missing)
    expected = compose(own, tool)[0]
    np.testing.assert_allclose(found[:3], expected[:3], atol=3e-4)
    np.testing.assert_allclose(found[3:], expected[3:], atol=1e-3)


def test_joints_and_poses_that_do_not_tell_the_tool_are_refused() -> None:
    poses, joints = poses_and_joints()
    swapped = joints[:, [0, 1, 4, 3, 2, 5, 6]]
    shuffled = np.random.default_rng(2).permutation(joints)
    reversed_ = joints * [1.0, 1.0, 1.0, 1.0, 1.0, -1.0, 1.0]
    for wrong in (swapped, shuffled, reversed_):
        lacking = flange_from_top(table_of(poses, wrong))
        assert isinstance(lacking, Missing)
        assert "do not belong" in lacking.reason
    for turned_about in ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]):
        few = poses * [1.0, 1.0, 1.0, *turned_about]
        lacking = flange_from_top(table_of(few, joints_of(few, np.zeros(len(few)))))
        assert isinstance(lacking, Missing)
        assert "two axes" in lacking.record
    lacking = flange_from_top(table_of(poses[:5], joints[:5]))
    assert isinstance(lacking, Missing)
    assert "5 rows" in lacking.reason


def test_a_fitted_tool_is_kept_for_rows_that_could_not_tell_it() -> None:
    """A model file names the tool: one new row is predicted as among all."""
    table = encoders("", 4)
    effect = get_effect("joint_offset").variants(table)[0]
    values = np.full(7, 1e-3)
    whole = effect.correction(Rows(table, physics()), values)
    again = with_shape("joint_offset", effect.shape)
    one = again.correction(Rows(table.select(np.arange(3, 4)), physics()), values)
    np.testing.assert_allclose(one[0], whole[3], rtol=1e-12)
    with pytest.raises(InputError, match="do not determine the tool"):
        get_effect("joint_offset").correction(
            Rows(table.select(np.arange(3, 4)), physics()), values
        )
    with pytest.raises(InputError, match="theta_z_rad, found x_m"):
        with_shape("joint_offset", {"x_m": 0.0})


# --- diagnosis ----------------------------------------------------------------


def offset(joints: F) -> F:
    """Zeros that are off by a few tenths of a mrad, and a little more the farther it is turned."""
    zeros = 1e-3 * np.array([0.3, -0.4, 0.5, 0.6, -0.6, -0.4, 0.5])
    return joints - zeros * (1.0 + 0.1 * np.sin(joints))


def play(joints: F) -> F:
    """Each link trails in its play, and a small motion does not take it across."""
    width = 1e-4 * np.array([1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    trailing, found = np.zeros(7), joints.copy()
    for i in range(1, len(joints)):
        trailing = np.clip(trailing + joints[i] - joints[i - 1], -width, width)
        found[i] -= trailing
    return found


def yielding(joints: F, loaded: F, hardening: float) -> F:
    """Springs in balance with the mechanism's wrench at the pose that it holds."""
    at = joints.copy()
    for _ in range(16):
        poses, jacobian = top_of(at)
        torque = np.einsum("nij,ni->nj", jacobian, wrench(poses) * loaded[:, None])
        softer = 1.0 - hardening * np.abs(torque) / (20.0 + np.abs(torque))
        at = 0.5 * (at + joints - YIELD_RAD_NM * torque * softer)
    return at


@lru_cache(maxsize=8)
def encoders(hidden: str, seed: int) -> Table:
    """A campaign whose poses are those that the controller works out of its encoders."""
    table = campaign("", 1.0, 4).drop("leds_visible")
    random = np.random.default_rng(seed)
    joints = joints_of(table.poses, random.uniform(-0.4, 0.4, len(table)))
    loaded = np.asarray(table.text("kind") != "unloaded")
    true = {
        "": lambda: joints,
        "joint_offset": lambda: offset(joints),
        "backlash": lambda: play(joints),
        "robot_compliance": lambda: yielding(joints, loaded, 0.1),
    }[hidden]()
    read, _ = top_of(joints)
    at, _ = top_of(true)
    noise = random.standard_normal(at.shape) * ([0.3] * 3 + [0.01] * 3)
    wrenches = wrench(at) * loaded[:, None] + noise
    way = np.diff(joints, axis=0, prepend=joints[:1] - 1.0)
    columns = columns_of(read, wrenches)
    columns |= dict(zip(JOINTS, joints.T, strict=True))
    columns |= dict(zip(JOINT_SIGNS, np.sign(way).T, strict=True))
    return table.with_columns(columns)


def test_compliance_is_the_balance_of_arm_and_mechanism() -> None:
    """Two springs in series: their first order is off by a quarter and more."""
    table = encoders("", 4).measured()
    table = table.select(np.arange(0, len(table), 5))
    joints = table.matrix(JOINTS)
    rigid = wrench(top_of(joints)[0])
    change = wrench(top_of(yielding(joints, np.ones(len(joints)), 0.0))[0]) - rigid
    effect = get_effect("robot_compliance").variants(encoders("", 4))[0]
    found = effect.correction(Rows(table, physics()), np.full(7, YIELD_RAD_NM))
    size = np.sqrt((change**2).mean(axis=0))
    assert np.all(np.sqrt(((found - change) ** 2).mean(axis=0)) < 0.12 * size)


@pytest.mark.parametrize("hidden", ["robot_compliance", "backlash", "joint_offset"])
def test_an_effect_of_the_joints_is_named(hidden: str) -> None:
    diagnosis = diagnose(model(), encoders(hidden, 4))
    assert found_in(diagnosis, hidden), diagnosis.sentence()


def test_the_simulated_arm_that_yields_is_named_from_its_own_encoders(tmp_path: Path) -> None:
    """The rig's joints hang behind, its poses are worked out of what the encoders say."""
    need_program("cc", "gcc")
    table = run_campaign(
        plan(workspace_poses(36, 3)),
        settings(joint_yield_rad_Nm=YIELD_RAD_NM, processes=1),
        None, options=CampaignOptions(source=StandIn(), folder=tmp_path),
    )  # fmt: skip
    read, _ = top_of(table.matrix(JOINTS))
    by_encoders = table.drop("leds_visible").with_columns(dict(zip(POSE, read.T, strict=True)))
    diagnosis = diagnose(model(), by_encoders)
    assert diagnosis.answer == (("robot_compliance",),), diagnosis.sentence()
    effect = diagnosis.effects[0]
    known = effect.sd < 2e-6
    assert known.sum() >= 2
    assert effect.values[known] == pytest.approx(YIELD_RAD_NM, rel=0.15)


def test_an_arm_without_faults_is_not_named() -> None:
    diagnosis = diagnose(model(), encoders("", 5))
    assert diagnosis.verdict == "none", diagnosis.sentence()
    listed = {item.id for item in diagnosis.not_testable}
    assert not listed & {"robot_compliance", "backlash", "joint_offset"}


def test_poses_of_the_camera_tell_nothing_of_the_encoders() -> None:
    table = encoders("", 4).with_columns({"leds_visible": np.full(len(encoders("", 4)), 8.0)})
    for id in ("robot_compliance", "backlash", "joint_offset"):
        lacking = get_effect(id).missing(table)
        assert lacking is not None
        assert lacking.record == "poses from the encoders"
