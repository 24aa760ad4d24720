"""Rules of the diagnosis that can be left out, to see what each is good for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any
from unittest.mock import patch

import numpy as np

from ecm.diagnosis.procedure import STAGES, Stages
from ecm.diagnosis.settings import DEFAULTS, DiagnosisSettings


@dataclass(frozen=True)
class Rule:
    """What leaves a rule out: other stages, other functions of the diagnosis, other limits."""

    stages: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    functions: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    limits: Mapping[str, Any] = field(default_factory=dict)


def _always(value: Any) -> Callable[..., Any]:
    return lambda *_, **__: value


def _no_errors(rows: Any, base: Any) -> Any:
    return np.zeros((len(rows), len(base.outputs), 0))


_PLAIN = "explains_more_than_its_plain_form"
RULES = {
    # Another base, or fewer rows
    "base of unlike ends": Rule(functions={"procedure.base_of_unlike_ends": _always(None)}),
    "base of the next degree": Rule(functions={"procedure.base_of_next_degree": _always(None)}),
    "another body": Rule(functions={"procedure.may_be_another_body": _always(False)}),
    "neighbours alike": Rule(functions={"procedure._neighbours_alike": _always(None)}),
    # Noise
    "noise that grows with load": Rule(
        functions={"procedure.with_load_growth": lambda noise, _: noise}
    ),
    "noise by what is left": Rule(
        functions={"procedure.noise_by_rest": lambda problem: problem.noise}
    ),
    "error of the mesh": Rule(functions={"problem.error_columns": _no_errors}),
    "rows that are outliers": Rule(limits={"outlier_chance": 1e-300}),
    # Search
    "share of a further effect": Rule(limits={"material_share": 0.0}),
    "one cause is likelier": Rule(limits={"one_cause_share": 0.0}),
    "shapes refined": Rule(limits={"shape_refinements": 0}),
    # Acceptance
    "held-out error falls": Rule(limits={"held_out_errors": -1e9}),
    "bootstraps": Rule(limits={"chosen_share": 0.0}),
    "within bounds": Rule(limits={"kept_within_bounds": 0.0}),
    "plain form": Rule(
        functions={f"{module}.{_PLAIN}": _always(True) for module in ("accept", "confusion")}
    ),
    # Classes
    "rivals that look alike": Rule(limits={"separable": 0.0}),
    "share of the form": Rule(limits={"form_share": 0.0}),
    "rivals that win bootstraps": Rule(limits={"rival_bootstraps": 1.0}),
    "close rivals that win some": Rule(limits={"close_bic": 0.0}),
    "wider class beside another": Rule(limits={"near_share": 0.0}),
    "wider class in doubt": Rule(limits={"doubtful_share": 1.0}),
    # Verdict
    "left after names": Rule(limits={"left_share": (1.0, 1.0, 1.0, 1.0)}),
    "least strength": Rule(limits={"least_strength": 0.0}),
    "other readings": Rule(limits={"least_wrong_error": 1e9}),
    "modulus and ratio": Rule(
        functions={
            "procedure.modulus_warning": _always(""),
            "procedure.ratio_warning": _always(""),
            "classify.modulus_warning": _always(""),
            "classify.ratio_warning": _always(""),
        }
    ),
    "patterns in time and neighbours": Rule(stages={"white": _always(None)}),
}
"""By what each is called in the table."""


@contextmanager
def without(*rules: str) -> Iterator[tuple[Stages, DiagnosisSettings]]:
    """Leave rules out while the block runs with these stages and limits."""
    stages, settings = STAGES, DEFAULTS
    with ExitStack() as patches:
        for rule in map(RULES.__getitem__, rules):
            for place, change in rule.functions.items():
                patches.enter_context(patch(f"ecm.diagnosis.{place}", change))
            stages = replace(stages, **rule.stages)
            settings = replace(settings, **rule.limits)
        yield stages, settings
