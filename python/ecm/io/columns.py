"""Column names of the measurement table: what each holds, and the name that a wrong one means."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from ecm.io.arrays import B
from ecm.io.toml import closest
from ecm.io.units import find_unit

POSE = ("x_m", "y_m", "z_m", "theta_x_rad", "theta_y_rad", "theta_z_rad")
WRENCH = ("fx_N", "fy_N", "fz_N", "tau_x_Nm", "tau_y_Nm", "tau_z_Nm")
VELOCITY = tuple(f"v_{name}" for name in POSE)
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
_ACTUATION = re.compile(r"(?P<kind>pressure)_(?P<number>[1-9][0-9]*)_Pa")
_AMOUNT = re.compile(r"(?P<kind>volume)_(?P<number>[1-9][0-9]*)_m3")
_TENDON = re.compile(r"tendon[1-9][0-9]*_N")
_SHORT = tuple(name.rsplit("_", 1)[0] for name in (*WRENCH, *POSE))
STIFFNESS = tuple(f"k_{force}_{coordinate}" for force in _SHORT[:6] for coordinate in _SHORT[6:])
"""The 36 columns of `predict --stiffness`: k_fx_x ... k_tau_z_theta_z, row by row of K."""

_OTHER_UNITS = frozenset({"km", "urad", "g", "kg", "v", "volt", "mps", "rads", "degs"})
"""Words that may end a name besides the units of logs."""
_ALIASES = {
    "thetax": "theta_x_rad",
    "thetay": "theta_y_rad",
    "thetaz": "theta_z_rad",
    "taux": "tau_x_Nm",
    "tauy": "tau_y_Nm",
    "tauz": "tau_z_Nm",
    "temp": "temperature_degC",
    "poseid": "pose_id",
}


def is_standard(name: str) -> bool:
    """Whether a column of this name has a meaning here (docs/columns.md)."""
    if name in _STANDARD or name in _STIFFNESS:
        return True
    return any(pattern.fullmatch(name) for pattern in (_TENDON, _ACTUATION, _AMOUNT))


def actuation_columns(names: Iterable[str]) -> tuple[str, ...]:
    """Return the actuator inputs among column names, by number.

    Examples
    --------
    >>> actuation_columns(["pressure_2_Pa", "x_m", "pressure_1_Pa", "pressure_bar"])
    ('pressure_1_Pa', 'pressure_2_Pa')
    """
    return _by_number(_ACTUATION, names)


def amount_columns(names: Iterable[str]) -> tuple[str, ...]:
    """Return the volume changes of chambers among column names, by number.

    Examples
    --------
    >>> amount_columns(["volume_1_m3", "x_m"])
    ('volume_1_m3',)
    """
    return _by_number(_AMOUNT, names)


def _by_number(pattern: re.Pattern[str], names: Iterable[str]) -> tuple[str, ...]:
    found = [match for name in names if (match := pattern.fullmatch(name))]
    return tuple(match[0] for match in sorted(found, key=lambda match: int(match["number"])))


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


_STANDARD = frozenset(STANDARD)
_STIFFNESS = frozenset(STIFFNESS)
_NO_UNIT = ("pose_id", "run", "repeat", "leds_visible", *TEXT, *JOINT_SIGNS)
_SQUEEZED = {_squeeze(name.lower()): name for name in STANDARD}
_STEMS = {
    _squeeze(name.rsplit("_", 1)[0].lower()): name for name in STANDARD if name not in _NO_UNIT
} | _ALIASES
