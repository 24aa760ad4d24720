"""Tables of a settings file as frozen dataclasses: unknown keys, types, lengths and ranges."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import field, fields
from typing import Any, TypeVar

from ecm.errors import InputError

T = TypeVar("T")


def setting(
    default: Any,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
) -> Any:
    """A dataclass field whose range or choices `from_table` checks; a tuple fixes the length."""
    return field(default=default, metadata={"low": low, "high": high, "choices": choices})


def nearest(name: str, known: list[str]) -> str:
    """End of a sentence about an unknown name: ". Did you mean `X`?", or "." alone."""
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f". Did you mean `{close[0]}`?" if close else "."


def _number(value: Any, low: float, high: float, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{place} = {value!r}: expected a number")
    number = float(value)
    if not math.isfinite(number) or not low <= number <= high:
        raise InputError(f"{place} = {value!r}: expected a number from {low:g} to {high:g}")
    return number


def _convert(value: Any, default: Any, meta: Mapping[str, Any], place: str) -> Any:
    low, high, choices = meta["low"], meta["high"], meta["choices"]
    if isinstance(default, bool):
        if not isinstance(value, bool):
            raise InputError(f"{place} = {value!r}: expected true or false")
        return value
    if isinstance(default, str):
        if not isinstance(value, str):
            raise InputError(f"{place} = {value!r}: expected a text")
        if choices and value not in choices:
            raise InputError(f"{place} = {value!r}: expected one of {', '.join(choices)}")
        return value
    if isinstance(default, tuple):
        if not isinstance(value, (list, tuple)) or len(value) != len(default):
            raise InputError(f"{place} = {value!r}: expected a list of {len(default)} numbers")
        return tuple(_number(v, low, high, f"{place}[{i}]") for i, v in enumerate(value))
    number = _number(value, low, high, place)
    if isinstance(default, int):
        if number != int(number):
            raise InputError(f"{place} = {value!r}: expected an integer")
        return int(number)
    return number


def from_table(kind: type[T], table: Mapping[str, Any], where: str) -> T:
    """`kind(**table)` after every key, type, length and range has been checked.

    Raises
    ------
    InputError
        With the file and table (`where`), the key, what was found and what was expected.
    """
    if not isinstance(table, Mapping):
        raise InputError(f"{where}: found {table!r}, expected a table of keys")
    known = {f.name: f for f in fields(kind)}  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    for key, value in table.items():
        if key not in known:
            raise InputError(
                f"{where}: unknown key `{key}`{nearest(key, list(known))} "
                f"Known keys: {', '.join(known)}"
            )
        spec = known[key]
        values[key] = _convert(value, spec.default, spec.metadata, f"{where} {key}")
    return kind(**values)
