"""Figures in plotly's dict form: readable without colour (markers, dashes, patterns differ)."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ecm.io.arrays import F, I, evenly

INK = "#1c2430"
# Wong's palette, distinct for colour-blind readers; order by darkness for print.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000")
DASHES = ("solid", "dash", "dot", "dashdot", "longdash")
MARKERS = ("circle", "square", "diamond", "cross", "triangle-up")
PATTERNS = ("", "/", "x", ".", "-")
MOST_DRAWN = 1000
"""Rows that a figure draws; more make a page large and hide each other."""
_LARGEST = 10
COMPONENT_LABELS = ("fx [N]", "fy [N]", "fz [N]", "τx [N m]", "τy [N m]", "τz [N m]")


def plain(text: str) -> str:
    """Escape a name from a data file for a label: plotly draws tags and links in its texts."""
    return html.escape(text, quote=False)


def drawn_rows(values: F) -> I:
    """Rows of (N, m) values to draw: all up to `MOST_DRAWN`, else some evenly and the largest."""
    if len(values) <= MOST_DRAWN:
        return np.arange(len(values), dtype=np.int64)
    spread = values.std(axis=0)
    size = (((values - values.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)) ** 2).sum(axis=1)
    return np.union1d(evenly(len(values), MOST_DRAWN), np.argsort(-size, kind="stable")[:_LARGEST])


def drawn_sentence(values: F) -> str:
    """Return a sentence for the caption where `drawn_rows` leaves some out, else nothing."""
    drawn = len(drawn_rows(values))
    if drawn == len(values):
        return ""
    return f" {drawn} of {len(values)} rows are drawn: evenly over their order, and the largest."


def _layout(**settings: Any) -> dict[str, Any]:
    return {
        "font": {"family": "system-ui, DejaVu Sans, Arial, sans-serif", "size": 13, "color": INK},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "margin": {"l": 64, "r": 16, "t": 60, "b": 48},
        "height": 420,
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0},
        **settings,
    }


def _axis(title: str = "", **settings: Any) -> dict[str, Any]:
    return {
        "title": {"text": title, "standoff": 6},
        "gridcolor": "#e4e8ed",
        "linecolor": "#8a94a2",
        "ticks": "outside",
        "zeroline": False,
        "showline": True,
        **settings,
    }


def _panels(
    n: int,
    x_titles: Sequence[str],
    y_titles: Sequence[str],
    titles: Sequence[str] = (),
    **settings: Any,
) -> dict[str, Any]:
    """Layout of n panels, at most three in a row; `panel_axes` says which axes a trace uses."""
    columns = min(3, n)
    rows = -(-n // columns)
    across, down = 0.075, 0.26 / rows
    width, height = (1.0 - across * (columns - 1)) / columns, (1.0 - down * (rows - 1)) / rows
    layout = _layout(**settings)
    layout["annotations"] = []
    for i in range(n):
        left = (i % columns) * (width + across)
        bottom = (rows - 1 - i // columns) * (height + down)
        axes = panel_axes(i)
        xaxis, yaxis = (axes[f"{letter}axis"].replace(letter, f"{letter}axis") for letter in "xy")
        layout[xaxis] = _axis(x_titles[i], anchor=axes["yaxis"], domain=[left, left + width])
        layout[yaxis] = _axis(y_titles[i], anchor=axes["xaxis"], domain=[bottom, bottom + height])
        if titles:
            layout["annotations"].append(_panel_title(titles[i], left + width / 2, bottom + height))
    return layout


def _panel_title(title: str, x: float, y: float) -> dict[str, Any]:
    return {
        "text": f"<b>{title}</b>",
        "x": x,
        "y": y,
        "xref": "paper",
        "yref": "paper",
        "xanchor": "center",
        "yanchor": "bottom",
        "showarrow": False,
        "font": {},
    }


def _edge_titles(n: int, x_title: str, y_title: str) -> tuple[list[str], list[str]]:
    """Axis titles of n panels: x below the last ones, y left of the first ones."""
    columns = min(3, n)
    return (
        [x_title if i >= n - columns else "" for i in range(n)],
        [y_title if i % columns == 0 else "" for i in range(n)],
    )


def panel_axes(panel: int) -> dict[str, str]:
    """Return the axes of a panel, counted from 0, for a trace."""
    suffix = "" if panel == 0 else str(panel + 1)
    return {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}


def _scatter(x: Any, y: Any, mode: str = "markers", **settings: Any) -> dict[str, Any]:
    return {"type": "scatter", "mode": mode, "x": _list(x), "y": _list(y), **settings}


def _bar(x: Any, y: Any, k: int | None = None, **settings: Any) -> dict[str, Any]:
    """Bars in colour and pattern `k`; None: the first colour without a pattern."""
    marker: dict[str, Any] = {"color": COLOURS[(k or 0) % 5]}
    if k is not None:
        marker["pattern"] = {"shape": PATTERNS[k % 5]}
    return {"type": "bar", "x": _list(x), "y": _list(y), "marker": marker, **settings}


def _list(values: Any) -> list[Any]:
    items: list[Any] = values.tolist() if isinstance(values, np.ndarray) else list(values)
    return items


def histograms(
    series: Mapping[str, F],
    labels: Sequence[str],
    *,
    limit: float,
    x_title: str,
    y_title: str = "pairs",
    bins: int = 40,
) -> dict[str, Any]:
    """Draw one histogram per column of (N, len(labels)) values, without those above the limit."""
    edges = np.linspace(-limit, limit, bins + 1)
    centres = 0.5 * (edges[1:] + edges[:-1])
    n = len(labels)
    layout = _panels(
        n, *_edge_titles(n, x_title, y_title), labels,
        height=200 * -(-n // 3) + 130, barmode="overlay", bargap=0.05,
    )  # fmt: skip
    layout["legend"] |= {"y": 1.06}
    data = [
        _bar(
            centres,
            np.histogram(values[:, i], bins=edges)[0],
            k,
            name=name,
            legendgroup=name,
            showlegend=i == 0 and len(series) > 1,
            opacity=0.65,
            **panel_axes(i),
        )
        for i in range(n)
        for k, (name, values) in enumerate(series.items())
    ]
    return {"data": data, "layout": layout}


def actual_predicted(observed: F, predicted: F, labels: Sequence[str]) -> dict[str, Any]:
    """Draw predicted over measured values, (N, len(labels)) each; the dashed line is exact."""
    n = len(labels)
    rows = drawn_rows(predicted - observed)
    observed, predicted = observed[rows], predicted[rows]
    titles = _edge_titles(n, "measured", "predicted")
    layout = _panels(n, *titles, labels, height=560, showlegend=False)
    data: list[dict[str, Any]] = []
    for i in range(n):
        values = np.concatenate([observed[:, i], predicted[:, i]])
        ends = [float(values.min()), float(values.max())]
        line = {"color": INK, "dash": "dash", "width": 1}
        template = "row %{customdata}<br>measured %{x:.3g}<br>predicted %{y:.3g}<extra></extra>"
        data += [
            _scatter(ends, ends, "lines", line=line, hoverinfo="skip", **panel_axes(i)),
            _scatter(
                observed[:, i],
                predicted[:, i],
                marker={"size": 4, "color": COLOURS[0]},
                customdata=rows.tolist(),
                hovertemplate=template,
                **panel_axes(i),
            ),
        ]
    return {"data": data, "layout": layout}


def histogram(values: F, *, x_title: str, y_title: str, bins: int = 40) -> dict[str, Any]:
    """Draw one histogram over the range of its values."""
    counts, edges = np.histogram(values, bins=bins)
    layout = _layout(xaxis=_axis(x_title), yaxis=_axis(y_title), bargap=0.05, height=320)
    return {"data": [_bar(0.5 * (edges[1:] + edges[:-1]), counts)], "layout": layout}


def times(fem_s: Sequence[float], model_s: Sequence[float]) -> dict[str, Any]:
    """Draw the distribution of evaluation times of FEM and model, logarithmic (Fig. 11)."""
    data = []
    for k, (name, values) in enumerate((("FEM", fem_s), ("model", model_s))):
        counts, edges = np.histogram(np.log10(np.asarray(values)), bins=20)
        widths = (10.0 ** edges[1:] - 10.0 ** edges[:-1]).tolist()
        centres = 10.0 ** (0.5 * (edges[1:] + edges[:-1]))
        data.append(_bar(centres, counts, k, width=widths, name=name))
    layout = _layout(
        xaxis=_axis("time of one evaluation [s]", type="log", exponentformat="power"),
        yaxis=_axis("pairs"),
        height=320,
    )
    return {"data": data, "layout": layout}


def lines(
    series: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    *,
    x_title: str,
    y_title: str,
    log_x: bool = False,
    log_y: bool = False,
) -> dict[str, Any]:
    """Draw curves with markers from (x, y) by name."""
    data = [
        _scatter(
            x,
            y,
            "lines+markers",
            name=name,
            line={"color": COLOURS[k % 5], "dash": DASHES[k % 5]},
            marker={"symbol": MARKERS[k % 5], "size": 8},
        )
        for k, (name, (x, y)) in enumerate(series.items())
    ]
    layout = _layout(
        xaxis=_axis(x_title, type="log" if log_x else "linear"),
        yaxis=_axis(y_title, type="log" if log_y else "linear", exponentformat="power"),
    )
    return {"data": data, "layout": layout}


def bars(
    groups: Mapping[str, Sequence[float]], labels: Sequence[str], *, y_title: str
) -> dict[str, Any]:
    """Draw grouped bars."""
    data = [_bar(labels, values, k, name=name) for k, (name, values) in enumerate(groups.items())]
    axes = {"xaxis": _axis(automargin=True), "yaxis": _axis(y_title)}
    return {"data": data, "layout": _layout(**axes, barmode="group", height=360)}


def stiffness_map(stiffness: F, title: str) -> dict[str, Any]:
    """Draw a matrix (6, 6) as numbers, coloured by sign and relative size."""
    names = ["x", "y", "z", "θx", "θy", "θz"]
    rows = ["fx", "fy", "fz", "τx", "τy", "τz"]
    diagonal = np.sqrt(np.abs(np.diag(stiffness)))
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.nan_to_num(stiffness / np.outer(diagonal, diagonal))
    text = [[f"{value:.4g}" for value in row] for row in stiffness]
    figure = text_map(relative, text, names, rows, limit=1.6)
    figure["layout"]["title"] = {"text": title, "font": {"size": 14}}
    return figure


def pose_cloud(poses: F) -> dict[str, Any]:
    """Draw poses (N, 6) in three views: positions in mm and rotation vectors in rad."""
    names = ("x [mm]", "y [mm]", "z [mm]", "θx [rad]", "θy [rad]", "θz [rad]")
    values = np.round(poses[drawn_rows(poses)] * ([1e3] * 3 + [1.0] * 3), 5)
    views = ((0, 1), (1, 2), (4, 5))
    titles = [names[a] for a, _ in views], [names[b] for _, b in views]
    marker = {"size": 3, "color": COLOURS[0], "opacity": 0.6}
    data = [
        _scatter(values[:, a], values[:, b], marker=marker, **panel_axes(i))
        for i, (a, b) in enumerate(views)
    ]
    return {"data": data, "layout": _panels(3, *titles, height=340, showlegend=False)}


def residuals_over(x: F, series: Mapping[str, F], *, x_title: str) -> dict[str, Any]:
    """Draw whitened residuals (N, 6) over a covariate (N,), one panel per component."""
    labels = [label.split(" [")[0] for label in COMPONENT_LABELS]
    rows = drawn_rows(next(iter(series.values())))
    layout = _panels(6, *_edge_titles(6, x_title, "residual / noise"), labels, height=540)
    layout["legend"] |= {"y": 1.06}
    data = [
        _scatter(
            np.round(x[rows], 4),
            np.round(values[rows, i], 4),
            name=name,
            legendgroup=name,
            showlegend=i == 0,
            marker={
                "size": 5 if k == 0 else 4,
                "symbol": ("circle-open", "cross-thin-open")[k % 2],
                "color": COLOURS[(1, 0)[k % 2]],
            },
            customdata=rows.tolist(),
            hovertemplate="row %{customdata}: %{y:.2f}<extra>" + name + "</extra>",
            **panel_axes(i),
        )
        for i in range(6)
        for k, (name, values) in enumerate(series.items())
    ]
    return {"data": data, "layout": layout}


def component_layout(outputs: Sequence[str], legend: str | None) -> dict[str, Any]:
    """Return the layout of one panel per component; `panel_axes` gives the axes of a trace."""
    n = len(outputs)
    layout = _panels(
        n, [""] * n, [""] * n, outputs,
        height=210 * -(-n // 3) + 180,
        showlegend=legend is not None,
        margin={"l": 64, "r": 16, "t": 96, "b": 76},
    )  # fmt: skip
    layout["legend"] |= {"x": 1.0, "xanchor": "right", "y": 1.16}
    return layout


def linked_views(
    views: Sequence[tuple[str, Sequence[float], str, Sequence[float]]],
    *,
    size: F,
    rows: Sequence[int],
    text: Sequence[str],
    link: str,
) -> dict[str, Any]:
    """Draw scatter plots (x title, x, y title, y) of the same rows; a click marks a row in all."""
    data = [
        _scatter(
            x,
            y,
            text=list(text),
            marker={"size": size.tolist(), "symbol": "circle-open", "color": COLOURS[0]},
            selected={"marker": {"color": COLOURS[1], "size": 20}},
            unselected={"marker": {"opacity": 0.35}},
            meta=link,
            customdata=list(rows),
            hovertemplate="row %{customdata}: %{text}<extra></extra>",
            **panel_axes(i),
        )
        for i, (_, x, _, y) in enumerate(views)
    ]
    titles = [view[0] for view in views], [view[2] for view in views]
    return {"data": data, "layout": _panels(len(views), *titles, height=360, showlegend=False)}


def text_map(
    values: F,
    text: Sequence[Sequence[str]],
    columns: Sequence[str],
    rows: Sequence[str],
    *,
    limit: float,
) -> dict[str, Any]:
    """Draw a matrix of text, coloured by the sign and size of values up to the limit."""
    heatmap = {
        "type": "heatmap",
        "z": values.tolist(),
        "x": list(columns),
        "y": list(rows),
        "text": [list(row) for row in text],
        "texttemplate": "%{text}",
        "colorscale": [[0, "#4393c3"], [0.5, "#ffffff"], [1, "#e58368"]],
        "textfont": {"color": INK},
        "zmid": 0,
        "zmin": -limit,
        "zmax": limit,
        "showscale": False,
        "hovertemplate": "%{y}, %{x}: %{text}<extra></extra>",
    }
    layout = _layout(
        xaxis=_axis("", side="top"),
        yaxis=_axis("", autorange="reversed"),
        height=380,
        margin={"l": 48, "r": 16, "t": 70, "b": 16},
    )
    return {"data": [heatmap], "layout": layout}
