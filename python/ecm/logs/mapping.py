"""Which column of a log becomes which standard column: proposed by names, refused where unclear."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH, is_standard, likely_name
from ecm.io.toml import did_you_mean
from ecm.logs.log import Log, unique_name
from ecm.logs.names import Named, Reading, read_name
from ecm.logs.rotations import COUNT, check_rotation_word
from ecm.logs.units import Unit, find_unit

_AXIS = {"x": 0, "y": 1, "z": 2}
_STANDARD = {"position": POSE[:3], "rotvec": POSE[3:], "force": WRENCH[:3], "torque": WRENCH[3:]}
_WITHOUT_AXIS = ("position", "rotation", "force", "torque")
_SI = {"length": "m", "angle": "rad", "force": "N", "torque": "Nm", "time": "s",
       "temperature": "degC"}  # fmt: skip
_USUAL = {"length": "mm", "angle": "deg", "force": "gf", "torque": "N mm", "temperature": "K"}
"""The other likely unit, for the question."""


@dataclass(frozen=True)
class Source:
    """A column of the log with its unit."""

    column: str
    unit: Unit

    def __str__(self) -> str:
        return self.column if self.unit.factor == 1.0 else f"{self.column} [{self.unit.word}]"


@dataclass(frozen=True)
class RotationSource:
    """Columns of the log that are one rotation, and the word for how they are."""

    word: str
    sources: tuple[Source, ...]

    def __str__(self) -> str:
        return f"{self.word} of {', '.join(map(str, self.sources))}"


@dataclass(frozen=True)
class ColumnMap:
    """What every standard column is read from.

    Parameters
    ----------
    columns
        Source by standard name.
    rotation
        Where the three rotations are one group: their source.
    own
        Columns of the log that are kept under a name of their own.
    """

    columns: Mapping[str, Source]
    rotation: RotationSource | None
    own: Mapping[str, str]


@dataclass(frozen=True)
class Wishes:
    """What the user said about a log.

    Parameters
    ----------
    columns
        Column of the log, `COLUMN` or `COLUMN:UNIT`, by standard name.
    rotation
        `WORD`, or `WORD:COLUMN,COLUMN,...` (rotations.py); empty: by the names.
    units
        Unit of each dimension for columns that state none.
    axis
        Axis of columns whose name has none: x, y or z.
    """

    columns: Mapping[str, str]
    rotation: str
    units: Mapping[str, Unit]
    axis: str


def propose(log: Log, wishes: Wishes, source: str) -> ColumnMap:
    """Return the mapping of a log's columns.

    Raises
    ------
    InputError
        For what has two readings; the message gives both and the option that decides.
    """
    named = {name: read_name(name, log.units.get(name, "")) for name in _renamed(log)}
    named = dict(zip(log.columns, named.values(), strict=True))
    found: dict[str, Source] = {}
    for standard, wish in wishes.columns.items():
        found[standard] = _wished(standard, wish, log, named, wishes)
    used = {entry.column for entry in found.values()}
    rotation = _rotation(named, wishes, log, source, used, found)
    used |= {entry.column for entry in rotation.sources} if rotation is not None else set()
    for name, own in named.items():
        if name in used:
            continue
        readings = _settled(own.readings, named, rotation)
        standards = {s for r in readings if (s := _standard(r, wishes.axis)) is not None}
        if len(standards) > 1:
            first, second = sorted(standards)[:2]
            raise InputError(
                f"{source}: column '{name}' may be {first} or {second}. Say which: "
                f"--map {first}={name} or --map {second}={name}"
            )
        if readings and not standards and readings[0].quantity in _WITHOUT_AXIS:
            _ask_axis(name, readings[0], source)
        for standard in standards - wishes.columns.keys():
            if standard in found:
                raise InputError(
                    f"{source}: columns '{found[standard].column}' and '{name}' may both be "
                    f'{standard}. Say which: --map "{standard}={name}" or '
                    f'--map "{standard}={found[standard].column}"'
                )
            found[standard] = Source(name, _unit(name, standard, own, wishes))
            used.add(name)
    _ask_units(found, log, source)
    own_names: dict[str, str] = {}
    for name in named:
        if name not in used:
            own_names[name] = unique_name(_own_name(name), {*own_names.values(), *found})
    return ColumnMap(found, rotation, own_names)


def _renamed(log: Log) -> list[str]:
    """The names with components of whole arrays written out: wrench.4 as torque.y."""
    names = []
    for name in log.columns:
        stem, dot, index = name.rpartition(".")
        size = sum(other.rpartition(".")[0] == stem for other in log.columns) if dot else 0
        if size == 6 and index.isdigit():
            word = stem.lower()
            group = "wrench" if any(w in word for w in ("wrench", "ft", "load", "force")) else ""
            group = group or ("pose" if "pose" in word or "twist" not in word else "")
            first, second = ("force", "torque") if group == "wrench" else ("position", "rotation")
            names.append(f"{first if int(index) < 3 else second}.{'xyz'[int(index) % 3]}")
        elif size == 3 and index.isdigit() and not stem[-1:].isdigit():
            names.append(f"{stem}.{'xyz'[int(index)]}")
        else:
            names.append(name)
    return names if len(set(names)) == len(names) else list(log.columns)


def _wished(
    standard: str, wish: str, log: Log, named: Mapping[str, Named], wishes: Wishes
) -> Source:
    """The source that --map gives: a column, or a column and its unit."""
    column, colon, word = _like(wish, log), "", ""
    if column not in log.columns:
        column, colon, word = wish.rpartition(":")
        column = _like(column if colon else wish, log)
    if column not in log.columns:
        raise InputError(
            f"--map {standard}={wish}: the log has no column '{column}', "
            f"{did_you_mean(column, log.columns)}"
        )
    if not is_standard(standard) and not standard.isidentifier():
        raise InputError(f"--map {standard}={wish}: '{standard}' is no column name")
    if colon:
        unit = find_unit(word)
        if unit is None:
            raise InputError(f"--map {standard}={wish}: '{word}' is no unit")
        dimension = _dimension(standard)
        if dimension and unit.dimension != dimension:
            raise InputError(
                f"--map {standard}={wish}: {unit.word} is a unit of {unit.dimension}, "
                f"expected one of {dimension}"
            )
        return Source(column, unit)
    return Source(column, _unit(column, standard, named[column], wishes))


def _like(name: str, log: Log) -> str:
    """The log's only column of this name without regard to case and separators, else the name."""
    if name in log.columns:
        return name
    alike = [own for own in log.columns if _squeezed(own) == _squeezed(name)]
    return alike[0] if len(alike) == 1 and _squeezed(name) else name


def _squeezed(name: str) -> str:
    return "".join(sign for sign in name.lower() if sign.isalnum())


def _dimension(standard: str) -> str:
    """Dimension of a standard column; empty for one without unit or of the user's own."""
    for words, dimension in (
        (("_Nm",), "torque"), (("_N",), "force"), (("_rad",), "angle"), (("_m",), "length"),
        (("time_s", "dwell_s"), "time"), (("_degC",), "temperature"),
    ):  # fmt: skip
        if is_standard(standard) and not standard.startswith("v_") and standard.endswith(words):
            return dimension
    return ""


_UNSTATED = Unit("", "unstated")


def _unit(column: str, standard: str, named: Named, wishes: Wishes) -> Unit:
    """The unit that name or user states; time without one is in seconds."""
    dimension = _dimension(standard)
    if column == standard or not dimension:
        return Unit("", "number")
    if named.unit is not None and named.unit.dimension == dimension:
        return named.unit
    if dimension in wishes.units:
        return wishes.units[dimension]
    return Unit("", dimension) if dimension in ("time", "temperature") else _UNSTATED


def _ask_units(found: Mapping[str, Source], log: Log, source: str) -> None:
    """Raise InputError for columns without a unit, with what each reading would mean."""
    without = [(name, entry.column) for name, entry in found.items() if entry.unit is _UNSTATED]
    if not without:
        return
    lines, words = [], dict[str, str]()
    for standard, column in without:
        dimension = _dimension(standard)
        first, second = _SI[dimension], _USUAL[dimension]
        words[dimension] = second
        low, high = float(log.columns[column].min()), float(log.columns[column].max())
        lines.append(f"  {column}: {low:.4g} to {high:.4g}, in {first} or in {second}?")
    other = ",".join(words.values())
    raise InputError(
        f"{source}: no unit is stated for {len(without)} column(s):\n"
        + "\n".join(lines[:12])
        + f'\nSay it once for all: --units SI (m, rad, N, N m), or e.g. --units "{other}"; '
        "for one column --map NAME=COLUMN:UNIT."
    )


def _settled(
    readings: Sequence[Reading], named: Mapping[str, Named], rotation: RotationSource | None
) -> list[Reading]:
    """The readings that what else the log holds leaves over."""
    left = [r for r in readings if r.quantity not in ("quaternion", "matrix", "euler", "clinical")]
    if rotation is not None:
        left = [r for r in left if r.quantity not in ("rotvec", "rotation")]
    if len(left) > 1:  # tx beside mx is a translation, beside px a torque
        sure = {n.readings[0].quantity for n in named.values() if len(n.readings) == 1}
        left = [r for r in left if r.quantity not in sure] or left
    return left


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
            "mechanism's own axis, which is x, or across it? Say --axis x, or --axis y or z"
        )


def _rotation(
    named: Mapping[str, Named],
    wishes: Wishes,
    log: Log,
    source: str,
    used: set[str],
    found: Mapping[str, Source],
) -> RotationSource | None:
    """The columns that are one rotation, by the user's word or by their names."""
    if any(name in found for name in POSE[3:]):
        return None
    word, colon, listed = wishes.rotation.partition(":")
    if word:
        count = check_rotation_word(word)
        if colon:
            columns = [_like(name.strip(), log) for name in listed.split(",")]
            for name in columns:
                if name not in log.columns:
                    raise InputError(
                        f"--rotation {wishes.rotation}: the log has no column '{name}', "
                        f"{did_you_mean(name, log.columns)}"
                    )
        else:
            columns = _columns_of(word, named, used)
        if len(columns) != count:
            raise InputError(
                f"--rotation {word}: expected {count} columns, found {len(columns)} "
                f"({', '.join(columns) or 'none'}). Name them: --rotation {word}:COLUMN,COLUMN,..."
            )
        return _rotation_source(word, columns, named, wishes, log, source)
    groups = _groups(named, used)
    if len(groups) > 1:
        shown = " or ".join(f"{kind} ({', '.join(names)})" for kind, names in groups.items())
        raise InputError(
            f"{source}: the rotation may be {shown}. Say which with --rotation WORD:COLUMN,..."
        )
    for kind, columns in groups.items():
        return _rotation_source(
            _word(kind, columns, named, source), columns, named, wishes, log, source
        )
    return None


def _word(kind: str, columns: Sequence[str], named: Mapping[str, Named], source: str) -> str:
    """Word of a group of columns; InputError where it has two readings."""
    parts = "".join(_part(named[name], kind) for name in columns)
    shown = ", ".join(columns)
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
            names = [n for n in names if _part(named[n], kind) in _AXIS]
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
    wishes: Wishes,
    log: Log,
    source: str,
) -> RotationSource:
    number = Unit("", "number")
    if COUNT.get(word, 3) != 3:
        if word == "xyzw" and "w" in [_part(named[n], "quaternion") for n in columns[:1]]:
            columns = [*columns[1:], columns[0]]
        return RotationSource(word, tuple(Source(name, number) for name in columns))
    sources = {
        f"theta_{axis}_rad": Source(name, _unit(name, f"theta_{axis}_rad", named[name], wishes))
        for axis, name in zip("xyz", columns, strict=True)
    }
    _ask_units(sources, log, source)
    return RotationSource(word, tuple(sources.values()))


def _own_name(name: str) -> str:
    """A name for a column that is kept as it is: letters, digits and _."""
    text = "".join(c if c.isalnum() and c.isascii() else "_" for c in name).strip("_").lower()
    text = text if text and not text[0].isdigit() else f"own_{text}"
    return f"own_{text}" if is_standard(text) or likely_name(text) else text
