"""Which columns of a log become standard columns: proposed by names, refused where unclear."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH, is_standard, likely_name
from ecm.io.toml import did_you_mean
from ecm.io.units import Unit
from ecm.logs.log import Log, unique_names
from ecm.logs.names import DIMENSION, Named, Reading, read_name, trailing_units
from ecm.logs.rotations import COUNT, check_rotation_word
from ecm.logs.sources import (
    ColumnMap,
    RotationSource,
    Source,
    UserChoices,
    ask_units,
    chosen_source,
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


_AXIS = {"x": 0, "y": 1, "z": 2}
_STANDARD = {"position": POSE[:3], "rotvec": POSE[3:], "force": WRENCH[:3], "torque": WRENCH[3:]}
_UNIT, _MOST_ROWS = 1e-3, 0.9
"""Error of a unit quaternion's length, and the share of rows in which four numbers are one."""
_WITHOUT_AXIS = ("position", "rotation", "force", "torque")


def propose(log: Log, choices: UserChoices, source: str) -> ColumnMap:
    """Return the mapping of a log's columns.

    Raises
    ------
    InputError
        For what has two readings; the message gives both and the option that decides.
    """
    named = _read_names(log)
    found: dict[str, Source] = {}
    for standard, choice in choices.columns.items():
        found[standard] = chosen_source(standard, choice, log, named, choices)
    used = {entry.column for entry in found.values()}
    rotation = rotation_of(named, choices, log, source, used, found)
    used |= {entry.column for entry in rotation.sources} if rotation is not None else set()
    sure = {n.readings[0].quantity for n in named.values() if len(n.readings) == 1}
    poses = rotation is not None or any(name in POSE for name in choices.columns)
    needed = poses and any(name in WRENCH for name in choices.columns)
    notes: list[str] = []
    for name, own in named.items():
        if name in used:
            continue
        readings = _settled(own.readings, sure, rotation)
        standards = {s for r in readings if (s := _standard(r, choices.axis)) is not None}
        doubtful = _doubtful(readings, standards)
        # Whoever has named pose and wrench need not say what each other column is.
        if doubtful and (needed or doubtful <= choices.columns.keys()):
            notes.append(
                f"column '{name}' may be {' or '.join(sorted(doubtful))}, and is kept as your own: "
                "--map decides"
            )
            continue
        if len(standards) > 1:
            first, second = sorted(standards)[:2]
            raise InputError(
                f"{source}: column '{name}' may be {first} or {second}. Say which: "
                f"--map {first}={name} or --map {second}={name}"
            )
        if readings and not standards and readings[0].quantity in _WITHOUT_AXIS:
            _ask_axis(name, readings[0], source)
        for standard in standards - choices.columns.keys():
            if standard in found:
                raise InputError(
                    f"{source}: columns '{found[standard].column}' and '{name}' may both be "
                    f'{standard}. Say which: --map "{standard}={name}" or '
                    f'--map "{standard}={found[standard].column}"'
                )
            found[standard] = Source(name, stated_unit(name, standard, own, choices))
            used.add(name)
    ask_units(found, log, source)
    left = [name for name in named if name not in used]
    own_names = unique_names(map(_own_name, left), taken=found)
    return ColumnMap(found, rotation, dict(zip(left, own_names, strict=True)), tuple(notes))


def _doubtful(readings: Sequence[Reading], standards: set[str]) -> set[str]:
    """Standard names between which a name does not decide; empty where it does, or says nothing."""
    if len(standards) > 1:
        return standards
    if readings and not standards and readings[0].quantity in _WITHOUT_AXIS:
        quantity = readings[0].quantity
        return set(_STANDARD["rotvec" if quantity == "rotation" else quantity])
    return set()


def _read_names(log: Log) -> dict[str, Named]:
    """The readings of every column; arrays state units at the end of their name: position_mm."""
    named: dict[str, Named] = {}
    for name, shown in zip(log.columns, _renamed(log), strict=True):
        own = read_name(shown, log.units.get(name, ""))
        repeated = re.fullmatch(r"(.*)_[2-9]", name)
        if repeated is not None and repeated[1] in named and not _is_pose_or_wrench(own):
            own = named[repeated[1]]  # a name that is there twice is asked about
        units = trailing_units(name.rpartition(".")[0])[1] if shown != name else {}
        stated = tuple(r for r in own.readings if DIMENSION.get(r.quantity) in units)
        if own.unit is None and stated:
            own = Named(stated, units[DIMENSION[stated[0].quantity]])
        named[name] = own
    return named


def _is_pose_or_wrench(named: Named) -> bool:
    return any(_standard(reading, "x") is not None for reading in named.readings)


def _renamed(log: Log) -> list[str]:
    """Names without that of a struct around all; of arrays by component: wrench.4 as torque.y."""
    names = []
    whole = {name.partition(".")[0] for name in log.columns}
    inner = [name.partition(".")[2] for name in log.columns]
    begin = len(next(iter(whole))) + 1 if len(whole) == 1 and all(map(_is_word, inner)) else 0
    arrays = _arrays(log)
    of_poses = {
        n: part for stem, own in arrays.items() for n, part in _pose_parts(log, stem, own).items()
    }
    sizes = Counter(name.rpartition(".")[0] for name in log.columns)
    for name in log.columns:
        stem, dot, index = name.rpartition(".")
        size = sizes[stem] if dot else 0
        if name in of_poses:
            names.append(of_poses[name])
        elif size == 6 and index.isdigit():
            word = stem.lower()
            group = "wrench" if any(w in word for w in ("wrench", "ft", "load", "force")) else ""
            group = group or ("pose" if "pose" in word or "twist" not in word else "")
            first, second = ("force", "torque") if group == "wrench" else ("position", "rotation")
            names.append(f"{first if int(index) < 3 else second}.{'xyz'[int(index) % 3]}")
        elif size == 3 and index.isdigit() and not stem[-1:].isdigit():
            names.append(f"{trailing_units(stem)[0][begin:]}_{'xyz'[int(index)]}")
        else:
            names.append(name[begin:])
    return names if len(set(names)) == len(names) else list(log.columns)


def _is_word(name: str) -> bool:
    return name[:1].isalpha()


def _arrays(log: Log) -> dict[str, list[str]]:
    """Columns that begin with the name of an array, by that name."""
    begin: dict[str, list[str]] = {}
    for name in log.columns:
        for dot in (place for place, sign in enumerate(name) if sign == "."):
            begin.setdefault(name[:dot], []).append(name)
    whole = {name.rstrip("0123456789.") for name in log.columns if name[-1:].isdigit()}
    return {stem: begin[stem] for stem in dict.fromkeys(whole) if f"{stem}.0" in log.columns
            or f"{stem}.0.0" in log.columns}  # fmt: skip


def _pose_parts(log: Log, stem: str, own: list[str]) -> dict[str, str]:
    """What the components of a whole pose are: place and rotation matrix, or place and quaternion.

    Seven numbers are a pose where four at an end are a unit quaternion: joints are not.
    """
    matrix = [f"{stem}.{i}.{j}" for i in range(3) for j in range(4)]
    if own == matrix:
        place = {f"{stem}.{i}.3": f"position.{'xyz'[i]}" for i in range(3)}
        return place | {f"{stem}.{i}.{j}": f"r{i + 1}{j + 1}" for i in range(3) for j in range(3)}
    if own != [f"{stem}.{i}" for i in range(7)]:
        return {}
    values = np.stack([log.columns[name] for name in own], axis=1)
    for first in (3, 0):
        length = np.linalg.norm(values[:, first : first + 4], axis=1)
        if np.mean(np.abs(length - 1.0) < _UNIT) > _MOST_ROWS:
            turn = {own[first + i]: f"q{i}" for i in range(4)}
            return turn | {own[(first + 4 + i) % 7]: f"position.{'xyz'[i]}" for i in range(3)}
    return {}


def _settled(
    readings: Sequence[Reading], sure: Collection[str], rotation: RotationSource | None
) -> list[Reading]:
    """The readings that what else the log holds, of these `sure` quantities, leaves over."""
    left = [r for r in readings if r.quantity not in ("quaternion", "matrix", "euler", "clinical")]
    if rotation is not None:
        left = [r for r in left if r.quantity not in ("rotvec", "rotation")]
    if len(left) > 1:  # tx beside mx is a translation, beside px a torque
        left = [r for r in left if r.quantity not in sure] or left
    return left


def standard_of(reading: Reading) -> str | None:
    """Return the standard name that a reading tells by itself; None where an axis is missing."""
    return _standard(reading, "")


def _standard(reading: Reading, axis: str) -> str | None:
    """Standard name of a reading; None where its axis is not known."""
    if reading.quantity == "standard":
        return reading.part
    if reading.quantity == "time":
        return "time_s"
    if reading.quantity == "temperature":
        return "temperature_degC"
    quantity = (
        "rotvec" if reading.quantity == "rotation" and reading.part == "" else (reading.quantity)
    )
    part = reading.part or axis
    if quantity not in _STANDARD or part not in _AXIS:
        return None
    return _STANDARD[quantity][_AXIS[part]]


def _ask_axis(name: str, reading: Reading, source: str) -> None:
    if reading.part == "":
        what = "displacement" if reading.quantity == "position" else reading.quantity
        raise InputError(
            f"{source}: column '{name}' is a {what} without an axis: along (or about) the "
            "mechanism's own axis, which is x, or across it? Say --axis x, or --axis y or z; where "
            f'several have none, each by itself: --map "{_likely(reading)}={name}"'
        )


def _likely(reading: Reading) -> str:
    """A standard name of a reading without an axis, for an example."""
    return _STANDARD["rotvec" if reading.quantity == "rotation" else reading.quantity][0]


def _own_name(name: str) -> str:
    """A name for a column that is kept as it is: letters, digits and _."""
    text = "".join(c if c.isalnum() and c.isascii() else "_" for c in name).strip("_").lower()
    text = text if text and not text[0].isdigit() else f"own_{text}"
    return f"own_{text}" if is_standard(text) or likely_name(text) else text
