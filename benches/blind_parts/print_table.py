"""The table of the benchmark, on the screen and as Markdown beside the sets."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from blind_parts.score import beside, failing, tier_lines
from blind_parts.sets import ALL_SETS, ARM
from ecm.io.cache import write_atomically

_MET = {True: "yes", False: "no", None: "–"}


def write_table(results: Sequence[dict[str, Any]], folder: Path, broken: int = 0) -> bool:
    """Prints and writes table.md and table.json; whether every goal is met."""
    text, document = table_text(results, broken)
    print(text)
    write_atomically(folder / "table.md", text)
    write_atomically(folder / "table.json", json.dumps(document, indent=1))
    return (
        all(line["met"] is not False for line in (*document["tiers"], *document["beside"]))
        and not broken
    )


def table_text(results: Sequence[dict[str, Any]], broken: int = 0) -> tuple[str, dict[str, Any]]:
    """Markdown and the same as a document."""
    tiers, rest = tier_lines(results), beside(results)
    run = {t: sum(r["set"]["tier"] == t for r in results) for t in ALL_SETS}
    counts = ", ".join(
        f"{'full robot' if t == ARM else f'tier {t}'}: {run[t]} of {n}" for t, n in ALL_SETS.items()
    )
    lines = [f"Sets run: {counts}." + (f" {broken} failed." if broken else ""), ""]
    lines += ["| figure | sets | goal | ours | goal met |", "|---|---|---|---|---|"]
    for line in tiers:
        lines.append(
            f"| {line['what']} | {line['sets']} | {line['goal']} | {line['value']:.2f} "
            f"| {_MET[line['met']]} |"
        )
    lines += ["", "| beside | of | goal | ours | goal met |", "|---|---|---|---|---|"]
    for line in rest:
        lines.append(
            f"| {line['what']} | {line['sets']} | {line['goal']} | {line['value']:.3f} "
            f"| {_MET[line['met']]} |"
        )
    wrong = failing(results)
    lines += ["", f"Failing sets: {len(wrong)}."]
    lines += [f"- {text}" for text in wrong]
    document = {"sets": run, "tiers": tiers, "beside": rest, "failing": wrong}
    return "\n".join(lines) + "\n", document
