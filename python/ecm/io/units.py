"""Units as logs write them, and size limits of poses with their likely unit."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.io.columns import POSE
from ecm.io.csv import RowErrors
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


_LONGEST_M = 2.0
"""Largest position, m, if the length of the mechanism is unknown."""
_LARGEST_LENGTHS = 5.0
"""Largest position in lengths of the mechanism."""
_LARGEST_REACH_M = 3.0
"""Largest position in a robot's or a camera's own frame."""
_ROUNDING = 1e-6
"""By how much a rotation vector of half a turn may be longer in a robot's own frame, rad."""
_FEW_ROWS = 0.1
"""If a smaller share of rows exceeds the limit, these rows are wrong; else the unit is."""
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


def check_positions(
    columns: Mapping[str, F], rows: I, length_m: float | None, errors: RowErrors
) -> None:
    """Add positions beyond the size limit to `errors`; InputError if unit or frame seems wrong."""
    limit_m = _LONGEST_M if length_m is None else max(_LARGEST_LENGTHS * length_m, 1e-9)
    for name in POSE[:3]:
        if name in columns:
            _check_column(name, columns[name], rows, limit_m, errors)


def check_rotations(
    columns: Mapping[str, F], rows: I, errors: RowErrors, *, in_own_frames: bool = False
) -> None:
    """Add rotation vectors of pi and more to `errors`; InputError if the unit seems wrong.

    In frames of the log half a turn is usual: a robot's tool that points down.
    """
    longest = math.pi + (_ROUNDING if in_own_frames else 0.0)
    for name in POSE[3:]:
        if name in columns:
            _check_column(name, columns[name], rows, longest, errors)
    if not all(name in columns for name in POSE[3:]):
        return
    theta = np.column_stack([columns[name][rows] for name in POSE[3:]])
    angles = np.sqrt(sum(values**2 for values in theta.T))
    for i in np.flatnonzero((angles >= longest) & (np.abs(theta) <= longest).all(axis=1)):
        turn = f"a rotation vector of {angles[i]:.4g} rad"
        errors.add(int(rows[i]), "", turn, "less than pi (the shorter way round)")


def _check_column(name: str, values: F, rows: I, limit: float, errors: RowErrors) -> None:
    outside = rows[np.abs(values[rows]) > limit]
    if len(outside) <= _FEW_ROWS * len(rows):
        unit = "m" if name in POSE[:3] else "rad"
        for row in outside:
            errors.add(int(row), name, f"{values[row]:g}", f"at most {limit:.3g} {unit}")
        return
    guess = _guess_length if name in POSE[:3] else _guess_angle
    raise InputError(
        f"{errors.source}: column '{name}', {errors.place(int(outside[0]))}: found "
        f"{values[outside[0]]:g} ({len(outside)} of {len(rows)} rows beyond {limit:.3g}), "
        f"{guess(name, values[rows], limit)}"
    )


def _guess_length(name: str, values: F, limit: float) -> str:
    largest, span = float(np.max(np.abs(values))), float(np.ptp(values))
    if largest <= _LARGEST_REACH_M and span <= limit:
        return (
            f"but they move by {span:.3g} m only: positions from another origin, for example the "
            "robot's base. Say where it is: base_from_robot = [x, y, z, 1, 0, 0, 0] in [frames] "
            "(docs/import.md)."
        )
    if largest / 1e3 > limit:
        return "no plausible position in metres. Check the unit and the frame."
    return (
        "expected metres: these look like millimetres. Divide by 1000, give "
        f"{name} = {{ column = ..., scale = 1e-3 }} in [columns], or import the log with "
        f"--map {name}=COLUMN:mm."
    )


def _guess_angle(name: str, values: F, _: float) -> str:
    if float(np.max(np.abs(values))) > 720.0:
        return "no plausible rotation vector in radians. Check the unit."
    return (
        "expected radians: these look like degrees. Multiply by pi/180, give "
        f"{name} = {{ column = ..., scale = 0.017453292519943295 }} in [columns], or import the "
        f"log with --map {name}=COLUMN:deg."
    )
