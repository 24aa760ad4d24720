"""Figures of a design: the chosen poses among the candidates, n against expected error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ecm.designs import Design, Size
from ecm.io.table import Table
from ecm.report import figures as draw


def pose_figure(candidates: Table, design: Design, x: str, y: str) -> dict[str, Any]:
    """Two coordinates of the candidates, the chosen ones marked."""
    series = (
        ("candidates", np.arange(len(candidates)), "#c4ccd6", 4, "circle"),
        ("chosen", design.indices, draw.COLOURS[0], 7, "diamond"),
    )
    data = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": name,
            "x": candidates.column(x)[rows].tolist(),
            "y": candidates.column(y)[rows].tolist(),
            "marker": {"color": colour, "size": size, "symbol": symbol},
        }
        for name, rows, colour, size, symbol in series
    ]
    layout = {
        "xaxis": {"title": {"text": x}},
        "yaxis": {"title": {"text": y}},
        "plot_bgcolor": "white",
        "height": 420,
    }
    return {"data": data, "layout": layout}


def size_figure(sizes: Sequence[Size], knee: Size) -> dict[str, Any]:
    """Expected errors over n, the knee marked."""
    n = [float(size.n) for size in sizes]
    figure = draw.lines(
        {
            "wrench h": (n, [size.wrench_error for size in sizes]),
            "stiffness K, times half the range": (n, [size.stiffness_error for size in sizes]),
        },
        x_title="poses n",
        y_title="expected error / noise of a reading",
        log_x=True,
        log_y=True,
    )
    figure["data"].append(
        {
            "type": "scatter",
            "mode": "markers",
            "name": f"knee, n = {knee.n}",
            "x": [float(knee.n)] * 2,
            "y": [knee.wrench_error, knee.stiffness_error],
            "marker": {"symbol": "circle-open", "size": 18, "color": "#b3261e"},
        }
    )
    return figure
