"""Draws the picture of README.md from a run of the main job.

make demo && .venv/bin/python docs/picture.py demo docs/neck.png
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from ecm._native import rotation_matrices
from ecm.io.table import read_table

F = NDArray[np.float64]
BLUE, ORANGE, INK = "#0072b2", "#d55e00", "#1c2430"


def centre_line(pose: F, length_m: float, points: int = 40) -> tuple[F, F]:
    """Smooth line from the clamped base to the top frame, and its directions, for drawing only."""
    s = np.linspace(0.0, 1.0, points)[:, None]
    top = rotation_matrices(pose[None, 3:])[0][:, 0]
    start, end = np.array([1.0, 0.0, 0.0]) * length_m, top * length_m
    line = (s**3 - 2 * s**2 + s) * start + (3 * s**2 - 2 * s**3) * pose[:3] + (s**3 - s**2) * end
    tangent = np.gradient(line, axis=0)
    return line, tangent / np.linalg.norm(tangent, axis=1)[:, None]


def draw_body(axes: plt.Axes, pose: F, length_m: float, radius_m: float, colour: str) -> None:
    """The body in the x, y plane: outline and end plates."""
    line, tangent = centre_line(pose, length_m)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    left = 1e3 * (line[:, :2] + radius_m * normal)
    right = 1e3 * (line[:, :2] - radius_m * normal)
    outline = np.concatenate([left, right[::-1]])
    axes.fill(outline[:, 1], outline[:, 0], color=colour, alpha=0.16, lw=0)
    for side in (left, right):
        axes.plot(side[:, 1], side[:, 0], color=colour, lw=1.0)
    axes.plot([left[-1, 1], right[-1, 1]], [left[-1, 0], right[-1, 0]], color=INK, lw=3)


def main(folder: Path, target: Path) -> None:
    """Three panels: the mechanism, how many poses a model needs, the missing effect found."""
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    body = summary["mechanism"]
    poses = read_table(folder / "simulated.csv").poses
    figure, (left, middle, right) = plt.subplots(
        1, 3, figsize=(12, 3.7), width_ratios=(1.0, 1.25, 1.25), layout="constrained"
    )
    # The most bent poses of either side that stay near the drawing's plane.
    flat = np.abs(poses[:, 2]) < 8e-3
    order = np.argsort(np.where(flat, poses[:, 1], 0.0))
    rest = np.array([body["length_m"], 0.0, 0.0, 0.0, 0.0, 0.0])
    for pose, colour in ((poses[order[0]], BLUE), (poses[order[-1]], ORANGE), (rest, INK)):
        draw_body(left, pose, body["length_m"], body["radius_m"], colour)
    left.plot([-40, 40], [0, 0], color=INK, lw=4)
    left.set(aspect="equal", xlabel="y [mm]", ylabel="x [mm]", title="a pose p needs a wrench h(p)")

    energy = summary["select"]["energy"]
    for name, marker, colour in (("energy4", "o", ORANGE), ("energy6", "s", BLUE)):
        rows = [r for r in energy if r["model"] == name]
        middle.loglog(
            [r["poses"] for r in rows],
            [r["rmse"][1] for r in rows],
            marker=marker,
            color=colour,
            label=f"{name}, {rows[0]['coefficients']} coefficients",
        )
    cubic = summary["select"]["table_two"]["degrees"][-1]
    middle.axhline(
        cubic["rmse"][1],
        color=INK,
        ls="--",
        label=f"the paper's cubic, 504, from {summary['select']['n_train']} poses",
    )
    counts = sorted({r["poses"] for r in energy})
    middle.set_xticks(counts, [str(c) for c in counts])
    middle.minorticks_off()
    middle.set(xlabel="poses", ylabel="error of fy [N]", title="how many poses a model needs")
    middle.set_ylim(4e-3, 2.0)
    middle.legend(fontsize=8, loc="lower left", frameon=False)

    history = summary["loop"]["history"]
    names = [h["name"].replace("+", "\n+ ") for h in history]
    right.bar(names, [h["held_out"] for h in history], color=[ORANGE, BLUE][: len(names)])
    right.axhline(1.0, color=INK, ls="--", lw=1)
    right.text(0.99, 1.01, "noise floor", transform=right.get_yaxis_transform(), ha="right")
    right.set(ylabel="held-out error / noise", title="the missing effect, found and added")
    for axes in (middle, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
