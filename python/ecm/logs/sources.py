"""Sources of standard columns in a log: a column with its unit, or several as one rotation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ecm.errors import InputError
from ecm.io.columns import is_standard
from ecm.io.toml import did_you_mean
from ecm.io.units import Unit, find_unit
from ecm.logs.log import Log
from ecm.logs.names import Named, trailing_units

_SI = {"length": "m", "angle": "rad", "force": "N", "torque": "Nm", "time": "s",
       "temperature": "degC"}  # fmt: skip
_USUAL = {"length": "mm", "angle": "deg", "force": "gf", "torque": "N mm", "temperature": "K"}
"""The other likely unit, for the question."""


@dataclass(frozen=True)
class Source:
    """A column of the log with its unit."""

    column: str
    unit: Unit
    sign: float = 1.0
    """-1 where the user asked for the column negated: --map "fx_N=-Fx"."""

    def __str__(self) -> str:
        name = f"-{self.column}" if self.sign < 0.0 else self.column
        return name if self.unit.factor == 1.0 else f"{name} [{self.unit.word}]"


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


@dataclass(frozen=True)
class UserChoices:
    """What the user said about a log.

    Parameters
    ----------
    columns
        Column of the log, `COLUMN`, `COLUMN:UNIT` or `-COLUMN`, by standard name.
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
    column = column_like(column if colon else choice, log)
    if column not in log.columns:
        raise InputError(
            f"--map {standard}={choice}: the log has no column '{column}', "
            f"{did_you_mean(column, log.columns)}"
        )
    if not is_standard(standard) and not standard.isidentifier():
        raise InputError(f"--map {standard}={choice}: '{standard}' is no column name")
    if colon:
        unit = find_unit(word)
        if unit is None:
            raise InputError(f"--map {standard}={choice}: '{word}' is no unit")
        dimension = _dimension(standard)
        if dimension and unit.dimension != dimension:
            raise InputError(
                f"--map {standard}={choice}: {unit.word} is a unit of {unit.dimension}, "
                f"expected one of {dimension}"
            )
        return Source(column, unit)
    return Source(column, stated_unit(column, standard, named[column], choices))


def without_columns(log: Log, ignore: Sequence[str]) -> Log:
    """The log without columns that are not used.

    Raises
    ------
    InputError
        For a column that it has not.
    """
    for name in ignore:
        if column_like(name, log) not in (*log.columns, *log.text):
            raise InputError(
                f"--ignore {name}: the log has no column '{name}', "
                f"{did_you_mean(name, log.columns)}"
            )
    gone = {column_like(name, log) for name in ignore}
    return replace(
        log,
        columns={name: values for name, values in log.columns.items() if name not in gone},
        text={name: values for name, values in log.text.items() if name not in gone},
    )


def column_like(name: str, log: Log) -> str:
    """The log's only column of this name without regard to case and separators, else the name."""
    known = (*log.columns, *log.text)
    if name in known:
        return name
    # A minus is no separator: -Fx is not Fx.
    alike = [
        own
        for own in known
        if _squeezed(own) == _squeezed(name) and own.startswith("-") == name.startswith("-")
    ]
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
    lines, words = [], dict[str, str]()
    for standard, column in without:
        dimension = _dimension(standard)
        first, second = _SI[dimension], _USUAL[dimension]
        words[dimension] = second
        known = log.columns[column][np.isfinite(log.columns[column])]
        extent = f"{known.min():.4g} to {known.max():.4g}" if len(known) else "no numbers"
        lines.append(f"  {column}: {extent}, in {first} or in {second}?")
    other = ",".join(words.values())
    raise InputError(
        f"{source}: no unit is stated for {len(without)} column(s):\n"
        + "\n".join(lines[:12])
        + f'\nSay it once for all: --units SI (m, rad, N, N m), or e.g. --units "{other}"; '
        "for one column --map NAME=COLUMN:UNIT."
    )
