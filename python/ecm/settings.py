"""A TOML table into a frozen dataclass: types by annotation, unknown keys refused.

The dataclass states name (with unit), default and, in the docstring below each field, meaning;
its __post_init__ checks ranges. Everything else about reading settings is here, once.
"""

from __future__ import annotations

import math
import types
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from ecm.errors import InputError
from ecm.toml_file import check_keys

T = TypeVar("T")


def read_settings(cls: type[T], table: Any, where: str) -> T:
    """An instance of a settings dataclass from a TOML table.

    Parameters
    ----------
    where
        File and table, e.g. ``neck.toml [design]``: the beginning of every message.
    """
    if not is_dataclass(cls):
        raise TypeError(f"{cls.__name__} is no dataclass")
    if not isinstance(table, Mapping):
        raise InputError(f"{where}: found {_show(table)}, expected a table of settings")
    known = {field.name: field for field in fields(cls) if field.init}
    check_keys(table, known, where)
    missing = [
        name
        for name, field in known.items()
        if field.default is MISSING and field.default_factory is MISSING and name not in table
    ]
    if missing:
        raise InputError(f"{where}: the key '{missing[0]}' is missing")
    hints = get_type_hints(cls)
    values = {key: convert(value, hints[key], f"{where}: {key}") for key, value in table.items()}
    try:
        return cls(**values)
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(where) else f"{where}: {text}") from None


def convert(value: Any, hint: Any, where: str) -> Any:  # noqa: PLR0911, PLR0912
    """One value into the annotated type; InputError naming the key where it does not fit."""
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        inner = [arg for arg in args if arg is not type(None)]
        if isinstance(value, int) and int in inner:
            return convert(value, int, where)
        return convert(value, inner[0], where)
    if origin is Literal:
        if value not in args:
            choices = ", ".join(repr(arg) for arg in args)
            raise InputError(f"{where} = {_show(value)}: expected one of {choices}")
        return value
    if origin is tuple:
        return _sequence(value, args, where)
    if hint is float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise InputError(f"{where} = {_show(value)}: expected a number")
        if not math.isfinite(value):
            raise InputError(f"{where} = {value}: expected a finite number")
        return float(value)
    if hint is int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise InputError(f"{where} = {_show(value)}: expected a whole number")
        return value
    if hint is bool:
        if not isinstance(value, bool):
            raise InputError(f"{where} = {_show(value)}: expected true or false")
        return value
    if hint is str or hint is Path:
        if not isinstance(value, str):
            raise InputError(f"{where} = {_show(value)}: expected text in quotes")
        return Path(value) if hint is Path else value
    if (origin or hint) in (dict, Mapping):
        if not isinstance(value, Mapping):
            raise InputError(f"{where} = {_show(value)}: expected a table")
        return dict(value)
    if is_dataclass(hint) and isinstance(hint, type):
        return read_settings(hint, value, where)
    return value


def _sequence(value: Any, args: tuple[Any, ...], where: str) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise InputError(f"{where} = {_show(value)}: expected a list in square brackets")
    if len(args) == 2 and args[1] is Ellipsis:
        hints = [args[0]] * len(value)
    else:
        hints = list(args)
        if len(value) != len(hints):
            raise InputError(f"{where} has {len(value)} entries: expected {len(hints)}")
    return tuple(
        convert(item, hint, f"{where}[{i}]")
        for i, (item, hint) in enumerate(zip(value, hints, strict=True))
    )


def _show(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
