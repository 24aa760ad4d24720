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
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ecm.errors import EcmError
from ecm.io.arrays import F
from ecm.rig.arm.kuka import Scene, mujoco
from ecm.rig.arm.mechanism import ControllerModel
from ecm.rig.settings import ArmSettings

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
            self._model.pose[:] = self.pose()
            self._model.evaluate()
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
            pose: F = simulation.pose
            return pose
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
        self._model.pose[:] = simulation.pose
        self._model.evaluate()
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
        torque: F = simulation.jacobian_T.dot(wrench) + acceleration * self._null_torque
        return torque


def null_direction(jacobian: F) -> F:
    """Unit vector n (7,) with J n = 0."""
    direction: F = np.linalg.svd(jacobian)[2][6]
    return direction


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
        """Function from pose, with the actuators' inputs behind it, (1, 6 + m) to h (1, 6)."""
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
        rotation, result = np.zeros(4), np.zeros(4)
        angle = float(np.linalg.norm(shift[3:]))
        axis = shift[3:] / angle if angle > 0.0 else np.array([1.0, 0.0, 0.0])
        self.library.mju_axisAngle2Quat(rotation, axis, angle)
        self.library.mju_mulQuat(result, rotation, self.quaternion)
        self.library.mju_quat2Vel(moved[3:], result, 1.0)
        return moved

    def ramp_extra_wrench(self, wrench: F, steps: int) -> None:
        """Change the wrench (6,) that acts beyond elasticity linearly over a number of steps."""
        self._extra_rate = (wrench - self._extra_wrench) / steps

    def compliance(self) -> F:
        """J M^-1 J' (6, 6): the inverse of the inertia at the top."""
        solved: F = np.zeros((6, 7))
        self.library.mj_solveM(self.model, self.data, solved, self.jacobian)
        product: F = solved @ self.jacobian.T
        symmetric: F = 0.5 * (product + product.T)
        return symmetric

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
