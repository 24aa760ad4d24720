"""The third blind benchmark of docs/discovery.md: bodies, laws and protocols of their own.

    python benches/blind_third.py --out build/third [--sets 104] [--seed 1 2]

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
from blind_parts.third import (
    HIDDEN,
    OUTCOMES,
    ThirdSet,
    given_model,
    outcome,
    solve_bodies,
    third_sets,
    third_table,
)


def answer_of(case: ThirdSet, folder: Path) -> dict[str, Any]:
    """Diagnose a set; its file."""
    table = third_table(case, folder)
    result, found = diagnosed(case, table, partial(given_model, table))
    driver = found.family.driver if found and found.family else ""
    return result | {"outcome": outcome(case, result["verdict"], result["answer"], driver)}


def table_text(results: list[dict[str, Any]]) -> str:
    """Markdown: a line for each law, for each protocol, and for each set that is not right."""

    def of(key: str, value: str) -> list[dict[str, Any]]:
        return [r for r in results if r["set"][key] == value]

    def words(r: dict[str, Any]) -> str:
        case = r["set"]
        which = f"({case['body']}, {case['protocol']}, {case['rows']} rows)"
        return f"{case['name'] or 'nothing'} at {case['strength']:g} {which}"

    groups = {name or "nothing": of("name", name) for name in ("", *HIDDEN)}
    protocols = sorted({r["set"]["protocol"] for r in results})
    groups |= {f"*{protocol}*": of("protocol", protocol) for protocol in protocols}
    lines = outcome_lines({**groups, "all": results}, OUTCOMES)
    return "\n".join([*lines, *not_right_lines(results, words)]) + "\n"


def main() -> int:
    """Run what is missing, then print and write the table."""
    given = parser_of(__doc__, 104).parse_args()
    cases = [case for seed in given.seed for case in third_sets(given.sets, seed)]
    found = run_sets(given, cases, answer_of, solve_bodies)
    write_table(given, table_text(found), len(found), len(cases))
    return 0


if __name__ == "__main__":
    sys.exit(main())
