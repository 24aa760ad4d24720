"""Figures of results; plotly is needed to draw them (extra `report`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ecm.io.arrays import F
from ecm.models.history import FitRecord
from ecm.report import figures


def history_figure(history: Sequence[FitRecord]) -> Any:
    """Bars of the error over the noise of each fit, on fitted and on held-out rows."""
    errors: dict[str, Sequence[float]] = {
        "fitted rows": [record.train for record in history],
        "held-out rows": [record.held_out for record in history],
    }
    names = [record.name for record in history]
    return figures.plotly_figure(figures.bars(errors, names, y_title="error / noise"))


def learning_curve_figure(sizes: Sequence[int], bands: dict[str, F]) -> Any:
    """Held-out error over the number of poses; `bands` by name, each (s,)."""
    series = {name: (list(sizes), band.tolist()) for name, band in bands.items()}
    figure = figures.lines(series, x_title="poses", y_title="error / noise", log_y=True)
    return figures.plotly_figure(figure)
