"""Faults of the instruments: what makes a reading unusable, and how to rehearse it.

`[rig] fault = "sensor_nan@5, led_loss@9+"` makes the sensor return NaN at pose visit 5 (counted
from 0) and hides the LEDs from visit 9 on. An unusable reading gives no row: the arm returns home,
the pose is skipped with the reason, and after three in a row the campaign stops and keeps the rest.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ecm.errors import InputError
from ecm.io.toml import did_you_mean
from ecm.rig.physics.camera import LEDS, LEDS_NEEDED
from ecm.rig.readings import Reading
from ecm.rig.settings import Instruments

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


def parse(text: str) -> tuple[Fault, ...]:
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
