"""The columns of a log that are one rotation, by the user's word or by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ecm.errors import InputError
from ecm.io.columns import POSE
from ecm.io.toml import did_you_mean
from ecm.io.units import Unit
from ecm.logs.log import Log
from ecm.logs.names import Named
from ecm.logs.rotations import COUNT, check_rotation_word
from ecm.logs.sources import (
    RotationSource,
    Source,
    UserChoices,
    ask_units,
    column_like,
    stated_unit,
)


def rotation_of(
    named: Mapping[str, Named],
    choices: UserChoices,
    log: Log,
    source: str,
    used: set[str],
    found: Mapping[str, Source],
) -> RotationSource | None:
    """The columns that are one rotation, by the user's word or by their names."""
    if any(name in found for name in POSE[3:]):
        return None
    word, colon, listed = choices.rotation.partition(":")
    if word:
        count = check_rotation_word(word)
        if colon:
            columns = [column_like(name.strip(), log) for name in listed.split(",")]
            for name in columns:
                if name not in log.columns:
                    raise InputError(
                        f"--rotation {choices.rotation}: the log has no column '{name}', "
                        f"{did_you_mean(name, log.columns)}"
                    )
        else:
            columns = _columns_of(word, named, used)
        if len(columns) != count:
            raise InputError(
                f"--rotation {word}: expected {count} columns, found {len(columns)} "
                f"({', '.join(columns) or 'none'}). Name them: --rotation {word}:COLUMN,COLUMN,..."
            )
        return _rotation_source(word, columns, named, choices, log, source)
    groups = _groups(named, used)
    if len(groups) > 1:
        shown = " or ".join(f"{kind} ({', '.join(names)})" for kind, names in groups.items())
        raise InputError(
            f"{source}: the rotation may be {shown}. Say which with --rotation WORD:COLUMN,..."
        )
    for kind, columns in groups.items():
        return _rotation_source(
            _word(kind, columns, named, source), columns, named, choices, log, source
        )
    return None


def _word(kind: str, columns: Sequence[str], named: Mapping[str, Named], source: str) -> str:
    """Word of a group of columns; InputError where it has two readings."""
    parts = "".join(_part(named[name], kind) for name in columns)
    shown = ", ".join(columns)
    orders = {word for word in ("wxyz", "xyzw") if word in columns[0].lower()}
    if kind == "quaternion" and len(orders) == 1 and "w" not in parts:
        return orders.pop()
    if kind == "quaternion" and "w" in parts:
        return "wxyz" if parts == "wxyz" else "xyzw"
    if kind == "matrix" and len(parts) == 18:
        return "rows"
    if kind == "rotvec":
        return "rotvec"
    if kind == "euler":
        return "xyz"
    first, second, why = {
        "quaternion": ("wxyz", "xyzw", "a quaternion with its scalar first or last"),
        "matrix": ("rows", "columns", "a rotation matrix row by row or column by column"),
        "rotation": ("rotvec", "xyz", "a rotation vector, or Euler angles of a sequence"),
        "clinical": ("grood-suntay-right", "grood-suntay-left", "a right knee or a left one"),
    }[kind]
    raise InputError(
        f"{source}: {shown} may be {why}. Say which: --rotation {first} or --rotation {second}"
    )


def _part(named: Named, kind: str) -> str:
    return next((r.part for r in named.readings if r.quantity == kind), "")


_NEEDED = {"quaternion": 4, "matrix": 9, "rotvec": 3, "rotation": 3, "euler": 3, "clinical": 3}
_ORDER = {part: i for i, part in enumerate(
    ["w", "x", "y", "z", "roll", "pitch", "yaw", "flexion", "adduction", "internal"]
)}  # fmt: skip


def _groups(named: Mapping[str, Named], used: set[str]) -> dict[str, list[str]]:
    """Columns of each kind of rotation that is complete, in the order of their parts."""
    groups: dict[str, list[str]] = {}
    for kind, count in _NEEDED.items():
        names = [n for n, own in named.items() if n not in used and _part(own, kind)]
        if kind == "rotation":  # r11 is of a matrix, angle without axis is no group
            names = [n for n in names if _part(named[n], kind) in ("x", "y", "z")]
        if len(names) == count:
            names.sort(key=lambda n: (_ORDER.get(_part(named[n], kind), 99), _part(named[n], kind)))
            groups[kind] = names
    if "quaternion" in groups and "rotation" in groups:
        del groups["rotation"]
    if "matrix" in groups:
        groups.pop("rotation", None)
    return groups


def _columns_of(word: str, named: Mapping[str, Named], used: set[str]) -> list[str]:
    """The columns that a word of a rotation can be of, by their names."""
    kinds = {
        "wxyz": ("quaternion",),
        "xyzw": ("quaternion",),
        "rows": ("matrix",),
        "columns": ("matrix",),
        "rotvec": ("rotvec", "rotation"),
    }.get(word, ("clinical",) if word.startswith("grood") else ("euler", "rotation", "rotvec"))
    groups = _groups(named, used)
    for kind in kinds:
        if kind in groups:
            columns = groups[kind]
            parts = [_part(named[name], kind) for name in columns]
            if kind == "quaternion" and "w" in parts and word == "xyzw":
                return [*columns[1:], columns[0]]
            if word == "columns":  # one after the other as in the log, whatever their indices
                return [name for name in named if name in columns]
            if kind in ("euler", "rotation", "rotvec") and word not in COUNT:
                if len(set(word.lower())) < 3:  # ZYZ: no name says which turn about z is meant
                    return []
                by_axis = dict(zip("xyz", columns, strict=True))
                return [by_axis[axis] for axis in word.lower() if axis in by_axis]
            return columns
    return []


def _rotation_source(
    word: str,
    columns: Sequence[str],
    named: Mapping[str, Named],
    choices: UserChoices,
    log: Log,
    source: str,
) -> RotationSource:
    number = Unit("", "number")
    if COUNT.get(word, 3) != 3:
        if word == "xyzw" and "w" in [_part(named[n], "quaternion") for n in columns[:1]]:
            columns = [*columns[1:], columns[0]]
        return RotationSource(word, tuple(Source(name, number) for name in columns))
    sources = {
        f"theta_{axis}_rad": Source(
            name, stated_unit(name, f"theta_{axis}_rad", named[name], choices)
        )
        for axis, name in zip("xyz", columns, strict=True)
    }
    ask_units(sources, log, source)
    return RotationSource(word, tuple(sources.values()))
