"""The table of the benchmark, on the screen and as Markdown beside the sets."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from blind_parts.score import OURS, beside, failing, tier_lines
from blind_parts.sets import TIER_SETS
from blind_parts.simple import SIMPLE
from ecm.stages import write_atomically


def write_table(results: Sequence[dict[str, Any]], folder: Path, broken: int = 0) -> bool:
    """Prints and writes table.md and table.json; whether every goal is met."""
    text, document = table_text(results, broken)
    print(text)
    write_atomically(folder / "table.md", text)
    write_atomically(folder / "table.json", json.dumps(document, indent=1))
    return all(line["met"] for line in (*document["tiers"], *document["beside"])) and not broken


def table_text(results: Sequence[dict[str, Any]], broken: int = 0) -> tuple[str, dict[str, Any]]:
    """Markdown and the same as a document."""
    simple = [name for name in SIMPLE if any(name in r.get("simple", {}) for r in results)]
    methods = [OURS, *simple]
    tiers, rest = tier_lines(results, methods), beside(results)
    run = {t: sum(r["set"]["tier"] == t for r in results) for t in TIER_SETS}
    told = ", ".join(f"tier {t}: {run[t]} of {n}" for t, n in TIER_SETS.items())
    lines = [f"Sets run: {told}." + (f" {broken} failed." if broken else ""), ""]
    lines.append("| figure | sets | goal | " + " | ".join(methods) + " | goal met |")
    lines.append("|---|---|---|" + "---|" * len(methods) + "---|")
    for line in tiers:
        cells = [f"{line['values'][m]:.2f}" if m in line["values"] else "–" for m in methods]
        met = "yes" if line["met"] else "no"
        lines.append(
            f"| {line['what']} | {line['sets']} | {line['goal']} | {' | '.join(cells)} | {met} |"
        )
    lines += ["", "| beside | of | goal | ours | goal met |", "|---|---|---|---|---|"]
    for line in rest:
        met = "yes" if line["met"] else "no"
        lines.append(
            f"| {line['what']} | {line['sets']} | {line['goal']} | {line['value']:.3f} | {met} |"
        )
    wrong = failing(results)
    lines += ["", f"Failing sets: {len(wrong)}."]
    lines += [f"- {text}" for text in wrong]
    document = {"sets": run, "tiers": tiers, "beside": rest, "failing": wrong}
    return "\n".join(lines) + "\n", document
