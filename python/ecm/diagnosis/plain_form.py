"""Plain-form test: whether the data show what an effect alone does, beyond a plainer form of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.diagnosis.problem import Candidate, Problem, with_more
from ecm.diagnosis.search import delta_chi2


def sign_is_significant(problem: Problem, chosen: Sequence[Candidate], item: Candidate) -> bool:
    """Whether the effect explains more than its plain form in its place, by the least BIC."""
    plain = item.effect.plain_form()
    if plain is None:
        return True
    wider, (other,) = with_more(problem, (plain,))
    others = [one for one in chosen if one is not item]
    gain = delta_chi2(wider, (*others, item)) - delta_chi2(wider, (*others, other))
    price = np.log(problem.size) * max(0, item.parameters - other.parameters)
    return bool(gain > problem.settings.least_bic + price)
