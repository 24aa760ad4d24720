"""Rules of the diagnosis that can be left out, each by changing a function of `ecm.diagnosis`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np

_ROOM = "ecm.diagnosis."
Change = tuple[str, Callable[..., Any]]


def _nothing(*_: Any, **__: Any) -> None:
    return None


def _no(*_: Any, **__: Any) -> bool:
    return False


def _yes(*_: Any, **__: Any) -> bool:
    return True


def _no_words(*_: Any, **__: Any) -> str:
    return ""


def _no_errors(rows: Any, base: Any) -> Any:
    return np.zeros((len(rows), len(base.outputs), 0))


RULES: dict[str, tuple[Change, ...]] = {
    "": (),
    "patterns in time and neighbours": (
        ("procedure.STAGES.white", _nothing),
        ("classify.find_pattern", _nothing),
    ),
    "one direction of the wrench": (("procedure.STAGES.direction", _nothing),),
    "base of unlike ends": (("procedure.base_of_unlike_ends", _nothing),),
    "base of the next degree": (("procedure.base_of_next_degree", _nothing),),
    "base beside names": (("procedure.base_beside_names", _nothing),),
    "another body": (("procedure.may_be_another_body", _no),),
    "neighbours alike": (("procedure._neighbours_alike", _nothing),),
    "plain form": (
        ("accept.explains_more_than_its_plain_form", _yes),
        ("confusion.explains_more_than_its_plain_form", _yes),
    ),
    "noise that grows with load": (("procedure.with_load_growth", lambda noise, _: noise),),
    "noise by what is left": (("procedure.noise_by_rest", lambda problem: problem.noise),),
    "fullest forms": (("procedure.fullest_forms", lambda problem, effects: effects),),
    "modulus and ratio": (
        ("procedure.modulus_warning", _no_words),
        ("procedure.ratio_warning", _no_words),
        ("classify.modulus_warning", _no_words),
    ),
    "error of the mesh": (("problem.error_columns", _no_errors),),
}
"""What is left out, by what it is called in the table; the first is the whole procedure."""


@contextmanager
def without(rule: str) -> Iterator[None]:
    """Leave a rule out while the block runs."""
    patches = []
    for place, change in RULES[rule]:
        module, _, name = place.partition(".")
        owner = _ROOM + module
        if "." in name:
            holder, name = name.split(".")
            owner += "." + holder
            # Stages are frozen.
            patches.append(_Frozen(owner, name, change))
        else:
            patches.append(patch(f"{owner}.{name}", change))
    try:
        for one in patches:
            one.start()
        yield
    finally:
        for one in reversed(patches):
            one.stop()


class _Frozen:
    """`patch` for a field of a frozen object."""

    def __init__(self, owner: str, name: str, change: Callable[..., Any]) -> None:
        module, holder = owner.rsplit(".", 1)
        self._owner = getattr(__import__(module, fromlist=[holder]), holder)
        self._name, self._change = name, change

    def start(self) -> None:
        self._before = getattr(self._owner, self._name)
        object.__setattr__(self._owner, self._name, self._change)

    def stop(self) -> None:
        object.__setattr__(self._owner, self._name, self._before)
