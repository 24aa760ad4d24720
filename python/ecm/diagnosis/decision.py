"""The results of all stages together, before they are reported."""

from __future__ import annotations

from dataclasses import dataclass

from ecm.diagnosis.accept import Accepted
from ecm.diagnosis.classify import Headline
from ecm.diagnosis.family import Family
from ecm.diagnosis.gate import Gate, Leftover
from ecm.diagnosis.preparation import Prepared
from ecm.diagnosis.problem import Problem
from ecm.diagnosis.search import Ranked
from ecm.diagnosis.stated_numbers import NoiseFinding
from ecm.diagnosis.unexplained import Unknown
from ecm.effects import Missing


@dataclass(frozen=True)
class Decision:
    """Results of the stages against one base."""

    prepared: Prepared
    problem: Problem
    noise_effects: tuple[NoiseFinding, ...]
    gate: Gate
    ranking: tuple[Ranked, ...]
    accepted: Accepted
    left: Leftover
    verdict: Headline
    unknown: Unknown | None
    warnings: tuple[str, ...] = ()
    family: Family | None = None
    """What drives the missing effect, where its form is not known."""
    neighbours_alike: bool = False
    """Whether fewer rows of a log were used, since its neighbours err alike."""

    @property
    def answer(self) -> tuple[tuple[str, ...], ...]:
        """One tuple per missing effect: one id when named, the class when ambiguous."""
        return self.accepted.classes if self.verdict in ("named", "ambiguous") else ()

    @property
    def not_testable(self) -> dict[str, Missing]:
        """Why an effect was not tested, and what to record, by id."""
        return self.problem.untestable | self.prepared.carried

    @property
    def strength_left(self) -> float:
        """Structure that is left after the accepted effects, rms in noise units."""
        return self.left.strength(self.problem)
