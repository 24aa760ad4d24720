"""Writes the tables "paper against here" into docs/paper.md from a run of the main job.

    make demo && .venv/bin/python docs/paper_tables.py demo docs/paper.md

Each table stands between `<!-- NAME -->` and `<!-- end -->` in the page.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

COMPONENTS = "fx N | fy N | fz N | τx N m | τy N m | τz N m"
RULE = "|---|---|---|---|---|---|---|---|"
Rows = list[dict[str, Any]]


def cells(values: Sequence[float]) -> str:
    """Three significant digits each."""
    return " | ".join(f"{v:.3g}" for v in values)


def beside(table: Rows, label: str) -> list[str]:
    """Ours, and the paper's below it."""
    lines = [f"| {label} | {COMPONENTS} | κ(X) |", RULE]
    for row in table:
        lines.append(f"| {row[label]:g} | {cells(row['rmse'])} | {row['kappa']:.4g} |")
        if "paper_rmse" in row:
            paper = " | ".join(f"{v:g}" for v in row["paper_rmse"])
            lines.append(f"| *the paper* | {paper} | {row['paper_kappa']:g} |")
    return lines


def simulation(summary: dict[str, Any]) -> list[str]:
    """Counts, K at rest."""
    step = summary["simulate"]
    counts = step["counts"]
    lines = [
        f"{counts['drawn']} wrenches drawn, {counts['screened']} passed the rod's screen, "
        f"{counts['solved']} solved by FEM, {counts['kept']} kept; "
        f"{step['iterations_mean']:.1f} Newton iterations a case.",
        "",
        "| K at rest | here | equation (11) | difference |",
        "|---|---|---|---|",
    ]
    for row in step["equation_11"]:
        ours, paper = row["ours"], row["paper"]
        lines.append(f"| {row['entry']} | {ours:.5g} | {paper:g} | {row['difference']:+.1%} |")
    return lines


def table_two(summary: dict[str, Any]) -> list[str]:
    """Degrees and thresholds."""
    table = summary["select"]["table_two"]
    raw = table["degrees"][-1]["kappa_raw"]
    degrees = {row["degree"]: row["rmse"] for row in table["degrees"]}
    falls = [degrees[2][j] / degrees[3][j] for j in (1, 2)]
    return [
        *beside(table["degrees"], "degree"),
        "",
        *beside(table["thresholds"], "threshold"),
        "",
        f"κ(X) of the cubic before normalisation: {raw:.2g} (the paper: above 5·10⁶). From degree "
        f"2 to 3 the error falls {falls[0]:.1f} times in fy and {falls[1]:.1f} times in fz.",
    ]


def table_three(summary: dict[str, Any]) -> list[str]:
    """Measured on the simulated rig, trained on one design, tested on the other."""
    lines = []
    for name, title in (("d", "D-optimal"), ("maximin", "maximin")):
        rows = [r for r in summary["identify"]["table_three"] if r["trained_on"] == name]
        lines += [f"Trained on the {title} design, tested on the other:", ""]
        lines += [*beside(rows, "threshold"), ""]
    return lines[:-1]


def models(summary: dict[str, Any]) -> list[str]:
    """All models on the other design's measurements, beside the noise floor."""
    lines = [f"| model | coefficients | poses | {COMPONENTS} | error / noise |", "|---" * 10 + "|"]
    for row in summary["identify"]["models"]:
        lines.append(
            f"| {row['model']} | {row['coefficients']} | {row['poses']} | {cells(row['rmse'])} | "
            f"{row['whitened_rms']:.2f} |"
        )
    floor = cells(summary["identify"]["floor"])
    return [*lines, f"| *noise floor* | | | {floor} | 1 |"]


def rest(summary: dict[str, Any], times: dict[str, Any]) -> list[str]:
    """Designs, symmetry, speed, loop."""
    designs = summary["select"]["designs"]
    share = summary["identify"]["symmetric_share"]["smallest"]
    history = summary["loop"]["history"]
    held = " → ".join(f"{fit['held_out']:.2f}" for fit in history)
    stages = times["stages_s"]
    hidden = ", ".join(summary["loop"]["score"]["truth"]) if summary["loop"]["score"] else "nothing"
    return [
        f"- Designs of {designs['d']['n']} poses: D-optimal at {designs['d']['efficiency']:.1%} of "
        f"the certified bound, maximin at {designs['maximin']['efficiency']:.1%} of its bound.",
        f"- Share of the symmetric part of K (Fig. 12): smallest {share:.4f} (the paper: above "
        "0.95).",
        "- Evaluation from Python against FEM, the same pairs (Fig. 11): "
        f"{times['evaluation']['ratio_of_medians']:.0f} times faster (the paper: at least 200).",
        f"- The loop, with {hidden} hidden in the rig: verdict "
        f"`{summary['loop']['diagnosis']['verdict']}`, held-out error over noise {held}.",
        f"- The whole job took {sum(stages.values()) / 60.0:.1f} minutes on two cores.",
    ]


def main(folder: Path, page: Path) -> None:
    """Rewrite every marked part of the page."""
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    times = json.loads((folder / "times.json").read_text(encoding="utf-8"))
    parts = {
        "simulation": simulation(summary),
        "table two": table_two(summary),
        "table three": table_three(summary),
        "models": models(summary),
        "rest": rest(summary, times),
    }
    text = page.read_text(encoding="utf-8")
    for name, lines in parts.items():
        pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        if not pattern.search(text):
            raise SystemExit(f"{page}: no part <!-- {name} --> ... <!-- end -->")
        body = "\n".join(lines)
        text = pattern.sub(lambda m, body=body: f"{m.group(1)}\n{body}\n\n{m.group(2)}", text)
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
