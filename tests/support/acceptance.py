"""The evidence for one chosen effect with a class that a test states."""

from __future__ import annotations

from collections.abc import Sequence

from ecm.diagnosis.accept import AcceptanceCheck, _Chosen, share_of
from ecm.diagnosis.problem import Candidate, Problem


def acceptance_check(
    problem: Problem,
    chosen: Sequence[Candidate],
    item: Candidate,
    members: Sequence[str],
    seed: int,
) -> AcceptanceCheck:
    """Return the evidence for `item`, whose class has these members, given the other chosen."""
    one = _Chosen(problem, chosen, item)
    winners = one.winners(seed)
    return one.in_class(one.alone(), winners, members, share_of(winners, members))
