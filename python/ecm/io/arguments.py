"""What a public function or setting was given, checked against its annotations.

A wrong type is refused with the name of the argument, what was found and what was expected, before
any work begins. What an annotation leaves open (`Any`, a table of any kind) is for the function.
"""

from __future__ import annotations

import collections.abc
import numbers
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from ecm.errors import InputError

_WORDS: dict[Any, str] = {
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    str: "text",
    Path: "a path",
    np.ndarray: "an array of numbers",
    type(None): "None",
}
_NUMBERS: dict[Any, Any] = {
    bool: (bool, np.bool_),
    int: numbers.Integral,
    float: numbers.Real,
    Path: (Path, str),
}
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


def check_fields(settings: Any) -> None:
    """Refuse fields of a dataclass that are of a wrong type; for its `__post_init__`."""
    hints = hints_of(type(settings))
    for item in fields(settings):
        check_type(item.name, getattr(settings, item.name), hints[item.name])


def check_type(name: str, value: Any, hint: Any) -> None:
    """Raise InputError where a value does not fit an annotation."""
    if not _fits(value, hint):
        raise InputError(f"{name} = {_shown(value)}: expected {_words(hint)}")


def _fits(value: Any, hint: Any) -> bool:  # noqa: PLR0911 - one return a kind of annotation
    origin, options = get_origin(hint), get_args(hint)
    if hint is Any or hint is object or isinstance(hint, str):
        return True
    if hint == ArrayLike:
        return _is_array(value)
    if hint is None or hint is type(None):
        return value is None
    if origin in (Union, types.UnionType):
        return any(_fits(value, option) for option in options)
    if origin is Literal:
        return any(type(value) is type(option) and value == option for option in options)
    if hint is np.ndarray or origin is np.ndarray:
        return _is_array(value)
    if origin is tuple or origin in (list, collections.abc.Sequence, collections.abc.Collection):
        return _is_sequence(value) and all(_fits(item, options[0]) for item in value)
    if origin in (dict, collections.abc.Mapping):
        return isinstance(value, Mapping) and all(
            _fits(key, options[0]) and _fits(item, options[1]) for key, item in value.items()
        )
    if origin is collections.abc.Callable or hint is Callable:
        return callable(value) and not isinstance(value, type)
    if hint in (int, float) and isinstance(value, (bool, np.bool_)):
        return False
    known = _NUMBERS.get(hint, origin or hint)
    try:
        return isinstance(value, known)
    except TypeError:  # a protocol that cannot be looked at
        return True


def _is_sequence(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.ndim == 1
    return isinstance(value, Sequence) and not isinstance(value, (str, bytes))


def _is_array(value: Any) -> bool:
    if isinstance(value, (str, bytes, Mapping)) or value is None:
        return False
    try:
        return np.asarray(value).dtype.kind in "fiub"
    except (TypeError, ValueError):
        return False


def _words(hint: Any) -> str:  # noqa: PLR0911 - one return a kind of annotation
    """What an annotation expects, in words."""
    origin, options = get_origin(hint), get_args(hint)
    if hint == ArrayLike:
        return _WORDS[np.ndarray]
    if hint in _WORDS:
        return _WORDS[hint]
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_words(option) for option in options))
    if origin is Literal:
        return f"one of {', '.join(map(str, options))}"
    if origin is np.ndarray:
        return _WORDS[np.ndarray]
    if origin in (dict, collections.abc.Mapping):
        return "a dict"
    if origin is collections.abc.Callable:
        return "a function"
    if origin is not None and options:
        return f"a list of {_words(options[0])}"
    return f"a {getattr(hint, '__name__', hint)}"


def _shown(value: Any) -> str:
    """A value as text of one line; of what is long, its type."""
    if isinstance(value, (str, bytes, numbers.Number, type(None))):
        text = repr(value)
        return text if len(text) <= 60 else f"{text[:57]}..."
    shape = getattr(value, "shape", None)
    of = f" of shape {shape}" if isinstance(shape, tuple) else ""
    name = value.__name__ if isinstance(value, type) else type(value).__name__
    return f"a {name}{of}"
