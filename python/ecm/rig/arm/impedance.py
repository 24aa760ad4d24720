"""Cartesian impedance control: a virtual spring and damper between the top frame and its target.

    tau = J'(K e - D v) + tau_null,   e = (r_d - r, log(R_d R')) in base axes, v = J q'

D is designed from the damping ratio on all that is elastic: with Lambda = (J M^-1 J')^-1 and
K_all = K + K_mechanism, where K_mechanism is what the controller's exported model says,

    Lambda^-1 = L L',  L' K_all L = Q diag(w^2) Q',  D = 2 zeta L'^-1 Q diag(w) Q' L^-1,

so that every mode of arm and mechanism has the ratio zeta. The null space of J is one direction n;
tau_null = M n a lies in it dynamically, J M^-1 tau_null = 0, and holds the elbow.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.rig.arm.feed_forward import ControllerModel
from ecm.rig.arm.simulation import Simulation
from ecm.rig.arm_table import ArmTable


class Impedance:
    """The controller; `design` runs every ten steps, `torque` at every step."""

    def __init__(self, arm: ArmTable, simulation: Simulation, model: ControllerModel) -> None:
        self._simulation = simulation
        self._model = model
        self._arm = arm
        self.stiffness: F = np.repeat([arm.impedance_N_m, arm.impedance_Nm_rad], 3)
        self.damping: F = np.zeros((6, 6))
        self._free: F = np.zeros(7)
        self._push: F = np.zeros(7)
        self._inertia = 1.0
        self._error: F = np.zeros(6)
        self._shift, self._turn = self._error[:3], self._error[3:]
        self._back: F = np.zeros(4)
        self._rest: F = np.zeros(4)

    def design(self) -> None:
        """Damping and null space of the present configuration."""
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
        self._free = null_direction(simulation.jacobian)
        self._push = simulation.times_inertia(self._free)
        self._inertia = float(self._free @ self._push)

    def torque(self, position_m: F, quaternion: F) -> F:
        """Joint torques (7,) towards a target position and orientation (w, x, y, z)."""
        simulation = self._simulation
        library = simulation.library
        np.subtract(position_m, simulation.position, out=self._shift)
        library.mju_negQuat(self._back, simulation.quaternion)
        library.mju_mulQuat(self._rest, quaternion, self._back)
        library.mju_quat2Vel(self._turn, self._rest, 1.0)
        velocity = simulation.jacobian.dot(simulation.speeds_rad_s)
        wrench = self.stiffness * self._error - self.damping.dot(velocity)
        arm, free = self._arm, self._free
        away = float(free.dot(simulation.home_rad - simulation.joints_rad))
        rate = float(free.dot(simulation.speeds_rad_s))
        drag = 2.0 * arm.damping_ratio * (arm.nullspace_Nm_rad * self._inertia) ** 0.5
        hold = (arm.nullspace_Nm_rad * away - drag * rate) / self._inertia
        torque: F = simulation.jacobian_T.dot(wrench) + hold * self._push
        return torque


def null_direction(jacobian: F) -> F:
    """Unit vector n with J n = 0."""
    direction: F = np.linalg.svd(jacobian)[2][6]
    return direction
