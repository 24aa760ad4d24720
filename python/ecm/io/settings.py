"""TOML files, and settings: a table becomes a frozen dataclass; key, type and range are checked.

A settings class states each field once, with its default and range, and its meaning below:

    @dataclass(frozen=True)
    class Exchange(Checked):
        starts: int = setting(10, low=1)
        \"\"\"Random starts; the best one is kept.\"\"\"
"""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import math
import sys
import textwrap
import types
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from difflib import get_close_matches
from functools import cache
from itertools import pairwise
from numbers import Real
from pathlib import Path
from typing import Any, TypeVar, Union, cast, get_args, get_origin

from ecm.errors import InputError, Remedy, shown
from ecm.io.arguments import check_type, hints_of

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
OTHER_FILES = (
    "Save the sheet of a workbook, or the file of another program, as CSV; or read it in Python "
    "and give the data frame: ecm.import_log(frame)."
)
"""What to do with files that nothing here reads."""


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
        other = ""
        if "table" in what:
            other = f" ecm import reads MAT, HDF5, NPZ and bags. {OTHER_FILES}"
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
        names = [entry.name for entry in path.parent.iterdir() if entry.exists()]
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
    lines.extend(f"{_key(key)} = {toml_value(value)}" for key, value in plain.items())
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


def toml_value(value: Any) -> str:
    """Return the TOML text of a value; scalars but floats are written as in JSON.

    Examples
    --------
    >>> toml_value({"column": "y_m", "scale": -1.0})
    '{ column = "y_m", scale = -1.0 }'
    """
    if isinstance(value, Mapping):
        pairs = [f"{_key(k)} = {toml_value(v)}" for k, v in value.items() if v is not None]
        return f"{{ {', '.join(pairs)} }}" if pairs else "{}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(item) for item in value)}]"
    if isinstance(value, float):
        return repr(float(value))  # nan and inf are words of TOML, too
    return json.dumps(value if isinstance(value, int) else str(value), ensure_ascii=False)


POLYNOMIAL_DEGREES = (1, 6)
MOST_OF_ONE_INPUT = 9
"""Largest degree of a polynomial of a single pose column."""
ENERGY_DEGREES = (4, 6)


T = TypeVar("T")

_KINDS: dict[Any, tuple[Any, str]] = {
    float: ((int, float), "a number"),
    int: ((int, float), "a whole number"),
    bool: (bool, "true or false"),
    str: (str, "text in quotes"),
    Path: (str, "text in quotes"),
}
"""Python types that a TOML value may have for each annotation, and the words for them."""


@dataclass(frozen=True)
class Limits:
    """What a setting may be; also parameters of `setting`."""

    low: float = -math.inf
    """Smallest number, also of each entry of a list."""
    above: float = -math.inf
    """Exclusive lower limit."""
    high: float = math.inf
    """Largest number."""
    choices: tuple[str, ...] = ()
    """Texts that are allowed."""
    size: int | None = None
    """Number of entries of a list."""

    def check(self, value: Any, place: str) -> None:
        """Raise InputError where a value (or an entry of a list) is out of range."""
        if isinstance(value, bool):
            return
        if isinstance(value, (list, tuple)):
            if self.size is not None and len(value) != self.size:
                raise InputError(
                    f"{place} has {len(value)} entries: expected a list of {self.size} numbers"
                )
            for i, entry in enumerate(value):
                self.check(entry, f"{place}[{i}]")
        elif isinstance(value, str) and self.choices and value not in self.choices:
            likely = closest(value, self.choices)
            hint = f", did you mean '{likely}'?" if likely else ""
            choices = ", ".join(filter(None, self.choices))
            raise InputError(f"{place} = '{value}': expected one of {choices}{hint}")
        elif isinstance(value, Real):
            number = float(value)
            if not math.isfinite(number):
                raise InputError(f"{place} = {value}: expected a finite number")
            if not (self.low <= number <= self.high and number > self.above):
                raise InputError(f"{place} = {value}: expected {self._range}")

    @property
    def _range(self) -> str:
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"a number from {self.low:g} to {self.high:g}"
        limits = (("above", self.above), ("at least", self.low), ("at most", self.high))
        return " and ".join(f"{word} {x:g}" for word, x in limits if math.isfinite(x))


@cache
def meanings(cls: type) -> dict[str, str]:
    """What each field of a dataclass means: the text below it in the source.

    Examples
    --------
    >>> from ecm.fem.simulate import Workspace
    >>> meanings(Workspace)["rotation_limit_rad"]
    'Largest rotation angle of an admissible pose, in rad, not degrees.'
    """
    found = {item.name: "" for item in fields(cls)}
    for kind in reversed([kind for kind in cls.__mro__ if is_dataclass(kind)]):
        with suppress(OSError):  # a package without its sources
            (node,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
            for item, below in pairwise(getattr(node, "body", ())):
                match item, below:
                    case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(ast.Constant(str(text))):
                        found[name] = " ".join(text.split())
    return found


def setting(default: Any = MISSING, *, any_size: bool = False, **limits: Any) -> Any:
    """Return a dataclass field whose range is checked when the settings are read.

    Parameters
    ----------
    default
        Value where the table has no such key; without it the key is required.
    any_size
        Whether a list may have another number of entries than its default.
    limits
        The fields of `Limits`.
    """
    if isinstance(default, tuple) and not any_size:
        limits["size"] = len(default)
    return field(default=default, metadata={"limits": Limits(**limits)})


def _check(cls: type, item: Any, value: Any, place: str) -> None:
    """Raise InputError where a setting is out of range, with what it means."""
    limits: Limits = item.metadata.get("limits", Limits())
    try:
        limits.check(value, place)
    except InputError as error:
        meaning = "" if limits.choices else meanings(cls)[item.name].rstrip(".")
        if meaning[1:2].islower():
            meaning = meaning[0].lower() + meaning[1:]
        raise InputError(f"{error} ({meaning})" if meaning else str(error)) from None


class Checked:
    """Base of settings that users also create in Python: types and ranges are checked then, too."""

    def __post_init__(self) -> None:
        hints = hints_of(self.__class__)
        for item in fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            value = getattr(self, item.name)
            check_type(item.name, value, hints[item.name])
            _check(self.__class__, item, value, item.name)
        self._check_together()

    def _check_together(self) -> None:
        """Raise InputError where one field does not fit another, or asks for more than a range."""


def read_settings(cls: type[T], table: Any, where: str) -> T:
    """Create a settings dataclass from a TOML table.

    Annotations give the types, `setting` the ranges. Every InputError begins with `where` (file and
    table, e.g. ``neck.toml [design]``) and names the key, what was found and what was expected.
    """
    if not isinstance(table, Mapping):
        raise InputError(f"{where}: found {shown(table)}, expected a table of settings")
    known = {item.name: item for item in fields(cls) if item.init}  # type: ignore[arg-type]
    check_keys(table, known, where)
    for name, item in known.items():
        required = item.default is MISSING and item.default_factory is MISSING
        if required and name not in table:
            raise InputError(f"{where}: the key '{name}' is missing")
    hints = hints_of(cls)
    values = {}
    for key, value in table.items():
        values[key] = _converted(value, hints[key], f"{where}: {key}")
        _check(cls, known[key], values[key], f"{where}: {key}")
    try:
        return cls(**values)
    except InputError as error:  # two fields that do not fit each other
        raise InputError(f"{where}: {error}") from None


def read_sections(
    kinds: Mapping[str, type], document: Mapping[str, Any], where: str
) -> dict[str, Any]:
    """Read the tables of these names, each as its kind of settings; an absent one has defaults."""
    return {
        name: read_settings(kind, document.get(name, {}), f"{where} [{name}]")
        for name, kind in kinds.items()
    }


def _converted(value: Any, hint: Any, place: str) -> Any:
    """Return a TOML value in the annotated type; InputError where it does not fit."""
    origin, options = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):  # `float | None`, `str | int`
        if value is None and type(None) in options:  # in a model file; TOML has no null
            return None
        kinds = [option for option in options if option is not type(None)]
        if len(kinds) == 1 or type(value) in kinds:
            return _converted(value, type(value) if type(value) in kinds else kinds[0], place)
        words = " or ".join(_KINDS[kind][1] for kind in kinds)
        raise InputError(f"{place} = {shown(value)}: expected {words}")
    if origin is tuple:
        if not isinstance(value, (list, tuple)):
            raise InputError(f"{place} = {shown(value)}: expected a list in square brackets")
        if options[-1] is not Ellipsis and len(value) != len(options):
            raise InputError(f"{place} has {len(value)} entries: expected {len(options)}")
        return tuple(_converted(v, options[0], f"{place}[{i}]") for i, v in enumerate(value))
    if is_dataclass(hint):
        return read_settings(cast("type", hint), value, place)
    accepted, words = _KINDS[hint]
    fits = isinstance(value, accepted) and (hint is bool or not isinstance(value, bool))
    if not fits or (hint is int and not float(value).is_integer()):
        raise InputError(f"{place} = {shown(value)}: expected {words}")
    return hint(value)
