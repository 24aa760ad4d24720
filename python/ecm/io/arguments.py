"""What a public function or setting was given, checked against its annotations.

A wrong type is refused with the name of the argument, what was found and what was expected, before
any work begins. What an annotation leaves open (`Any`, a table of any kind) is for the function.
"""

from __future__ import annotations

import numbers
import os
import types
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from ecm.errors import InputError, shown

_KINDS: dict[Any, tuple[Any, str]] = {
    bool: ((bool, np.bool_), "True or False"),
    int: (numbers.Integral, "a whole number"),
    float: (numbers.Real, "a number"),
    str: (str, "text"),
    Path: ((Path, str), "a path"),
    np.ndarray: (np.ndarray, "an array of numbers"),
    dict: (Mapping, "a dict"),
    Mapping: (Mapping, "a dict"),
    Callable: (Callable, "a function"),
    type(None): (type(None), "None"),
}
"""What a value of each annotation may be, and the words for it."""
_hints: dict[Any, dict[str, Any]] = {}


def check_arguments(function: Callable[..., Any], given: Mapping[str, Any]) -> None:
    """Refuse arguments of a wrong type.

    Parameters
    ----------
    function
        The function whose annotations count.
    given
        Its arguments by name: `locals()` in its first line.

    Raises
    ------
    InputError
        For the first argument that does not fit, and for a count or seed below 0.

    Examples
    --------
    >>> def visit(poses: list[str], times: int = 1) -> None:
    ...     check_arguments(visit, locals())
    >>> visit(["a"], times="two")
    Traceback (most recent call last):
    ...
    ecm.errors.InputError: times = 'two': expected a whole number
    """
    hints = hints_of(function)
    for name, value in given.items():
        if name in hints:
            check_type(name, value, hints[name])
            if isinstance(value, numbers.Integral) and int(value) < 0:
                raise InputError(f"{name} = {value}: expected 0 or more")


def hints_of(annotated: Any) -> dict[str, Any]:
    """Annotations by name; what is imported for type checkers alone is `Any`."""
    unknown: dict[str, Any] = {}
    while annotated not in _hints:
        try:
            _hints[annotated] = get_type_hints(annotated, localns=dict(unknown))
        except NameError as error:
            unknown[str(error.name)] = Any
    return _hints[annotated]


def path_of(given: str | Path) -> Path:
    """Return the path that was given, with the home folder for `~`: no shell has put it in.

    Examples
    --------
    >>> path_of("~/neck.json") == Path.home() / "neck.json"
    True
    """
    return Path(os.path.expanduser(given))


def listed(given: Any) -> list[Any]:
    """A list of what may be given alone, such as a name.

    Examples
    --------
    >>> listed("payload"), listed(["payload", "fts_drift"]), listed(())
    (['payload'], ['payload', 'fts_drift'], [])
    """
    return list(given) if _is_sequence(given) else [given]


def check_type(name: str, value: Any, hint: Any) -> None:
    """Raise InputError where a value does not fit an annotation."""
    if not _fits(value, hint):
        raise InputError(f"{name} = {_shown(value)}: expected {_words(hint)}")


def _origin(hint: Any) -> Any:
    """`list` of `list[str]`; what has no parts is its own origin."""
    return np.ndarray if hint == ArrayLike else get_origin(hint) or hint


def _fits(value: Any, hint: Any) -> bool:  # noqa: PLR0911 - one return a kind of annotation
    origin, options = _origin(hint), get_args(hint)
    if origin in (Any, object) or isinstance(hint, str):
        return True
    if origin is np.ndarray:
        return is_array(value)
    if origin in (Union, types.UnionType):
        return any(_fits(value, option) for option in options)
    if origin is Literal:
        return any(type(value) is type(option) and value == option for option in options)
    if origin in (tuple, list, Sequence, Collection):
        own = options[:1]
        return _is_sequence(value) and all(_fits(item, kind) for kind in own for item in value)
    if origin in (int, float) and isinstance(value, (bool, np.bool_)):
        return False
    try:
        known = isinstance(value, _KINDS.get(origin, (origin, ""))[0])
    except TypeError:  # a protocol that cannot be looked at
        return True
    if origin is Callable:
        return known and not isinstance(value, type)
    if origin in (dict, Mapping) and known and options:
        parts = zip(options, (value.keys(), value.values()), strict=True)
        return all(_fits(item, option) for option, part in parts for item in part)
    return known


def _is_sequence(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.ndim == 1
    return isinstance(value, Sequence) and not isinstance(value, (str, bytes))


def is_array(value: Any) -> bool:
    """Whether a value is an array of numbers, or numbers that make one."""
    if isinstance(value, (str, bytes, Mapping)) or value is None:
        return False
    try:
        return np.asarray(value).dtype.kind in "fiub"
    except (TypeError, ValueError):
        return False


def _words(hint: Any) -> str:
    """What an annotation expects, in words."""
    origin, options = _origin(hint), get_args(hint)
    if origin in _KINDS:
        return _KINDS[origin][1]
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_words(option) for option in options))
    if origin is Literal:
        return f"one of {', '.join(map(str, options))}"
    if options:
        return f"a list of {_words(options[0])}"
    return getattr(hint, "EXPECTED", None) or f"a {getattr(hint, '__name__', hint)}"


def _shown(value: Any) -> str:
    """A value as text of one line; of what is no number and no text, its type."""
    if isinstance(value, (str, bytes, numbers.Number, type(None))):
        return shown(value)
    shape = getattr(value, "shape", None)
    of = f" of shape {shape}" if isinstance(shape, tuple) else ""
    if isinstance(value, type):
        return f"the class {value.__name__} itself"
    return f"a {type(value).__name__}{of}"
