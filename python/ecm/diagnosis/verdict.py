"""Stage verdict: the headline, and the probability that it is right.

The chance of chance alone is far below 1e-6 for nearly every name; what makes names wrong is that
another cause looks alike, or that the truth is in no catalogue. So the probability is the share of
right verdicts of the same evidence among sets whose cause is known (Platt 1999): logit P = w'x,
x of `evidence`. Beside effects of the model the odds of a name are nine to one less.
`benches/blind_calibration.py` fits w and prints how often verdicts of each probability were right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from scipy import special

from ecm.diagnosis.accept import Accepted
from ecm.diagnosis.family import FURTHER_CAUSE, Family, Posterior, posterior
from ecm.diagnosis.left_over import (
    Gate,
    Leftover,
    Pattern,
    Unknown,
    describe_residual,
    find_pattern,
    residual_after,
    runs_apart,
)
from ecm.diagnosis.preparation import Prepared
from ecm.diagnosis.problem import Problem
from ecm.diagnosis.search import (
    Ranked,
    Refinement,
    delta_chi2,
    explained_share,
    seen_in_repeats,
)
from ecm.diagnosis.statements import (
    NoiseFinding,
    WrongStatement,
    find_wrong_statement,
    modulus_warning,
    ratio_warning,
)
from ecm.effects import Missing
from ecm.models.physics.map import PhysicsMap
from ecm.regression.f_test import OUTLIER_CHANCE
from ecm.regression.slow_noise import SlowNoise

Headline = Literal["none", "named", "ambiguous", "family", "unknown"]
Describe = Callable[..., Unknown]


@dataclass(frozen=True)
class Decision:
    """Results of the stages against one base."""

    prepared: Prepared
    problem: Problem
    noise_effects: tuple[NoiseFinding, ...]
    gate: Gate
    ranking: tuple[Ranked, ...]
    accepted: Accepted
    """Effects that count: none of them where the table or the stated body is wrong."""
    left: Leftover
    unknown: Unknown | None = None
    """What is left without a name."""
    warnings: tuple[str, ...] = ()
    family: Family | None = None
    """What drives the missing effect, where its form is not known."""
    refinements: tuple[Refinement, ...] = ()
    """Richer forms of the effects that the search chose first."""
    several: Decision | None = None
    """With more effects, by themselves less likely than not."""
    fewer_tried: bool = False
    """Whether the best set of fewer effects was asked in place of these."""

    @property
    def verdict(self) -> Headline:
        """The headline: accepted effects are the answer where nothing else is said."""
        if self.family is not None:
            return "family"
        if self.unknown is not None:
            return "unknown"
        most = max(map(len, self.accepted.classes), default=0)
        return "none" if most == 0 else "named" if most == 1 else "ambiguous"

    @property
    def answer(self) -> tuple[tuple[str, ...], ...]:
        """One tuple per missing effect: one id when named, the class when ambiguous."""
        return self.accepted.classes if self.verdict in ("named", "ambiguous") else ()

    @property
    def not_testable(self) -> dict[str, Missing]:
        """Why an effect was not tested, and what to record, by id."""
        tested = self.problem.ids
        held = {id: why for id, why in self.prepared.of_model.items() if id not in tested}
        return self.problem.untestable | held

    @cached_property
    def without_effects(self) -> Posterior:
        """How likely each driver, the pose and nothing are, without a named effect."""
        return posterior(self.problem)

    @property
    def slow_noise(self) -> SlowNoise | None:
        """Slow part of the noise of a log; None where there is none."""
        slow = self.problem.noise.slow
        return None if slow is None else slow.said(self.gate.p)

    @property
    def misread(self) -> bool:
        """Whether the words say what looks wrong with the table."""
        return self.unknown is not None and self.unknown.misread

    @property
    def statement(self) -> WrongStatement | None:
        """Another reading of the table that explains what is left: no body is to blame."""
        return None if self.unknown is None else self.unknown.statement

    def without_names(self, describe: Describe, words: str, **seen: Any) -> Decision:
        """Return `unknown` with all structure said to be this, where no name and no draft helps."""
        everything = describe(self.problem, (), self.gate.structure)
        said = {"words": words, "nearest": None, "template": ""} | seen
        return replace(
            self,
            accepted=Accepted(checks=self.accepted.checks),
            unknown=replace(everything, **said),
        )


def verdict(
    found: Decision,
    *,
    describe: Describe = describe_residual,
    white: Callable[[Problem], Pattern | None] = find_pattern,
) -> Decision:
    """Give the headline of what the stages before found.

    `describe` puts what is left into words; `white` looks for a pattern before `none` or a name is
    said.
    """
    problem, gate, accepted, left = found.problem, found.gate, found.accepted, found.left
    if (wrong := _wrong_statement(found)) is not None:
        return found.without_names(describe, wrong.sentence(), statement=wrong, misread=True)
    if strange := _strange(found):
        return found.without_names(describe, strange, misread=True)
    still = left.remains and gate.rejected
    pattern = _pattern_instead(found, white)
    if pattern is not None:
        variables = (pattern.variable,) if pattern.variable else ()
        return found.without_names(describe, pattern.words, variables=variables, pattern=pattern)
    if accepted.effects and not left.remains:
        if not is_unlikely(found):
            return found
        # Less likely than not: none of the effects counts.
        accepted, still = Accepted(checks=accepted.checks), gate.rejected
        found = replace(found, accepted=accepted)
    if not accepted.effects and _nothing_is_likely(found, still):
        return found
    unknown = describe(problem, accepted.effects, gate.structure)
    return replace(found, unknown=unknown)


def _nothing_is_likely(found: Decision, still: bool) -> bool:
    """Whether nothing is likely enough to be said, where no effect is accepted.

    What smooth functions of the pose do not see passes the gate: drivers must not outweigh nothing
    so far that chance does it to one table of 10,000. One of a hundred tables without an effect
    does not pass it, one of 10,000 by far: there nothing must be the likeliest.
    """
    if still and found.gate.p <= OUTLIER_CHANCE:
        return False
    chances = found.without_effects
    if still:
        return chances.nothing_is_likeliest
    return chances.of_nothing >= OUTLIER_CHANCE * (1.0 - chances.of_pose)


def _wrong_statement(found: Decision) -> WrongStatement | None:
    """Return the reading of the table that explains what the base leaves; None where none does."""
    problem, effects = found.problem, found.accepted.effects
    # A polynomial takes in most wrong readings: its gate does not see them.
    if not found.gate.rejected and problem.base.kind != "polynomial":
        return None
    counted = problem.weights.sum() * problem.response.shape[1]
    before, after = (
        float(np.sqrt(problem.squares_of(residual_after(problem, some)) / counted))
        for some in ((), effects)
    )
    return find_wrong_statement(problem, effects, before, after)


def _strange(found: Decision) -> str:
    """Return what is wrong with the table or the stated body, in words; empty where nothing is.

    A body that is fitted to misread columns has any E and nu, which say nothing more.
    """
    problem, misread = found.problem, found.prepared.misread
    modulus = modulus_warning(problem)
    if misread is None or not misread.decided:
        return modulus or ratio_warning(problem)
    reversed_body = isinstance(problem.base, PhysicsMap) and problem.base.factor < 0.0
    said = misread.sentence()
    return f"{said}; {modulus}" if reversed_body and modulus else said


def _pattern_instead(found: Decision, white: Callable[[Problem], Pattern | None]) -> Pattern | None:
    """Return a pattern that explains more than what is accepted and what the model holds, or where
    nothing is accepted, than all smooth functions of the pose: these would imitate a part of it.

    A periodic motion gives every effect its period: beside what is accepted a pattern must be left.
    """
    problem, accepted = found.problem, found.accepted
    runs = runs_apart(problem, accepted.effects) if accepted.effects else None
    if runs is not None:
        return runs
    pattern = white(problem)
    named = delta_chi2(problem, accepted.effects) + problem.held
    if pattern is None or (named and pattern.explained <= named):
        return None
    if not accepted.effects:
        # By BIC: they are many, and imitate a part of anything.
        smooth = found.gate.smooth
        more = found.gate.structure + smooth.dof * (1.0 - np.log(problem.size))
        seen = more if found.gate.rejected and found.left.remains else 0.0
        return None if pattern.explained < seen else pattern
    beside = white(replace(problem, response=residual_after(problem, accepted.effects)))
    return None if beside is None else pattern


WEIGHTS = {"named": (1.27, -0.38, 1.1, -0.5), "none": (3.93, 0.5), "unknown": (2.39,),
           "family": (2.94,)}  # fmt: skip
"""w by verdict, of the seeds 101 to 103, 106, 107, 109, 110 and 112: 1083 names and classes, 422
`none`, 143 `unknown` and 80 families; an `ambiguous` one is as a named one."""


_AS_LIKELY = 0.5
"""Least probability of a name or class: below it the contrary is likelier."""
_LEAST_LEFT, _CHANCE = 0.003, 5.0
"""Share, and chi^2, that names leave below which less tells no more: form and chance leave them."""


def is_unlikely(found: Decision) -> bool:
    """Whether names are less likely than not."""
    return probability(found) < _AS_LIKELY


def evidence(decision: Decision) -> tuple[str, tuple[float, ...]]:
    """Return the key in `WEIGHTS` and x of a verdict."""
    if decision.answer and not decision.fewer_tried:
        problem, effects = decision.problem, decision.accepted.effects
        members = float(max(len(one) for one in decision.accepted.classes))
        share = min(1.0, *(explained_share(problem, effects, item) for item in effects))
        chance = _CHANCE / max(delta_chi2(problem, effects), _CHANCE)
        left = max(decision.left.share, _LEAST_LEFT, chance)
        return "named", (1.0, members, float(np.log(max(share, 1e-9))), float(np.log(left)))
    if decision.verdict == "none":
        nothing = decision.without_effects.of_nothing
        return "none", (1.0, float(np.clip(np.log(nothing / max(1.0 - nothing, 1e-9)), -5.0, 5.0)))
    # More names in place of a family are as likely as it is: all of them follow its driver.
    of_driver = decision.family is not None or decision.fewer_tried
    return ("family" if of_driver else "unknown"), (1.0,)


def probability(decision: Decision) -> float:
    """Return the probability that the verdict is right: of a name or class, that it is a cause.

    Of `none` it is that nothing is there which these data could show, of `unknown` that no effect
    of the catalogue is the cause, of a family that this is the driver.
    """
    key, x = evidence(decision)
    logit, problem = np.dot(WEIGHTS[key], x), decision.problem
    effects, own = decision.accepted.effects, {effect.id for effect in problem.holds}
    further = problem.held and not {item.id for item in effects} <= own
    if key == "named" and further and not seen_in_repeats(problem, effects):
        # The form of what the model holds is likelier than one more cause.
        logit += np.log(FURTHER_CAUSE)
    return float(special.expit(logit))
