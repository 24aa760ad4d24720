"""Cartesian impedance control: a virtual spring and damper between the top frame and its target.

    tau = J'(K e - D v) + tau_null,   e = (r_d - r, log(R_d R')) in base axes, v = J q'

The damping D gives every mode of arm and mechanism the damping ratio zeta. With
Lambda = (J M^-1 J')^-1 and K_all = K + K_mechanism, the latter by the controller's model,

    Lambda^-1 = L L',  L' K_all L = Q diag(w^2) Q',  D = 2 zeta L'^-1 Q diag(w) Q' L^-1.

The null space of J is one direction n; tau_null = M n a holds the elbow and does not accelerate the
top, J M^-1 tau_null = 0.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.rig.arm.controller_model import ControllerModel
from ecm.rig.arm.settings import ArmSettings
from ecm.rig.arm.simulation import Simulation


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
