"""Units as logs write them, and the unit that a factor between two loads tells."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from ecm.errors import InputError
from ecm.io.toml import closest

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
_ANGLES = {"rad": 1.0, "mrad": 1e-3, "grad": math.pi / 200.0, "rev": 2.0 * math.pi} | dict.fromkeys(
    ("deg", "degree", "degrees", "°"), math.pi / 180.0
)
_FORCES = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "gf": _GF_N, "kgf": 1e3 * _GF_N, "lbf": _LBF_N,
           "lb": _LBF_N, "lbs": _LBF_N, "ozf": _LBF_N / 16.0}  # fmt: skip
_TIMES = {
    "ms": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "minutes": 60.0,
    "h": 3600.0,
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
_UNITS = {
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
_LOWER = {word.lower(): unit for word, unit in reversed(_UNITS.items())}
_SI = ("m", "rad", "N", "Nm", "s", "degC")


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
    squeezed = re.sub(r"[\s.*·_^()\[\]-]", "", word)
    return _UNITS.get(squeezed) or _LOWER.get(squeezed.lower())


def factor_of(word: str) -> float:
    """Return the SI value of one of a known unit: 0.001 of `N mm`."""
    return _UNITS[word.replace(" ", "")].factor


def is_other_unit(word: str) -> bool:
    """Whether a word is a unit of something else, such as V, kg or mm/s.

    Examples
    --------
    >>> is_other_unit("mm/s"), is_other_unit("kg"), is_other_unit("N mm"), is_other_unit("raw")
    (True, True, False, False)
    """
    text = word.strip(" []()").lower()
    return find_unit(text) is None and (text in _OTHER or any(sign in text for sign in "/%²³"))


def given_units(words: Sequence[str]) -> dict[str, Unit]:
    """Return the unit of each dimension from words such as `mm`, `deg`, or `SI` for all.

    Raises
    ------
    InputError
        For an unknown word, or two units of one dimension.

    Examples
    --------
    >>> given_units(["mm", "N mm"])["torque"].factor
    0.001
    """
    found: dict[str, Unit] = {}
    si = any(word.strip().upper() == "SI" for word in words)
    for word in words:
        if word.strip().upper() == "SI" or not word.strip():
            continue
        unit = find_unit(word)
        if unit is None:
            near = closest(word, _UNITS)
            hint = f"did you mean '{near}'?" if near else "known are m, mm, deg, N, N mm, lbf, SI"
            raise InputError(f"--units: '{word}' is no unit, {hint}")
        if found.setdefault(unit.dimension, unit).factor != unit.factor:
            raise InputError(
                f"--units: '{found[unit.dimension].word}' and '{word}' are both units of "
                f"{unit.dimension}; give one, and --map NAME=COLUMN:UNIT for what differs"
            )
    return {_UNITS[word].dimension: _UNITS[word] for word in _SI} | found if si else found


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
