"""The third blind benchmark of docs/discovery.md: bodies, laws and protocols of their own.

    python benches/blind_third.py --out build/third [--sets 104] [--seed 1 2] [--evidence]
        [--without RULE | --ablate]

With --evidence the posterior of `blind_parts.evidence` answers in place of `ecm diagnose`; with
--without a rule of `blind_parts.ablation` is left out, with --ablate each of them in turn.
Every set is a file in a folder named by a hash of the code; one that is there is not run again.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

# Before numpy is imported, here and in the workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import numpy as np

from blind import code_hash
from blind_parts.ablation import RULES, without
from blind_parts.evidence import answer_by_evidence
from blind_parts.third import (
    BODIES,
    HIDDEN,
    ThirdSet,
    given_model,
    outcome,
    solved,
    third_sets,
    third_table,
)
from blind_parts.workers import run_all
from ecm.diagnosis import diagnose
from ecm.errors import EcmError
from ecm.io.cache import write_atomically
from ecm.io.parallel import own_cores

_OUTCOMES = (
    "right", "family", "unknown", "none", "ambiguous", "wrong class", "wrong name", "alarm",
    "refused",
)  # fmt: skip


def run_one(case: ThirdSet, folder: Path, *, evidence: bool, rule: str = "") -> None:
    """Diagnose a set and write its file; in whichever process."""
    table = third_table(case, folder.parent)
    began = time.process_time()
    try:
        if evidence:
            one = answer_by_evidence(given_model(table), table)
            verdict, answer, said = one.verdict, one.answer, " ".join(one.families)
        else:
            with without(rule) as stages:
                found = diagnose(given_model(table), table, stages=stages)
            verdict, answer = found.verdict, [list(members) for members in found.answer]
            said = found.sentence()
    except EcmError as error:
        verdict, answer, said = "refused", [], str(error)
    result = {"set": case.to_dict(), "verdict": verdict, "answer": answer, "said": said}
    result["outcome"] = outcome(case, verdict, answer, said)
    result["seconds"] = time.process_time() - began
    write_atomically(_file(case, folder), json.dumps(result))


def _file(case: ThirdSet, folder: Path) -> Path:
    return folder / f"{case.seed}-{case.index:04d}.json"


def table_text(results: list[dict[str, Any]]) -> str:
    """Markdown: a line for each law, for each protocol, and for each set that is not right."""
    lines = [
        "| hidden | sets | " + " | ".join(_OUTCOMES) + " |",
        "|---" * (len(_OUTCOMES) + 2) + "|",
    ]
    groups = [(name or "nothing", lambda r, name=name: r["set"]["name"] == name)
              for name in ("", *HIDDEN)]  # fmt: skip
    protocols = sorted({r["set"]["protocol"] for r in results})
    groups += [(f"*{p}*", lambda r, p=p: r["set"]["protocol"] == p) for p in protocols]
    groups.append(("all", lambda r: True))
    for what, test in groups:
        own = Counter(r["outcome"] for r in results if test(r))
        shown = " | ".join(str(own[key] or "") for key in _OUTCOMES)
        lines.append(f"| {what} | {own.total()} | {shown} |")
    for r in results:
        if r["outcome"] != "right":
            case = r["set"]
            answer = " + ".join("|".join(members) for members in r["answer"])
            lines.append(
                f"- {case['index']} {case['name'] or 'nothing'} at {case['strength']:g} "
                f"({case['body']}, {case['protocol']}, {case['rows']} rows): "
                f"{r['verdict']} {answer}"
            )
    return "\n".join(lines) + "\n"


def line_of(rule: str, whole: list[dict[str, Any]], results: list[dict[str, Any]]) -> str:
    """Markdown: one line of the ablation, beside the whole procedure on the same sets."""
    own = Counter(r["outcome"] for r in results)
    before = {(r["set"]["seed"], r["set"]["index"]): r["outcome"] for r in whole}
    changed = [(before[r["set"]["seed"], r["set"]["index"]], r["outcome"]) for r in results]
    lost = sum(a == "right" != b for a, b in changed)
    gained = sum(a != "right" == b for a, b in changed)
    shown = " | ".join(str(own[key] or "") for key in _OUTCOMES)
    return f"| {rule or 'whole procedure'} | {own.total()} | {shown} | {lost} | {gained} |"


def main() -> int:
    """Run what is missing, then print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sets", type=int, default=104)
    parser.add_argument("--seed", type=int, nargs="+", default=[1])
    parser.add_argument("--workers", type=int, default=own_cores())
    parser.add_argument("--evidence", action="store_true", help="the posterior answers")
    parser.add_argument("--without", choices=RULES, default="", help="leave a rule out")
    parser.add_argument("--ablate", action="store_true", help="leave out each rule in turn")
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no set after that")
    given = parser.parse_args()
    cases = [case for seed in given.seed for case in third_sets(given.sets, seed)]
    if not given.ablate:
        kind = "evidence" if given.evidence else "sets"
        found = answered(given, cases, kind, given.without)
        text = table_text(found)
        print(f"\nSets: {len(found)} of {len(cases)}, seeds {given.seed}.\n\n{text}")
        write_atomically(given.out / "table.md", text)
        return 0
    whole = answered(given, cases, "sets", "")
    print("\n| without | sets | " + " | ".join(_OUTCOMES) + " | right lost | right gained |")
    print("|---" * (len(_OUTCOMES) + 4) + "|")
    for rule in RULES:
        print(line_of(rule, whole, answered(given, cases, "sets", rule)), flush=True)
    return 0


def answered(
    given: argparse.Namespace, cases: list[ThirdSet], kind: str, rule: str
) -> list[dict[str, Any]]:
    """Run the sets whose files are missing, and return the results of all."""
    name = f"{kind}-{code_hash()}" + (f"-without-{rule.replace(' ', '-')}" if rule else "")
    folder = given.out / name
    folder.mkdir(parents=True, exist_ok=True)
    todo = [case for case in cases if not _file(case, folder).exists()]
    if todo:
        for body in BODIES:  # solved once, before several processes ask for them
            solved(body, given.out)
    run_all(
        todo,
        partial(run_one, folder=folder, evidence=kind == "evidence", rule=rule),
        workers=given.workers,
        seconds=given.seconds,
        progress=lambda done, left_s: print(
            f"\r{done}/{len(todo)} sets, about {left_s / 60.0:.0f} min left ",
            end="",
            file=sys.stderr,
            flush=True,
        ),
    )
    return [json.loads(_file(c, folder).read_text()) for c in cases if _file(c, folder).exists()]


if __name__ == "__main__":
    sys.exit(main())
