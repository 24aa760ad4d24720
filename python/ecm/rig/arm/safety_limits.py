"""Limits watched a hundred times a second while the arm moves; the first broken one ends it."""

from __future__ import annotations

import math

import numpy as np

from ecm.io.arrays import F
from ecm.rig.arm.feed_forward import ControllerModel
from ecm.rig.arm.kuka import RANGE_RAD, SPEED_RAD_S, TORQUE_NM
from ecm.rig.arm.simulation import Simulation
from ecm.rig.settings import RigSettings

REFERENCE_M = 0.4
"""Length that makes the Jacobian's rows comparable."""


class Guard:
    """Force, torque, stretch, speed, singularity, joint range, joint torque, contact."""

    def __init__(
        self,
        settings: RigSettings,
        simulation: Simulation,
        model: ControllerModel,
        length_m: float,
    ) -> None:
        self._arm = settings.arm
        self._simulation = simulation
        self._model = model
        self._length_m = length_m
        self._stretch = settings.rig.stretch_limit * length_m
        self._allowed = RANGE_RAD - settings.arm.joint_margin_rad

    def breach(self, torque_Nm: F) -> str:
        """The first limit that is broken, in words; empty where none is."""
        arm, simulation = self._arm, self._simulation
        joints, speeds = simulation.joints_rad, simulation.speeds_rad_s
        wrench, pose = simulation.wrench, simulation.pose
        force = _norm(wrench[:3])
        if force > arm.force_limit_N:
            return f"force {force:.1f} N, limit {arm.force_limit_N:g} N ([rig] force_limit_N)"
        moment = _norm(wrench[3:])
        if moment > arm.torque_limit_Nm:
            return (
                f"torque {moment:.2f} N m, limit {arm.torque_limit_Nm:g} N m "
                "([rig] torque_limit_Nm)"
            )
        away = math.hypot(pose[0] - self._length_m, pose[1], pose[2])
        if away > self._stretch:
            return (
                f"top moved {away * 1e3:.1f} mm, limit {self._stretch * 1e3:.1f} mm "
                "([rig] stretch_limit)"
            )
        speed = _norm(simulation.jacobian[:3].dot(speeds))
        if speed > arm.speed_limit_m_s:
            return f"speed {speed:.3f} m/s, limit {arm.speed_limit_m_s:g} ([rig] speed_limit_m_s)"
        return self._joints(joints, speeds, torque_Nm) or self._contact()

    def _joints(self, joints: F, speeds: F, torque_Nm: F) -> str:
        for found, limit, name, factor, unit in (
            (joints, self._allowed, "is at", 180.0 / math.pi, "degrees"),
            (speeds, SPEED_RAD_S, "turns at", 180.0 / math.pi, "degrees/s"),
            (torque_Nm, TORQUE_NM, "needs", 1.0, "N m"),
        ):
            beyond = np.abs(found) - limit
            if (beyond > 0.0).any():
                i = int(np.argmax(beyond))
                return (
                    f"joint {i + 1} {name} {found[i] * factor:.1f} {unit}, "
                    f"limit {limit[i] * factor:.1f}"
                )
        return ""

    def singular(self) -> str:
        """Whether the arm is near a singular configuration (looked at every 0.1 s)."""
        scaled = self._simulation.jacobian.copy()
        scaled[:3] /= REFERENCE_M
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
