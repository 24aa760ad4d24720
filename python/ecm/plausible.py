"""Do the numbers look like metres and radians? Refused with the guess where they do not."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from ecm.columns import POSE
from ecm.errors import InputError
from ecm.faults import Faults

_REACH_M = 2.0
"""Without a length: no mechanism here is longer."""
_REACH_LENGTHS = 5.0
"""With a length: no pose is farther from the base than so many lengths."""
_FEW = 0.1
"""Below this share of rows it is the rows that are wrong, not the unit."""


def check_poses(
    columns: Mapping[str, NDArray[np.float64]], length_m: float | None, faults: Faults
) -> None:
    """Note single implausible rows in `faults`; InputError where the unit seems to be another."""
    limit = _REACH_M if length_m is None else max(_REACH_LENGTHS * length_m, 1e-9)
    for name in POSE[:3]:
        if name in columns:
            _check(name, columns[name], limit, _length_guess, faults)
    for name in POSE[3:]:
        if name in columns:
            _check(name, columns[name], math.pi, _angle_guess, faults)
    if all(name in columns for name in POSE[3:]):
        angle = np.sqrt(sum(columns[name] ** 2 for name in POSE[3:]))
        for row in np.flatnonzero(angle >= math.pi):
            if all(abs(columns[name][row]) <= math.pi for name in POSE[3:]):
                faults.add(
                    int(row),
                    "",
                    f"a rotation vector of {angle[row]:.4g} rad",
                    "less than pi (the shorter way round)",
                )


def _check(
    name: str,
    values: NDArray[np.float64],
    limit: float,
    guess: Callable[[str, float, float], str],
    faults: Faults,
) -> None:
    outside = np.flatnonzero(np.abs(values) > limit)
    if len(outside) == 0:
        return
    if len(outside) > _FEW * len(values):
        largest = float(np.max(np.abs(values)))
        raise InputError(
            f"{faults.source}: column '{name}', {faults.place(int(outside[0]))}: found "
            f"{values[outside[0]]:g} ({len(outside)} of {len(values)} rows beyond {limit:.3g}), "
            f"{guess(name, largest, limit)}"
        )
    unit = "m" if name in POSE[:3] else "rad"
    for row in outside:
        faults.add(int(row), name, f"{values[row]:g}", f"at most {limit:.3g} {unit}")


def _length_guess(name: str, largest: float, limit: float) -> str:
    if largest / 1e3 <= limit:
        return (
            "expected metres: these look like millimetres. Divide by 1000, or give "
            f"{name} = {{ column = ..., scale = 1e-3 }} in [columns]."
        )
    return "no plausible position in metres. Check the unit and the frame."


def _angle_guess(name: str, largest: float, _limit: float) -> str:
    if largest <= 720.0:
        return (
            "expected radians: these look like degrees. Multiply by pi/180, or give "
            f"{name} = {{ column = ..., scale = 0.017453292519943295 }} in [columns]."
        )
    return "no plausible rotation vector in radians. Check the unit."
