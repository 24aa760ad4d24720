"""Stages classify and verdict: the final class of each effect, and the headline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ecm.diagnosis.accept import Accepted
from ecm.diagnosis.confusion import widened_class
from ecm.diagnosis.gate import Gate, Leftover, residual_after
from ecm.diagnosis.problem import Problem
from ecm.diagnosis.readings import WrongStatement, find_wrong_statement
from ecm.diagnosis.stated_numbers import ratio_warning
from ecm.diagnosis.unexplained import Unknown, describe_residual
from ecm.diagnosis.whiteness import Pattern, explains_more, find_pattern
from ecm.io.arrays import F
from ecm.io.units import unit_of_factor
from ecm.models.physics.map import PhysicsMap

_NEAR_SHARE_IN_DOUBT = 0.6
"""Share of a name that a rival may lose where the form of the effect is in doubt."""
DOUBTFUL_SHARE = 0.04
"""The form is in doubt where more than this share is left,"""
_DOUBTFUL_P = 0.05
"""and where what is left is seen with this chance."""
_MOST_MODULUS_FACTOR = 5.0
"""Largest error of the stated E; beyond it a sign or a unit is wrong."""

Headline = Literal["none", "named", "ambiguous", "family", "unknown"]
Describe = Callable[..., Unknown]


@dataclass(frozen=True)
class Verdict:
    """The headline, and what it rests on."""

    headline: Headline
    accepted: Accepted
    """Effects that count: none of them where the stated body is wrong."""
    unknown: Unknown | None
    """What is left without a name."""


def classify(
    problem: Problem, accepted: Accepted, left: Leftover, *, other_body: bool = False
) -> Accepted:
    """Widen the class of each effect where its form is in doubt, or beside another departure.

    Two wrong names together may explain a third effect: each needs its rivals far away. So does
    one name beside a body that is not the stated one.

    Parameters
    ----------
    other_body
        Whether the base stands in for that of a stated body that does not fit.
    """
    settings = problem.settings
    if left.remains or modulus_warning(problem):
        return accepted
    doubtful = left.share > DOUBTFUL_SHARE and left.p < _DOUBTFUL_P
    if not doubtful and not other_body and len(accepted.effects) < 2:
        return accepted
    near = _NEAR_SHARE_IN_DOUBT if doubtful else settings.near_share
    classes = tuple(
        tuple(widened_class(problem, accepted.effects, item, members, near))
        for item, members in zip(accepted.effects, accepted.classes, strict=True)
    )
    return replace(accepted, classes=classes)


def verdict(
    problem: Problem,
    gate: Gate,
    accepted: Accepted,
    left: Leftover,
    *,
    describe: Describe = describe_residual,
    white: Callable[[Problem], Pattern | None] = find_pattern,
    misread: str = "",
) -> Verdict:
    """Give the headline.

    Parameters
    ----------
    describe
        Function that puts what is left into words.
    white
        Function that looks for a pattern before `none` or a name is said.
    misread
        What is wrong with the signs or columns of the table beyond doubt; empty where nothing is.
    """
    # A polynomial takes in most wrong readings: its gate does not see them.
    asked = gate.rejected or problem.base.kind == "polynomial"
    wrong = _wrong_statement(problem, accepted) if asked else None
    if wrong is not None:
        unknown = describe(problem, residual_after(problem, ()), (), gate.structure)
        said = replace(
            unknown,
            words=wrong.sentence(),
            nearest=None,
            statement=wrong,
            misread=True,
            template="",
        )
        return Verdict("unknown", Accepted(checks=accepted.checks), said)
    strange = _strange(problem, misread)
    if strange:
        unknown = describe(problem, residual_after(problem, ()), (), gate.structure)
        nothing = Accepted(checks=accepted.checks)
        said = replace(unknown, words=strange, nearest=None, misread=True, template="")
        return Verdict("unknown", nothing, said)
    may_name = bool(accepted.effects) and not left.remains
    single = all(len(members) == 1 for members in accepted.classes)
    pattern = _pattern_instead(problem, gate, accepted, left, white)
    if pattern is not None:
        unknown = describe(problem, residual_after(problem, ()), (), gate.structure)
        variables = (pattern.variable,) if pattern.variable else ()
        seen = replace(unknown, words=pattern.words, variables=variables, nearest=None)
        seen = replace(seen, template="", pattern=pattern)
        return Verdict("unknown", Accepted(checks=accepted.checks), seen)
    if may_name:
        return Verdict("named" if single else "ambiguous", accepted, None)
    if not accepted.effects and not (left.remains and gate.rejected):
        return Verdict("none", accepted, None)
    residual = residual_after(problem, accepted.effects)
    unknown = describe(problem, residual, accepted.effects, gate.structure)
    return Verdict("unknown", accepted, unknown)


def _strange(problem: Problem, misread: str) -> str:
    """Return what is wrong with the table or the stated body, in words; empty where nothing is.

    A body that is fitted to misread columns has any E and nu, which say nothing more.
    """
    modulus = modulus_warning(problem)
    if not misread:
        return modulus or ratio_warning(problem)
    reversed_body = isinstance(problem.base, PhysicsMap) and problem.base.factor < 0.0
    return f"{misread}; {modulus}" if reversed_body and modulus else misread


def _pattern_instead(
    problem: Problem,
    gate: Gate,
    accepted: Accepted,
    left: Leftover,
    white: Callable[[Problem], Pattern | None],
) -> Pattern | None:
    """Return a pattern where nothing is accepted and no function of the pose is left, or where it
    explains more than what is accepted: names would imitate a part of it.

    A periodic motion gives every effect its period: beside what is accepted a pattern must be left.
    """
    if not accepted.effects:
        return None if left.remains and gate.rejected else white(problem)
    pattern = white(problem)
    if not explains_more(pattern, problem, accepted.effects):
        return None
    beside = white(replace(problem, response=residual_after(problem, accepted.effects)))
    return None if beside is None else pattern


def _rms(problem: Problem, residual: F) -> float:
    """Return the weighted rms of a whitened residual (N, m)."""
    squares = (residual**2).sum(axis=1) @ problem.weights
    return float(np.sqrt(squares / (problem.weights.sum() * residual.shape[1])))


def _wrong_statement(problem: Problem, accepted: Accepted) -> WrongStatement | None:
    before = _rms(problem, residual_after(problem, ()))
    after = _rms(problem, residual_after(problem, accepted.effects))
    return find_wrong_statement(problem, accepted.effects, before, after)


def modulus_warning(problem: Problem) -> str:
    """Return what is wrong with the factor on E of a physics base; empty where it may be true."""
    if not isinstance(problem.base, PhysicsMap):
        return ""
    factor, most = problem.base.factor, _MOST_MODULUS_FACTOR
    if 1.0 / most < factor < most:
        return ""
    ratio = f"the wrench is {factor:.3g} times that of the stated body"
    if factor < 0.0:
        return f"{ratio}: a sign is likely wrong"
    unit = unit_of_factor(factor)
    if unit:
        return f"{ratio}: a unit is likely wrong ({unit})"
    return f"{ratio}, which is no unit's factor: [mechanism] states another body"
