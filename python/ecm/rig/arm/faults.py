"""Faults of the instruments: what makes a reading useless, and rehearsed ones.

`[rig] fault = "sensor_nan@5, led_loss@9+"` makes the sensor give NaN at pose visit 5 (counted from
0) and hides the LEDs from visit 9 on. A useless reading is no row of the table: the arm comes home,
the pose is skipped with the reason, and after three in a row the campaign stops, all else kept.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from ecm.errors import InputError
from ecm.io.toml import did_you_mean
from ecm.rig.physics.camera import LEDS, LEDS_NEEDED
from ecm.rig.readings import Reading
from ecm.rig.settings import Instruments

NAMES = ("sensor_dropout", "sensor_nan", "saturation", "led_loss")
IN_A_ROW = 3
"""So many useless readings one after the other end the campaign."""


@dataclass(frozen=True)
class Fault:
    """A rehearsed fault at one pose visit, or from it on."""

    name: str
    visit: int
    lasts: bool

    def at(self, visit: int) -> bool:
        """Whether it acts there."""
        return visit >= self.visit if self.lasts else visit == self.visit


def parse(text: str) -> tuple[Fault, ...]:
    """`NAME@VISIT` or `NAME@VISIT+`, with commas.

    Raises
    ------
    InputError
        Naming what was found and the known faults.
    """
    found = []
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
        found.append(Fault(name, int(match[2]), bool(match[3])))
    return tuple(found)


@dataclass(frozen=True)
class Taken:
    """A reading and what the instruments tell about it."""

    reading: Reading
    samples: int = 1
    leds: int = LEDS


def with_fault(taken: Taken, fault: Fault, instrument: Instruments) -> Taken:
    """The reading as the fault leaves it."""
    sensor = taken.reading.sensor.copy()
    if fault.name == "sensor_dropout":
        return replace(taken, samples=0)
    if fault.name == "led_loss":
        return replace(taken, leds=LEDS_NEEDED - 1)
    sensor[0] = np.nan if fault.name == "sensor_nan" else instrument.fts_range[0]
    return replace(taken, reading=replace(taken.reading, sensor=sensor))


def useless(taken: Taken, instrument: Instruments) -> str:
    """Why a reading cannot be used; empty where it can."""
    if taken.samples == 0:
        return "the force-torque sensor gave no samples in the window"
    if taken.leds < LEDS_NEEDED:
        return f"{taken.leds} of {LEDS} LEDs were visible, {LEDS_NEEDED} are needed"
    reading = taken.reading
    for name, values in (("force-torque sensor", reading.sensor), ("camera", reading.pose)):
        if not np.isfinite(values).all():
            axis = int(np.argmin(np.isfinite(values)))
            return f"the {name} gave {values[axis]} on axis {axis + 1}"
    full = np.abs(reading.sensor) >= np.asarray(instrument.fts_range) - 1e-9
    if full.any():
        axis = int(np.argmax(full))
        return (
            f"the force-torque sensor is saturated on axis {axis + 1} "
            f"({reading.sensor[axis]:.4g} at a range of {instrument.fts_range[axis]:.4g})"
        )
    return ""
