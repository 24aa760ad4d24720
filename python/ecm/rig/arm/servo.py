"""Joint position control: a stiff servo on every joint, integrated implicitly, with feed-forward.

    tau = k (q_d + e - q) + d (q_d' - q') + J' h_model(p),    e' = (q_d - q) / T

The integrator e removes the error of the feed-forward's model. q is what the encoders read: if
joints yield ([rig] joint_yield_rad_Nm), the true angles lag behind by the yield times J'h.

Backward Euler of spring and damper over one step is the spring at the present position with the
damper d + dt k at the end of the step; MuJoCo's Euler integrator treats joint damping so.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.rig.arm.controller_model import ControllerModel
from ecm.rig.arm.settings import ArmSettings
from ecm.rig.arm.simulation import Simulation

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
        angles: F = joints + self._yield * load
        return angles

    def pose(self) -> F:
        """Pose (6,) of the top frame by the encoders."""
        simulation = self._simulation
        if not self._yield:
            pose: F = simulation.pose
            return pose
        return simulation.pose_after(self.encoders_rad() - simulation.joints_rad)

    def damper_torque_Nm(self) -> F:
        """Torque (7,) of the implicit dampers."""
        torque: F = self._implicit * self._simulation.speeds_rad_s
        return torque
