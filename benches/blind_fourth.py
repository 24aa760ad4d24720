"""The fourth blind benchmark of docs/discovery.md: driven arms, and effects of their actuation.

    python benches/blind_fourth.py --out build/fourth [--sets 96] [--seed 1 2]

Every set is a file in a folder named by a hash of the code; one that is there is not run again.
"""

from __future__ import annotations

import os
import sys
from functools import partial
from pathlib import Path
from typing import Any

# Before numpy is imported, here and in the workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

from blind_parts.command import (
    diagnosed,
    not_right_lines,
    outcome_lines,
    parser_of,
    run_sets,
    write_table,
)
from blind_parts.fourth import HIDDEN, SWAPPED, FourthSet, fourth_sets, fourth_table, solved
from blind_parts.workers import run_all
from ecm.models import fit_model
from ecm.rig import score

_OUTCOMES = ("right", "part", "unsaid", "wrong name", "wrong class", "alarm", "refused")
_GOALS = {"named at s = 1": 0.9, "wrong name": 0.01, "nothing hidden": 0.985}


def answer_of(case: FourthSet, folder: Path) -> dict[str, Any]:
    """Diagnose a set; its file."""
    table = fourth_table(case, folder)
    result, found = diagnosed(case, table, partial(fit_model, table, "actuated4"))
    if found is None and "tendons swapped" in result["said"]:
        result["answer"] = [[SWAPPED]]
    return result | {"outcome": outcome(case, result["verdict"], result["answer"])}


def outcome(case: FourthSet, verdict: str, answer: list[list[str]]) -> str:
    """right: every hidden effect in a class of at most three, and no class left over; part: some of
    them and no other; unsaid: no name; of nothing hidden an alarm."""
    if not answer:
        return verdict if verdict == "refused" else "unsaid" if case.names else "right"
    if not case.names:
        return "alarm"
    scored = score(list(case.names), answer)
    if scored["correct"]:
        return "right"
    if not scored["wrong"]:
        return "part"
    return "wrong name" if any(len(one) == 1 for one in scored["wrong"]) else "wrong class"


def _solve(folder: Path, cases: list[FourthSet], workers: int) -> None:
    """Solve the bodies of the sets, before several processes ask for them."""
    bodies = sorted({case.body for case in cases})
    run_all(bodies, partial(_solve_one, folder=folder), workers=workers)


def _solve_one(body: int, folder: Path) -> None:
    solved(body, folder)


def table_text(results: list[dict[str, Any]]) -> str:
    """Markdown: the goals, a line for each effect, pairs, and each set that is not right."""

    def share(own: list[dict[str, Any]], what: str) -> float:
        return sum(r["outcome"] == what for r in own) / max(len(own), 1)

    hidden = [r for r in results if r["set"]["names"]]
    nothing = [r for r in results if not r["set"]["names"]]
    at_one = [r for r in hidden if r["set"]["strength"] == 1.0]
    lines = ["| figure | sets | goal | value |", "|---|---|---|---|"]
    figures = {
        "named at s = 1": (at_one, "right"),
        "wrong name": (hidden, "wrong name"),
        "nothing hidden": (nothing, "right"),
    }
    for name, (own, what) in figures.items():
        sign = "<=" if name == "wrong name" else ">="
        lines.append(f"| {name} | {len(own)} | {sign} {_GOALS[name]:g} | {share(own, what):.3f} |")
    groups = {"nothing": nothing}
    for name in (*HIDDEN, SWAPPED):
        groups[name] = [r for r in hidden if r["set"]["names"] == [name]]
    groups["pairs"] = [r for r in hidden if len(r["set"]["names"]) == 2]

    def words(r: dict[str, Any]) -> str:
        case = r["set"]
        which = f"(arm {case['body']}, {case['poses']} poses): {r['outcome']}"
        return f"{' + '.join(case['names']) or 'nothing'} at {case['strength']:g} {which}"

    lines += ["", *outcome_lines({**groups, "all": results}, _OUTCOMES), ""]
    return "\n".join([*lines, *not_right_lines(results, words)]) + "\n"


def main() -> int:
    """Run what is missing, then print and write the table."""
    given = parser_of(__doc__, 96).parse_args()
    cases = [case for seed in given.seed for case in fourth_sets(given.sets, seed)]
    solve = partial(_solve, cases=cases, workers=given.workers)
    found = run_sets(given, cases, answer_of, solve)
    write_table(given, table_text(found), len(found), len(cases))
    return 0


if __name__ == "__main__":
    sys.exit(main())
