"""Safety limits of the arm, checked a hundred times a second, and readings that are of no use."""

from __future__ import annotations

import math

import numpy as np

from ecm.io.arrays import F
from ecm.rig.arm.kuka import RANGE_RAD, SPEED_RAD_S, TORQUE_NM
from ecm.rig.arm.mechanism import ControllerModel
from ecm.rig.arm.simulation import Simulation
from ecm.rig.physics.camera import LEDS, LEDS_NEEDED
from ecm.rig.readings import Reading
from ecm.rig.settings import Instruments, RigSettings


def unusable(reading: Reading, leds: int, instrument: Instruments) -> str:
    """Return why a reading that shows so many LEDs cannot be used; empty if it can."""
    if leds < LEDS_NEEDED:
        return f"{leds} of {LEDS} LEDs were visible, {LEDS_NEEDED} are needed"
    saturated = np.abs(reading.sensor) >= np.asarray(instrument.fts_range) - 1e-9
    if saturated.any():
        axis = int(np.argmax(saturated))
        return (
            f"the force-torque sensor is saturated on axis {axis + 1} "
            f"({reading.sensor[axis]:.4g} at a range of {instrument.fts_range[axis]:.4g})"
        )
    return ""


_REFERENCE_M = 0.4
"""Length that makes the rows of the Jacobian comparable."""


class SafetyLimits:
    """Limits of force, torque, stretch, speed, joints, singularity and contact."""

    def __init__(
        self, settings: RigSettings, simulation: Simulation, model: ControllerModel, length_m: float
    ) -> None:
        self._arm = settings.arm
        self._simulation = simulation
        self._model = model
        self._length_m = length_m
        self._stretch_m = settings.rig.stretch_limit * length_m
        self._range_rad = RANGE_RAD - settings.arm.joint_margin_rad

    def broken(self, torque_Nm: F) -> str:
        """Message about the first limit that is broken by the state and the joint torques (7,)."""
        arm, simulation = self._arm, self._simulation
        force = _norm(simulation.wrench[:3])
        if force > arm.force_limit_N:
            return f"force {force:.1f} N, limit {arm.force_limit_N:g} N ([rig] force_limit_N)"
        moment = _norm(simulation.wrench[3:])
        if moment > arm.torque_limit_Nm:
            return (
                f"torque {moment:.2f} N m, limit {arm.torque_limit_Nm:g} N m "
                "([rig] torque_limit_Nm)"
            )
        pose = simulation.pose
        moved = math.hypot(pose[0] - self._length_m, pose[1], pose[2])
        if moved > self._stretch_m:
            return (
                f"top moved {moved * 1e3:.1f} mm, limit {self._stretch_m * 1e3:.1f} mm "
                "([rig] stretch_limit)"
            )
        speed = _norm(simulation.jacobian[:3].dot(simulation.speeds_rad_s))
        if speed > arm.speed_limit_m_s:
            return f"speed {speed:.3f} m/s, limit {arm.speed_limit_m_s:g} ([rig] speed_limit_m_s)"
        return self._joints(torque_Nm) or self._contact()

    def _joints(self, torque_Nm: F) -> str:
        for values, limit, verb, factor, unit in (
            (self._simulation.joints_rad, self._range_rad, "is at", 180.0 / math.pi, "degrees"),
            (self._simulation.speeds_rad_s, SPEED_RAD_S, "turns at", 180.0 / math.pi, "degrees/s"),
            (torque_Nm, TORQUE_NM, "needs", 1.0, "N m"),
        ):
            excess = np.abs(values) - limit
            if (excess > 0.0).any():
                i = int(np.argmax(excess))
                return (
                    f"joint {i + 1} {verb} {values[i] * factor:.1f} {unit}, "
                    f"limit {limit[i] * factor:.1f}"
                )
        return ""

    def singular(self) -> str:
        """Message if the arm is near a singular configuration (checked every 0.1 s)."""
        scaled = self._simulation.jacobian.copy()
        scaled[:3] /= _REFERENCE_M
        smallest = float(np.linalg.svd(scaled, compute_uv=False)[-1])
        if smallest < self._arm.singularity_limit:
            return (
                f"near a singular configuration: smallest singular value {smallest:.3f}, limit "
                f"{self._arm.singularity_limit:g} ([rig] singularity_limit)"
            )
        return ""

    def _contact(self) -> str:
        simulation = self._simulation
        if simulation.data.ncon == 0:
            return ""
        # What the sensor reads beyond the model of the mechanism.
        self._model.pose[:] = simulation.pose
        self._model.evaluate()
        unexplained = simulation.contact_N() + _norm(simulation.wrench[:3] - self._model.wrench[:3])
        if unexplained > self._arm.contact_limit_N:
            return (
                f"contact: {unexplained:.1f} N that the model of the mechanism does not explain, "
                f"limit {self._arm.contact_limit_N:g} N ([rig] contact_limit_N)"
            )
        return ""


def _norm(vector: F) -> float:
    return math.sqrt(float(vector.dot(vector)))
