"""The layout of model files: type, shape and range of each value, checked before any is used.

A checksum says that a file is as it was written, not that its writer was this program. Each family
of models states the layout of its own keys (`ModelSpecification.layout`); `check_document` adds
what all have. A layout is a function of a value and of its place, which raises InputError.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from ecm.errors import InputError, shown
from ecm.io.arrays import LARGEST

Layout = Callable[[Any, str], None]
Keys = Mapping[str, Layout]

_LEAST = 1e-100
"""Smallest positive number: the inverse of a smaller one is too large."""


def _wrong(place: str, value: Any, expected: str) -> InputError:
    found = f"shape {np.shape(value)}" if isinstance(value, np.ndarray) else shown(value)
    return InputError(f"{place}: found {found}, expected {expected}")


def number(low: float = -LARGEST, *, positive: bool = False) -> Layout:
    """A finite number from `low`, or above 0, to 1e100.

    Examples
    --------
    >>> number(0.0)(2.5, "noise.force_sd_N")
    >>> try:
    ...     number(0.0)("2.5", "noise.force_sd_N")
    ... except InputError as error:
    ...     print(error)
    noise.force_sd_N: found '2.5', expected a number of at least 0
    """
    least = _LEAST if positive else low
    words = "above 0" if positive else f"of at least {low:g}" if low > -LARGEST else "up to 1e100"

    def holds(value: Any) -> bool:
        known = isinstance(value, int | float) and not isinstance(value, bool)
        return known and least <= value <= LARGEST  # nan fails, too

    return must(holds, f"a number {words}")


def must(holds: Callable[[Any], bool], words: str) -> Layout:
    """A value of which something holds; else it was expected to be what the words say."""

    def check(value: Any, place: str) -> None:
        if not holds(value):
            raise _wrong(place, value, words)

    return check


text = must(lambda value: isinstance(value, str), "text")
flag = must(lambda value: isinstance(value, bool), "true or false")
anything = must(lambda value: True, "anything")


def one_of(*choices: str) -> Layout:
    """One of these texts."""
    return must(lambda value: value in choices, f"one of {', '.join(choices)}")


def exactly(expected: Any) -> Layout:
    """This value and no other."""
    return must(lambda value: bool(value == expected), str(expected))


def or_null(layout: Layout) -> Layout:
    """As the layout, or null."""

    def check(value: Any, place: str) -> None:
        if value is not None:
            layout(value, place)

    return check


def array(*shape: int | None, positive: bool = False, most: float = LARGEST) -> Layout:
    """Nested lists of finite numbers; None leaves a length open, which is at least 1.

    Examples
    --------
    >>> try:
    ...     array(2, None)([[1.0, 2.0], [3.0]], "layers[0].matrix")
    ... except InputError as error:
    ...     print(error)
    layers[0].matrix: found [[1.0, 2.0], [3.0]], expected numbers in the shape (2, N)
    """
    sizes = ", ".join("N" if size is None else str(size) for size in shape)
    above = " above 0" if positive else ""
    words = f"numbers{above} in the shape ({sizes}{',' if len(shape) == 1 else ''})"

    def check(value: Any, place: str) -> None:
        if not isinstance(value, list):
            raise _wrong(place, value, words)
        try:
            values = np.array(value)
        except (ValueError, OverflowError):  # lists of different lengths
            raise _wrong(place, value, words) from None
        if values.dtype.kind not in "fiu":
            raise _wrong(place, value, words)
        fits = values.ndim == len(shape) and values.size > 0
        if not fits or any(s not in (n, None) for s, n in zip(shape, values.shape, strict=True)):
            raise _wrong(place, values, words)
        numbers = values.astype(np.float64)
        bad = ~(np.abs(numbers) <= most) | (positive & (numbers < _LEAST))
        if bad.any():
            at = tuple(int(i) for i in np.argwhere(bad)[0])
            inside = "".join(f"[{i}]" for i in at)
            raise _wrong(f"{place}{inside}", values[at].item(), f"a number{above} up to {most:g}")

    return check


def items(layout: Layout, least: int = 0) -> Layout:
    """A list of values of one layout."""
    words = "a list" if not least else f"a list of at least {least}"
    whole = must(lambda value: isinstance(value, list) and len(value) >= least, words)
    return _each(whole, lambda value: ((f"[{i}]", item, layout) for i, item in enumerate(value)))


def row(*layouts: Layout) -> Layout:
    """A list with a layout for each of its values."""
    n = len(layouts)
    whole = must(lambda value: isinstance(value, list) and len(value) == n, f"a list of {n} values")
    return _each(
        whole, lambda value: ((f"[{i}]", value[i], layout) for i, layout in enumerate(layouts))
    )


def named(layout: Layout) -> Layout:
    """An object whose values have one layout, under any names."""
    return _each(
        _an_object, lambda value: ((f".{shown(key)}", value[key], layout) for key in value)
    )


_an_object = must(lambda value: isinstance(value, dict), "an object")


def _each(whole: Layout, parts: Callable[[Any], Iterable[tuple[str, Any, Layout]]]) -> Layout:
    """A layout of the whole, then of each of its parts: place within it, value and layout."""

    def check(value: Any, place: str) -> None:
        whole(value, place)
        for at, item, layout in parts(value):
            layout(item, f"{place}{at}")

    return check


def record(needed: Keys, optional: Keys | None = None, *, others: bool = False) -> Layout:
    """An object with these keys, with or without the optional ones; `others` may stand beside."""
    known = {**needed, **(optional or {})}

    def check(value: Any, place: str) -> None:
        _an_object(value, place)
        begin = f"{place}." if place else ""
        for key in needed:
            if key not in value:
                raise InputError(f"{begin}{key}: missing")
        for key, item in value.items():
            if key in known:
                known[key](item, f"{begin}{key}")
            elif not others:
                raise InputError(
                    f"{begin}{shown(key)}: an unknown key, expected {', '.join(known)}"
                )

    return check


_PAIR = row(number(), number())


def _range(value: Any, place: str) -> None:
    """Smallest and largest number of a column."""
    _PAIR(value, place)
    if value[0] > value[1]:
        raise _wrong(place, value, "the smaller number first")


def _domain(inputs: Sequence[str]) -> Layout:
    """Ranges of all pose columns, or of none."""

    def check(value: Any, place: str) -> None:
        named(_range)(value, place)
        if value:
            record(dict.fromkeys(inputs, anything), others=True)(value, place)

    return check


_ERROR = number(0.0)
_NOISE = record({"source": one_of("repeats", "declared", "assumed")}, dict.fromkeys((
    "position_sd_m", "rotation_sd_rad", "force_sd_N", "torque_sd_Nm", "growth_per_N",
    "growth_per_Nm"), _ERROR))  # fmt: skip
_EFFECT = record(
    {
        "id": text,
        "shape": named(anything),
        "frozen": flag,
        "parameters": named(record({"value": number(), "sd": or_null(_ERROR)}, others=True)),
    },
    others=True,
)
_SCENE = record({}, {"gravity_m_s2": array(3), "payload_mass_kg": or_null(_ERROR)})
_FIT = record(
    {"name": text, "train": _ERROR, "held_out": _ERROR, "ceiling": or_null(_ERROR)},
    {"floor": _ERROR, "chi2": _ERROR, "parameters": _ERROR, "size": _ERROR}
    | {"rows": text, "test": text},
    others=True,
)


def _either(first: Layout, other: Layout) -> Layout:
    def check(value: Any, place: str) -> None:
        try:
            first(value, place)
        except InputError:
            other(value, place)

    return check


def _training(n: int, m: int, taken: int) -> Layout:
    sentence = or_null(record({"sentence": text}, others=True))
    known = {
        **dict.fromkeys(("rows", "largest_leverage"), or_null(_ERROR)),
        **dict.fromkeys(("over_noise", "residual_variance"), _ERROR),
        **dict.fromkeys(("hash", "source"), or_null(text)),
        **dict.fromkeys(("effect_sizes", "effect_shares", "means"), named(number())),
        **dict.fromkeys(("pose_error", "rows_used", "form", "prior", "slow_noise"), sentence),
        "poses": _either(array(None, n), array(None, taken)),
        "smallest_taken": flag,
        "mean_stiffness": array(m, n),
        "of_fit": named(_either(number(), _either(array(None), array(None, None)))),
    }
    return record({}, known, others=True)


def check_document(document: Mapping[str, Any], count: int, taken: int) -> None:
    """Check what all families have in an opened model file.

    Parameters
    ----------
    document
        The document; its columns are a list of names, as `open_model` ensures.
    count
        Number of coefficients.
    taken
        Number of columns that the map takes, those of its actuators too.

    Raises
    ------
    InputError
        A value has another type, shape or range; the message names its place.
    """
    n, m = len(document["inputs"]), len(document["outputs"])
    residual = record({"source": text, "components": array(m, positive=True)})
    noise = document["noise"]
    of_components = isinstance(noise, dict) and "components" in noise
    needed = {
        "length_m": or_null(number(positive=True)),
        "noise": residual if of_components else _NOISE,
        "effects": items(_EFFECT),
        "covariance": anything,
        "training": _training(n, m, taken),
        "domain": _domain(document["inputs"]),
    }
    optional = {
        "scene": _SCENE,
        "conditions": named(_range),
        "base_frozen": flag,
        "correlations": items(row(text, text, number())),
        "history": items(_FIT),
    }
    record(needed, optional, others=True)(document, "")
    _check_covariance(document, count)


def _check_covariance(document: Mapping[str, Any], count: int) -> None:
    """Check the covariance of so many coefficients, in each of the forms that a file may have."""
    m = len(document["outputs"])
    outputs = document.get("covariance_of_outputs")
    size = count if outputs is None else count // m
    or_null(array(size, size))(document["covariance"], "covariance")
    if outputs is not None:
        array(m, m)(outputs, "covariance_of_outputs")
    if document["covariance"] is None and document.get("covariance_sd") is not None:
        array(count, positive=True)(document["covariance_sd"], "covariance_sd")
        rows = [array(i, most=1.0) for i in range(1, count)]
        row(*rows)(document.get("covariance_correlation"), "covariance_correlation")


T = TypeVar("T")
_READ: Mapping[str, Callable[[Any], Any]] = {
    "F": lambda value: np.asarray(value, dtype=np.float64),
    "int": int,
    "float": float,
    "tuple[float, float]": lambda value: (float(value[0]), float(value[1])),
}
"""How a value of a file becomes a field, by its annotation; others are taken as they are."""


def plain(item: Any) -> dict[str, Any]:
    """The fields of a dataclass of numbers and arrays, for a model file or the cache."""
    values = {own.name: getattr(item, own.name) for own in fields(item)}
    lists = {n: np.asarray(v).tolist() for n, v in values.items() if not isinstance(v, str)}
    return {**values, **lists}


def read_plain(kind: Callable[..., T], document: Mapping[str, Any]) -> T:
    """The dataclass whose fields `plain` wrote, from a document of a layout that was checked."""
    own = fields(kind)  # type: ignore[arg-type]
    return kind(**{f.name: _READ.get(str(f.type), lambda v: v)(document[f.name]) for f in own})
