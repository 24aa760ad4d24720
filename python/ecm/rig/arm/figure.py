"""The paper's Fig. 7 (right): one pose on its way, component by component, with the phases."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ecm.io.extras import require
from ecm.rig.arm.plot_style import COLOURS, PANELS
from ecm.rig.arm.procedure import Sortie, Stop, whole_way


def figure_7(sortie: Sortie, stop: Stop, length_m: float, path: Path) -> None:
    """Writes the picture of a sortie with one stop; the suffix of `path` chooses the format.

    Raises
    ------
    MissingExtra
        Where matplotlib is missing.
    """
    figure = require("matplotlib.figure", "report", "--phases").Figure(
        figsize=(9.0, 6.0), layout="constrained"
    )
    outcome = sortie.outcomes[0]
    time_s, way = whole_way(sortie)
    rest = np.array([length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
    axes: Any = figure.subplots(2, 3, sharex=True)
    for j, axis in enumerate(axes.ravel()):
        for name, begin, end in (*outcome.phases, *sortie.home.phases):
            axis.axvspan(begin, end, color=COLOURS[name], lw=0, label=name if j == 0 else None)
        axis.plot(time_s, 1e3 * (way[:, j] - rest[j]), color="#204a87", lw=1.5)
        axis.axhline(1e3 * (stop.goal[j] - rest[j]), color="#a40000", lw=1.0, ls="--")
        axis.set_title(PANELS[j], fontsize=10)
        axis.margins(x=0)
    for axis in axes[1]:
        axis.set_xlabel("time [s]")
    words = "reached" if not outcome.reason else f"skipped: {outcome.reason}"
    figure.suptitle(f"One pose of the procedure ({words}); dashed: goal", fontsize=11)
    figure.legend(loc="outside lower center", ncols=len(COLOURS), fontsize=9, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, metadata=_no_date(path))


def _no_date(path: Path) -> dict[str, Any]:
    """The same picture gives the same bytes."""
    return {"Date": None} if path.suffix == ".svg" else {}
