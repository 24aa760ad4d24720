"""Draws the picture of the five lines in README.md.

.venv/bin/python docs/hinge_picture.py FOLDER docs/hinge.png

FOLDER holds their hinge.csv, hinge.json and better.json.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import ecm

BLUE, ORANGE, INK = "#0072b2", "#d55e00", "#1c2430"
NOISE_NMM = 3.0


def main(folder: Path, target: Path) -> None:
    """Measured over modelled, with what is left below, before and after."""
    table = ecm.read_table(folder / "hinge.csv")
    angle = np.rad2deg(table.column("theta_z_rad"))
    torque = 1e3 * table.column("tau_z_Nm")
    figure, axes = plt.subplots(
        2, 2, figsize=(10, 4.6), sharex=True, sharey="row", height_ratios=(2, 1.2),
        layout="constrained",
    )  # fmt: skip
    for column, (name, title, colour) in enumerate(
        (("hinge.json", "a cubic", ORANGE), ("better.json", "the cubic and hysteresis", BLUE))
    ):
        model = 1e3 * ecm.load_model(folder / name).predict(table)[:, 0]
        above, below = axes[:, column]
        above.plot(angle, torque, ".", color=INK, ms=3, label="measured")
        above.plot(angle, model, color=colour, lw=1.4, label=title)
        above.legend(frameon=False, loc="upper left")
        left = torque - model
        times = np.sqrt((left**2).mean()) / NOISE_NMM
        below.axhspan(-NOISE_NMM, NOISE_NMM, color=INK, alpha=0.15, lw=0)
        below.plot(angle, left, ".", color=colour, ms=3)
        below.set_title(f"what it leaves: {times:.1f} times the noise (band)", fontsize=10)
        below.set_xlabel("angle [deg]")
    axes[0, 0].set_ylabel("torque [N mm]")
    axes[1, 0].set_ylabel("[N mm]")
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
