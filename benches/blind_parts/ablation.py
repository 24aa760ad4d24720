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
    """What leaves a rule out: other stages, functions and numbers, settings of the diagnosis."""

    stages: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    places: Mapping[str, Any] = field(default_factory=dict)
    limits: Mapping[str, Any] = field(default_factory=dict)


def _always(value: Any) -> Callable[..., Any]:
    return lambda *_, **__: value


def _no_errors(rows: Any, base: Any) -> Any:
    return np.zeros((len(rows), len(base.outputs), 0))


RULES = {
    # Another base, or fewer rows
    "base of unlike ends": Rule(places={"procedure.base_of_unlike_ends": _always(None)}),
    "base of the next degree": Rule(places={"procedure.base_of_next_degree": _always(None)}),
    "another body": Rule(places={"procedure.may_be_another_body": _always(False)}),
    "neighbours alike": Rule(places={"procedure._neighbours_alike": _always(None)}),
    # Noise
    "noise that grows with load": Rule(
        places={"procedure.with_load_growth": lambda noise, _: noise}
    ),
    "noise by what is left": Rule(
        places={"procedure.noise_by_rest": lambda problem: problem.noise}
    ),
    "error of the mesh": Rule(places={"problem.error_columns": _no_errors}),
    "rows that are outliers": Rule(places={"problem.OUTLIER_CHANCE": 1e-300}),
    # Search
    "share of a further effect": Rule(places={"search.MATERIAL_SHARE": 0.0}),
    "one cause is likelier": Rule(places={"search.ONE_CAUSE_SHARE": 0.0}),
    "shapes refined": Rule(places={"problem.SHAPE_REFINEMENTS": 0}),
    # Acceptance
    "held-out error falls": Rule(limits={"held_out_errors": -1e9}),
    "bootstraps": Rule(places={"accept.CHOSEN_SHARE": 0.0}),
    "within bounds": Rule(places={"accept.KEPT_WITHIN_BOUNDS": 0.0}),
    "plain form": Rule(places={"accept.explains_more_than_its_plain_form": _always(True)}),
    # Classes
    "rivals that look alike": Rule(places={"accept.SEPARABLE": 0.0}),
    "share of the form": Rule(
        places={f"{module}.FORM_SHARE": 0.0 for module in ("accept", "family")}
    ),
    "rivals that win bootstraps": Rule(places={"accept.RIVAL_BOOTSTRAPS": 1.0}),
    "close rivals that win some": Rule(places={"accept.CLOSE_BIC": 0.0}),
    "wider class beside another": Rule(limits={"near_share": 0.0}),
    "wider class in doubt": Rule(places={"verdict.DOUBTFUL_SHARE": 1.0}),
    # Verdict
    "left after names": Rule(places={"left_over.LEFT_SHARE": (1.0, 1.0, 1.0, 1.0)}),
    "least strength": Rule(places={"left_over.LEAST_STRENGTH": 0.0}),
    "other readings": Rule(places={"statements.LEAST_WRONG_ERROR": 1e9}),
    "modulus and ratio": Rule(
        places={
            "procedure.modulus_warning": _always(""),
            "procedure.ratio_warning": _always(""),
            "verdict.modulus_warning": _always(""),
            "verdict.ratio_warning": _always(""),
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
            for place, change in rule.places.items():
                patches.enter_context(patch(f"ecm.diagnosis.{place}", change))
            stages = replace(stages, **rule.stages)
            settings = replace(settings, **rule.limits)
        yield stages, settings
