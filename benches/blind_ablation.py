"""What each rule of the diagnosis is good for: fresh sets of all three blind benchmarks.

    python benches/blind_ablation.py --out build/ablation [--sets 300] [--seed 1]
        [--rules RULE ...] [--together RULE ...]

Each set is answered by the whole procedure and with one rule left out at a time, on the same data.
A rule stays where right answers or wrong names change by more than their interval. Every set is a
file; one that is there is not run again. With --together all the rules that are named are left out
at once, beside the whole procedure.
"""

from __future__ import annotations

import argparse
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

from blind import code_hash, prepared
from blind_parts import other_bodies, other_sets, score, third
from blind_parts.ablation import RULES, without
from blind_parts.analysis import library
from blind_parts.data import data_of
from blind_parts.sets import set_of
from blind_parts.workers import run_all
from ecm.diagnosis import check, diagnose, find_missing
from ecm.errors import EcmError
from ecm.io.cache import write_atomically
from ecm.io.parallel import own_cores
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
        found = third.outcome(own, verdict, answer, " ".join(said))
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


def answered(case: Case, own: Any, data: tuple[Model, Table, Any], *rules: str) -> dict[str, Any]:
    """The answer without some rules, and whether it is right."""
    model, table, effects = data
    said: list[str] = []
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
            verdict, answer = found.verdict, [list(members) for members in found.answer]
        except (EcmError, np.linalg.LinAlgError) as error:
            verdict, answer, said = "refused", [], [str(error)]
    shown = {"verdict": verdict, "answer": answer}
    return shown | {"outcome": outcome(case, own, verdict, answer, said)}


def run_one(case: Case, folder: Path, rules: list[list[str]]) -> None:
    """Answer a set by the whole procedure and without rules, and write its file."""
    path = folder / f"{case.name}.json"
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
        found["set"] = own.to_dict()
        found |= {" + ".join(rule): answered(case, own, data, *rule) for rule in todo}
    write_atomically(path, json.dumps(found))


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


def main() -> int:
    """Run what is missing, then print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sets", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--benchmarks", type=int, nargs="+", default=[1, 2, 3], choices=(1, 2, 3))
    parser.add_argument("--rules", nargs="*", choices=RULES, default=list(RULES))
    parser.add_argument("--together", nargs="+", choices=RULES, default=[])
    parser.add_argument("--workers", type=int, default=own_cores())
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no set after that")
    parser.add_argument("--code", help="go on with the sets of that hash of the code")
    given = parser.parse_args()
    folder = given.out / f"sets-{given.code or code_hash()}"
    folder.mkdir(parents=True, exist_ok=True)
    each = -(-given.sets // len(given.benchmarks))
    cases = [Case(b, i, given.seed) for i in range(each) for b in given.benchmarks]
    rules = [given.together] if given.together else [[rule] for rule in given.rules]
    prepared([case.set() for case in cases if case.benchmark == 1], given.out)
    for benchmark, bodies in ((2, other_bodies), (3, third)):
        if benchmark in given.benchmarks:
            bodies.solve_bodies(given.out)
    run_all(
        cases,
        partial(run_one, folder=folder, rules=rules),
        workers=given.workers,
        seconds=given.seconds,
    )
    files = [folder / f"{case.name}.json" for case in cases]
    kept = [json.loads(file.read_text()) for file in files if file.exists()]
    kept = [one for one in kept if "skipped" not in one]
    text = table_text(kept, [" + ".join(rule) for rule in rules])
    print(f"\nSets: {len(kept)} of {len(cases)}, seed {given.seed}.\n\n{text}")
    write_atomically(given.out / "table.md", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
