"""Sources of standard columns in a log, and their conversion to SI; rotations and back.

R is the rotation of the top frame:

| word | columns | R |
|---|---|---|
| `rotvec` | 3 | exp of the vector |
| `wxyz`, `xyzw` | 4 | of the quaternion, scalar first or last |
| `rows`, `columns` | 9 | the matrix, its rows (or columns) one after the other |
| `ZYX`, ... (capitals) | 3 | turns about the moving axes, in this order (intrinsic) |
| `xyz`, ... (small) | 3 | turns about the fixed axes, in this order (extrinsic) |
| `grood-suntay-right`, `-left` | 3 | flexion, adduction, internal rotation of a knee |

Grood and Suntay (1983), with x to the right, y to the front and z up of the femur, and flexion f,
adduction a and internal rotation i: R = Rx(-f) Ry(-a) Rz(i) of a right knee, Rx(-f) Ry(a) Rz(-i)
of a left one.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm._native import rotation_matrices, rotation_vectors
from ecm.errors import InputError
from ecm.io.arrays import B, F
from ecm.io.columns import MAY_BE_EMPTY, POSE, TEXT, WHOLE, WRENCH, Unit, is_standard
from ecm.io.description import shown_ranges
from ecm.io.sanity import EPOCH_S
from ecm.io.se3 import ORDERS, quaternions_of, vectors_of
from ecm.io.settings import did_you_mean
from ecm.io.validate import is_unsorted, is_word
from ecm.logs.log import Log
from ecm.logs.names import (
    SI,
    Answer,
    Named,
    Question,
    find_unit,
    ranges,
    trailing_units,
    unknown_unit,
)

COUNT = {
    "rotvec": 3, "wxyz": 4, "xyzw": 4, "rows": 9, "columns": 9,
    "grood-suntay-right": 3, "grood-suntay-left": 3,
}  # fmt: skip
"""Number of columns of each word; sequences of Euler angles have three."""
_NORM = 1e-3
"""Quaternions and matrices that are farther from unit size are said."""
_UNUSABLE = 0.5
"""A quaternion shorter than this, or a matrix this far from a rotation, has no direction."""


def check_rotation_word(word: str) -> int:
    """Return the number of columns; InputError for a word that names no rotation.

    It is one of the table above, or a sequence such as `ZYX` or `xyz`.
    """
    sequence = re.fullmatch(r"[XYZ]{3}|[xyz]{3}", word)
    if word not in COUNT and (sequence is None or word[0] == word[1] or word[1] == word[2]):
        raise InputError(
            f"rotation '{word}': expected {', '.join(COUNT)}, or a sequence of Euler angles, e.g. "
            "ZYX about moving axes or xyz about fixed axes"
        )
    return COUNT.get(word, 3)


def to_rotation_vectors(word: str, values: F) -> tuple[F, B, str]:
    """Return rotation vectors of length below pi from what a log holds.

    Parameters
    ----------
    word
        One of the table above.
    values
        (N, k) columns; angles in rad.

    Returns
    -------
    vectors, usable, note
        (N, 3) rad; (N,) whether the row holds a rotation (else its vector is NaN); what was
        normalised, in words.

    Examples
    --------
    >>> half = np.sqrt(0.5)
    >>> to_rotation_vectors("wxyz", np.array([[half, 0.0, 0.0, half]]))[0].round(4)
    array([[0.    , 0.    , 1.5708]])
    """
    usable: B = np.asarray(np.isfinite(values).all(axis=1))
    note = ""
    if word in ORDERS:
        size = np.linalg.norm(np.where(usable[:, None], values, 1.0), axis=1)
        usable &= size > _UNUSABLE
        off = usable & (np.abs(size - 1.0) > _NORM)
        if off.any():
            worst = size[off][np.argmax(np.abs(size[off] - 1.0))]
            note = f"{int(off.sum())} quaternions were normalised (norm up to {worst:.4g})"
    elif word in ("rows", "columns"):
        matrices = values.reshape(-1, 3, 3)
        gram = np.einsum("nij,nkj->nik", matrices, matrices) - np.eye(3)
        error = np.abs(np.where(usable[:, None, None], gram, 0.0)).max(axis=(1, 2))
        usable &= (error < _UNUSABLE) & (np.linalg.det(np.nan_to_num(matrices)) > 0.0)
        if (usable & (error > _NORM)).any():
            note = f"{int((usable & (error > _NORM)).sum())} matrices were made orthogonal"
    elif word == "rotvec":
        long = usable & (np.linalg.norm(np.nan_to_num(values), axis=1) >= np.pi)
        if long.any():
            note = f"{int(long.sum())} rotation vectors beyond pi were turned the shorter way round"
    vectors = np.full((len(values), 3), np.nan)
    if usable.any():
        vectors[usable] = _vectors(word, values[usable])
    return vectors, usable, note


def _vectors(word: str, values: F) -> F:
    if word == "rotvec":
        return _shorter(values)
    if word in ORDERS:
        return vectors_of(values, word)
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - scipy takes long to load

    if word in ("rows", "columns"):
        matrices = values.reshape(-1, 3, 3)
        turned = matrices if word == "rows" else matrices.transpose(0, 2, 1)
        return np.asarray(Rotation.from_matrix(turned).as_rotvec())
    if word.startswith("grood"):
        return np.asarray(Rotation.from_euler("XYZ", values * _signs(word)).as_rotvec())
    return np.asarray(Rotation.from_euler(word, values).as_rotvec())


def rotation_columns(word: str, vectors: F) -> dict[str, F]:
    """Return what a log would hold, as columns, from rotation vectors (N, 3) in rad.

    Angles are in rad: those of Grood and Suntay and of three different axes have the middle one
    between -pi/2 and pi/2. Quaternions have a scalar part of at least 0.

    Where the middle angle leaves the other two undetermined (a gimbal lock), the third is 0, and
    scipy warns.

    Raises
    ------
    InputError
        An unknown word.

    Examples
    --------
    >>> knee = rotation_columns("grood-suntay-right", np.array([[-0.5, 0.0, 0.0]]))
    >>> [(name, float(angle[0].round(3)) + 0.0) for name, angle in knee.items()]
    [('flexion_rad', 0.5), ('adduction_rad', 0.0), ('internal_rotation_rad', 0.0)]
    """
    check_rotation_word(word)
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - scipy takes long to load

    turn = Rotation.from_rotvec(vectors)
    if word == "rotvec":
        names, values = ["rx_rad", "ry_rad", "rz_rad"], vectors
    elif word in ORDERS:
        names = [f"q{letter}" for letter in word]
        values = quaternions_of(vectors, word)
    elif word in ("rows", "columns"):
        pairs = [(i, j) for i in range(3) for j in range(3)]
        pairs = pairs if word == "rows" else [(j, i) for i, j in pairs]
        names = [f"r{i + 1}{j + 1}" for i, j in pairs]
        values = turn.as_matrix()[:, [i for i, _ in pairs], [j for _, j in pairs]]
    elif word.startswith("grood"):
        names = ["flexion_rad", "adduction_rad", "internal_rotation_rad"]
        values = turn.as_euler("XYZ") * _signs(word)
    else:
        names = [f"euler{i + 1}_{axis}_rad" for i, axis in enumerate(word)]
        sequence: Any = word  # checked above
        values = turn.as_euler(sequence)
    return dict(zip(names, np.asarray(values).T, strict=True))


def _signs(word: str) -> F:
    """Signs of Rx, Ry and Rz in flexion, adduction and internal rotation."""
    side = -1.0 if word.endswith("right") else 1.0
    return np.array([-1.0, side, -side])


def _shorter(values: F) -> F:
    """The same rotations as vectors of length below pi."""
    vectors = np.array(values)
    long = np.linalg.norm(values, axis=1) >= np.pi
    if long.any():
        vectors[long] = rotation_vectors(rotation_matrices(np.ascontiguousarray(values[long])))
    return vectors


_USUAL = {"length": "mm", "angle": "deg", "force": "gf", "torque": "N mm", "temperature": "K",
          "pressure": "bar", "volume": "ml"}  # fmt: skip
"""The other likely unit, for the question."""
_BENCH = {"length": "mm", "angle": "deg", "force": "N", "torque": "N m"}
"""The units of most benches, where SI would be out of range."""


@dataclass(frozen=True)
class Source:
    """A column of the log with its unit."""

    column: str
    unit: Unit
    sign: float = 1.0
    """-1 where the user asked for the column negated: --map "fx_N=-Fx"."""

    def __str__(self) -> str:
        name = f"-{self.column}" if self.sign < 0.0 else self.column
        told = self.unit.factor == 1.0 or self.column.endswith(f"[{self.unit.word}]")
        return name if told else f"{name} [{self.unit.word}]"


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
    notes
        Sentences about columns that were not asked about.
    """

    columns: Mapping[str, Source]
    rotation: RotationSource | None
    own: Mapping[str, str]
    notes: tuple[str, ...] = ()
    missing: tuple[Answer, ...] = ()
    """What else may be the pose or the wrench that was not found."""


@dataclass(frozen=True)
class UserChoices:
    """What the user said about a log.

    Parameters
    ----------
    columns
        Column of the log, `COLUMN`, `COLUMN:UNIT` or `-COLUMN`, by standard name.
    rotation
        `WORD`, or `WORD:COLUMN,COLUMN,...` (the words of `COUNT`); empty: by the names.
    units
        Unit of each dimension for columns that state none.
    axis
        Axis of columns whose name has none: x, y or z.
    """

    columns: Mapping[str, str]
    rotation: str
    units: Mapping[str, Unit]
    axis: str


def chosen_source(
    standard: str, choice: str, log: Log, named: Mapping[str, Named], choices: UserChoices
) -> Source:
    """The source that --map gives: a column, or a column and its unit; `-` before it negates."""
    if choice.startswith("-") and not {choice, choice.rpartition(":")[0]} & {*log.columns}:
        positive = chosen_source(standard, choice[1:].lstrip(), log, named, choices)
        return replace(positive, sign=-positive.sign)
    column, colon, word = choice.rpartition(":")
    whole = choice in log.columns
    # Of the columns F and FN, F:N means the first.
    if whole or (column not in log.columns and column_like(choice, log) in log.columns):
        column, colon, word = choice, "", ""
    column = known_column(column if colon else choice, log, f"--map {standard}={choice}")
    if not is_standard(standard) and not standard.isidentifier():
        raise InputError(f"--map {standard}={choice}: '{standard}' is no column name")
    if colon:
        unit = find_unit(word) or _worth(word, named[column])
        if unit is None:
            raise InputError(
                f"--map {standard}={choice}: '{word}' is no unit, nor what one of the column is "
                "worth, such as 12.5 N of a volt, 50 mm of a strain, 100 mm2 of a stress"
            )
        dimension = _dimension(standard)
        if dimension and unit.dimension != dimension:
            raise InputError(
                f"--map {standard}={choice}: {unit.word} is a unit of {unit.dimension}, "
                f"expected one of {dimension}"
            )
        return Source(column, unit)
    return Source(column, stated_unit(column, standard, named[column], choices))


_WORTH = re.compile(r"(?P<size>[+-]?\d+\.?\d*(?:[eE][+-]?\d+)?)\s*(?P<unit>[A-Za-zµ°].*)")
_AREA = re.compile(r"(?P<length>m|cm|mm|in)(?:\^?2|²)")


def _worth(word: str, named: Named) -> Unit | None:
    """The unit of what one of a column is worth: `50 mm` of a strain, `12.5 N` of a volt.

    An area times a stress is a force. Strain and stress count in their own unit, % or MPa.
    """
    found = _WORTH.fullmatch(word.strip())
    if found is None:
        return None
    own = 1.0 if named.unit is None else named.unit.factor
    kinds = {guess.quantity for guess in named.guesses}
    area = _AREA.fullmatch(found["unit"])
    length = find_unit(area["length"] if area is not None else found["unit"])
    if length is None or (area is not None and "stress" not in kinds):
        return None
    factor = float(found["size"]) * (own if kinds & {"strain", "stress"} else 1.0)
    if area is not None:
        return Unit(word, "force", factor * length.factor**2)
    return Unit(word, length.dimension, factor * length.factor)


def known_column(name: str, log: Log, option: str, *, or_text: bool = False) -> str:
    """The log's column of this name, which an option gives; InputError where there is none."""
    column = column_like(name, log)
    if column not in log.columns and not (or_text and column in log.text):
        raise InputError(
            f"{option}: the log has no column '{column}', {did_you_mean(column, log.columns)}"
        )
    return column


def column_like(name: str, log: Log) -> str:
    """The log's only column of this name without regard to case and separators, else the name."""
    known = (*log.columns, *log.text)
    if name in known:
        return name
    # A minus is no separator: -Fx is not Fx.
    same = [
        own
        for own in known
        if _squeezed(own) == _squeezed(name) and own.startswith("-") == name.startswith("-")
    ]
    return same[0] if len(same) == 1 and _squeezed(name) else name


def _squeezed(name: str) -> str:
    return "".join(sign for sign in name.lower() if sign.isalnum())


def _dimension(standard: str) -> str:
    """Dimension of a standard column; empty for one without unit or of the user's own."""
    if not is_standard(standard) or standard.startswith("v_"):
        return ""
    unit = find_unit(standard.rpartition("_")[2])
    return "" if unit is None else unit.dimension


_UNSTATED = Unit("", "unstated")


def stated_unit(column: str, standard: str, named: Named, choices: UserChoices) -> Unit:
    """The unit that name or user states; time without one is in seconds."""
    dimension = _dimension(standard)
    if column == standard or not dimension:
        return Unit("", "number")
    if named.unit is not None and named.unit.dimension == dimension:
        return named.unit
    if dimension in choices.units:
        return choices.units[dimension]
    ending = trailing_units(column)[1]  # of a name whose words say nothing: ML_mm
    if dimension in ending:
        return ending[dimension]
    return Unit("", dimension) if dimension in ("time", "temperature") else _UNSTATED


def ask_units(found: Mapping[str, Source], log: Log, source: str) -> None:
    """Raise InputError for columns without a unit, with what each reading would mean."""
    without = [(name, entry.column) for name, entry in found.items() if entry.unit is _UNSTATED]
    if not without:
        return
    lines, words, worth = [], dict[str, str](), list[str]()
    for standard, column in without:
        dimension = _dimension(standard)
        first, second = SI[dimension], _USUAL[dimension]
        words[dimension] = second
        known = log.columns[column][np.isfinite(log.columns[column])]
        extent = f"{known.min():.4g} to {known.max():.4g}" if len(known) else "no numbers"
        lines.append(f"  {column}: {extent}, in {first} or in {second}?")
        if unknown := unknown_unit(column, log):
            lines[-1] += f" '{unknown}' is no unit that is known"
            worth.append(f'--map "{standard}={column}:NUMBER {first}"')
    other = ",".join(words.values())
    usual = [word for dimension, word in _BENCH.items() if dimension in words]
    answers = [Answer({"units": ["SI"]}), Answer({"units": usual})]
    raise Question(
        f"{source}: no unit is stated for {len(without)} column(s):\n"
        + "\n".join(lines[:12])
        + f'\nSay it once for all: --units SI (m, rad, N, N m), or e.g. --units "{other}"; '
        "for one column --map NAME=COLUMN:UNIT"
        + (f", or what one of it is worth: {worth[0]}." if worth else "."),
        *(() if worth else answers),
    )


def standard_columns(
    log: Log, mapped: ColumnMap, source: str
) -> tuple[dict[str, NDArray[Any]], dict[str, str], list[str], B]:
    """Standard columns, what each was read from, notes, and which rows hold a rotation."""
    found: dict[str, NDArray[Any]] = {}
    words: dict[str, str] = {}
    for name, entry in mapped.columns.items():
        values = log.columns[entry.column] * entry.unit.factor + entry.unit.offset
        found[name] = entry.sign * values
        words[name] = _words(entry, unknown_unit(entry.column, log))
    notes = list(mapped.notes)
    usable = np.ones(len(log), dtype=bool)
    if mapped.rotation is not None:
        parts = mapped.rotation.sources
        values = np.column_stack([log.columns[part.column] * part.unit.factor for part in parts])
        vectors, usable, note = to_rotation_vectors(mapped.rotation.word, values)
        found |= dict(zip(POSE[3:], vectors.T, strict=True))
        words |= dict.fromkeys(POSE[3:], f"rotation vector: {mapped.rotation}")
        notes += [note] if note else []
    for column, name in mapped.own.items():
        found[name], words[name] = log.columns[column], f"{column}, kept as it is"
    for name, cells in log.text.items():
        if name in TEXT and all(is_word(name, str(cell)) for cell in cells):
            found[name], words[name] = cells, name
        else:
            notes.append(f"column '{name}' is text and was left aside")
    if not any(name in found for name in (*POSE, *WRENCH)):
        raise Question(
            f"{source}: no pose and no wrench was found by name. Its columns:\n{ranges(log)}\n"
            "Name what is one: --map NAME=COLUMN:UNIT, for example --map theta_z_rad=COLUMN:deg "
            f"(names: {', '.join((*POSE, *WRENCH))}, time_s)",
            *mapped.missing,
        )
    likely = {n: c for answer in mapped.missing for n, c in answer.options["columns"].items()}
    for what, group, unit in (("pose", POSE, "mm"), ("wrench", WRENCH, "N")):
        if not any(name in found for name in group):
            example = [f"{name}={likely[name]}" for name in group if name in likely]
            example = [*example, f"{group[0]}=COLUMN:{unit}"]
            notes.append(
                f"no {what} was found by name, without which no model can be fitted: say "
                f"--map NAME=COLUMN:UNIT, for example --map {shlex.quote(example[0])}"
            )
    order = {name: i for i, name in enumerate(("time_s", "run", *POSE, *WRENCH))}
    names = sorted(found, key=lambda name: order.get(name, len(order)))
    return {name: found[name] for name in names}, words, notes, usable


def _words(entry: Source, unknown: str) -> str:
    if entry.sign < 0.0:
        return f"-1 * {_words(replace(entry, sign=1.0), unknown)}"
    unit, said = entry.unit, f", '{unknown}' is no unit that is known: taken as "
    if unit.word == "" and unit.dimension in ("time", "temperature"):
        assumed = "s" if unit.dimension == "time" else "degC"
        return f"{entry.column}{said if unknown else ', no unit stated, taken as '}{assumed}"
    factor = "" if unit.factor == 1.0 else f" * {unit.factor:.6g}"
    offset = "" if unit.offset == 0.0 else f" {'+-'[unit.offset < 0]} {abs(unit.offset):.6g}"
    said = f"{said}{unit.word}" if unknown and find_unit(unit.word) is not None else ""
    return f"{entry.column}{factor}{offset}{said}"


def unwrap_angle(table: dict[str, NDArray[Any]], notes: list[str]) -> None:
    """Unwrap a single angle that jumps by a whole turn, as encoders from 0 to 360 degrees do.

    Readings within half a turn stay: poses at rest may follow each other with larger steps.
    """
    angles = [name for name in POSE[3:] if name in table]
    if len(angles) != 1:
        return
    values = table[angles[0]]
    if not np.isfinite(values).all() or np.abs(values).max() <= math.pi:
        return
    unwrapped = np.unwrap(values)
    turns = 2.0 * math.pi * np.round(np.median(unwrapped) / (2.0 * math.pi))
    if not np.allclose(unwrapped - turns, values, rtol=0.0, atol=1e-9):
        jumps = int(np.count_nonzero(np.abs(np.diff(values)) > math.pi))
        notes.append(f"{angles[0]}: whole turns taken out, {jumps} jumps unwrapped")
        table[angles[0]] = unwrapped - turns


def sort_by_time(table: dict[str, NDArray[Any]], usable: B) -> tuple[B, list[str]]:
    """Sort the rows where one clock tells their order; return `usable` (N,) sorted, and notes."""
    time = table.get("time_s", np.zeros(0))
    if not is_unsorted(time[np.isfinite(time)]):
        return usable, []
    order = np.argsort(time, kind="stable")
    table.update({name: values[order] for name, values in table.items()})
    return usable[order], ["the rows were put in the order of time, and are counted in it"]


def begin_time_at_zero(table: dict[str, NDArray[Any]]) -> tuple[list[str], float]:
    """Begin time at 0; a time that begins again starts a new run. Notes, and 0 since 1970, s."""
    if "time_s" not in table:
        return [], 0.0
    time, notes, epoch_s = table["time_s"], [], 0.0
    known = time[np.isfinite(time)]
    if len(known) and known.min() > EPOCH_S:
        power = min(3, max(0, round((math.log10(np.median(known)) - 9.2) / 3)))
        epoch_s = float(known.min()) / 10.0 ** (3 * power)
        time = (time - known.min()) / 10.0 ** (3 * power)
        notes.append(f"time counts from an epoch in {('s', 'ms', 'us', 'ns')[power]}")
    back = np.flatnonzero(np.diff(time) < 0.0) + 1
    again = back[time[back] <= np.nanmin(time) + 0.1 * np.nanmax(time)] if len(back) else back
    if len(back) and len(again) == len(back) and "run" not in table:
        run = np.zeros(len(time))
        run[back] = 1.0
        table["run"] = np.cumsum(run)
        rows = shown_ranges((back + 1).tolist())
        notes.append(f"time begins again at row {rows}: {len(back) + 1} runs")
    table["time_s"] = time
    return notes, epoch_s


def drop_columns_with_gaps(
    table: dict[str, NDArray[Any]],
    words: dict[str, str],
    wanted: Collection[str],
    own: Mapping[str, str],
) -> list[str]:
    """Take out the user's own columns that are empty in rows which hold everything else.

    A column that nobody asked for must not cost rows. own: name in the table of each of the log.
    """
    columns = {name: column for column, name in own.items()}
    full = holds_numbers({name: values for name, values in table.items() if name in wanted})
    notes = []
    for name in [name for name in table if name not in wanted and name not in MAY_BE_EMPTY]:
        gaps = int((full & ~holds_numbers({name: table[name]})).sum())
        if gaps:
            column = columns.get(name, name)
            del table[name], words[name]
            named = shlex.quote(f"{name}={column}")
            notes.append(
                f"column '{column}' has no number in {gaps} rows and was left aside; "
                f"--map {named} keeps it, and leaves these rows out"
            )
    return notes


def holds_numbers(table: Mapping[str, NDArray[Any]]) -> B:
    rows = len(next(iter(table.values())))
    good = np.ones(rows, dtype=bool)
    for name, values in table.items():
        if name not in MAY_BE_EMPTY:
            good &= np.isfinite(values)
        if name in WHOLE:
            good &= np.nan_to_num(values) == np.round(np.nan_to_num(values))
    return good
