"""The arm: kinematics, dynamics against pinocchio, energy, and the model inside the loop."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ecm._native import EnergyEvaluator
from ecm.io.arrays import F
from ecm.rig.arm import simulation as arm
from ecm.rig.arm.mechanism import ControllerModel
from ecm.rig.arm.simulation import (
    Simulation,
    flange_pose,
    inverse_kinematics,
    joints_at_swivel,
    null_direction,
    scene,
    swivel_angle,
)
from ecm.rig.arm.trips import Stop, cubic_profile, duration_s
from support.arm_rig import library, mechanism, settings, simulated_arm
from support.stand_in import REST, L, some_poses, wrench


def simulation(step_s: float = 1e-3, payload_kg: float = 0.0) -> Simulation:
    rig = settings(step_s=step_s)
    rig = type(rig).from_dict(rig.to_dict() | {"plant": {"payload_mass_kg": payload_kg}})
    return Simulation(scene(rig, L), mechanism().model().predict)


def near_home(count: int, size: float, seed: int = 0) -> F:
    random = np.random.default_rng(seed)
    home = scene(settings(), L).home_rad
    joints: F = home + random.uniform(-size, size, (count, 7))
    return joints


# --- kinematics ---------------------------------------------------------------


def test_at_home_the_top_frame_is_the_mechanisms() -> None:
    assert simulation().pose == pytest.approx(REST, abs=1e-12)


def test_the_flange_is_where_mujoco_has_it() -> None:
    sim = simulation()
    place = scene(settings(), L)
    for joints in near_home(50, 1.0):
        sim.reset(joints)
        axes = sim.data.site_xmat[0].reshape(3, 3)
        wanted = place.flange_goal(sim.data.site_xpos[0], axes)
        position, turn = flange_pose(joints)
        assert position == pytest.approx(wanted[0], abs=1e-12)
        assert turn == pytest.approx(wanted[1], abs=1e-12)


def test_inverse_kinematics_finds_the_joints_back() -> None:
    for joints in near_home(300, 0.4, seed=1):
        position, axes = flange_pose(joints)
        found = joints_at_swivel(position, axes, swivel_angle(joints), near_home(1, 0.0)[0])
        assert found.joints_rad == pytest.approx(joints, abs=1e-9)


def test_the_chosen_elbow_is_kept_and_the_pose_too() -> None:
    joints = near_home(1, 0.1, seed=2)[0]
    position, axes = flange_pose(joints)
    for psi in (-0.6, 0.2, 0.7):
        found = inverse_kinematics(position, axes, psi, joints, 0.035)
        assert swivel_angle(found.joints_rad) == pytest.approx(psi, abs=1e-9)
        again = flange_pose(found.joints_rad)
        assert again[0] == pytest.approx(position, abs=1e-12)
        assert again[1] == pytest.approx(axes, abs=1e-12)


def test_another_elbow_is_taken_where_the_chosen_one_leaves_a_joint_no_room() -> None:
    home = near_home(1, 0.0)[0]
    position, axes = flange_pose(home)
    margin = float(arm.RANGE_RAD[1] - abs(home[1])) - 0.02
    wanted = inverse_kinematics(position, axes, swivel_angle(home), home, 0.035).joints_rad
    assert wanted == pytest.approx(home, abs=1e-9)
    narrow = inverse_kinematics(position, axes, swivel_angle(home), home, margin)
    assert (
        "joint" in narrow.reason or abs(swivel_angle(narrow.joints_rad) - swivel_angle(home)) > 0.05
    )


def test_out_of_reach_says_how_far() -> None:
    home = near_home(1, 0.0)[0]
    _, axes = flange_pose(home)
    found = inverse_kinematics(np.array([1.5, 0.0, 0.3]), axes, 0.0, home, 0.035)
    assert "m from the shoulder; the arm has 0.79" in found.reason


def test_the_null_direction_moves_nothing() -> None:
    sim = simulation()
    for joints in near_home(20, 0.4, seed=3):
        sim.reset(joints)
        assert sim.jacobian @ null_direction(sim.jacobian) == pytest.approx(np.zeros(6), abs=1e-12)


def test_the_cubic_law_rests_at_both_ends_and_peaks_at_the_given_speed() -> None:
    duration = duration_s(0.03, 0.02)
    share, rate = cubic_profile(duration, 1e-3)
    assert share[-1] == 1.0
    assert 0.03 * rate.max() == pytest.approx(0.02, rel=1e-3)
    assert rate[-1] == 0.0
    assert rate == pytest.approx(np.gradient(np.r_[0.0, share], 1e-3)[1:], abs=5e-3)


# --- dynamics -------------------------------------------------------------------


# The published figures, link by link; docs/robot.md names the publications.
MASS_KG = (4.195, 4.300, 3.659, 2.385, 1.704, 0.400, 0.650)
ROTOR_KG_M2 = (3.19, 3.05, 1.98, 2.05, 0.787, 0.391, 0.394)
AXES = ((0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1))
ORIGINS_M = (0.1105, 0.2, 0.2, 0.2, 0.2, 0.19, 0.0)
"""Height of each body's frame above the one before."""
CENTRES_M = (
    (-0.0216, 0.0100, -0.0377),
    (0.0003, -0.0041, 0.0824),
    (0.0003, 0.1137, -0.0001),
    (-0.0015, 0.0000, 0.1486),
    (-0.0004, -0.0554, -0.0101),
    (0.0021, 0.0586, -0.0448),
    (-0.0005, 0.0015, 0.0716),
)
"""In the Denavit-Hartenberg frame at the end of each link; y is along links 1, 3 and 5."""
QUARTERS = (1, 0, -1, 0, 1, 0, 0)
"""Quarter turns about x from the axes of the body to those of that frame."""
ENDS_M = (0.2, 0.0, 0.2, 0.0, 0.19, 0.0, 0.0)
"""Height of that frame above the body's own."""
LENGTHS_M = (0.2, 0.2, 0.2, 0.2, 0.19, 0.06, arm.FLANGE_M)
RADII_M = (0.06, 0.06, 0.06, 0.055, 0.05, 0.045, 0.035)
TOOL = ((0.045, 0.020, 0.25), (0.050, 0.040, 0.80), (0.055, 0.010, 0.20))
"""Radius, thickness in m and mass in kg of the cylinders under the flange."""


def of_body(turn: int) -> F:
    """(3, 3) from the axes of a Denavit-Hartenberg frame to those of its body."""
    return np.array([[1.0, 0.0, 0.0], [0.0, 1.0 - abs(turn), -turn], [0.0, turn, 1 - abs(turn)]])


def cylinder(mass: float, radius: float, length: float) -> F:
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    return np.diag([across, across, 0.5 * mass * radius**2])


def pinocchio_model(tensors: list[F] | None = None) -> object:
    """The same chain from the published figures alone, without the MJCF."""
    pin = pytest.importorskip("pinocchio", reason="pinocchio is missing: pip install pin")
    model = pin.Model()
    parent = 0
    for i in range(7):
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, ORIGINS_M[i]]))
        joint = pin.JointModelRevoluteUnaligned(np.array(AXES[i], dtype=float))
        parent = model.addJoint(parent, joint, place, f"joint{i + 1}")
        tensor = tensors[i] if tensors else cylinder(MASS_KG[i], RADII_M[i], LENGTHS_M[i])
        centre = of_body(QUARTERS[i]) @ CENTRES_M[i] + [0.0, 0.0, ENDS_M[i]]
        model.appendBodyToJoint(parent, pin.Inertia(MASS_KG[i], centre, tensor), pin.SE3.Identity())
    height = arm.FLANGE_M
    for radius, thick, mass in TOOL:
        inertia = pin.Inertia(mass, np.zeros(3), cylinder(mass, radius, thick))
        shift = pin.SE3(np.eye(3), np.array([0.0, 0.0, height + 0.5 * thick]))
        model.appendBodyToJoint(parent, inertia, shift)
        height += thick
    model.armature = np.array(ROTOR_KG_M2)
    # The foot stands with its z along the world's x, where gravity is -9.81.
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    return model


def test_inertia_bias_and_inverse_dynamics_agree_with_pinocchio() -> None:
    pin = pytest.importorskip("pinocchio", reason="pinocchio is missing: pip install pin")
    model = pinocchio_model()
    data = model.createData()  # type: ignore[attr-defined]
    sim = simulation()
    random = np.random.default_rng(4)
    worst = np.zeros(3)
    for joints in near_home(60, 0.5, seed=5):
        speeds, accelerations = random.uniform(-2.0, 2.0, (2, 7))
        sim.reset(joints)
        sim.speeds_rad_s[:] = speeds
        sim.update()
        inertia = np.stack([sim.times_inertia(row) for row in np.eye(7)])
        wanted = pin.crba(model, data, joints)
        wanted = np.triu(wanted) + np.triu(wanted, 1).T
        worst[0] = max(worst[0], np.abs(inertia - wanted).max())
        bias = pin.nonLinearEffects(model, data, joints, speeds)
        worst[1] = max(worst[1], np.abs(sim.data.qfrc_bias - bias).max())
        sim.data.qacc[:] = accelerations
        mujoco.mj_inverse(sim.model, sim.data)
        # MuJoCo's inverse counts the gravity compensation as given; pinocchio knows none.
        force = sim.data.qfrc_inverse + sim.gravity_Nm
        torque = pin.rnea(model, data, joints, speeds, accelerations)
        worst[2] = max(worst[2], np.abs(force - torque).max())
    assert worst.max() < 1e-8, worst


# xx yy zz xy xz yz in kg m2, in the frames of the centres of mass: Gaz, Flacco, De Luca, ICRA 2016,
# rounded. Figures of 0.01 and 0.05 are bounds of their search.
PUBLISHED_TENSORS = (
    (0.0100, 0.0019, 0.0100, 0.0100, 0.0100, 0.0100),
    (0.0474, 0.0500, 0.0016, 0.0000, 0.0001, -0.0009),
    (0.0470, 0.0008, 0.0500, -0.0003, 0.0000, -0.0006),
    (0.0124, 0.0073, 0.0100, 0.0000, -0.0005, -0.0005),
    (0.0063, 0.0012, 0.0071, -0.0002, 0.0000, -0.0050),
    (0.0005, 0.0000, 0.0035, 0.0000, 0.0000, -0.0011),
    (0.0000, 0.0000, 0.0001, 0.0000, 0.0000, 0.0000),
)


def test_inertia_is_that_of_the_published_model_within_1_5_per_cent() -> None:
    pin = pytest.importorskip("pinocchio", reason="pinocchio is missing: pip install pin")
    tensors = []
    for (xx, yy, zz, xy, xz, yz), turn in zip(PUBLISHED_TENSORS, QUARTERS, strict=True):
        own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        axes = of_body(turn)
        tensors.append(axes @ own @ axes.T)
    ours, theirs = pinocchio_model(), pinocchio_model(tensors)
    worst = 0.0
    for joints in near_home(60, 0.8, seed=7):
        a, b = (
            pin.crba(model, model.createData(), joints)  # type: ignore[attr-defined]
            for model in (ours, theirs)
        )
        worst = max(worst, float(np.linalg.norm(np.triu(a - b)) / np.linalg.norm(np.triu(b))))
    assert worst < 0.015, worst


def test_gravity_is_compensated_with_the_payload_on() -> None:
    sim = simulation(payload_kg=1.5)
    free = Simulation(scene(settings(), L), np.zeros_like)
    for body in (sim, free):
        body.mechanism = np.zeros_like
        body.reset()
        for _ in range(500):
            body.advance(np.zeros(7))
        assert np.abs(body.joints_rad - body.home_rad).max() < 1e-12
    assert np.abs(sim.gravity_Nm).max() > 10.0


# --- mechanism and arm -----------------------------------------------------------


def swing(step_s: float, method: str) -> F:
    """Total energy over half a second of free swinging on the mechanism, nothing damped."""
    sim = simulation(step_s)
    body: EnergyEvaluator = mechanism().model()
    solution = inverse_kinematics(
        *scene(settings(), L).flange_goal(np.array([L - 0.002, 0.006, -0.004]), np.eye(3)),
        0.0, sim.home_rad, 0.035,
    )  # fmt: skip
    sim.reset(solution.joints_rad)

    def energy() -> float:
        kinetic = 0.5 * float(sim.speeds_rad_s @ sim.times_inertia(sim.speeds_rad_s))
        return kinetic + float(body.energy_J(sim.pose[None])[0])

    def rate(joints: F, speeds: F) -> F:
        sim.joints_rad[:], sim.speeds_rad_s[:] = joints, speeds
        sim.update()
        sim.applied_Nm[:] = -sim.jacobian_T.dot(sim.wrench)
        mujoco.mj_step2(sim.model, sim.data)  # for its acceleration; the state is set again
        return np.array(sim.data.qacc)

    levels = [energy()]
    for _ in range(round(0.5 / step_s)):
        if method == "loop":
            sim.advance(np.zeros(7))
        else:
            q, v, h = sim.joints_rad.copy(), sim.speeds_rad_s.copy(), step_s
            a1 = rate(q, v)
            a2 = rate(q + 0.5 * h * v, v + 0.5 * h * a1)
            a3 = rate(q + 0.5 * h * v + 0.25 * h * h * a1, v + 0.5 * h * a2)
            a4 = rate(q + h * v + 0.5 * h * h * a2, v + h * a3)
            sim.joints_rad[:] = q + h * v + h * h / 6.0 * (a1 + a2 + a3)
            sim.speeds_rad_s[:] = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            sim.update()
        levels.append(energy())
    return np.asarray(levels) / levels[0] - 1.0


def test_energy_is_conserved_with_the_mechanism_attached_and_damping_off() -> None:
    assert np.abs(swing(1e-3, "runge_kutta")).max() < 1e-7
    # The loop's own integrator is symplectic: its energy swings by the step, and does not drift.
    coarse, fine = swing(1e-3, "loop"), swing(5e-4, "loop")
    assert np.abs(coarse).max() < 0.05
    assert np.abs(fine).max() < 0.6 * np.abs(coarse).max()
    assert abs(coarse[-100:].mean() - coarse[:100].mean()) < 0.01


def stability_number(sim: Simulation, stiffness: F) -> float:
    """Time step times the fastest angular frequency; explicit integration needs less than 2."""
    symmetric = 0.5 * (stiffness + stiffness.T)
    fastest = np.linalg.eigvals(sim.compliance() @ symmetric).real.max()
    return sim.step_s * float(np.sqrt(max(fastest, 0.0)))


def test_explicit_steps_are_far_from_their_limit() -> None:
    sim = simulation()
    body: EnergyEvaluator = mechanism().model()
    for joints in near_home(20, 0.2, seed=6):
        sim.reset(joints)
        assert stability_number(sim, body.stiffness(REST[None])[0]) < 0.2


def test_the_loop_evaluates_the_exported_model() -> None:
    model = ControllerModel(library())
    poses = some_poses(80, seed=9)
    fitted = EnergyEvaluator.fit(
        poses, 0.97 * wrench(poses), length_m=L, degree=4, symmetry="alike"
    )
    for pose in some_poses(20, seed=10):
        model.evaluate(pose)
        near = fitted.predict(pose[None])[0]
        assert model.wrench == pytest.approx(near, rel=0.05, abs=0.5)
        step = np.zeros(6)
        step[1] = 1e-6
        model.evaluate(pose + step)
        up = model.wrench.copy()
        model.evaluate(pose - step)
        slope = (up - model.wrench) / 2e-6
        model.evaluate(pose)
        assert model.stiffness[:, 1] == pytest.approx(slope, rel=1e-5, abs=1e-4)


def test_impedance_alone_settles_where_both_springs_balance() -> None:
    control = simulated_arm()
    goal = REST + np.array([-0.006, 0.003, 0.0, 0.0, 0.0, 0.1])

    outcome = control.trip([Stop(0, goal, (), 0.1, 0.2)]).stops[0]
    assert outcome.reason == ""
    pose = outcome.after_impedance
    h = mechanism().model().predict(pose[None])[0]
    turn = np.array([0.0, 0.0, goal[5] - pose[5]])
    pull = np.r_[5000.0 * (goal[:3] - pose[:3]), 300.0 * turn]
    assert pull[:3] == pytest.approx(h[:3], abs=0.3)
    assert pull[5] == pytest.approx(h[5], abs=0.02)
    # 5 kN/m against 24 kN/m: about a sixth of the way along x.
    assert (pose[0] - L) / (goal[0] - L) == pytest.approx(5000.0 / 29000.0, abs=0.06)
