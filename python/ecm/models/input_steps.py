"""What acts in place of the recorded inputs of actuators, as a controller adds it up step by step.

Each effect of an actuator changes an input a by da, and the wrench by G da. What depends on the
inputs of the moment alone is one matrix; a hysteresis and a lag remember those before.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from ecm.effects.actuation import (
    PressureCrossTalk,
    PressureGain,
    PressureHysteresis,
    PressureOffset,
    RegulatorLag,
)
from ecm.io.arrays import F
from ecm.regression.rows import driven_by, taken_by

_OF_THE_MOMENT = (PressureOffset, PressureGain, PressureCrossTalk)
_NO_STEP = (
    "it follows the dwell of a row or the bend of a tendon and has no step: the inputs of "
    "files are those that act, and docs/effects/actuation.md says how they follow"
)


@dataclass
class InputSteps:
    """Constants of the steps of a map's inputs.

    Examples
    --------
    >>> import ecm
    >>> rows = {"x_m": [0.0, 0.1, 0.2], "pressure_1_Pa": [0.0, 2e5, 1e5], "fx_N": [0.0, 1.0, 2.0]}
    >>> steps = InputSteps(ecm.fit(ecm.as_table(rows), "linear").base)
    >>> steps.add(PressureGain(), np.array([0.03])), steps.gain.tolist(), steps.offset.tolist()
    ('', [[0.03]], [0.0])
    """

    base: Any
    """The map that takes the inputs."""
    acting: list[str] = field(default_factory=list)
    """Ids of the effects."""
    slips: list[tuple[int, float, float]] = field(default_factory=list)
    """Actuator, reach and size of each spring that slips."""
    lags: list[tuple[int, float, float]] = field(default_factory=list)
    """Actuator, time constant and share of each lag."""

    def __post_init__(self) -> None:
        self.names = driven_by(self.base)
        self.offset: F = np.zeros(len(self.names))
        self.gain: F = np.zeros((len(self.names), len(self.names)))

    def add(self, effect: Any, values: F) -> str:
        """Add an effect with its fitted values, or say why it has no step."""
        size, own = float(values[0]), [name in effect.concerned(self.names) for name in self.names]
        places = [i for i, concerned in enumerate(own) if concerned]
        if isinstance(effect, PressureHysteresis):
            self.slips += [(i, effect.reach_Pa, size) for i in places]
        elif isinstance(effect, RegulatorLag):
            self.lags += [(i, effect.tau_s, size) for i in places]
        elif isinstance(effect, _OF_THE_MOMENT):
            none_and_each, rows = np.vstack([np.zeros(len(own)), np.eye(len(own))]), cast(Any, self)
            change = size * effect.change(rows, none_and_each) * own
            self.offset = self.offset + change[0]
            self.gain = self.gain + (change[1:] - change[0]).T
        else:
            return _NO_STEP
        self.acting.append(effect.id)
        return ""

    def constants(self, c: bool) -> dict[str, str]:
        """Constants for the template in C or Rust; what has no entry gets one of no effect."""
        taken, count = taken_by(self.base), len(self.base.outputs)
        slips, lags = self.slips or [(0, 1.0, 0.0)], self.lags or [(0, 1.0, 0.0)]
        number, around = ("R({!r})", "{{{}}}") if c else ("{!r}", "[{}]")

        def listed(values: Any) -> str:
            return ", ".join(number.format(x) if isinstance(x, float) else str(x) for x in values)

        parts = {"SLIPSIN REACH SLIP": slips, "LAGSIN TAU LAG": lags}
        columns = {
            key: listed(values)
            for keys, rows in parts.items()
            for key, values in zip(keys.split(), zip(*rows, strict=True), strict=True)
        }
        return columns | {
            "SLIPS": ", ".join(f"({listed(row)})" for row in slips),
            "LAGS": ", ".join(f"({listed(row)})" for row in lags),
            "EFFECTS": ", ".join(self.acting),
            "RECORDED": ", ".join(taken),
            "COLUMNS": listed(taken.index(name) for name in self.names),
            "OFFSET": listed(self.offset.tolist()),
            "GAIN": ", ".join(around.format(listed(row)) for row in self.gain.tolist()),
            "A": str(len(self.names)),
            "S": str(len(slips)),
            "T": str(len(lags)),
            "N": str(len(taken)),
            "M": str(count),
            "NM": str(count * len(taken)),
        }
