"""The columns of a log as standard columns in SI, and notes on what was done to them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.io.arrays import B, F
from ecm.io.columns import MAY_BE_EMPTY, POSE, WHOLE, WRENCH
from ecm.io.leave_out import shown_ranges
from ecm.logs.log import Log
from ecm.logs.rotations import to_rotation_vectors
from ecm.logs.sources import ColumnMap, Source

_MOST_SHOWN = 20
_EPOCH_S = 1e8
"""Larger times count from an epoch; the table's begin at 0."""


def standard_columns(
    log: Log, mapped: ColumnMap, source: str
) -> tuple[dict[str, NDArray[Any]], dict[str, str], list[str], B]:
    """Standard columns, what each was read from, notes, and which rows hold a rotation."""
    found: dict[str, F] = {}
    words: dict[str, str] = {}
    for name, entry in mapped.columns.items():
        values = log.columns[entry.column] * entry.unit.factor + entry.unit.offset
        found[name] = entry.sign * values
        words[name] = _words(entry)
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
    for name in log.text:
        notes.append(f"column '{name}' is text and was left aside")
    if not any(name in found for name in (*POSE, *WRENCH)):
        raise InputError(
            f"{source}: no pose and no wrench was found by name. Its columns:\n{_ranges(log)}\n"
            "Name what is one: --map NAME=COLUMN:UNIT, for example --map theta_z_rad=COLUMN:deg "
            f"(names: {', '.join((*POSE, *WRENCH))}, time_s)"
        )
    for what, group in (("pose", POSE), ("wrench", WRENCH)):
        if not any(name in found for name in group):
            notes.append(f"no {what} was found by name: say --map NAME=COLUMN:UNIT, for example "
                         f"--map {group[0]}=COLUMN:{'mm' if what == 'pose' else 'N'}")  # fmt: skip
    order = {name: i for i, name in enumerate(("time_s", "run", *POSE, *WRENCH))}
    names = sorted(found, key=lambda name: order.get(name, len(order)))
    return {name: found[name] for name in names}, words, notes, usable


def _ranges(log: Log) -> str:
    """The first columns with their smallest and largest number, a line each."""
    lines = [f"  {n}: {np.nanmin(v):.4g} to {np.nanmax(v):.4g}" for n, v in log.columns.items()]
    return "\n".join(lines[:_MOST_SHOWN]) + ("\n  ..." if len(lines) > _MOST_SHOWN else "")


def _words(entry: Source) -> str:
    if entry.sign < 0.0:
        return f"-1 * {_words(replace(entry, sign=1.0))}"
    unit = entry.unit
    if unit.word == "" and unit.dimension in ("time", "temperature"):
        assumed = "s" if unit.dimension == "time" else "degC"
        return f"{entry.column}, no unit stated, taken as {assumed}"
    factor = "" if unit.factor == 1.0 else f" * {unit.factor:.6g}"
    offset = "" if unit.offset == 0.0 else f" {'+-'[unit.offset < 0]} {abs(unit.offset):.6g}"
    return f"{entry.column}{factor}{offset}"


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


def begin_time_at_zero(table: dict[str, NDArray[Any]]) -> list[str]:
    """Begin time at 0; a time that begins again starts a new run."""
    if "time_s" not in table:
        return []
    time, notes = table["time_s"], []
    known = time[np.isfinite(time)]
    if len(known) and known.min() > _EPOCH_S:
        power = min(3, max(0, round((math.log10(np.median(known)) - 9.2) / 3)))
        time = (time - known.min()) / 10.0 ** (3 * power)
        notes.append(f"time counts from an epoch in {('s', 'ms', 'us', 'ns')[power]}")
    back = np.flatnonzero(np.diff(time) < 0.0) + 1
    again = back[time[back] <= time[0] + 0.1 * np.nanmax(time)] if len(back) else back
    if len(back) and len(again) == len(back) and "run" not in table:
        run = np.zeros(len(time))
        run[back] = 1.0
        table["run"] = np.cumsum(run)
        rows = shown_ranges((back + 1).tolist())
        notes.append(f"time begins again at row {rows}: {len(back) + 1} runs")
    table["time_s"] = time
    return notes


def drop_columns_with_gaps(
    table: dict[str, NDArray[Any]], words: dict[str, str], wanted: Collection[str]
) -> list[str]:
    """Take out the user's own columns that are empty in rows which hold everything else.

    A column that nobody asked for must not cost rows.
    """
    full = holds_numbers({name: values for name, values in table.items() if name in wanted})
    notes = []
    for name in [name for name in table if name not in wanted and name not in MAY_BE_EMPTY]:
        gaps = int((full & ~holds_numbers({name: table[name]})).sum())
        if gaps:
            del table[name], words[name]
            notes.append(
                f"column '{name}' has no number in {gaps} rows and was left aside; "
                f"--map {name}=COLUMN keeps it"
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
