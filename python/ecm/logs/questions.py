"""What a log leaves open: each question knows the answers that may be right, the likeliest first.

`answered` of importing.py tries them, so that a refusal ends in an import that works.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH
from ecm.logs.log import Log
from ecm.logs.names import Named, trailing_units

_KINDS = {"pose": POSE, "wrench": WRENCH}
_DIMENSIONS = {"pose": ("length", "angle"), "wrench": ("force", "torque")}
_COLUMN_OF = {
    "length": ("x_m", "mm"),
    "angle": ("theta_z_rad", "deg"),
    "force": ("fx_N", "N"),
    "torque": ("tau_z_Nm", "N mm"),
}
"""The column that one of this dimension becomes, and its unit where none is stated."""
_WORDS = {"length": "displacement", "angle": "rotation", "force": "force", "torque": "torque"}
_PER_ONE = {
    "strain": ("pose", "gauge length", "50 mm"),
    "stress": ("wrench", "cross-section", "100 mm2"),
}
"""What a strain or stress is multiplied by, and the size of an example."""
_MOST_LISTED, _MOST_LINES = 8, 20


@dataclass(frozen=True)
class Answer:
    """Options of `import_log`, and what they take for granted, in words."""

    options: Mapping[str, Any] = field(default_factory=dict)
    words: str = ""


class Question(InputError):
    """A log may be read in several ways.

    Parameters
    ----------
    message
        What is open, and the options that decide.
    answers
        The ways, the likeliest first.

    Examples
    --------
    >>> question = Question("no axis", Answer({"axis": "x"}, "its axis is taken as x"))
    >>> print(question, question.answers[0].options)
    no axis {'axis': 'x'}
    """

    def __init__(self, message: str, *answers: Answer) -> None:
        super().__init__(message)
        self.answers = answers


def named_as(standard: str, column: str, words: str = "") -> Answer:
    """The answer that a column of the log is a standard one."""
    words = words or f"column '{column.rpartition(':')[0] or column}' is taken as {standard}"
    return Answer({"columns": {standard: column}}, words)


def missing(log: Log, named: Mapping[str, Named], found: Collection[str]) -> tuple[Answer, ...]:
    """What else may be the pose or the wrench that no name tells; empty where both are found.

    A strain or a stress comes first, with a length or an area to be put in; then columns of a
    fitting unit; then, as an example, any that vary and do not always rise, as the time does.

    Parameters
    ----------
    log
        The log.
    named
        What each name of its columns tells.
    found
        Standard columns that were found, and the columns of the log that they are read from.
    """
    chosen: dict[str, str] = {}
    words, examples = [], []
    taken = set(found)
    for kind, standards in _KINDS.items():
        if taken.intersection(standards):
            continue
        left = {name: values for name, values in log.columns.items() if name not in taken}
        known = _by_name(kind, {name: named[name] for name in left})
        if known is not None:
            standard, column, ending, said = known
            words.append(said)
        else:
            varying = [name for name, values in left.items() if _varies(values)]
            free = [name for name in varying if not _rises(left[name])] or varying
            if not free:
                return ()
            turned = not taken.isdisjoint((*POSE[3:], *WRENCH[3:]))
            dimension = _DIMENSIONS[kind][turned]
            standard, ending = _COLUMN_OF[dimension]
            column, example = free[0], f"in {ending}"
            unit = named[column].unit
            if unit is not None and unit.dimension == "other":  # volts: what is one of them worth
                ending = f"1 {ending}"
                example = f"of {ending} a {unit.word}"
            examples.append(f"'{column}' stands for a {_WORDS[dimension]} {example}")
        chosen[standard] = f"{column}:{ending}" if ending else column
        taken |= {standard, column}
    if examples:
        extents = [f"{name} ({low} to {high})" for name, low, high in _extents(log)]
        listed = ", ".join(extents[:_MOST_LISTED]) + (", ..." if extents[_MOST_LISTED:] else "")
        words.append(
            f"no name tells which column is what: {' and '.join(examples)} as an example, put in "
            f"the right ones of {listed}"
        )
    return (Answer({"columns": chosen}, "; ".join(words)),) if chosen else ()


def _by_name(kind: str, named: Mapping[str, Named]) -> tuple[str, str, str, str] | None:
    """Standard column, own column, its unit or worth, and words of what a name or unit tells."""
    for name, own in named.items():
        for material, (of, what, size) in _PER_ONE.items():
            if of == kind and any(guess.quantity == material for guess in own.guesses):
                said = f"'{name}' is a {material}, taken with a {what} of {size} (put in yours)"
                return _KINDS[kind][0], name, size, said
    for dimension in _DIMENSIONS[kind]:
        standard, usual = _COLUMN_OF[dimension]
        for name, own in named.items():
            stated = own.unit is not None and own.unit.dimension == dimension
            stated = stated or dimension in trailing_units(name)[1]
            if stated or any(guess.dimension == dimension for guess in own.guesses):
                ending = "" if stated else usual
                return standard, name, ending, f"'{name}' is taken as {standard}"
    return None


def _extents(log: Log) -> list[tuple[str, str, str]]:
    """Name, smallest and largest number of each column."""
    return [(n, f"{np.nanmin(v):.4g}", f"{np.nanmax(v):.4g}") for n, v in log.columns.items()]


def ranges(log: Log) -> str:
    """The first columns with their smallest and largest number, a line each."""
    lines = [f"  {name}: {low} to {high}" for name, low, high in _extents(log)]
    return "\n".join(lines[:_MOST_LINES]) + ("\n  ..." if len(lines) > _MOST_LINES else "")


def _varies(values: Any) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 1 and bool(np.ptp(known) > 0.0)


def _rises(values: Any) -> bool:
    """Whether each value is larger than the one before, as of a clock or the number of a row."""
    return bool((np.diff(values) > 0.0).all())
