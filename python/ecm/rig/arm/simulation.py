"""Arm and mechanism at 1 kHz: MuJoCo moves the arm, by servos and an impedance.

tau = k (q_d + e - q) + d (q_d' - q') + J' h_model(p),    e' = (q_d - q) / T

The integrator e removes the error of the feed-forward's model. q is what the encoders read: if
joints yield ([rig] joint_yield_rad_Nm), the true angles lag behind by the yield times J'h.

Backward Euler of spring and damper over one step is the spring at the present position with the
damper d + dt k at the end of the step; MuJoCo's Euler integrator treats joint damping so.

tau = J'(K e - D v) + tau_null,   e = (r_d - r, log(R_d R')) in base axes, v = J q'

The damping D gives every mode of arm and mechanism the damping ratio zeta. With
Lambda = (J M^-1 J')^-1 and K_all = K + K_mechanism, the latter by the controller's model,

    Lambda^-1 = L L',  L' K_all L = Q diag(w^2) Q',  D = 2 zeta L'^-1 Q diag(w) Q' L^-1.

The null space of J is one direction n; tau_null = M n a holds the elbow and does not accelerate the
top, J M^-1 tau_null = 0.

At every step the pose p of the site `top` gives the wrench h(p) on the mechanism, and the arm feels
the generalised force -J'h. The mechanism is integrated explicitly: treating its linear part K
implicitly would add dt^2 K to the inertia at the top, 25 g at 25 kN/m and 1 ms, which is small
against the arm's kilogrammes: the fastest mode has dt w = 0.05, the limit is 2. The joint servo,
which is stiff, is implicit.

The arm: a KUKA LWR 4+, its kinematics in closed form, and its scene, `lwr4.xml` (MJCF).

    base_from_flange = Tz(d1) Rz(q1) Ry(-q2) Rz(q3) Tz(d3) Ry(q4)
                       Rz(q5) Tz(d5) Ry(-q6) Rz(q7) Tz(d7)

Seven joints place the flange in a pose with the elbow anywhere on a circle. The swivel angle psi
turns the elbow about the line from shoulder to wrist; psi = 0 is straight up. Shoulder, elbow and
wrist have two solutions each; those of a reference configuration are taken, so that a path never
jumps.

The world of the scene is the base frame of the mechanism, the arm stands beside it. The mechanism
itself is no body: it acts as a wrench on the site `top`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from ecm.errors import EcmError
from ecm.io.arrays import F
from ecm.io.extras import require
from ecm.rig.arm.mechanism import ControllerModel
from ecm.rig.settings import ArmSettings, RigSettings

SHOULDER_M, UPPER_M, FOREARM_M, FLANGE_M = 0.3105, 0.400, 0.390, 0.078
"""d1, d3, d5, d7."""
TOOL_M = 0.020 + 0.040 + 0.010
"""From the flange to the top frame: adapter, sensor, target plate."""
_RIM_M = 0.055
"""Radius of the target plate."""

RANGE_RAD: F = np.deg2rad([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 170.0])
TORQUE_NM: F = np.array([176.0, 176.0, 100.0, 100.0, 100.0, 38.0, 38.0])
SPEED_RAD_S: F = np.deg2rad([110.0, 110.0, 128.0, 128.0, 204.0, 184.0, 184.0])
"""Limits of the joints by the maker's data sheet."""

HOME_RAD: F = np.deg2rad([0.0, -30.0, 0.0, 85.0, 0.0, -65.0, 0.0])
"""Flange straight down; arm far from stretched and from all limits for tilts up to 45 degrees."""

_SHOULDER: F = np.array([0.0, 0.0, SHOULDER_M])
_UP: F = np.array([0.0, 0.0, 1.0])
_SWIVEL_OFFSETS_RAD: F = np.deg2rad(sorted(range(-60, 61, 5), key=abs))


def rotation_z(angle: float) -> F:
    """Rotation matrix about z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_y(angle: float) -> F:
    """Rotation matrix about y."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _arm_axes(joints_rad: F) -> tuple[F, F]:
    """Axes (3, 3) of the upper arm and of the forearm in the axes of the arm's foot."""
    upper = rotation_z(joints_rad[0]) @ rotation_y(-joints_rad[1]) @ rotation_z(joints_rad[2])
    return upper, upper @ rotation_y(joints_rad[3])


def flange_pose(joints_rad: F) -> tuple[F, F]:
    """Position (3,) and axes (3, 3) of the flange in the axes of the arm's foot."""
    upper, forearm = _arm_axes(joints_rad)
    lower = forearm @ rotation_z(joints_rad[4])
    hand = lower @ rotation_y(-joints_rad[5]) @ rotation_z(joints_rad[6])
    position = _SHOULDER + UPPER_M * upper[:, 2] + FOREARM_M * lower[:, 2] + FLANGE_M * hand[:, 2]
    return position, hand


def swivel_angle(joints_rad: F) -> float:
    """Swivel angle psi of a configuration, rad."""
    upper, forearm = _arm_axes(joints_rad)
    _, e1, e2 = _elbow_circle(UPPER_M * upper[:, 2] + FOREARM_M * forearm[:, 2])
    return math.atan2(float(upper[:, 2] @ e2), float(upper[:, 2] @ e1))


@dataclass(frozen=True)
class Solution:
    """Joint angles for a pose, or the reason why there are none."""

    joints_rad: F
    reason: str = ""


def joints_at_swivel(position: F, axes: F, psi: float, near_rad: F) -> Solution:
    """Joint angles (7,) for a flange pose and a swivel angle, with the signs of `near_rad`."""
    to_wrist = position - FLANGE_M * axes[:, 2] - _SHOULDER
    distance = float(np.linalg.norm(to_wrist))
    longest = UPPER_M + FOREARM_M
    c4 = (distance**2 - UPPER_M**2 - FOREARM_M**2) / (2.0 * UPPER_M * FOREARM_M)
    if not -1.0 < c4 < 1.0:
        return Solution(
            near_rad,
            f"the wrist would be {distance:.3f} m from the shoulder; the arm has {longest:g}",
        )
    q4 = math.copysign(math.acos(c4), near_rad[3])
    along, e1, e2 = _elbow_circle(to_wrist)
    cos_b = (UPPER_M**2 + distance**2 - FOREARM_M**2) / (2.0 * UPPER_M * distance)
    sin_b = math.sqrt(max(0.0, 1.0 - cos_b**2))
    upper = cos_b * along + sin_b * (math.cos(psi) * e1 + math.sin(psi) * e2)
    s2 = math.copysign(math.hypot(upper[0], upper[1]), near_rad[1] or -1.0)
    q2 = math.atan2(s2, upper[2])
    q1 = math.atan2(-upper[1] / s2, -upper[0] / s2) if abs(s2) > 1e-9 else float(near_rad[0])
    shoulder = rotation_z(q1) @ rotation_y(-q2)
    forearm = shoulder.T @ (to_wrist - UPPER_M * upper)
    q3 = math.atan2(forearm[1] * np.sign(q4), forearm[0] * np.sign(q4))
    hand = (shoulder @ rotation_z(q3) @ rotation_y(q4)).T @ axes
    sign = math.copysign(1.0, near_rad[5])
    s6 = sign * math.hypot(hand[0, 2], hand[1, 2])
    q6 = math.atan2(s6, hand[2, 2])
    q5 = math.atan2(-hand[1, 2] * sign, -hand[0, 2] * sign)
    q7 = math.atan2(-hand[2, 1] * sign, hand[2, 0] * sign)
    joints = np.array([q1, q2, q3, q4, q5, q6, q7])
    # Add full turns so that each angle is the nearest to the reference: ranges are below one turn.
    joints += 2.0 * np.pi * np.round((near_rad - joints) / (2.0 * np.pi))
    return Solution(joints)


def inverse_kinematics(
    position: F, axes: F, psi: float, near_rad: F, margin_rad: float
) -> Solution:
    """Joint angles for a flange pose at the swivel angle nearest to `psi` that fits all ranges.

    The solution has a reason where no swivel angle within 60 degrees fits.
    """
    allowed = RANGE_RAD - margin_rad
    first = Solution(near_rad)
    for i, offset in enumerate(_SWIVEL_OFFSETS_RAD):
        solution = joints_at_swivel(position, axes, psi + float(offset), near_rad)
        excess = np.abs(solution.joints_rad) - allowed
        if not solution.reason and np.all(excess <= 0.0):
            return solution
        if i == 0:
            worst = int(np.argmax(excess))
            first = Solution(
                solution.joints_rad,
                solution.reason
                or f"joint {worst + 1} would be at {math.degrees(solution.joints_rad[worst]):.1f} "
                f"degrees, its range leaves {math.degrees(allowed[worst]):.1f}",
            )
    return first


def _elbow_circle(to_wrist: F) -> tuple[F, F, F]:
    """Unit vectors: along the line from shoulder to wrist, up, and sideways."""
    along = to_wrist / np.linalg.norm(to_wrist)
    up = _UP - (_UP @ along) * along
    size = float(np.linalg.norm(up))
    if size < 1e-9:  # the arm points straight up: any direction will do
        up, size = np.array([1.0, 0.0, 0.0]) - along[0] * along, 1.0
    e1 = up / size
    return along, e1, np.cross(along, e1)


_TOP_FROM_TOOL: F = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Axes of the flange in the top frame: its z points down the mechanism."""
_WORLD_FROM_FOOT: F = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
"""Axes of the arm's foot in the world: x is up, the arm extends along z."""


def mujoco() -> Any:
    """Return the module mujoco; MissingExtra if it is not installed."""
    return require("mujoco", "robot", '[rig] mode = "robot"')


@dataclass(frozen=True)
class Scene:
    """MJCF of the scene, the home configuration, and the place of the arm."""

    text: str
    home_rad: F
    foot_m: F
    """Origin of the arm's foot in the world, (3,)."""
    friction: float
    """Share of the published joint friction that acts."""

    def flange_goal(self, top_m: F, top_axes: F) -> tuple[F, F]:
        """Flange position and axes in the foot's axes for a top frame in the world."""
        axes = top_axes @ _TOP_FROM_TOOL
        position = top_m - TOOL_M * axes[:, 2]
        return _WORLD_FROM_FOOT.T @ (position - self.foot_m), _WORLD_FROM_FOOT.T @ axes


def scene(settings: RigSettings, length_m: float) -> Scene:
    """Place the arm with its flange over the undeformed mechanism and the elbow as chosen."""
    arm, table = settings.arm, settings.plant
    position, axes = flange_pose(HOME_RAD)
    psi = swivel_angle(HOME_RAD) + arm.elbow_rad
    home = inverse_kinematics(position, axes, psi, HOME_RAD, arm.joint_margin_rad)
    top = np.array([length_m, 0.0, 0.0])
    foot: F = top - _WORLD_FROM_FOOT @ (position + TOOL_M * axes[:, 2])
    face = _RIM_M + arm.stop_m
    values = {
        "step_s": arm.step_s,
        "gravity": " ".join(map(repr, table.gravity_m_s2)),
        "x": float(foot[0]),
        "x_up": float(foot[0]) + 0.11,
        "z": float(foot[2]),
        "payload_kg": table.payload_mass_kg,
        "payload_centre": " ".join(map(repr, table.payload_centre_m)),
        "payload_inertia": table.payload_mass_kg * 0.02**2,
        # The face of a wall at the distance stop_m from the rim of the target plate.
        "wall": f'<geom name="stop" class="touch" type="box" size="0.03 0.01 0.06" '
        f'pos="{length_m!r} {face + 0.01!r} 0" rgba="0.8 0.2 0.2 1"/>'
        if arm.stop_m > 0.0
        else "",
    }
    text = Template((files(__package__) / "lwr4.xml").read_text(encoding="utf-8"))
    return Scene(text.substitute(values), home.joints_rad, foot, arm.joint_friction)


_INTEGRATOR_S = 0.1


class Servo:
    """The controller; between `engage` and `release` its dampers are in the simulation."""

    def __init__(self, arm: ArmSettings, simulation: Simulation, model: ControllerModel) -> None:
        self._simulation = simulation
        self._model = model
        self._feed_forward = arm.feed_forward
        inertia = np.array([simulation.times_inertia(row)[i] for i, row in enumerate(np.eye(7))])
        self._spring = arm.joint_stiffness_Nm_rad
        self._damper = 2.0 * arm.joint_damping_ratio * np.sqrt(self._spring * inertia)
        self._integral: F = np.zeros(7)
        self._engaged = False
        self._gain = simulation.step_s / _INTEGRATOR_S
        self._implicit = self._damper + simulation.step_s * self._spring
        self._joint_damping: F = simulation.model.dof_damping.copy()
        self._yield = arm.joint_yield_rad_Nm

    def engage(self) -> None:
        """Add the dampers to the simulation; the integrator is reset if they were out."""
        if not self._engaged:
            self._integral[:] = 0.0
        self._engaged = True
        self._simulation.model.dof_damping[:] = self._joint_damping + self._implicit

    def release(self) -> None:
        """Remove the dampers."""
        self._engaged = False
        self._simulation.model.dof_damping[:] = self._joint_damping

    def torque(self, joints_rad: F, speeds_rad_s: F) -> F:
        """Joint torques (7,) towards the target at the end of this step, without the dampers."""
        error = joints_rad - self.encoders_rad()
        self._integral += self._gain * error
        torque: F = self._spring * (error + self._integral)
        torque += self._damper * speeds_rad_s
        if self._feed_forward:
            self._model.evaluate(self.pose())
            torque += self._simulation.jacobian_T.dot(self._model.wrench)
        return torque

    def encoders_rad(self) -> F:
        """Joint angles (7,) that the encoders read."""
        joints = self._simulation.joints_rad
        if not self._yield:
            return joints
        load: F = self._simulation.jacobian_T.dot(self._simulation.wrench)
        return joints + self._yield * load

    def pose(self) -> F:
        """Pose (6,) of the top frame by the encoders."""
        simulation = self._simulation
        if not self._yield:
            return simulation.pose
        return simulation.pose_after(self.encoders_rad() - simulation.joints_rad)

    def damper_torque_Nm(self) -> F:
        """Torque (7,) of the implicit dampers."""
        return self._implicit * self._simulation.speeds_rad_s


class Impedance:
    """The controller; call `design` every ten steps, `torque` at every step."""

    def __init__(self, arm: ArmSettings, simulation: Simulation, model: ControllerModel) -> None:
        self._simulation = simulation
        self._model = model
        self._arm = arm
        self.stiffness: F = np.repeat([arm.impedance_N_m, arm.impedance_Nm_rad], 3)
        self.damping: F = np.zeros((6, 6))
        self._null: F = np.zeros(7)
        self._null_torque: F = np.zeros(7)
        self._null_inertia = 1.0
        self._error: F = np.zeros(6)
        self._shift, self._rotation = self._error[:3], self._error[3:]
        self._inverse: F = np.zeros(4)
        self._relative: F = np.zeros(4)

    def design(self) -> None:
        """Compute damping and null space in the present configuration."""
        simulation = self._simulation
        self._model.evaluate(simulation.pose)
        elastic = 0.5 * (self._model.stiffness + self._model.stiffness.T)
        elastic[np.diag_indices(6)] += self.stiffness
        factor = np.linalg.cholesky(simulation.compliance())
        squares, modes = np.linalg.eigh(factor.T @ elastic @ factor)
        half = np.linalg.solve(factor.T, modes)
        rates = np.sqrt(np.maximum(squares, 0.0))
        self.damping = 2.0 * self._arm.damping_ratio * (half * rates) @ half.T
        self._null = null_direction(simulation.jacobian)
        self._null_torque = simulation.times_inertia(self._null)
        self._null_inertia = float(self._null @ self._null_torque)

    def torque(self, position_m: F, quaternion: F) -> F:
        """Joint torques (7,) towards a target position and orientation (w, x, y, z)."""
        simulation = self._simulation
        library = simulation.library
        np.subtract(position_m, simulation.position, out=self._shift)
        library.mju_negQuat(self._inverse, simulation.quaternion)
        library.mju_mulQuat(self._relative, quaternion, self._inverse)
        library.mju_quat2Vel(self._rotation, self._relative, 1.0)
        velocity = simulation.jacobian.dot(simulation.speeds_rad_s)
        wrench = self.stiffness * self._error - self.damping.dot(velocity)
        arm, null = self._arm, self._null
        angle = float(null.dot(simulation.home_rad - simulation.joints_rad))
        rate = float(null.dot(simulation.speeds_rad_s))
        damper = 2.0 * arm.damping_ratio * (arm.nullspace_Nm_rad * self._null_inertia) ** 0.5
        acceleration = (arm.nullspace_Nm_rad * angle - damper * rate) / self._null_inertia
        return np.asarray(simulation.jacobian_T.dot(wrench) + acceleration * self._null_torque)


def null_direction(jacobian: F) -> F:
    """Unit vector n (7,) with J n = 0."""
    return np.asarray(np.linalg.svd(jacobian)[2][6])


_DIVERGED_NM2 = 1e12
"""Square of a joint torque that only a diverged simulation has."""


class Diverged(Exception):
    """A torque is NaN or too large; MuJoCo itself would continue from an arbitrary state."""


class Simulation:
    """State of the simulation; the arrays are views into MuJoCo's own, valid between steps."""

    def __init__(self, scene: Scene, mechanism: Callable[[F], F], actuators: int = 0) -> None:
        self.library = mujoco()
        self.model: Any = self.library.MjModel.from_xml_string(scene.text)
        self.model.dof_damping *= scene.friction
        self.model.dof_frictionloss *= scene.friction
        self.data: Any = self.library.MjData(self.model)
        self.mechanism = mechanism
        """Function from pose, with the actuators' inputs after it, (1, 6 + m) to h (1, 6)."""
        self.home_rad = scene.home_rad
        self.joints_rad: F = self.data.qpos
        self.speeds_rad_s: F = self.data.qvel
        self.applied_Nm: F = self.data.qfrc_applied
        self.gravity_Nm: F = self.data.qfrc_gravcomp
        self.jacobian: F = np.zeros((6, 7))
        self.jacobian_T = self.jacobian.T
        self._linear, self._angular = self.jacobian[:3], self.jacobian[3:]
        self.quaternion: F = np.zeros(4)
        """Orientation of the top frame, w x y z."""
        self._row: F = np.zeros((1, 6 + actuators))
        self.pose, self.inputs = self._row[0, :6], self._row[0, 6:]
        self.position, self._rotation = self.pose[:3], self.pose[3:]
        self._site_position: F = self.data.site_xpos[0]
        self._site_axes: F = self.data.site_xmat[0]
        self.wrench: F = np.zeros(6)
        """Wrench (6,) that the arm exerts on the mechanism, the extra wrench included."""
        self._extra_wrench: F = np.zeros(6)
        self._extra_rate: F | None = None
        self.steps = 0
        self.step_s = float(self.model.opt.timestep)
        self.reset()

    @property
    def time_s(self) -> float:
        """Time since the last reset."""
        return self.steps * self.step_s

    def reset(self, joints_rad: F | None = None) -> None:
        """Put the arm at rest in a configuration (7,), by default at home."""
        self.library.mj_resetData(self.model, self.data)
        self.joints_rad[:] = self.home_rad if joints_rad is None else joints_rad
        self.steps = 0
        self.inputs[:] = 0.0
        self._extra_wrench[:] = 0.0
        self._extra_rate = None
        self.update()

    def update(self) -> None:
        """Compute pose, Jacobian, wrench, inertia and Coriolis terms of the present state."""
        library, model, data = self.library, self.model, self.data
        library.mj_step1(model, data)
        library.mj_jacSite(model, data, self._linear, self._angular, 0)
        library.mju_mat2Quat(self.quaternion, self._site_axes)
        library.mju_quat2Vel(self._rotation, self.quaternion, 1.0)
        self.position[:] = self._site_position
        try:
            self.wrench = self.mechanism(self._row)[0]
        except EcmError:
            if np.isfinite(self._row).all():
                raise
            raise Diverged from None
        if self._extra_rate is not None:
            self.wrench = self.wrench + self._extra_wrench

    def advance(self, torque_Nm: F) -> None:
        """Simulate one step under joint torques (7,); the mechanism's J'h is subtracted."""
        np.subtract(torque_Nm, self.jacobian_T.dot(self.wrench), out=self.applied_Nm)
        # True for NaN, too. MuJoCo itself would write a log into the working directory.
        if not self.applied_Nm.dot(self.applied_Nm) < _DIVERGED_NM2:
            raise Diverged
        self.library.mj_step2(self.model, self.data)
        self.steps += 1
        if self._extra_rate is not None:
            self._extra_wrench += self._extra_rate
        self.update()

    def pose_after(self, change_rad: F) -> F:
        """Pose (6,) after a small change of the joint angles (7,), to first order."""
        moved: F = np.zeros(6)
        shift = self.jacobian.dot(change_rad)
        moved[:3] = self.position + shift[:3]
        turned, turn = self.quaternion.copy(), self._site_axes.reshape(3, 3).T @ shift[3:]
        self.library.mju_quatIntegrate(turned, turn, 1.0)
        self.library.mju_quat2Vel(moved[3:], turned, 1.0)
        return moved

    def ramp_extra_wrench(self, wrench: F, steps: int) -> None:
        """Change the wrench (6,) that acts beyond elasticity linearly over a number of steps."""
        self._extra_rate = (wrench - self._extra_wrench) / steps

    def compliance(self) -> F:
        """J M^-1 J' (6, 6): the inverse of the inertia at the top."""
        solved: F = np.zeros((6, 7))
        self.library.mj_solveM(self.model, self.data, solved, self.jacobian)
        product: F = solved @ self.jacobian.T
        return np.asarray(0.5 * (product + product.T))

    def times_inertia(self, vector: F) -> F:
        """Product of the inertia matrix and a vector (7,)."""
        product: F = np.zeros(7)
        self.library.mj_mulM(self.model, self.data, product, vector)
        return product

    def contact_N(self) -> float:
        """Sum of the contact forces on the target plate, N."""
        total = 0.0
        force = np.zeros(6)
        for i in range(self.data.ncon):
            self.library.mj_contactForce(self.model, self.data, i, force)
            total += float(np.linalg.norm(force[:3]))
        return total
