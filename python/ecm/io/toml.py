"""TOML files: a reader with readable errors, a small writer, and messages for unknown names."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ecm.errors import InputError, Remedy, shown

_MOST_LISTED = 40
"""Names that a message lists."""
_parser = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")


def read_toml(path: Path, what: str = "TOML file") -> dict[str, Any]:
    """Read a TOML file; InputError names file and line where it cannot be read."""
    return parse_toml(read_text(path, what), str(path), what)


def parse_toml(text: str, where: str, what: str) -> dict[str, Any]:
    """Return what a TOML text says; InputError with the place `where` for other text."""
    try:
        document: dict[str, Any] = _parser.loads(text)
    # TOMLDecodeError, whose message carries line and column; brackets in brackets, thousands deep.
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{where}: this {what} is no valid TOML: {error}. Correct that place; "
            "'ecm new config|arm|rig|data' writes a valid example."
        ) from None
    return document


IMPORT = "ecm import DATA --out table.csv"
"""The command that makes a table of a log."""


def read_text(path: Path, what: str) -> str:
    """Read a UTF-8 text file; InputError for a missing, unreadable or binary one."""
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: this {what} does not exist. {_likely_file(path)}") from None
    except IsADirectoryError:
        raise InputError(f"{path}: found a directory, expected a {what}. Give a file.") from None
    except NotADirectoryError:
        raise InputError(f"{path}: a part of this path is a file, not a directory.") from None
    except PermissionError:
        raise InputError(f"{path}: no permission to read this {what}.") from None
    if b"\0" in raw[:65536]:
        other = " ecm import reads MAT, HDF5, NPZ and bags." if what == "table" else ""
        raise InputError(f"{path}: found a binary file, expected a {what} (UTF-8 text).{other}")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        message = f"{path}: line {line} is not UTF-8 text, expected a {what} in UTF-8"
        words, command = "save it again as UTF-8", ""
        if what.startswith("table"):
            words += ", or import it as a log, whose letters may be those of Windows"
            command = IMPORT
        raise InputError(message, remedy=Remedy(words, command)) from None


def refuse_pipe(path: Path, what: str) -> None:
    """Raise InputError for what can be read only once: a pipe, a terminal, a device.

    Later steps, and the commands that a refusal names, read a file again.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        raise InputError(
            f"{path}: a pipe or a device; a {what} is read more than once, also by later steps",
            remedy=Remedy("save it as a file first, and give that one"),
        )


def _likely_file(path: Path) -> str:
    if not path.parent.is_dir():
        return f"The directory {path.parent} does not exist either: check the path."
    try:
        names = [entry.name for entry in path.parent.iterdir()]
    except OSError:
        names = []
    likely = closest(path.name, names, similarity=0.6)
    return f"Did you mean {path.parent / likely}?" if likely else "Check the path."


def closest(name: str, known: Iterable[str], similarity: float = 0.5) -> str | None:
    """Return the known name most like this one; None where none reaches the similarity (0 to 1)."""
    matches = get_close_matches(name, list(known), n=1, cutoff=similarity)
    return matches[0] if matches else None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """End a message about an unknown name: the likely name, or all known names."""
    names = list(known)
    likely = closest(name, names)
    if likely:
        return f"did you mean '{likely}'?"
    more = len(names) - _MOST_LISTED
    return f"known: {', '.join(names[:_MOST_LISTED])}{f' and {more} more' if more > 0 else ''}"


def check_keys(table: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    """Raise InputError for the first unknown key, with the most likely known one."""
    names = list(known)
    for key in table:
        if key not in names:
            raise InputError(f"{where}: unknown key {shown(key)}, {did_you_mean(key, names)}")


def write_toml(document: Mapping[str, Any]) -> str:
    """Return TOML text of tables of scalars, lists and inline tables; None is left out."""
    lines: list[str] = []
    _write_table(document, (), lines)
    return "\n".join(lines).strip() + "\n"


def _write_table(table: Mapping[str, Any], path: tuple[str, ...], lines: list[str]) -> None:
    plain = {k: v for k, v in table.items() if not _is_section(v, path) and v is not None}
    if path and (plain or not table):
        lines.append(f"\n[{'.'.join(_key(part) for part in path)}]")
    lines.extend(f"{_key(key)} = {_value(value)}" for key, value in plain.items())
    for key, value in table.items():
        if _is_section(value, path):
            _write_table(value, (*path, str(key)), lines)


def _is_section(value: object, path: tuple[str, ...]) -> bool:
    # [columns] holds one inline table per column; [run.N] is a section of its own.
    return isinstance(value, Mapping) and (not path or path == ("run",))


def _key(key: object) -> str:
    text = str(key)
    bare = text.isascii() and text.replace("_", "").replace("-", "").isalnum()
    return text if bare else json.dumps(text, ensure_ascii=False)


def _value(value: Any) -> str:
    """Return the TOML text of a value; scalars but floats are written as in JSON."""
    if isinstance(value, Mapping):
        inside = ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items() if v is not None)
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_value(item) for item in value)}]"
    if isinstance(value, float):
        return repr(float(value))  # nan and inf are words of TOML, too
    return json.dumps(value if isinstance(value, int) else str(value), ensure_ascii=False)
