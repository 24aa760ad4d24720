"""Arm and mechanism at 1 kHz: MuJoCo moves the arm, the mechanism acts on it as a wrench.

At every step the pose p of the site `top` gives the wrench h(p) on the mechanism, and the arm feels
the generalised force -J'h. The mechanism is integrated explicitly: treating its linear part K
implicitly would add dt^2 K to the inertia at the top, 25 g at 25 kN/m and 1 ms, which is small
against the arm's kilogrammes. `stability_number` compares the fastest mode with the limit of 2.
The joint servo, which is stiff, is implicit (`servo.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ecm.errors import EcmError
from ecm.io.arrays import F
from ecm.rig.arm.scene import Scene, mujoco

_DIVERGED_NM2 = 1e12
"""Square of a joint torque that only a diverged simulation has."""


class Diverged(Exception):
    """A torque is NaN or too large; MuJoCo itself would continue from an arbitrary state."""


class Simulation:
    """State of the simulation; the arrays are views into MuJoCo's own, valid between steps."""

    def __init__(self, scene: Scene, mechanism: Callable[[F], F]) -> None:
        self.library = mujoco()
        self.model: Any = self.library.MjModel.from_xml_string(scene.text)
        self.data: Any = self.library.MjData(self.model)
        self.mechanism = mechanism
        """Function from pose (1, 6) to wrench h (1, 6)."""
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
        self._row: F = np.zeros((1, 6))
        self.pose = self._row[0]
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

    def stability_number(self, stiffness: F) -> float:
        """Time step times the fastest angular frequency; explicit integration needs less than 2."""
        symmetric = 0.5 * (stiffness + stiffness.T)
        fastest = np.linalg.eigvals(self.compliance() @ symmetric).real.max()
        return self.step_s * float(np.sqrt(max(fastest, 0.0)))
