"""The next day of the third blind benchmark of docs/discovery.md: models before rows of other days.

    python benches/blind_again.py --out build/again [--sets 104] [--seed 1 2]

Every set is a file in a folder named by a hash of the code; one that is there is not run again.
"""

from __future__ import annotations

import os
import sys
from typing import Any

# Before numpy is imported, here and in the workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import numpy as np

from blind_parts.again import answers_of
from blind_parts.command import (
    not_right_lines,
    outcome_lines,
    parser_of,
    run_sets,
    write_table,
)
from blind_parts.third import OUTCOMES, solve_bodies, third_sets

_DAYS = {
    "same": "the same rig",
    "grown": "what was hidden, 1.6 times as large",
    "other": "another cause beside it",
}
_CHANGES = ("wandering zero", "wear below the largest load", "hardening in log time")
"""Laws that go on over night: the same rig is not the same."""


def table_text(results: list[dict[str, Any]]) -> str:
    """Markdown: a line for each day, the errors on fresh rows, and what is not right."""
    steady = [r for r in results if r["set"]["name"] not in _CHANGES]
    days = {
        "same": steady,
        "grown": [r for r in results if r["set"]["name"]],
        "other": results,
    }
    groups = {_DAYS[day]: [r["days"][day] for r in own] for day, own in days.items()}
    before, after = (np.array([r["fresh"][key] for r in results]) for key in ("before", "after"))
    lines = [
        *outcome_lines(groups, OUTCOMES),
        "",
        "| with that cause, on fresh rows | as the model was | after ADD IT |",
        "|---|---|---|",
        f"| median error over the noise | {np.median(before):.2f} | {np.median(after):.2f} |",
        f"| below 2 | {np.mean(before < 2.0):.3f} | {np.mean(after < 2.0):.3f} |",
        "",
    ]
    for day, own in groups.items():
        lines += [f"{day[0].upper()}{day[1:]}:", "", *not_right_lines(own, _words), ""]
    return "\n".join(lines)


def _words(result: dict[str, Any]) -> str:
    case = result["set"]
    which = f"({case['body']}, {case['protocol']}, {case['rows']} rows)"
    return f"{case['name'] or 'nothing'} at {case['strength']:g} {which}: {result['outcome']}"


def main() -> int:
    """Run what is missing, then print and write the table."""
    given = parser_of(__doc__, 104).parse_args()
    cases = [case for seed in given.seed for case in third_sets(given.sets, seed)]
    found = run_sets(given, cases, answers_of, solve_bodies)
    write_table(given, table_text(found), len(found), len(cases))
    return 0


if __name__ == "__main__":
    sys.exit(main())
