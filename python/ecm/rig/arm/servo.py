"""Joint position control: a stiff servo on every joint, integrated implicitly, with feed-forward.

    tau = k (q_d + e - q) + d (q_d' - q') + J' h_model(p),    e' = (q_d - q) / T

The trim e takes out what the model of the feed-forward does not know. q is what the encoders read:
where joints yield ([rig] joint_yield_rad_Nm), the true angles hang behind by the yield times J'h.

Backward Euler of spring and damper over one step is the spring taken at the present position with
the damper d + dt k taken at the end of the step; MuJoCo's Euler integrator treats joint damping so.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.rig.arm.feed_forward import ControllerModel
from ecm.rig.arm.simulation import Simulation
from ecm.rig.arm_table import ArmTable

_TRIM_S = 0.1


class Servo:
    """The controller; between `engage` and `release` its dampers are in the model."""

    def __init__(self, arm: ArmTable, simulation: Simulation, model: ControllerModel) -> None:
        self._simulation = simulation
        self._model = model
        self._forward = arm.feed_forward
        own = np.array([simulation.times_inertia(row)[i] for i, row in enumerate(np.eye(7))])
        self._spring = arm.joint_stiffness_Nm_rad
        self._damper = 2.0 * arm.joint_damping_ratio * np.sqrt(self._spring * own)
        self._trim: F = np.zeros(7)
        self._engaged = False
        self._share = simulation.step_s / _TRIM_S
        self._implicit = self._damper + simulation.step_s * self._spring
        self._own: F = simulation.model.dof_damping.copy()
        self._yield = arm.joint_yield_rad_Nm

    def engage(self) -> None:
        """Put the dampers into the model; the trim begins anew where they were out."""
        if not self._engaged:
            self._trim[:] = 0.0
        self._engaged = True
        self._simulation.model.dof_damping[:] = self._own + self._implicit

    def release(self) -> None:
        """Take them out again."""
        self._engaged = False
        self._simulation.model.dof_damping[:] = self._own

    def torque(self, joints_rad: F, speeds_rad_s: F) -> F:
        """Joint torques (7,) towards the target at the end of this step, dampers apart."""
        simulation, model = self._simulation, self._model
        away = joints_rad - self.encoders_rad()
        self._trim += self._share * away
        torque: F = self._spring * (away + self._trim)
        torque += self._damper * speeds_rad_s
        if self._forward:
            model.pose[:] = self.pose()
            model.evaluate()
            torque += simulation.jacobian_T.dot(model.wrench)
        return torque

    def encoders_rad(self) -> F:
        """(7,) what the encoders read: they sit before what yields."""
        joints = self._simulation.joints_rad
        if not self._yield:
            return joints
        held: F = self._simulation.jacobian_T.dot(self._simulation.wrench)
        read: F = joints + self._yield * held
        return read

    def pose(self) -> F:
        """(6,) of the top by the encoders, all that a position controller knows of it."""
        simulation = self._simulation
        if not self._yield:
            here: F = simulation.pose
            return here
        return simulation.pose_beside(self.encoders_rad() - simulation.joints_rad)

    def dampers_Nm(self) -> F:
        """What the implicit dampers take at present."""
        taken: F = self._implicit * self._simulation.speeds_rad_s
        return taken
