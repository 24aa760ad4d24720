"""Size limits of poses: numbers that are not metres and radians, and their likely unit."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.io.columns import POSE
from ecm.io.row_errors import RowErrors
from ecm.io.units import factor_of

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
