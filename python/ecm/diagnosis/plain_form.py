"""Whether the data show what an effect alone does, beyond a plainer thing that does the rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.diagnosis.problem import Candidate, Problem, with_more
from ecm.diagnosis.search import LEAST_BIC, delta_chi2, normal_equations
from ecm.effects import Effect


def plain_form(item: Candidate) -> Effect | None:
    """What would look the same without the effect's own sign; most effects have no such thing."""
    return item.effect.plain_form()


def sign_is_significant(problem: Problem, chosen: Sequence[Candidate], item: Candidate) -> bool:
    """Whether the effect explains more than its plainer form does in its place, by BIC at least."""
    plain = plain_form(item)
    if plain is None:
        return True
    wider, (other,) = with_more(problem, (plain,))
    equations = normal_equations(wider)
    others = [one for one in chosen if one is not item]
    own = delta_chi2(equations, wider, (*others, item))
    price = np.log(problem.size) * max(0, item.parameters - other.parameters)
    return bool(own - delta_chi2(equations, wider, (*others, other)) > LEAST_BIC + price)
