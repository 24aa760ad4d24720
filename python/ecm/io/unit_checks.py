"""Do the numbers look like metres and radians? If not, the message names the likely unit."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.io.columns import POSE
from ecm.io.row_errors import RowErrors

_LONGEST_M = 2.0
"""No mechanism without a known length is longer."""
_REACH_LENGTHS = 5.0
"""No pose of a mechanism of known length is farther from the base than so many lengths."""
_FEW_ROWS = 0.1
"""Below this share of rows the rows are wrong, above it the unit."""


def check_pose_units(
    columns: Mapping[str, F], rows: I, length_m: float | None, errors: RowErrors
) -> None:
    """Add implausible poses among `rows` to `errors`; InputError where the unit seems wrong."""
    reach = _LONGEST_M if length_m is None else max(_REACH_LENGTHS * length_m, 1e-9)
    for name in POSE:
        if name in columns:
            _check_column(name, columns[name], rows, reach if name in POSE[:3] else math.pi, errors)
    if not all(name in columns for name in POSE[3:]):
        return
    theta = np.column_stack([columns[name][rows] for name in POSE[3:]])
    angles = np.sqrt(sum(values**2 for values in theta.T))
    for i in np.flatnonzero((angles >= math.pi) & (np.abs(theta) <= math.pi).all(axis=1)):
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
        f"{guess(name, float(np.max(np.abs(values[rows]))), limit)}"
    )


def _guess_length(name: str, largest: float, limit: float) -> str:
    if largest / 1e3 > limit:
        return "no plausible position in metres. Check the unit and the frame."
    return (
        "expected metres: these look like millimetres. Divide by 1000, or give "
        f"{name} = {{ column = ..., scale = 1e-3 }} in [columns]."
    )


def _guess_angle(name: str, largest: float, _: float) -> str:
    if largest > 720.0:
        return "no plausible rotation vector in radians. Check the unit."
    return (
        "expected radians: these look like degrees. Multiply by pi/180, or give "
        f"{name} = {{ column = ..., scale = 0.017453292519943295 }} in [columns]."
    )
