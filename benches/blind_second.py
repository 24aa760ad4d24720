"""The second blind benchmark of docs/discovery.md: other bodies, few rows, wrong statements.

    python benches/blind_second.py --out build/second [--sets 240] [--seed 1]

Rods of other sizes, a tapered one, a tube and a square bar by FEM, a planar rod and a hinge, with
40 to 120 rows and few repeats: nothing hidden, one effect of the catalogue, one of no catalogue, or
one wrong statement of the user. Every set is a file in a folder named by a hash of the code; one
that is there is not run again.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from functools import partial
from pathlib import Path

# Before numpy is imported, here and in the workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import numpy as np

from blind import code_hash
from blind_parts.other_bodies import solve_bodies
from blind_parts.other_sets import other_sets, run_one, set_file
from blind_parts.other_table import table_text
from blind_parts.workers import run_all
from ecm.io.cache import write_atomically
from ecm.io.parallel import own_cores


def main() -> int:
    """Run what is missing, then print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sets", type=int, default=240)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--workers", type=int, default=own_cores(), help="processes; default: cores"
    )
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no set after that")
    parser.add_argument("--table", action="store_true", help="only print what is there")
    parser.add_argument("--code", help="go on with the sets of that hash of the code")
    given = parser.parse_args()
    folder = given.out / f"sets-{given.code or code_hash()}"
    folder.mkdir(parents=True, exist_ok=True)
    cases = other_sets(given.sets, given.seed)
    todo = [] if given.table else [case for case in cases if not set_file(case, folder).exists()]
    if todo:
        solve_bodies(given.out)
    run_all(
        todo,
        partial(run_one, folder=folder),
        workers=given.workers,
        seconds=given.seconds,
    )
    found = [
        json.loads(set_file(c, folder).read_text()) for c in cases if set_file(c, folder).exists()
    ]
    text, met = table_text(found)
    print(f"\nSets: {len(found)} of {len(cases)}, seed {given.seed}.\n\n{text}")
    write_atomically(given.out / "table.md", text)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
