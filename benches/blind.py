"""The blind benchmark of docs/discovery.md: tiers 0 to 7.

    python benches/blind.py --out build/blind [--sets 20] [--tiers 0 1]

Data come from the simulated rig (FEM of the neck, quasi-static) and from a second generator that
shares no code with the library (a Cosserat rod), half and half; tier 6 is the rig with its arm in
full. Every set is a file under --out; one that is there is not run again, so that a run may be
stopped and gone on with. All tiers grow side by side: a run that stops early is a fair sample. A
hash of the code names the folder: what other code found is not mixed in.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import json
import os
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

# Small matrices: threads only wait for each other. Before numpy is imported, here and in workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import numpy as np

import ecm
from blind_parts.analysis import oracle, parameters, same_verdicts, worked_answer
from blind_parts.data import data_of, shared_model, shared_plan
from blind_parts.print_table import write_table
from blind_parts.second import second_answer
from blind_parts.sets import ALL_SETS, ARM, Set, balanced, each_of, sets_of
from blind_parts.workers import run_all
from ecm import _native
from ecm.io.cache import write_atomically
from ecm.io.extras import own_cores

_SEEDS_EVERY = 15
"""The same data are analysed with twenty seeds in one of so many rounds of a tier."""


def run_set(case: Set, folder: Path) -> dict[str, Any]:
    """Everything about one set, as its file keeps it."""
    began = time.process_time()
    data = data_of(case, folder)
    result: dict[str, Any] = {"set": case.to_dict()}
    spent = {"data": time.process_time() - began}
    result["ours"], work = worked_answer(case, data)
    spent["ours"] = result["ours"]["seconds"]
    if case.tier in (1, 2, ARM) and case.hidden:
        result["oracle"] = oracle(case, work.problem)
        if case.tier != ARM:
            result["parameters"] = parameters(case, data, result["ours"])
    if case.tier <= 4 and case.round % _SEEDS_EVERY == 2:
        result["same_verdict"] = same_verdicts(case, data, result["ours"], work)
    if case.tier == 5:
        result["second"] = second_answer(case, data, result["ours"], folder)
    result["seconds"] = time.process_time() - began
    result["spent"] = spent
    return result


def run_one(case: Set, folder: Path) -> None:
    """Run a set and write its file; in whichever process."""
    write_atomically(folder / f"{case.name}.json", json.dumps(run_set(case, folder)))


def code_hash() -> str:
    """Return the hash of all that a result depends on: library, compiled part, benchmark."""
    library = Path(ecm.__file__).parent
    not_run = (library / "cli", library / "report")
    files = [f for f in sorted(library.rglob("*.py")) if not set(not_run) & set(f.parents)]
    own = ("print_table.py", "score.py", "workers.py")  # what they make of results, not results
    bench = sorted((Path(__file__).parent / "blind_parts").glob("*.py"))
    files += [f for f in bench if f.name not in own]
    files += [Path(_native.__file__), Path(__file__)]
    sums = [hashlib.sha256(f.read_bytes()).hexdigest() for f in files]
    return hashlib.sha256("".join(sums).encode()).hexdigest()[:12]


def stored_result(case: Set, folder: Path) -> dict[str, Any] | None:
    """The result of a set that has been run."""
    path = folder / f"{case.name}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def prepared(sets: list[Set], folder: Path) -> None:
    """Plans and bases that all sets share, before several processes ask for them."""
    for source, protocol in sorted({(one.source, one.protocol) for one in sets}):
        shared_plan(source, protocol, folder)
        shared_model(source)


def selected_sets(given: argparse.Namespace) -> list[Set]:
    """What the command line asks for, in the order in which it is run."""
    sets = [one for tier in given.tiers for one in sets_of(tier, given.sets)]
    if given.each is not None:
        sets = each_of(given.source or "rod", given.each)
    sets = [one for one in balanced(sets) if given.source in (None, one.source)]
    sets = [one for one in sets if one.round % given.every == 0]
    if any(one.source == "arm" for one in sets) and not importlib.util.find_spec("mujoco"):
        print("the arm's sets are left out: they need the extra [robot]", file=sys.stderr)
        sets = [one for one in sets if one.source != "arm"]
    return sets


def main() -> int:
    """Run what is missing, then print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sets", type=int, help="at most so many of each tier")
    parser.add_argument("--tiers", type=int, nargs="*", default=list(ALL_SETS))
    parser.add_argument("--source", choices=("rig", "rod", "arm"))
    parser.add_argument(
        "--each",
        type=float,
        metavar="S",
        help="instead: each effect of --source once at strength S",
    )
    parser.add_argument(
        "--workers", type=int, default=own_cores(), help="processes; default: cores"
    )
    parser.add_argument(
        "--every", type=int, default=1, metavar="K", help="every K-th round only; default all"
    )
    parser.add_argument("--table", action="store_true", help="only print what is there")
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no set after that")
    parser.add_argument("--code", help="go on with the sets of that hash of the code")
    given = parser.parse_args()
    # Results of other code are not mixed in.
    folder = given.out / f"sets-{given.code or code_hash()}"
    folder.mkdir(parents=True, exist_ok=True)
    cases = selected_sets(given)
    failed: list[Set] = []
    if not given.table:
        todo = [case for case in cases if stored_result(case, folder) is None]
        prepared(todo, folder)
        work = partial(run_one, folder=folder)
        failed = run_all(todo, work, workers=given.workers, seconds=given.seconds)
        print(file=sys.stderr)
    found = (stored_result(case, folder) for case in cases)
    met = write_table([result for result in found if result is not None], given.out, len(failed))
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
