"""Column names of the measurement table, and units as logs write them.

What each column holds, the name that a wrong one means, and the unit that a factor between two
loads tells.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import B
from ecm.io.settings import closest

_LBF_N = 4.4482216152605
_GF_N = 9.80665e-3
_INCH_M = 0.0254


@dataclass(frozen=True)
class Unit:
    """A unit: SI value = factor * value + offset.

    Examples
    --------
    >>> find_unit("gf cm").factor
    9.80665e-05
    """

    word: str
    dimension: str
    """length, angle, force, torque, time, temperature, or quaternion's `number`."""
    factor: float = 1.0
    offset: float = 0.0


_LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "µm": 1e-6, "in": _INCH_M,
            "inch": _INCH_M, "inches": _INCH_M, "ft": 12 * _INCH_M}  # fmt: skip
_ANGLES = {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "µrad": 1e-6, "grad": math.pi / 200.0,
           "rev": 2.0 * math.pi} | dict.fromkeys(
    ("deg", "degree", "degrees", "°"), math.pi / 180.0
)  # fmt: skip
_FORCES = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "gf": _GF_N, "kgf": 1e3 * _GF_N, "lbf": _LBF_N,
           "lb": _LBF_N, "lbs": _LBF_N, "ozf": _LBF_N / 16.0, "daN": 10.0, "uN": 1e-6, "µN": 1e-6,
           "kip": 1e3 * _LBF_N, "kips": 1e3 * _LBF_N, "MN": 1e6}  # fmt: skip
_TIMES = {
    "ms": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "minutes": 60.0,
    "h": 3600.0,
    "hr": 3600.0,
    "hours": 3600.0,
} | dict.fromkeys(("s", "sec", "second", "seconds"), 1.0)
_TORQUES = (
    {f + l: _FORCES[f] * _LENGTHS[l] for f in _FORCES for l in ("m", "mm", "cm", "in", "ft")}
    | {l + f: _FORCES[f] * _LENGTHS[l] for f in ("lbf", "lb") for l in ("in", "ft")}
    | {"ozin": _LBF_N / 16.0 * _INCH_M}
)  # fmt: skip
_TEMPERATURES = {
    ("degC", "C", "°C", "celsius"): (1.0, 0.0),
    ("K", "kelvin"): (1.0, -273.15),
    ("degF", "F", "°F", "fahrenheit"): (5.0 / 9.0, -160.0 / 9.0),
}
UNITS = {
    word: Unit(word, dimension, factor)
    for dimension, words in (
        ("length", _LENGTHS), ("angle", _ANGLES), ("force", _FORCES), ("torque", _TORQUES),
        ("time", _TIMES),
    )
    for word, factor in words.items()
} | {
    word: Unit(word, "temperature", *scale)
    for words, scale in _TEMPERATURES.items()
    for word in words
}  # fmt: skip
_LOWER = {word.lower(): unit for word, unit in reversed(UNITS.items())}


_OTHER = frozenset(
    {"v", "mv", "uv", "kg", "g", "mg", "pa", "kpa", "mpa", "gpa", "bar", "psi", "hz", "khz", "rpm"}
    | {"counts", "count", "cts", "pulses", "digits", "steps", "pixel", "pixels", "db", "lsb"}
    | {"pct", "percent"}
)
"""Units of what is neither pose, wrench, time nor temperature."""


def find_unit(word: str) -> Unit | None:
    """Return the unit of a word such as `N mm`, `N*mm`, `Nmm` or `[deg]`; None for no unit.

    Case counts only where it tells units apart (mN and MN).
    """
    squeezed = re.sub(r"[\s.*·・⋅_^()\[\]-]", "", plain(word))
    return UNITS.get(squeezed) or _LOWER.get(squeezed.lower())


def plain(text: str) -> str:
    """Return a text whose signs of one meaning are one: `℃` and `㎜`, wide letters, both mu.

    Examples
    --------
    >>> plain("荷重（Ｎ）"), plain("25 ℃"), plain("㎜"), plain("μm") == plain("µm")
    ('荷重(N)', '25 °C', 'mm', True)
    """
    return unicodedata.normalize("NFKC", text).replace("μ", "µ")


def factor_of(word: str) -> float:
    """Return the SI value of one of a known unit: 0.001 of `N mm`."""
    return UNITS[word.replace(" ", "")].factor


def is_other_unit(word: str) -> bool:
    """Whether a word is a unit of something else, such as V, kg or mm/s.

    Examples
    --------
    >>> is_other_unit("mm/s"), is_other_unit("kg"), is_other_unit("N mm"), is_other_unit("raw")
    (True, True, False, False)
    """
    text = word.strip(" []()").lower()
    return find_unit(text) is None and (text in _OTHER or any(sign in text for sign in "/%²³"))


_SAME_FACTOR = 0.1
"""Share by which a factor may differ from that of a unit: bodies and fits differ, too."""
_FACTORS = {
    1e3: "mm, N mm, mN or kN",
    1e6: "N mm beside mm",
    100.0: "cm or N cm",
    180.0 / math.pi: "degrees",
    1.0 / factor_of("in"): "inches",
    factor_of("in") / factor_of("mm"): "inches beside mm",
    factor_of("kgf"): "kgf",
    1.0 / factor_of("gf"): "gf",
    factor_of("lbf"): "lbf",
    1.0 / factor_of("lbf in"): "lbf in",
}
"""Factors between a unit and that of the table, and the unit."""


def unit_of_factor(factor: float) -> str:
    """Return the units whose factor, or its inverse, a ratio of two loads is; empty for none.

    Examples
    --------
    >>> unit_of_factor(0.00102), unit_of_factor(4.4), unit_of_factor(0.0088)
    ('mm, N mm, mN or kN', 'lbf', '')
    """
    if not factor > 0.0:
        return ""
    size = abs(math.log(factor))
    near = {abs(size - math.log(own)): words for own, words in _FACTORS.items()}
    return near[min(near)] if min(near) < math.log1p(_SAME_FACTOR) else ""


POSE = ("x_m", "y_m", "z_m", "theta_x_rad", "theta_y_rad", "theta_z_rad")
WRENCH = ("fx_N", "fy_N", "fz_N", "tau_x_Nm", "tau_y_Nm", "tau_z_Nm")
VELOCITY = tuple(f"v_{name}" for name in POSE)
POSE_OFFSETS = tuple(f"offset_{name}" for name in POSE)
"""Columns of a plan: the way from the free pose at the row's pressures, in base axes."""
SPREAD = tuple(f"sd_{name}" for name in POSE + WRENCH)
TEXT = ("approach", "kind", "action")
KINDS = ("pose", "home", "unloaded")
JOINTS = tuple(f"q{i}_rad" for i in range(1, 8))
JOINT_SIGNS = tuple(f"q{i}_dir" for i in range(1, 8))
WHOLE = ("pose_id", "run", "repeat", "leds_visible", *JOINT_SIGNS)
MAY_BE_EMPTY = ("dwell_s",)
STANDARD = (
    *POSE,
    *WRENCH,
    "pose_id",
    "time_s",
    "run",
    "repeat",
    "dwell_s",
    *TEXT,
    "temperature_degC",
    "sensor_temperature_degC",
    "leds_visible",
    *JOINTS,
    *JOINT_SIGNS,
    *VELOCITY,
    *SPREAD,
)
_ACTUATION = re.compile(r"(?:(?P<chamber>pressure)|tension)_(?P<number>[1-9]\d*)_(?(chamber)Pa|N)")
_AMOUNT = re.compile(r"(?:(?P<chamber>volume)|length)_(?P<number>[1-9]\d*)_(?(chamber)m3|m)")
_TENDON = re.compile(r"tendon[1-9][0-9]*_N")
_SHORT = tuple(name.rsplit("_", 1)[0] for name in (*WRENCH, *POSE))
STIFFNESS = tuple(f"k_{force}_{coordinate}" for force in _SHORT[:6] for coordinate in _SHORT[6:])
"""The 36 columns of `predict --stiffness`: k_fx_x ... k_tau_z_theta_z, row by row of K."""

_OTHER_UNITS = frozenset({"km", "urad", "g", "kg", "v", "volt", "mps", "rads", "degs"})
"""Words that may end a name besides the units of logs."""
_ALIASES = {"temp": "temperature_degC", "poseid": "pose_id"}


def is_standard(name: str) -> bool:
    """Whether a column of this name has a meaning here (docs/columns.md)."""
    patterns = (_TENDON, _ACTUATION, _AMOUNT)
    return name in _MEANT or any(pattern.fullmatch(name) for pattern in patterns)


def actuation_columns(names: Iterable[str]) -> tuple[str, ...]:
    """Return the actuator inputs among column names: pressures, then tensions, by number.

    Examples
    --------
    >>> actuation_columns(["tension_1_N", "pressure_2_Pa", "x_m", "pressure_1_Pa", "pressure_bar"])
    ('pressure_1_Pa', 'pressure_2_Pa', 'tension_1_N')
    """
    return _by_number(_ACTUATION, names)


def amount_columns(names: Iterable[str]) -> tuple[str, ...]:
    """Return volume changes of chambers, then shortenings of tendons, among column names.

    Examples
    --------
    >>> amount_columns(["length_1_m", "volume_1_m3", "x_m"])
    ('volume_1_m3', 'length_1_m')
    """
    return _by_number(_AMOUNT, names)


def _by_number(pattern: re.Pattern[str], names: Iterable[str]) -> tuple[str, ...]:
    found = [match for name in names if (match := pattern.fullmatch(name))]

    def place(match: re.Match[str]) -> tuple[bool, int]:
        return match["chamber"] is None, int(match["number"])

    return tuple(match[0] for match in sorted(found, key=place))


def likely_name(name: str) -> str | None:
    """Return the standard name of a column with another unit, without unit or misspelt.

    None for a standard name, and for a column of the user's own.
    """
    if is_standard(name):
        return None
    squeezed = _squeeze(name.lower())
    if squeezed in _SQUEEZED:
        return _SQUEEZED[squeezed]
    stem, unit = _split_unit(name)
    known = _STEMS.get(stem)
    if known is not None and (unit == "" or _is_unit(unit)):
        return known
    tendon = re.fullmatch(r"tendon([1-9][0-9]*)", stem)
    if tendon is not None and (unit == "" or _is_unit(unit)):
        return f"tendon{tendon[1]}_N"
    return None


def unit_of(name: str) -> str:
    """Return the unit at the end of a column's name, e.g. 'N m' of tau_x_Nm."""
    return name.rsplit("_", 1)[1].replace("Nm", "N m")


def behind(unit: str) -> str:
    """A unit as it stands behind a number; nothing for a number without one.

    Examples
    --------
    >>> f"0.2{behind('kg')}", f"0.2{behind('1')}"
    ('0.2 kg', '0.2')
    """
    return "" if unit in ("", "1") else f" {unit}"


def same_unit(names: Sequence[str]) -> B:
    """(m, m) whether two columns have one unit, by the ends of their names.

    Examples
    --------
    >>> same_unit(["fx_N", "fy_N", "tau_x_Nm"])[0]
    array([ True,  True, False])
    """
    units = np.array([name.rpartition("_")[2] for name in names])
    return np.asarray(units[:, None] == units)


def close_name(name: str) -> str | None:
    """Return a standard name that this one resembles, for a hint in a warning."""
    return closest(name, STANDARD, similarity=0.85)


def _split_unit(name: str) -> tuple[str, str]:
    """Split 'tau_z [N mm]' into ('tauz', 'nmm'), 'fx_kN' into ('fx', 'kn'), 'x' into ('x', '')."""
    text = name.strip().lower()
    bracket = re.fullmatch(r"(.*?)\s*[\[(]\s*(.*?)\s*[\])]", text)
    if bracket is not None:
        return _squeeze(bracket[1]), _squeeze(bracket[2])
    parts = text.replace(" ", "_").split("_")
    for size in (2, 1):
        unit = "".join(parts[-size:])
        if len(parts) > size and _is_unit(unit):
            return _squeeze("".join(parts[:-size])), unit
    return _squeeze(text), ""


def _is_unit(word: str) -> bool:
    return find_unit(word) is not None or word in _OTHER_UNITS


def _squeeze(text: str) -> str:
    return re.sub(r"[^a-z0-9]", "", text)


# In a log `offset_x mm` is a column of its own: no likely name of `offset_x_m`.
_MEANT = frozenset((*STANDARD, *POSE_OFFSETS, *STIFFNESS))
_SQUEEZED = {_squeeze(name.lower()): name for name in STANDARD}
_STEMS = {
    _squeeze(name.rsplit("_", 1)[0].lower()): name
    for name in STANDARD
    if name not in (*WHOLE, *TEXT)  # they have no unit
} | _ALIASES
