"""What is hidden in the other bodies: known effects, effects of no catalogue, wrong statements.

Effects are wrenches on the rows of a table, by formulas other than those that are fitted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blind_parts.other_bodies import Body, Visited
from blind_parts.rod import cross, turn
from blind_parts.strange import STRANGE
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table

F = NDArray[np.float64]


@dataclass
class Made:
    """Rows before noise: what really happened."""

    body: Body
    at: Visited
    time_s: F
    dwell_s: F
    temperature_degC: F
    slider: F
    random: np.random.Generator

    @property
    def poses(self) -> F:
        """(N, 6)."""
        return self.at.poses

    @property
    def wrenches(self) -> F:
        """(N, 6)."""
        return self.at.wrenches

    def table(self) -> Table:
        """Poses, wrenches and times as a table."""
        columns = dict(zip(POSE, self.poses.T, strict=True))
        columns |= dict(zip(WRENCH, self.wrenches.T, strict=True))
        return Table(columns | {"time_s": self.time_s})


Law = Callable[[Made], F]


def _section(**sizes: float) -> Law:
    """The rod with another section."""
    return lambda m: m.body.changed(m.at, **sizes) - m.wrenches


def _anisotropy(m: Made) -> F:
    angle = float(m.random.uniform(0.0, np.pi))
    return _section(uneven=0.02, uneven_angle_rad=angle)(m)


def _hysteresis(m: Made) -> F:
    """Bouc-Wen of each coordinate along the visits."""
    size = m.poses.std(axis=0)
    path = (m.poses - m.poses[0]) / np.where(size > 0.0, 0.3 * size, np.inf)
    state, states = np.zeros(6), []
    before = path[0]
    for here in path:
        for part in np.full((20, 6), (here - before) / 20.0):
            rate = part - (0.6 * np.sign(state) * np.abs(part) + 0.4 * part) * np.abs(state)
            state = np.clip(state + rate, -1.0, 1.0)
        states.append(state)
        before = here
    return np.array(states) * m.wrenches.std(axis=0)


def _drift(m: Made) -> F:
    """The zero creeps exponentially, in the axes of the sensor."""
    zero = m.random.standard_normal(6) * m.wrenches.std(axis=0)
    course = -np.expm1(-m.time_s / (0.8 * m.time_s[-1]))
    return course[:, None] * _in_top(m, zero)


def _in_top(m: Made, zero: F) -> F:
    matrices = turn(m.poses[:, 3:])
    return np.hstack([matrices @ zero[:3], matrices @ zero[3:]])


def _offset(m: Made) -> F:
    return _in_top(m, m.random.standard_normal(6) * m.wrenches.std(axis=0))


def _payload(m: Made) -> F:
    force = np.tile([9.81, 0.0, 0.0], (len(m.poses), 1))
    arm = turn(m.poses[:, 3:]) @ (0.2 * m.body.length_m * m.random.uniform(-1.0, 1.0, 3))
    return np.hstack([force, cross(arm, force)])


def _warm(m: Made) -> F:
    change = m.temperature_degC - m.temperature_degC.mean()
    return m.wrenches * np.expm1(-0.3 * change / (20.0 + change))[:, None]


def _relaxation(m: Made) -> F:
    """A power law of the time at rest."""
    return m.wrenches * (m.dwell_s / 10.0)[:, None] ** -0.08 - m.wrenches


def _kink(m: Made) -> F:
    """A bumper that is met softly beyond two thirds of the range of the last coordinate."""
    j = m.body.axes[-1]
    angle = m.poses[:, j]
    limit, width = np.quantile(angle, 0.65), 0.02 * float(np.ptp(angle))
    out = np.zeros_like(m.poses)
    out[:, j] = width * np.logaddexp(0.0, (angle - limit) / width)
    return out


def _slider(m: Made) -> F:
    return m.wrenches * m.slider[:, None]


KNOWN: dict[str, tuple[Law, str]] = {
    "strain_stiffening": (_section(hardening=0.3), "rod"),
    "anisotropy": (_anisotropy, "rod"),
    "length_error": (_section(base_shift_m=2e-4), "rod"),
    "pre_curvature": (_section(curvature=(0.05, 0.02)), "rod"),
    "taper": (_section(taper=0.03), "rod"),
    "payload": (_payload, "six"),
    "fts_offset": (_offset, "six"),
    "hysteresis": (_hysteresis, "any"),
    "fts_drift": (_drift, "any"),
    "temperature_modulus": (_warm, "any"),
    "stress_relaxation": (_relaxation, "any"),
    "kink": (_kink, "few"),
    "unused_column:slider": (_slider, "few"),
}
"""Law and where it can be hidden: in a stated rod, in six columns, in fewer, or anywhere."""


def _day(m: Made) -> F:
    """All grows softer and stiffer with the hour: less than one period while it is measured."""
    period = m.time_s[-1] * float(m.random.uniform(0.7, 1.4))
    return (
        m.wrenches * np.sin(2.0 * np.pi * m.time_s / period + m.random.uniform(0.0, 6.28))[:, None]
    )


def _hum(m: Made) -> F:
    """A period of some readings."""
    period = float(m.random.uniform(4.0, 9.0)) * float(np.median(np.diff(m.time_s)))
    return np.outer(np.sin(2.0 * np.pi * m.time_s / period), m.wrenches.std(axis=0))


def _memory(m: Made) -> F:
    """A share of the wrench of the visit before, in other components."""
    before = np.roll(m.wrenches, 1, axis=0)
    mix = m.random.standard_normal((6, 6)) * m.wrenches.std(axis=0)[:, None]
    scale = m.wrenches.std(axis=0)
    return (before / np.where(scale > 0.0, scale, 1.0)) @ mix.T


def _swelling(m: Made) -> F:
    """The body takes up water: it pushes along its axis and bends as the root of time."""
    course = np.sqrt(m.time_s / m.time_s[-1])
    return (
        np.outer(course, m.random.standard_normal(6))
        * m.wrenches.std(axis=0)
        * (1.0 + 3.0 * m.poses[:, 5:6])
    )


def _suction(m: Made) -> F:
    """A film of liquid holds the platform after each visit of a far pose."""
    far = np.linalg.norm((m.poses - m.poses.mean(axis=0)) / (m.poses.std(axis=0) + 1e-12), axis=1)
    course = np.exp(-((np.roll(far, 1) - np.median(far)) ** 2))
    return np.outer(course, m.random.standard_normal(6) * m.wrenches.std(axis=0))


FOREIGN: dict[str, tuple[Law, str]] = {
    "day": (_day, "any"),
    "hum": (_hum, "any"),
    "memory": (_memory, "any"),
    "swelling": (_swelling, "any"),
    "suction": (_suction, "any"),
    **{
        name: (lambda m, law=STRANGE[name]: law(m.table(), m.random), "six")  # type: ignore[misc]
        for name in ("magnet", "three_fold", "gear_ripple")
    },
}
"""Effects that no catalogue has; the last are those of the first benchmark."""
WORDS = {"magnet": "magnet", "swelling": "swell", "day": "temperature|the room"}
"""Words for some of them, one of which a name should have beside it that is said in their place."""


# --- wrong statements ---------------------------------------------------------------------------
@dataclass(frozen=True)
class Statement:
    """What a user states wrongly, and which words or names say so."""

    of: str
    """Where it can be stated: `rod` (stiffness is stated), six, or any."""
    words: str
    """Regular expression of what the diagnosis may say."""
    ids: tuple[str, ...] = ()
    """Effects whose name says the same."""


STATEMENTS: dict[str, Statement] = {
    "modulus": Statement("rod", r"\bE\b|modulus|times its own"),
    "nu": Statement("rod", r"\bnu\b|Poisson|stiffness(es)? .*stated", ("compressibility",)),
    "length": Statement("six", r"length", ("length_error",)),
    "noise_small": Statement("any", r"noise is (1\.[5-9]\d*|[2-9][\d.]*) times"),
    "noise_large": Statement("any", r"noise is 0\.([0-5]|6[0-6])\d* times"),
    "frame": Statement("six", r"turned by|axes look"),
    "torque": Statement("any", r"sign looks reversed"),
    "origin": Statement(
        "six",
        r"(measured from|taken about) a point|origin",
        ("base_frame_misalignment", "tip_frame_misalignment", "length_error", "fts_frame"),
    ),
    "minutes": Statement("any", r"minutes"),
}
"""Minutes are stated where the rows have the time at rest, which is in seconds."""
