"""Safety limits, checked a hundred times a second, and faults of instruments to rehearse.

`[rig] fault = "sensor_nan@5, led_loss@9+"` makes the sensor return NaN at pose visit 5 (counted
from 0) and hides the LEDs from visit 9 on. An unusable reading gives no row: the arm returns home,
the pose is skipped with the reason, and after three in a row the campaign stops and keeps the rest.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.toml import did_you_mean
from ecm.rig.arm.kuka import RANGE_RAD, SPEED_RAD_S, TORQUE_NM
from ecm.rig.arm.mechanism import ControllerModel
from ecm.rig.arm.simulation import Simulation
from ecm.rig.physics.camera import LEDS, LEDS_NEEDED
from ecm.rig.readings import Reading
from ecm.rig.settings import Instruments, RigSettings

NAMES = ("sensor_dropout", "sensor_nan", "saturation", "led_loss")
MAX_IN_A_ROW = 3
"""Number of consecutive unusable readings that stops the campaign."""


@dataclass(frozen=True)
class Fault:
    """A rehearsed fault at one pose visit, or from it on."""

    name: str
    visit: int
    lasting: bool

    def acts_at(self, visit: int) -> bool:
        """Whether the fault acts at a pose visit."""
        return visit >= self.visit if self.lasting else visit == self.visit


def parse_faults(text: str) -> tuple[Fault, ...]:
    """Read `NAME@VISIT` or `NAME@VISIT+`, separated by commas; InputError for anything else."""
    faults = []
    for part in filter(None, (p.strip() for p in text.split(","))):
        match = re.fullmatch(r"(\w+)@(\d+)(\+?)", part)
        name = part.partition("@")[0]
        if name not in NAMES:
            raise InputError(f"[rig] fault: unknown '{name}', {did_you_mean(name, NAMES)}")
        if match is None:
            raise InputError(
                f"[rig] fault: found `{part}`, expected NAME@VISIT or NAME@VISIT+, such as "
                "`sensor_nan@5`"
            )
        faults.append(Fault(name, int(match[2]), bool(match[3])))
    return tuple(faults)


@dataclass(frozen=True)
class InstrumentOutput:
    """A reading, the number of its sensor samples and of its visible LEDs."""

    reading: Reading
    samples: int = 1
    leds: int = LEDS

    def with_faults(
        self, faults: Sequence[Fault], visit: int, instrument: Instruments
    ) -> InstrumentOutput:
        """Apply the faults that act at a pose visit."""
        output = self
        for fault in faults:
            if not fault.acts_at(visit):
                continue
            if fault.name == "sensor_dropout":
                output = replace(output, samples=0)
            elif fault.name == "led_loss":
                output = replace(output, leds=LEDS_NEEDED - 1)
            else:
                sensor = output.reading.sensor.copy()
                sensor[0] = np.nan if fault.name == "sensor_nan" else instrument.fts_range[0]
                output = replace(output, reading=replace(output.reading, sensor=sensor))
        return output

    def unusable(self, instrument: Instruments) -> str:
        """Return why the reading cannot be used; empty if it can."""
        if self.samples == 0:
            return "the force-torque sensor gave no samples in the window"
        if self.leds < LEDS_NEEDED:
            return f"{self.leds} of {LEDS} LEDs were visible, {LEDS_NEEDED} are needed"
        sensor = self.reading.sensor
        for name, values in (("force-torque sensor", sensor), ("camera", self.reading.pose)):
            if not np.isfinite(values).all():
                axis = int(np.argmin(np.isfinite(values)))
                return f"the {name} gave {values[axis]} on axis {axis + 1}"
        saturated = np.abs(sensor) >= np.asarray(instrument.fts_range) - 1e-9
        if saturated.any():
            axis = int(np.argmax(saturated))
            return (
                f"the force-torque sensor is saturated on axis {axis + 1} "
                f"({sensor[axis]:.4g} at a range of {instrument.fts_range[axis]:.4g})"
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
