"""Arm and mechanism at 1 kHz: MuJoCo moves the arm, the mechanism acts on it as a wrench.

At every step the pose p of the site `top` gives the mechanism's resistance h(p), and the arm feels
the generalised force -J'h. The mechanism is integrated explicitly: treating its linear part K
implicitly would add dt^2 K to the inertia at the top, 25 g at 25 kN/m and 1 ms, against the
kilogrammes of arm that stand behind it. `stability_number` says how far from the limit of 2 the
fastest mode is. The joint servo, which is stiff, is implicit (`servo.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ecm.errors import EcmError
from ecm.io.arrays import F
from ecm.rig.arm.scene import Scene, mujoco

_BEYOND_NM2 = 1e12
"""Square of a torque that no arm has."""


class Diverged(Exception):
    """A force is no number, or none of this world; MuJoCo would go on from nowhere."""


class Simulation:
    """State, and views into MuJoCo's own arrays that stay valid between steps."""

    def __init__(self, scene: Scene, mechanism: Callable[[F], F]) -> None:
        self.library = mujoco()
        self.model: Any = self.library.MjModel.from_xml_string(scene.text)
        self.data: Any = self.library.MjData(self.model)
        self.mechanism = mechanism
        """(1, 6) pose to (1, 6) wrench h."""
        self.home_rad = scene.home_rad
        self.joints_rad: F = self.data.qpos
        self.speeds_rad_s: F = self.data.qvel
        self.applied_Nm: F = self.data.qfrc_applied
        self.gravity_Nm: F = self.data.qfrc_gravcomp
        self.jacobian: F = np.zeros((6, 7))
        self.jacobian_T = self.jacobian.T
        self._linear, self._angular = self.jacobian[:3], self.jacobian[3:]
        self.quaternion: F = np.zeros(4)
        """Of the top frame, w x y z."""
        self._row: F = np.zeros((1, 6))
        self.pose = self._row[0]
        self.position, self._turn = self.pose[:3], self.pose[3:]
        self._site_position: F = self.data.site_xpos[0]
        self._site_axes: F = self.data.site_xmat[0]
        self.wrench: F = np.zeros(6)
        """h, what the arm exerts on the mechanism."""
        self.beside: F = np.zeros(6)
        """What acts beside the mechanism's elasticity, part of `wrench`; see `drift`."""
        self._drift: F | None = None
        self.steps = 0
        self.step_s = float(self.model.opt.timestep)
        self.reset()

    @property
    def time_s(self) -> float:
        """Since the last reset."""
        return self.steps * self.step_s

    def reset(self, joints_rad: F | None = None) -> None:
        """At rest in a configuration, home by default."""
        self.library.mj_resetData(self.model, self.data)
        self.joints_rad[:] = self.home_rad if joints_rad is None else joints_rad
        self.steps = 0
        self.beside[:] = 0.0
        self._drift = None
        self.sense()

    def sense(self) -> None:
        """Pose, Jacobian and h of the present state; inertia and Coriolis terms are ready."""
        library, model, data = self.library, self.model, self.data
        library.mj_step1(model, data)
        library.mj_jacSite(model, data, self._linear, self._angular, 0)
        library.mju_mat2Quat(self.quaternion, self._site_axes)
        library.mju_quat2Vel(self._turn, self.quaternion, 1.0)
        self.position[:] = self._site_position
        try:
            self.wrench = self.mechanism(self._row)[0]
        except EcmError:
            if np.isfinite(self._row).all():
                raise
            raise Diverged from None
        if self._drift is not None:
            self.wrench = self.wrench + self.beside

    def advance(self, torque_Nm: F) -> None:
        """One step under joint torques that hold the mechanism as well: applied - J'h."""
        np.subtract(torque_Nm, self.jacobian_T.dot(self.wrench), out=self.applied_Nm)
        # Fails for NaN too. Beyond, MuJoCo would write a log into the folder where the user works.
        if not self.applied_Nm.dot(self.applied_Nm) < _BEYOND_NM2:
            raise Diverged
        self.library.mj_step2(self.model, self.data)
        self.steps += 1
        if self._drift is not None:
            self.beside += self._drift
        self.sense()

    def pose_beside(self, away_rad: F) -> F:
        """Pose (6,) with the joints so far (7,) from where they are, to first order."""
        moved: F = np.zeros(6)
        shift = self.jacobian.dot(away_rad)
        moved[:3] = self.position + shift[:3]
        turn, beside = np.zeros(4), np.zeros(4)
        angle = float(np.linalg.norm(shift[3:]))
        axis = shift[3:] / angle if angle > 0.0 else np.array([1.0, 0.0, 0.0])
        self.library.mju_axisAngle2Quat(turn, axis, angle)
        self.library.mju_mulQuat(beside, turn, self.quaternion)
        self.library.mju_quat2Vel(moved[3:], beside, 1.0)
        return moved

    def drift(self, beside: F, steps: int) -> None:
        """What acts beside elasticity goes to this wrench (6,) in so many steps, evenly."""
        self._drift = (beside - self.beside) / steps

    def compliance(self) -> F:
        """J M^-1 J', inverse of the inertia felt at the top, (6, 6)."""
        solved: F = np.zeros((6, 7))
        self.library.mj_solveM(self.model, self.data, solved, self.jacobian)
        felt: F = solved @ self.jacobian.T
        symmetric: F = 0.5 * (felt + felt.T)
        return symmetric

    def times_inertia(self, vector: F) -> F:
        """M v."""
        product: F = np.zeros(7)
        self.library.mj_mulM(self.model, self.data, product, vector)
        return product

    def contact_N(self) -> float:
        """Sum of the contact forces on the target plate."""
        total = 0.0
        force = np.zeros(6)
        for i in range(self.data.ncon):
            self.library.mj_contactForce(self.model, self.data, i, force)
            total += float(np.linalg.norm(force[:3]))
        return total

    def stability_number(self, stiffness: F) -> float:
        """dt times the fastest angular frequency of arm and mechanism; explicit steps need < 2."""
        symmetric = 0.5 * (stiffness + stiffness.T)
        fastest = np.linalg.eigvals(self.compliance() @ symmetric).real.max()
        return self.step_s * float(np.sqrt(max(fastest, 0.0)))
