"""The second blind benchmark of docs/discovery.md: other bodies, few rows, wrong statements.

    python benches/blind_second.py --out build/second [--sets 240] [--seed 1]

Rods of other sizes, a tapered one, a tube and a square bar by FEM, a planar rod and a hinge, with
40 to 120 rows and few repeats: nothing hidden, one effect of the catalogue, one of no catalogue, or
one wrong statement of the user. Every set is a file in a folder named by a hash of the code; one
that is there is not run again.
"""

from __future__ import annotations

import os
import sys

# Before numpy is imported, here and in the workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

from blind_parts.command import parser_of, run_sets, write_table
from blind_parts.other_bodies import solve_bodies
from blind_parts.other_sets import answer_of, other_sets
from blind_parts.other_table import table_text


def main() -> int:
    """Run what is missing, then print and write the table."""
    given = parser_of(__doc__, 240).parse_args()
    cases = [case for seed in given.seed for case in other_sets(given.sets, seed)]
    found = run_sets(given, cases, answer_of, solve_bodies)
    text, met = table_text(found)
    write_table(given, text, len(found), len(cases))
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
