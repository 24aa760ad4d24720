"""Prints the tables "paper against here" of README.md from a run of the main job.

make demo && .venv/bin/python docs/readme_tables.py demo/summary.json demo/times.json
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

HEADER = "| fx N | fy N | fz N | τx N m | τy N m | τz N m | κ(X) |"
RULE = "|---|---|---|---|---|---|---|---|"


def cells(values: list[float]) -> str:
    """Six errors and kappa, three digits."""
    return " | ".join(f"{v:.3g}" for v in values)


def rows(table: list[dict[str, Any]], label: str) -> list[str]:
    """Ours, and the paper's below it."""
    lines = []
    for row in table:
        lines.append(f"| {row[label]} | {cells(row['rmse'])} | {row['kappa']:.4g} |")
        if "paper_rmse" in row:
            paper = " | ".join(f"{v:g}" for v in row["paper_rmse"])
            lines.append(f"| *the paper* | {paper} | {row['paper_kappa']:g} |")
    return lines


def main(summary_path: Path, times_path: Path) -> None:
    """All tables."""
    summary = json.loads(summary_path.read_text(encoding="utf-8"))
    times = json.loads(times_path.read_text(encoding="utf-8"))
    table = summary["select"]["table_two"]
    counts = summary["simulate"]["counts"]
    print("counts", counts, "iterations", summary["simulate"]["iterations_mean"])
    print(f"kappa before normalisation: {table['degrees'][-1]['kappa_raw']:.3g}\n")
    print(f"| degree {HEADER}\n{RULE}", *rows(table["degrees"], "degree"), sep="\n")
    print(f"\n| b {HEADER}\n{RULE}", *rows(table["thresholds"], "threshold"), sep="\n")
    for name in ("d", "maximin"):
        chosen = [r for r in summary["identify"]["table_three"] if r["trained_on"] == name]
        print(f"\ntrained on {name}\n| b {HEADER}\n{RULE}", *rows(chosen, "threshold"), sep="\n")
    print("\n| model | coefficients | poses | fx | fy | fz | τx | τy | τz | error/noise |")
    for row in summary["identify"]["models"]:
        print(
            f"| {row['model']} | {row['coefficients']} | {row['poses']} | {cells(row['rmse'])} | "
            f"{row['whitened_rms']:.3g} |"
        )
    print(f"| noise floor | | | {cells(summary['identify']['floor'])} | 1 |\n")
    for row in summary["select"]["energy"]:
        print(f"| {row['model']} | {row['coefficients']} | {row['poses']} | {cells(row['rmse'])} |")
    print("\nequation (11):")
    for row in summary["simulate"]["equation_11"]:
        print(
            f"| {row['entry']} | {row['ours']:.5g} | {row['paper']:g} | {row['difference']:+.1%}|"
        )
    print("designs", summary["select"]["designs"])
    print("symmetric share", summary["identify"]["symmetric_share"])
    print("speed", times["evaluation"]["ratio_of_medians"], times["stages_s"])
    print("loop", summary["loop"]["history"])


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
