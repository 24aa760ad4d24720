"""Units as logs write them: the word at the end of a name, in brackets, or given once for all."""

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


def _units() -> dict[str, Unit]:
    lengths = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "µm": 1e-6, "in": _INCH_M,
               "inch": _INCH_M, "inches": _INCH_M, "ft": 12 * _INCH_M}  # fmt: skip
    degree = math.pi / 180.0
    angles = {"rad": 1.0, "mrad": 1e-3, "deg": degree, "degree": degree, "degrees": degree,
              "°": degree, "grad": math.pi / 200.0, "rev": 2.0 * math.pi}  # fmt: skip
    forces = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "gf": _GF_N, "kgf": 1e3 * _GF_N, "lbf": _LBF_N,
              "lb": _LBF_N, "lbs": _LBF_N, "ozf": _LBF_N / 16.0}  # fmt: skip
    times = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6,
             "µs": 1e-6, "ns": 1e-9, "min": 60.0, "minutes": 60.0, "h": 3600.0,
             "hours": 3600.0}  # fmt: skip
    torques = {
        f"{force}{length}": forces[force] * lengths[length]
        for force in ("N", "kN", "mN", "gf", "kgf", "lbf", "lb", "ozf")
        for length in ("m", "mm", "cm", "in", "ft")
    } | {
        f"{length}{force}": forces[force] * lengths[length]
        for force in ("lbf", "lb")
        for length in ("in", "ft")
    }
    torques["ozin"] = _LBF_N / 16.0 * _INCH_M
    found = {
        word: Unit(word, dimension, factor)
        for dimension, words in (
            ("length", lengths), ("angle", angles), ("force", forces), ("torque", torques),
            ("time", times),
        )
        for word, factor in words.items()
    }  # fmt: skip
    for word in ("degC", "C", "°C", "celsius"):
        found[word] = Unit(word, "temperature")
    for word in ("K", "kelvin"):
        found[word] = Unit(word, "temperature", 1.0, -273.15)
    for word in ("degF", "F", "°F", "fahrenheit"):
        found[word] = Unit(word, "temperature", 5.0 / 9.0, -160.0 / 9.0)
    return found


_UNITS = _units()
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
