"""What a column of a log is, by its name: quantity, axis and unit.

Case and separators do not matter. A name with two readings gets both: who asks decides by what else
the log holds, or asks the user.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from ecm.io.columns import is_standard
from ecm.io.units import Unit, find_unit, is_other_unit

DIMENSION = {
    "position": "length",
    "force": "force",
    "torque": "torque",
    "rotvec": "angle",
    "rotation": "angle",
    "euler": "angle",
    "clinical": "angle",
    "quaternion": "number",
    "matrix": "number",
    "time": "time",
    "temperature": "temperature",
}
"""Dimension of each quantity."""


@dataclass(frozen=True)
class Reading:
    """One reading of a name.

    Parameters
    ----------
    quantity
        A key of `DIMENSION`, or `standard` for a name of this project.
    part
        Axis, component of a quaternion or matrix, angle's name; empty where the name has none.
    """

    quantity: str
    part: str = ""


@dataclass(frozen=True)
class Named:
    """The readings of a name, likeliest first, and the unit that it states."""

    readings: tuple[Reading, ...]
    unit: Unit | None = None


_WORDS = {
    "position": "pos position p disp displ displacement deflection translation trans location loc "
    "coordinate extension stroke elongation weg verschiebung",
    "force": "f force load kraft",
    "torque": "m torque moment tau trq mom drehmoment",
    "rotvec": "theta rotvec rv rodrigues axisangle",
    "rotation": "r rot rotation angle ang euler winkel deviation phi alpha",
    "quaternion": "q quat quaternion orientation ori",
    "matrix": "r rot rotation matrix dcm",
    "time": "t time timestamp stamp timestamps elapsed zeit clock",
    "temperature": "temp temperature",
}
_QUANTITIES: dict[str, list[str]] = {}
for _quantity, _names in _WORDS.items():
    for _name in _names.split():
        _QUANTITIES.setdefault(_name, []).append(_quantity)
_LONG_WORDS = sorted((word for word in _QUANTITIES if len(word) > 2), key=len, reverse=True)
_EULER = {"roll": "x", "pitch": "y", "yaw": "z"}
_CLINICAL = {
    "flexion": "flexion", "flex": "flexion", "extensionflexion": "flexion",
    "adduction": "adduction", "varus": "adduction", "varusvalgus": "adduction",
    "internal": "internal", "internalrotation": "internal", "axialrotation": "internal",
    "internalrot": "internal", "introtation": "internal", "introt": "internal",
    "axialrot": "internal", "tibialrotation": "internal", "tibialrot": "internal",
    "internalexternal": "internal", "internalexternalrotation": "internal",
}  # fmt: skip
_IGNORED = frozenset(
    {"pose", "tool", "tcp", "tip", "top", "platform", "marker", "rigid", "body", "ft", "fts", "ati"}
    | {"sensor", "measured", "actual", "meas", "robot", "ee", "end", "effector", "wrench", "msg"}
    | {"transform", "data", "value", "raw", "mean", "avg", "signal", "channel", "ch", "stamped"}
    | {"joint", "the", "of", "in", "about", "component", "wxyz", "xyzw"}
)
"""Words that say where or how something was measured, not what."""
_SIDES = frozenset({"r", "l", "right", "left"})
"""Last words that say which of two limbs: ankle_angle_r."""
_NOT_MEASURED = frozenset(
    {"error", "err", "limit", "commanded", "command", "cmd", "target", "desired", "setpoint"}
    | {"reference", "ref", "std", "sd", "sigma", "variance", "max", "min", "bias", "tare", "arm"}
    | {"velocity", "speed", "rate", "acceleration"}
)
"""Words of numbers that belong to a pose or wrench but are no reading of it."""


def read_name(name: str, unit_word: str = "") -> Named:
    """Return the readings of a column's name.

    Parameters
    ----------
    name
        As in the log.
    unit_word
        Unit that the log states for this column elsewhere.

    Examples
    --------
    >>> named = read_name("Force-X (lbf)")
    >>> named.readings[0], named.unit.factor
    (Reading(quantity='force', part='x'), 4.4482216152605)
    >>> [reading.quantity for reading in read_name("tx").readings]
    ['position', 'torque']
    >>> read_name("Force X (V)").readings, read_name("Force X limit").readings
    ((), ())
    """
    if is_standard(name):
        return Named((Reading("standard", name),))
    unit = find_unit(unit_word) if unit_word else None
    bracket = re.fullmatch(r"(.*?)[\s_]*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*", name)
    if bracket is not None and bracket[1]:
        unit_word = unit_word or bracket[2]
        name, unit = bracket[1], unit or find_unit(bracket[2])
    comma = re.fullmatch(r"(.*\w)\s*,\s*([^,]+)", name)
    if comma is not None and find_unit(comma[2]) is not None:
        name, unit = comma[1], unit or find_unit(comma[2])
    tokens = _tokens(name)
    last = tokens[-1] if len(tokens) > 1 else ""
    if is_other_unit(unit_word) or is_other_unit(last):
        return Named(())
    for size in (2, 1):
        found = find_unit("".join(tokens[-size:])) if len(tokens) > size else None
        if found is None or _NOT_MEASURED.intersection(tokens[:-size]):
            continue
        readings = _readings(tokens[:-size])
        fitting = tuple(r for r in readings if DIMENSION[r.quantity] == found.dimension)
        if fitting:
            return Named(fitting, found)  # time_min is in minutes, fx_min is a smallest force
    if _NOT_MEASURED.intersection(tokens):
        return Named(())
    readings = _readings(tokens)
    outer = re.match(r"[^./]*[./](?=.*[A-Za-z])", name)
    if not readings and outer is not None and not _is_axis(name[outer.end() :]):
        # log.t of a struct, /rig/ft/force.x of a topic; gyro.x is no position
        return read_name(name[outer.end() :], unit.word if unit is not None else unit_word)
    if unit is not None:
        readings = tuple(r for r in readings if DIMENSION[r.quantity] == unit.dimension)
    return Named(readings, unit)


def trailing_units(name: str) -> tuple[str, dict[str, Unit]]:
    """Return the name of an array without the units at its end, and these by dimension.

    Examples
    --------
    >>> name, units = trailing_units("Wrench [N, N mm]")
    >>> name, {dimension: unit.word for dimension, unit in units.items()}
    ('Wrench', {'force': 'N', 'torque': 'Nmm'})
    >>> trailing_units("position_mm")[0], trailing_units("force")
    ('position', ('force', {}))
    """
    bracket = re.fullmatch(r"(.*?)[\s_]*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*", name)
    if bracket is not None and bracket[1]:
        given = [find_unit(word) for word in bracket[2].split(",")]
        return bracket[1], {unit.dimension: unit for unit in given if unit is not None}
    units: dict[str, Unit] = {}
    while True:
        cut = re.fullmatch(r"(.*[A-Za-z0-9])[\s_.-]+([A-Za-z°µ]+)", name)
        found = find_unit(cut[2]) if cut is not None else None
        if cut is None or found is None or found.dimension in units:
            return name, units
        name, units[found.dimension] = cut[1], found


def _is_axis(name: str) -> bool:
    return name.strip().lower() in ("x", "y", "z")


def _tokens(name: str) -> list[str]:
    """Words of a name: 'ForceX', 'force_x' and 'Force X' are ['force', 'x']."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z0-9])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    return [token.lower() for token in re.split(r"[^A-Za-z0-9°µ]+", spaced) if token]


def _readings(tokens: list[str]) -> tuple[Reading, ...]:
    labview = tokens == ["x", "value"]  # LabVIEW's first column, which mostly is time
    tokens = [token for token in tokens if token not in _IGNORED] or tokens[-1:]
    joined = "".join(tokens)
    if joined in _CLINICAL:
        return (Reading("clinical", _CLINICAL[joined]),)
    for token in tokens:
        if token in _EULER:
            return (Reading("euler", token),)
        if token in ("adduction", "varus", "flexion"):
            return (Reading("clinical", _CLINICAL[token]),)
    if len(tokens) > 1 and tokens[-1] in _SIDES:
        tokens = tokens[:-1]
    stem, part = _split_axis(tokens)
    if stem in ("", "own") and part in ("x", "y", "z"):
        position = (Reading("position", part),)
        return (Reading("time"), *position) if labview else position
    found = [Reading(q, part) for q in _quantities(stem) if _fits(q, part)]
    if stem == "t" and part:
        return (Reading("position", part), Reading("torque", part))
    return tuple(found)


def _quantities(stem: str) -> list[str]:
    """Quantities of a stem; of two words the last known one counts, so 'wrench torque' is one."""
    if stem in _QUANTITIES:
        return _QUANTITIES[stem]
    ends = (word for word in _LONG_WORDS if stem.endswith(word))
    begins = (word for word in _LONG_WORDS if stem.startswith(word))
    word = next(ends, None) or next(begins, None)
    return [] if word is None else _QUANTITIES[word]


def _split_axis(tokens: list[str]) -> tuple[str, str]:
    """Stem and part: ['force', 'x'], ['fx'], ['x', 'force'] and ['q', '0'], ['r', '1', '2']."""
    text = [token for token in tokens if token not in "xyzw" and not token.isdigit()]
    parts = [token for token in tokens if token not in text]
    if parts:
        return "".join(text), "".join(parts)
    match = re.fullmatch(r"([a-z]+?)([xyzw]|[0-9]{1,2})", "".join(text))
    if match is not None and (match[1] in _QUANTITIES or match[1] == ""):
        return match[1], match[2]
    return "".join(text), ""


def _fits(quantity: str, part: str) -> bool:
    """Whether a quantity can have this part."""
    if quantity == "matrix":
        return bool(re.fullmatch(r"[0-9]{1,2}|[xyz]{2}", part))
    if quantity == "quaternion":
        return part in ("x", "y", "z", "w", "0", "1", "2", "3", "4")
    if quantity in ("time", "temperature"):
        return part == ""
    return part in ("", "x", "y", "z", "0", "1", "2", "3")
