"""The probability that a verdict is right, calibrated on fresh sets of the three benchmarks.

The chance of chance alone is far below 1e-6 for nearly every name; what makes names wrong is that
another cause looks alike, or that the truth is in no catalogue. So the probability is the share of
right verdicts of the same evidence among sets whose cause is known (Platt 1999): logit P = w'x,

    x = (1, log of the chi^2 that the weakest effect explains, members of the largest class)

for a name or a class, and x = (1, BIC of the best effect that is not named) for `none`. A family
carries its own posterior. `benches/blind_ablation.py --calibration` fits w and prints how often
verdicts of each probability were right.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ecm.diagnosis.search import delta_chi2

if TYPE_CHECKING:
    from ecm.diagnosis.decision import Decision

WEIGHTS = {
    "named": (-2.22, 0.86, -0.68),
    "none": (2.75, -1.06),
    "unknown": (1.16,),
}
"""w by verdict, of 483 sets of the seeds 21 and 22; an `ambiguous` one is as a named one."""


def evidence(decision: Decision) -> tuple[str, tuple[float, ...]]:
    """Return the key in `WEIGHTS` and x of a verdict that is no family."""
    if decision.verdict in ("named", "ambiguous"):
        effects, classes = decision.accepted.effects, decision.accepted.classes
        total = delta_chi2(decision.problem, effects)
        weakest = min(
            total - delta_chi2(decision.problem, [one for one in effects if one is not item])
            for item in effects
        )
        members = max(len(one) for one in classes)
        return "named", (1.0, float(np.log(max(weakest, 1.0))), float(members))
    if decision.verdict == "none":
        best = max((item.delta_bic for item in decision.ranking), default=0.0)
        return "none", (1.0, float(np.clip(best / 10.0, -1.0, 5.0)))
    return "unknown", (1.0,)


def probability(decision: Decision) -> float:
    """Return the probability that the verdict is right: of a name or class, that it is a cause.

    Of `none` it is that nothing is there which these data could show, of `unknown` that no effect
    of the catalogue is the cause.
    """
    if decision.family is not None:
        return decision.family.probability
    key, x = evidence(decision)
    return float(1.0 / (1.0 + np.exp(-np.dot(WEIGHTS[key], x))))
