"""Rules of the diagnosis that can be left out, each by changing a function of `ecm.diagnosis`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any
from unittest.mock import patch

import numpy as np

from ecm.diagnosis.procedure import STAGES, Stages


@dataclass(frozen=True)
class Rule:
    """What leaves a rule out: other stages, and other functions of the modules of the diagnosis."""

    stages: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    functions: Mapping[str, Callable[..., Any]] = field(default_factory=dict)


def _always(value: Any) -> Callable[..., Any]:
    return lambda *_, **__: value


def _no_errors(rows: Any, base: Any) -> Any:
    return np.zeros((len(rows), len(base.outputs), 0))


_PLAIN = "explains_more_than_its_plain_form"
RULES = {
    "": Rule(),
    "patterns in time and neighbours": Rule(stages={"white": _always(None)}),
    "one direction of the wrench": Rule(stages={"direction": _always(None)}),
    "base of unlike ends": Rule(functions={"procedure.base_of_unlike_ends": _always(None)}),
    "base of the next degree": Rule(functions={"procedure.base_of_next_degree": _always(None)}),
    "base beside names": Rule(functions={"procedure.base_beside_names": _always(None)}),
    "another body": Rule(functions={"procedure.may_be_another_body": _always(False)}),
    "neighbours alike": Rule(functions={"procedure._neighbours_alike": _always(None)}),
    "plain form": Rule(
        functions={f"{module}.{_PLAIN}": _always(True) for module in ("accept", "confusion")}
    ),
    "noise that grows with load": Rule(
        functions={"procedure.with_load_growth": lambda noise, _: noise}
    ),
    "noise by what is left": Rule(
        functions={"procedure.noise_by_rest": lambda problem: problem.noise}
    ),
    "fullest forms": Rule(functions={"procedure.fullest_forms": lambda _, effects: effects}),
    "modulus and ratio": Rule(
        functions={
            "procedure.modulus_warning": _always(""),
            "procedure.ratio_warning": _always(""),
            "classify.modulus_warning": _always(""),
        }
    ),
    "error of the mesh": Rule(functions={"problem.error_columns": _no_errors}),
}
"""By what each is called in the table; the first leaves nothing out."""


@contextmanager
def without(rule: str) -> Iterator[Stages]:
    """Leave a rule out while the block runs with these stages."""
    with ExitStack() as patches:
        for place, change in RULES[rule].functions.items():
            patches.enter_context(patch(f"ecm.diagnosis.{place}", change))
        yield replace(STAGES, **RULES[rule].stages)
