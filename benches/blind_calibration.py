"""How sure the diagnosis is: its weights and probabilities on fresh sets of three blind benchmarks.

    python benches/blind_calibration.py --out build/calibration --seed 99 100 [--sets 300]

The weights of `ecm.diagnosis.verdict` are fitted to the sets of all seeds but the last (of one seed
none), in which every name is said however unlikely; on the last the probabilities of the code are
held against what was right. Every set is a file; one that is there is not run again.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

# Before numpy is imported, here and in the workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import numpy as np
from scipy.optimize import minimize

from blind import prepared
from blind_parts import other_bodies, other_sets, score, third
from blind_parts.analysis import library
from blind_parts.command import parser_of, run_sets, write_table
from blind_parts.data import data_of
from blind_parts.sets import set_of
from ecm import check
from ecm.diagnosis import diagnose, find_missing
from ecm.diagnosis.verdict import WEIGHTS, evidence, probability
from ecm.errors import EcmError
from ecm.io.table import Table
from ecm.models import Model

_TIERS = range(6)
_FRESH = 10_000
"""Sets of the first benchmark from this index on are none of its table."""


@dataclass(frozen=True)
class Case:
    """A set of one of the three benchmarks."""

    benchmark: int
    place: int
    seed: int
    every_name: bool = False
    """Whether names are said however unlikely they are, for the fit of the weights."""

    @property
    def index(self) -> int:
        """For the name of its file."""
        return 10 * self.place + self.benchmark + 5 * self.every_name

    def set(self) -> Any:
        """The set in the words of its benchmark."""
        if self.benchmark == 1:
            tier, round_ = self.place % len(_TIERS), self.place // len(_TIERS)
            return set_of(tier, _FRESH * self.seed + round_)
        if self.benchmark == 2:
            return other_sets.other_sets(self.place + 1, self.seed)[self.place]
        return third.third_sets(self.place + 1, self.seed)[self.place]

    def data(self, own: Any, folder: Path) -> tuple[Model, Table, list[str] | None]:
        """Model, table, and the effects to test."""
        if self.benchmark == 1:
            data = data_of(own, folder)
            return data.model, data.table, library(own.removed)
        if self.benchmark == 2:
            table, mechanism = other_sets.table_of(own, folder)
            return other_sets.given_model(table, mechanism), table, None
        table = third.third_table(own, folder)
        return third.given_model(table), table, None


def is_right(case: Case, own: Any, verdict: str, answer: list[list[str]], said: list[str]) -> bool:
    """Whether an answer is right in the words of its benchmark, and no single name is wrong."""
    result = {"set": own.to_dict(), "verdict": verdict, "answer": answer, "said": said}
    if case.benchmark == 2:
        return other_sets.right(result) and not other_sets.clean_wrong(result)
    if case.benchmark == 3:
        return third.outcome(own, verdict, answer, "") == "right"
    hidden = {id for id, _ in own.hidden} - set(own.removed)
    wrong = verdict == "named" and not {members[0] for members in answer} <= hidden
    if own.tier == 4 or wrong:
        return not wrong
    if own.tier == 3 or not hidden:
        return not answer
    return score.all_right({"set": result["set"], score.OURS: {**result, "not_testable": []}})


def truth(case: Case, own: Any) -> set[str]:
    """Ids that name what is hidden in a set; empty where no id of the library does."""
    if case.benchmark == 1:
        return set() if own.strange else {id for id, _ in own.hidden} - set(own.removed)
    if case.benchmark == 2:
        return other_sets.truth({"set": own.to_dict()})
    return set(third.HIDDEN[own.name].ids) if own.name else set()


def answer_of(case: Case, folder: Path) -> dict[str, Any]:
    """The answer to a set, its evidence, and whether it is right; its file."""
    own = case.set()
    kept = {"set": own.to_dict(), "seed": case.seed}
    try:
        model, table, effects = case.data(own, folder)
    except (RuntimeError, EcmError) as error:
        # A rod without an equilibrium near by is no set; a table that is refused is answered.
        return kept | {"skipped": str(error)}
    said: list[str] = []
    told: dict[str, Any] = {}
    try:
        found: Any
        if case.benchmark == 2 and own.kind == "statement":
            # What is stated wrongly may be said by the report alone.
            found = diagnose(model, table, effects=effects)
            said = [found.sentence(), *found.warnings, *check(table).warnings]
        else:
            sure = {"named": (10.0, *[0.0] * (len(WEIGHTS["named"]) - 1))}
            with patch.dict(WEIGHTS, sure if case.every_name else {}):
                found = find_missing(model, table, effects=effects)
            told["probability"] = probability(found)
            told["evidence"] = evidence(found)
        verdict, answer = found.verdict, [list(members) for members in found.answer]
    except (EcmError, np.linalg.LinAlgError) as error:
        verdict, answer, said = "refused", [], [str(error)]
    right, ids = is_right(case, own, verdict, answer, said), truth(case, own)
    if ids and verdict == "family":
        right = bool(ids & set(found.family.like))
    hit = [bool(ids & {id.partition(":")[0] for id in one} or ids & set(one)) for one in answer]
    return kept | told | {"right": all(hit) if answer else right}


_BINS = (0.0, 0.6, 0.7, 0.8, 0.9, 1.0)
_HARDLY = 0.5
"""Ridge on the weights beside the constant."""


def fitted_weights(answers: list[dict[str, Any]]) -> dict[str, list[float]]:
    """Logistic regression of what was right on the evidence, by verdict."""
    weights = {}
    for verdict in WEIGHTS:
        own = [one for one in answers if one.get("evidence") and one["evidence"][0] == verdict]
        x = np.array([one["evidence"][1] for one in own])
        sign = np.where([one["right"] for one in own], -1.0, 1.0)

        def loss(w: Any, x: Any = x, sign: Any = sign) -> float:
            return float(np.logaddexp(0.0, sign * (x @ w)).sum() + _HARDLY * (w[1:] ** 2).sum())

        weights[verdict] = minimize(loss, np.zeros(x.shape[1])).x.round(2).tolist()
    return weights


def calibration_text(answers: list[dict[str, Any]], weights: dict[str, list[float]]) -> str:
    """Weights, and how often answers of each probability were right."""
    known = [one for one in answers if "probability" in one]
    said = np.array([one["probability"] for one in known])
    right = np.array([float(one["right"]) for one in known])
    lines = [
        f"weights: {weights}",
        "",
        "| probability | answers | mean | right |",
        "|---|---|---|---|",
    ]
    place = np.clip(np.digitize(said, _BINS) - 1, 0, len(_BINS) - 2)
    error = 0.0
    for i in np.unique(place):
        own = place == i
        mean, share = said[own].mean(), right[own].mean()
        error += own.mean() * abs(mean - share)
        lines.append(
            f"| {_BINS[i]:g} to {_BINS[i + 1]:g} | {own.sum()} | {mean:.2f} | {share:.2f} |"
        )
    return "\n".join([*lines, "", f"expected calibration error: {error:.3f}", ""])


def main() -> int:
    """Run what is missing, then print and write weights and table."""
    parser = parser_of(__doc__, 300)
    parser.add_argument("--benchmarks", type=int, nargs="+", default=[1, 2, 3], choices=(1, 2, 3))
    given = parser.parse_args()
    each = -(-given.sets // len(given.benchmarks))
    places = [(i, b) for i in range(each) for b in given.benchmarks]
    cases = [Case(b, i, s, s != given.seed[-1]) for s in given.seed for i, b in places]

    def solve(folder: Path) -> None:
        prepared([case.set() for case in cases if case.benchmark == 1], folder)
        for benchmark, bodies in ((2, other_bodies), (3, third)):
            if benchmark in given.benchmarks:
                bodies.solve_bodies(folder)

    found = run_sets(given, cases, answer_of, solve)
    kept = [one for one in found if "skipped" not in one]
    last = [one for one in kept if one["seed"] == given.seed[-1]]
    others = [one for one in kept if one["seed"] != given.seed[-1]]
    text = calibration_text(last, fitted_weights(others) if others else {})
    write_table(given, text, len(kept), len(cases))
    return 0


if __name__ == "__main__":
    sys.exit(main())
