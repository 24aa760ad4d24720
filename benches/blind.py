"""The blind benchmark of docs/discovery.md: tiers 0 to 5, ours beside five simpler methods.

    python benches/blind.py --out build/blind [--sets 20] [--tiers 0 1] [--no-simple]

Data come from the simulated rig (FEM of the neck, quasi-static) and from a second generator that
shares no code with the library (a Cosserat rod), half and half. Every set is a file under --out;
one that is there is not run again, so that a run may be stopped and gone on with. A hash of the
code names the folder: what other code found is not mixed in.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
import traceback
from pathlib import Path
from typing import Any

# Small matrices: threads of the BLAS only wait for each other. Before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from blind_parts.analysis import oracle, our_answer, parameters, problem_of, same_verdicts
from blind_parts.data import data_of
from blind_parts.print_table import write_table
from blind_parts.second import second_answer
from blind_parts.sets import TIER_SETS, Set, each_of, sets_of
from blind_parts.simple import simple_answers
from ecm.stages import write_atomically

_SEEDS_EVERY = 20
"""The same data are analysed with twenty seeds in so many sets of each source once."""


def run_set(asked: Set, folder: Path, *, simple: bool) -> dict[str, Any]:
    """Everything about one set, as its file keeps it."""
    began = time.perf_counter()
    data = data_of(asked, folder)
    result: dict[str, Any] = {"set": asked.to_dict()}
    result["ours"] = our_answer(asked, data)
    problem = problem_of(asked, data)
    if asked.tier in (1, 2):
        result["oracle"] = oracle(asked, problem)
        result["parameters"] = parameters(asked, data, result["ours"])
    if asked.tier <= 4 and (asked.index // 2) % _SEEDS_EVERY == _SEEDS_EVERY - 1:
        result["same_verdict"] = same_verdicts(asked, data, result["ours"])
    if asked.tier == 5:
        result["second"] = second_answer(asked, data, result["ours"], folder)
    if simple and asked.tier != 5:
        result["simple"] = simple_answers(asked, data, problem)
    result["seconds"] = time.perf_counter() - began
    return result


def code_hash() -> str:
    """Of the sources that a result depends on: library and benchmark."""
    import ecm

    library = Path(ecm.__file__).parent
    parts = ("diagnose", "effects", "compare", "models", "rig")
    files = [f for part in parts for f in sorted((library / part).rglob("*.py"))]
    files += sorted((Path(__file__).parent / "blind_parts").glob("*.py"))
    sums = [hashlib.sha256(f.read_bytes()).hexdigest() for f in (*files, library / "refit.py")]
    return hashlib.sha256("".join(sums).encode()).hexdigest()[:12]


def kept(asked: Set, folder: Path, *, simple: bool) -> dict[str, Any] | None:
    """The result of a set that has been run, with the simpler methods where they are asked for."""
    path = folder / f"{asked.name}.json"
    if not path.exists():
        return None
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    if simple and asked.tier != 5 and "simple" not in found:
        return None
    return found


def main() -> int:
    """Run what is missing, then print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sets", type=int, help="at most so many of each tier")
    parser.add_argument("--tiers", type=int, nargs="*", default=list(TIER_SETS))
    parser.add_argument("--source", choices=("rig", "rod"))
    parser.add_argument(
        "--each",
        type=float,
        metavar="S",
        help="instead: each effect of --source once at strength S",
    )
    parser.add_argument("--no-simple", action="store_true", help="ours alone")
    parser.add_argument("--table", action="store_true", help="only print what is there")
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no set after that")
    parser.add_argument("--code", help="go on with the sets of that hash of the code")
    given = parser.parse_args()
    # Results of other code are not mixed in.
    folder = given.out / f"sets-{given.code or code_hash()}"
    folder.mkdir(parents=True, exist_ok=True)
    simple = not given.no_simple
    asked = [one for tier in given.tiers for one in sets_of(tier, given.sets)]
    if given.each is not None:
        asked = each_of(given.source or "rod", given.each)
    asked = [one for one in asked if given.source in (None, one.source)]
    results, broken, began = [], 0, time.perf_counter()
    for number, one in enumerate(asked):
        found = kept(one, folder, simple=simple and not given.table)
        if found is None and not given.table and time.perf_counter() - began < given.seconds:
            try:
                found = run_set(one, given.out, simple=simple)
            except Exception:
                broken += 1
                print(f"{one.name} {one.hidden}: failed", file=sys.stderr)
                traceback.print_exc()
                continue
            write_atomically(folder / f"{one.name}.json", json.dumps(found))
            print(f"\r{number + 1}/{len(asked)} {one.name}  ", end="", file=sys.stderr, flush=True)
        if found is not None:
            results.append(found)
    print(file=sys.stderr)
    met = write_table(results, given.out, broken)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
