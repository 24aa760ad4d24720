"""What analyses of the same data share is worked out once: problem and noise effects.

None of them depends on the seed or the folds, so that a further analysis of the same data only
repeats the stages that do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ecm.diagnosis import Stages
from ecm.diagnosis.left_over import Unknown
from ecm.diagnosis.problem import Problem

SHARED = ("assemble", "noise")
"""Stages whose results are kept."""
NOT_DESCRIBED = Unknown((), "", None, "")


def only_the_answer(stages: Stages) -> Stages:
    """Stages without the description of unknown structure, which the verdict does not need."""
    return replace(stages, describe=lambda *_: NOT_DESCRIBED)


class Work:
    """Results of the shared stages of one analysis, in the order of its calls."""

    def __init__(self, stages: Stages | None = None) -> None:
        self._stages = Stages() if stages is None else stages
        self._kept: dict[str, list[Any]] = {name: [] for name in SHARED}

    @property
    def problem(self) -> Problem:
        """The linearised problem that the analysis ended with."""
        problem: Problem = self._kept["assemble"][-1]
        return problem

    def recording(self) -> Stages:
        """Stages that keep what the shared ones return."""
        return replace(self._stages, **{name: self._recorded(name) for name in SHARED})

    def replaying(self) -> Stages:
        """Stages that return the same again."""
        again = {name: self._again(name) for name in SHARED}
        return only_the_answer(replace(self._stages, **again))

    def _recorded(self, name: str) -> Callable[..., Any]:
        real, kept = getattr(self._stages, name), self._kept[name]

        def stage(*given: Any) -> Any:
            kept.append(real(*given))
            return kept[-1]

        return stage

    def _again(self, name: str) -> Callable[..., Any]:
        real, left = getattr(self._stages, name), iter(self._kept[name])

        def stage(*given: Any) -> Any:
            kept = next(left, None)
            return real(*given) if kept is None else kept

        return stage
