"""The kinds of misses of docs/discovery.md: how often each is right, unknown or a wrong name.

    python benches/blind_kinds.py --out build/kinds [--each 8] [--seed 3]

Rods with a stated stiffness, 60 to 120 rows, half of the sets at strength 1 and half at 3. Every
set is a file in a folder named by a hash of the code; one that is there is not run again.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from functools import partial
from pathlib import Path
from typing import Any

# Before numpy is imported, here and in the workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import numpy as np

from blind import code_hash
from blind_parts.miss_kinds import MISSES
from blind_parts.other_bodies import BODIES
from blind_parts.other_sets import OtherSet, run_one, set_file
from blind_parts.workers import run_all
from ecm.io.cache import write_atomically
from ecm.io.parallel import own_cores


def sets(each: int, seed: int) -> list[OtherSet]:
    """The sets of a seed, kind by kind."""
    rods = [b.name for b in BODIES.values() if b.stated and len(b.axes) == 6]
    found = []
    for number, name in enumerate(MISSES):
        for i in range(each):
            random = np.random.default_rng([seed, number, i, 0])
            rows = int(random.integers(60, 121))
            found.append(
                OtherSet(
                    seed=seed,
                    index=1000 * number + i,
                    kind="miss",
                    name=name,
                    body=rods[i % len(rods)],
                    strength=(1.0, 3.0)[i // 2 % 2],
                    rows=rows,
                    repeats=rows // 10 * (i % 3),
                    declared=True,
                )
            )
    return found


def outcome(result: dict[str, Any]) -> str:
    """right, a name too much, unknown, none, or wrong."""
    names = MISSES[result["set"]["name"]][1]
    answer = [set(members) for members in result["answer"] if len(members) <= 3]
    hit = [any(name in members for members in answer) for name in names]
    if all(hit):
        return "right" if len(result["answer"]) == len(names) else "more"
    if result["verdict"] == "named" and not any(hit):
        return "wrong"
    return "part" if any(hit) else result["verdict"] if not result["answer"] else "class"


COLUMNS = {
    "right": "right",
    "more": "right, and another name",
    "part": "one of two",
    "unknown": "`unknown`",
    "none": "`none`",
    "class": "class without it",
    "wrong": "clean wrong name",
}


def table(results: list[dict[str, Any]]) -> str:
    """Markdown: one line a kind."""
    lines = ["| kind | sets | " + " | ".join(COLUMNS.values()) + " |"]
    lines.append("|---" * (len(COLUMNS) + 2) + "|")
    for name in MISSES:
        own = [outcome(r) for r in results if r["set"]["name"] == name]
        counts = " | ".join(str(own.count(key)) for key in COLUMNS)
        lines.append(f"| {name} | {len(own)} | {counts} |")
    for r in results:
        if outcome(r) != "right":
            case = r["set"]
            said = " + ".join("|".join(members) for members in r["answer"])
            lines.append(
                f"- {case['name']} {case['index']} at {case['strength']:g} ({case['body']}, "
                f"{case['rows']} rows): {r['verdict']} {said}"
            )
    return "\n".join(lines) + "\n"


def main() -> int:
    """Run what is missing, then print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--each", type=int, default=8)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--workers", type=int, default=own_cores())
    given = parser.parse_args()
    folder = given.out / f"sets-{code_hash()}"
    folder.mkdir(parents=True, exist_ok=True)
    cases = sets(given.each, given.seed)
    todo = [case for case in cases if not set_file(case, folder).exists()]
    run_all(
        todo,
        partial(run_one, folder=folder),
        workers=given.workers,
        seconds=np.inf,
        progress=lambda done, left_s: print(
            f"\r{done}/{len(todo)} sets ", end="", file=sys.stderr, flush=True
        ),
    )
    text = table([json.loads(set_file(case, folder).read_text()) for case in cases])
    print(f"\nSeed {given.seed}.\n\n{text}")
    write_atomically(given.out / "table.md", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
