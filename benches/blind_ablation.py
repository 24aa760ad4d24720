"""What each rule of the diagnosis is good for: fresh sets of all three blind benchmarks.

    python benches/blind_ablation.py --out build/ablation [--sets 300] [--seed 1]
        [--rules RULE ...] [--together RULE ...] [--calibration]

Each set is answered by the whole procedure and with one rule left out at a time, on the same data.
A rule stays where right answers or wrong names change by more than their interval. Every set is a
file; one that is there is not run again. With --together all the rules that are named are left out
at once, beside the whole procedure. With --calibration no rule is left out: the weights of
`ecm.diagnosis.verdict` are fitted to the sets of all seeds but the last, on which the
probabilities of the code are then held against what was right.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

# Before numpy is imported, here and in the workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import numpy as np
from scipy.optimize import minimize

from blind import prepared
from blind_parts import other_bodies, other_sets, score, third
from blind_parts.ablation import RULES, without
from blind_parts.analysis import library
from blind_parts.command import parser_of, run_sets, write_table
from blind_parts.data import data_of
from blind_parts.sets import set_of
from ecm import check
from ecm.diagnosis import diagnose, find_missing
from ecm.diagnosis.verdict import WEIGHTS, evidence, probability
from ecm.errors import EcmError
from ecm.io.cache import write_atomically
from ecm.io.table import Table
from ecm.models import Model

_TIERS = range(6)
_FRESH = 10_000
"""Sets of the first benchmark from this index on are none of its table."""


@dataclass(frozen=True)
class Case:
    """A set of one of the three benchmarks."""

    benchmark: int
    index: int
    seed: int

    @property
    def name(self) -> str:
        """File name."""
        return f"{self.benchmark}-{self.seed}-{self.index:04d}"

    def set(self) -> Any:
        """The set in the words of its benchmark."""
        if self.benchmark == 1:
            tier, round_ = self.index % len(_TIERS), self.index // len(_TIERS)
            return set_of(tier, _FRESH * self.seed + round_)
        if self.benchmark == 2:
            return other_sets.other_sets(self.index + 1, self.seed)[self.index]
        return third.third_sets(self.index + 1, self.seed)[self.index]

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


def outcome(case: Case, own: Any, verdict: str, answer: list[list[str]], said: list[str]) -> str:
    """`right`, `wrong name` (single names, one of them wrong), or `miss`."""
    result = {"set": own.to_dict(), "verdict": verdict, "answer": answer, "said": said}
    if case.benchmark == 2:
        wrong, right = other_sets.clean_wrong(result), other_sets.right(result)
    elif case.benchmark == 3:
        found = third.outcome(own, verdict, answer, "")
        alarm = found == "alarm" and all(len(members) == 1 for members in answer)
        wrong, right = found == "wrong name" or (alarm and bool(answer)), found == "right"
    else:
        hidden = {id for id, _ in own.hidden} - set(own.removed)
        names = {members[0] for members in answer}
        wrong = verdict == "named" and not names <= hidden
        told = {"set": result["set"], score.OURS: {**result, "not_testable": []}}
        if own.tier in (3, 4) or not hidden:
            right = not answer if own.tier != 4 else not wrong
        else:
            right = score.all_right(told)
    return "wrong name" if wrong else "right" if right else "miss"


def truth(case: Case, own: Any) -> set[str]:
    """Ids that name what is hidden in a set; empty where no id of the library does."""
    if case.benchmark == 1:
        return set() if own.strange else {id for id, _ in own.hidden} - set(own.removed)
    if case.benchmark == 2:
        return other_sets.truth({"set": own.to_dict()})
    return set(third.HIDDEN[own.name].ids) if own.name else set()


def answered(case: Case, own: Any, data: tuple[Model, Table, Any], *rules: str) -> dict[str, Any]:
    """The answer without some rules, and whether it is right."""
    model, table, effects = data
    said: list[str] = []
    told: dict[str, Any] = {}
    with without(*rules) as (stages, settings):
        options: dict[str, Any] = {"effects": effects, "stages": stages, "settings": settings}
        try:
            found: Any
            if case.benchmark == 2 and own.kind == "statement":
                # What is stated wrongly may be said by the report alone.
                found = diagnose(model, table, **options)
                said = [found.sentence(), *found.warnings, *check(table).warnings]
            else:
                found = find_missing(model, table, **options)
                told["probability"] = probability(found)
                told["evidence"] = None if found.family else evidence(found)
            verdict, answer = found.verdict, [list(members) for members in found.answer]
        except (EcmError, np.linalg.LinAlgError) as error:
            verdict, answer, said = "refused", [], [str(error)]
    told |= {"verdict": verdict, "answer": answer}
    right = told["outcome"] = outcome(case, own, verdict, answer, said)
    ids = truth(case, own)
    hit = [bool(ids & {id.partition(":")[0] for id in one} or ids & set(one)) for one in answer]
    return told | {"right": all(hit) if answer else right == "right"}


def run_one(case: Case, folder: Path, rules: list[list[str]]) -> None:
    """Answer a set by the whole procedure and without rules, and write its file."""
    path = file_of(case, folder)
    found = json.loads(path.read_text()) if path.exists() else {}
    todo = [rule for rule in [[], *rules] if " + ".join(rule) not in found]
    if todo:
        own = case.set()
        try:
            data = case.data(own, folder.parent)
        except (RuntimeError, EcmError) as error:
            # A rod without an equilibrium near by is no set; a table that is refused is answered.
            found["skipped"] = str(error)
            todo = []
        found |= {"set": own.to_dict(), "seed": case.seed}
        found |= {" + ".join(rule): answered(case, own, data, *rule) for rule in todo}
    write_atomically(path, json.dumps(found))


def file_of(case: Case, folder: Path) -> Path:
    """Where the answers to a set are kept."""
    return folder / f"{case.name}.json"


def table_text(found: list[dict[str, Any]], rules: list[str]) -> str:
    """Markdown: a line for each rule, beside the whole procedure on the same sets."""
    lines = [
        "| without | sets | other answer | right | lost | gained | wrong names | more | fewer |",
        "|---" * 9 + "|",
    ]
    for rule in ["", *rules]:
        pairs = [(one[""], one[rule]) for one in found if rule in one]
        both = [(a["outcome"], b["outcome"]) for a, b in pairs]
        counts = [
            len(pairs),
            sum(a["answer"] != b["answer"] or a["verdict"] != b["verdict"] for a, b in pairs),
            sum(b == "right" for _, b in both),
            sum(a == "right" != b for a, b in both),
            sum(a != "right" == b for a, b in both),
            sum(b == "wrong name" for _, b in both),
            sum(a != "wrong name" == b for a, b in both),
            sum(a == "wrong name" != b for a, b in both),
        ]
        lines.append(f"| {rule or 'whole procedure'} | {' | '.join(map(str, counts))} |")
    return "\n".join(lines) + "\n"


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
    """Run what is missing, then print and write the table."""
    parser = parser_of(__doc__, 300)
    parser.add_argument("--benchmarks", type=int, nargs="+", default=[1, 2, 3], choices=(1, 2, 3))
    parser.add_argument("--rules", nargs="*", choices=RULES, default=list(RULES))
    parser.add_argument("--together", nargs="+", choices=RULES, default=[])
    parser.add_argument("--calibration", action="store_true", help="instead: the probabilities")
    given = parser.parse_args()
    each = -(-given.sets // len(given.benchmarks))
    cases = [Case(b, i, s) for s in given.seed for i in range(each) for b in given.benchmarks]
    rules = [given.together] if given.together else [[rule] for rule in given.rules]
    rules = [] if given.calibration else rules

    def solve(folder: Path) -> None:
        prepared([case.set() for case in cases if case.benchmark == 1], folder)
        for benchmark, bodies in ((2, other_bodies), (3, third)):
            if benchmark in given.benchmarks:
                bodies.solve_bodies(folder)

    found = run_sets(given, cases, partial(run_one, rules=rules), file_of, solve)
    kept = [one for one in found if "skipped" not in one]
    text = table_text(kept, [" + ".join(rule) for rule in rules])
    if given.calibration:
        last = [one for one in kept if one["seed"] == given.seed[-1]]
        others = [one[""] for one in kept if one["seed"] != given.seed[-1]]
        text = calibration_text([one[""] for one in last], fitted_weights(others))
    write_table(given, text, len(kept), len(cases))
    return 0


if __name__ == "__main__":
    sys.exit(main())
