"""Figures in plotly's dict form, and the mechanism in space.

They are readable without colour: markers, dashes and patterns differ.
"""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ecm.io.arrays import F, I, evenly
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.extras import require
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table
from ecm.report.blocks import MechanismBlock

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


def plotly_figure(figure: dict[str, Any]) -> Any:
    """Return a figure of this module as plotly's; MissingExtra where that is not installed."""
    return require("plotly.graph_objects", "report", "A figure").Figure(figure)


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


def some_rows(shown: int, total: int, how: str) -> str:
    """Return a sentence for the caption where some rows are left out, after a space; else nothing.

    Examples
    --------
    >>> some_rows(10, 20, "the largest")
    ' 10 of 20 rows are drawn: the largest.'
    """
    return "" if shown == total else f" {shown} of {total} rows are drawn: {how}."


def drawn_sentence(values: F) -> str:
    """Return `some_rows` of those that `drawn_rows` leaves."""
    how = "evenly over their order, and the largest"
    return some_rows(len(drawn_rows(values)), len(values), how)


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


def plain_layout(x_title: str, y_title: str, **settings: Any) -> dict[str, Any]:
    """Return the layout of a single panel."""
    return _layout(xaxis=_axis(x_title), yaxis=_axis(y_title), **settings)


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
    x_titles: Sequence[str], y_titles: Sequence[str], titles: Sequence[str] = (), **settings: Any
) -> dict[str, Any]:
    """Layout of panels, at most three in a row; `panel_axes` says which axes a trace uses."""
    n = len(x_titles)
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


def _labelled(labels: Sequence[str], x_title: str, y_title: str, **settings: Any) -> dict[str, Any]:
    """Layout of a panel below each label, x below the last ones, y left of the first ones."""
    n = len(labels)
    columns = min(3, n)
    x_titles = [x_title if i >= n - columns else "" for i in range(n)]
    y_titles = [y_title if i % columns == 0 else "" for i in range(n)]
    return _panels(x_titles, y_titles, labels, **settings)


def panel_axes(panel: int) -> dict[str, str]:
    """Return the axes of a panel, counted from 0, for a trace."""
    suffix = "" if panel == 0 else str(panel + 1)
    return {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}


def scatter(x: Any, y: Any, mode: str = "markers", **settings: Any) -> dict[str, Any]:
    """Return a trace of points or lines, its numbers with five digits; x may be names."""
    x, y = ([v if isinstance(v, str) else float(f"{v:.5g}") for v in of] for of in (x, y))
    return {"type": "scatter", "mode": mode, "x": x, "y": y, **settings}


def panel_traces(
    points: Iterable[tuple[Any, Any]],
    rows: Sequence[int],
    *,
    name: str = "",
    link: str = "",
    **settings: Any,
) -> list[dict[str, Any]]:
    """Return a trace of (x, y) in each panel, which share their rows and their entry of the legend.

    Parameters
    ----------
    points
        x and y of each panel, (n,) each.
    rows
        (n,) numbers of the rows.
    name
        Entry in the legend; empty: none.
    link
        A click on a point marks its row in all figures and tables of this link.
    """
    if link:
        selected = {"marker": {"color": COLOURS[1], "size": 14}}
        settings |= {
            "meta": link,
            "selected": selected,
            "unselected": {"marker": {"opacity": 0.35}},
        }
    if name:
        settings |= {"name": name, "legendgroup": name}
    shared = settings | {"customdata": list(rows)}
    return [
        scatter(x, y, showlegend=bool(name) and j == 0, **shared, **panel_axes(j))
        for j, (x, y) in enumerate(points)
    ]


def _bar(x: Any, y: Any, k: int, **settings: Any) -> dict[str, Any]:
    """Bars in colour and pattern `k`."""
    marker = {"color": COLOURS[k % 5], "pattern": {"shape": PATTERNS[k % 5]}}
    return {"type": "bar", "x": _list(x), "y": _list(y), "marker": marker, **settings}


def _list(values: Any) -> list[Any]:
    return values.tolist() if isinstance(values, np.ndarray) else list(values)


def histograms(
    series: Mapping[str, F],
    labels: Sequence[str],
    *,
    limit: float,
    x_title: str,
    y_title: str = "pairs",
) -> dict[str, Any]:
    """Draw one histogram per column of (N, len(labels)) values, without those above the limit."""
    edges = np.linspace(-limit, limit, 41)
    centres = 0.5 * (edges[1:] + edges[:-1])
    n = len(labels)
    height = 200 * -(-n // 3) + 130
    layout = _labelled(labels, x_title, y_title, height=height, barmode="overlay", bargap=0.05)
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
    rows = drawn_rows(predicted - observed)
    points = list(zip(observed[rows].T, predicted[rows].T, strict=True))
    ends = [np.array([np.min(pair), np.max(pair)]) for pair in points]
    layout = _labelled(labels, "measured", "predicted", height=560)
    line = {"color": INK, "dash": "dash", "width": 1}
    template = "row %{customdata}<br>measured %{x:.3g}<br>predicted %{y:.3g}<extra></extra>"
    marker = {"size": 4, "color": COLOURS[0]}
    exact = panel_traces([(e, e) for e in ends], [], mode="lines", line=line, hoverinfo="skip")
    measured = panel_traces(points, rows.tolist(), marker=marker, hovertemplate=template)
    return {"data": [*exact, *measured], "layout": layout}


def measured_and_modelled(
    over: F,
    measured: F,
    modelled: F,
    x_titles: Sequence[str],
    outputs: Sequence[str],
    *,
    is_curve: bool,
) -> dict[str, Any]:
    """Draw measured points and what the model gives there, a panel for each component.

    Parameters
    ----------
    over
        (N, m) coordinate that each component is drawn over.
    measured, modelled
        (N, m) wrenches.
    x_titles, outputs
        (m,) names of the coordinates and of the components.
    is_curve
        Whether the model has one wrench at each place: then it is a line.
    """
    rows = drawn_rows(measured - modelled)
    order = rows[np.argsort(over[rows, 0], kind="stable")] if is_curve else rows
    layout = _panels(x_titles, outputs, height=260 * -(-len(outputs) // 3) + 120)
    layout["legend"] |= {"y": 1.06}
    looks: list[dict[str, Any]] = [
        {"mode": "markers", "marker": {"size": 6 - k, "symbol": symbol, "color": COLOURS[k]}}
        for k, symbol in enumerate(("circle-open", "cross-thin-open"))
    ]
    if is_curve:
        looks[1] = {"mode": "lines", "line": {"color": COLOURS[1]}}
    data = []
    given = (("measured", measured, rows), ("modelled", modelled, order))
    for (name, values, places), drawn in zip(given, looks, strict=True):
        points = list(zip(over[places].T, values[places].T, strict=True))
        template = "row %{customdata}<br>%{x:.4g}: %{y:.4g}<extra>" + name + "</extra>"
        numbers = (places + 1).tolist()
        data += panel_traces(points, numbers, name=name, hovertemplate=template, **drawn)
    return {"data": data, "layout": layout}


def histogram(
    series: Mapping[str, Any], *, x_title: str, y_title: str, log: bool = False, bins: int = 40
) -> dict[str, Any]:
    """Draw one histogram of each of the values over their range."""
    data = []
    for k, (name, given) in enumerate(series.items()):
        values = np.asarray(given, dtype=np.float64)
        counts, edges = np.histogram(np.log10(values) if log else values, bins=bins)
        centres, ends = 0.5 * (edges[1:] + edges[:-1]), edges
        if log:
            centres, ends = 10.0**centres, 10.0**edges
        data.append(_bar(centres, counts, k, width=np.diff(ends).tolist(), name=name))
    layout = plain_layout(x_title, y_title, height=320, showlegend=len(series) > 1)
    if log:
        layout["xaxis"] |= {"type": "log", "exponentformat": "power"}
    return {"data": data, "layout": layout}


def lines(
    series: Mapping[str, tuple[Sequence[float] | Sequence[str], Sequence[float]]],
    *,
    x_title: str,
    y_title: str,
    log_x: bool = False,
    log_y: bool = False,
) -> dict[str, Any]:
    """Draw curves with markers from (x, y) by name."""
    data = [
        scatter(
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
        xaxis=_axis(x_title, type="log" if log_x else "-"),  # numbers, or names
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
    diagonal = np.sqrt(np.abs(np.diag(stiffness)))
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.nan_to_num(stiffness / np.outer(diagonal, diagonal))
    text = [[f"{value:.4g}" for value in row] for row in stiffness]
    figure = text_map(relative, text, limit=1.6)
    figure["layout"]["title"] = {"text": title, "font": {"size": 14}}
    return figure


def pose_cloud(poses: F) -> dict[str, Any]:
    """Draw poses (N, 6) in three views: positions in mm and rotation vectors in rad."""
    names = ("x [mm]", "y [mm]", "z [mm]", "θx [rad]", "θy [rad]", "θz [rad]")
    rows = drawn_rows(poses)
    columns = dict(zip(names, (poses[rows] * ([1e3] * 3 + [1.0] * 3)).T, strict=True))
    marker = {"size": 3, "color": COLOURS[0], "opacity": 0.6}
    pairs = [(names[a], names[b]) for a, b in ((0, 1), (1, 2), (4, 5))]
    return views(columns, pairs, rows.tolist(), marker=marker)


def views(
    columns: Mapping[str, F], pairs: Iterable[tuple[str, str]], rows: Sequence[int], **settings: Any
) -> dict[str, Any]:
    """Draw columns (n,) against each other, a pair a panel; those that lack one are left out."""
    shown = [(a, b) for a, b in pairs if a in columns and b in columns]
    data = panel_traces([(columns[a], columns[b]) for a, b in shown], rows, **settings)
    layout = _panels([a for a, _ in shown], [b for _, b in shown], height=350)
    return {"data": data, "layout": layout}


def residuals_over(x: F, series: Mapping[str, F], *, x_title: str) -> dict[str, Any]:
    """Draw whitened residuals (N, 6) over a covariate (N,), one panel per component."""
    labels = [label.split(" [")[0] for label in COMPONENT_LABELS]
    rows = drawn_rows(next(iter(series.values())))
    layout = _labelled(labels, x_title, "residual / noise", height=540)
    layout["legend"] |= {"y": 1.06}
    data: list[dict[str, Any]] = []
    for k, (name, values) in enumerate(series.items()):
        symbol = ("circle-open", "cross-thin-open")[k % 2]
        data += panel_traces(
            [(x[rows], column) for column in values[rows].T],
            rows.tolist(),
            name=name,
            marker={"size": 5 - k % 2, "symbol": symbol, "color": COLOURS[(1, 0)[k % 2]]},
            hovertemplate="row %{customdata}: %{y:.2f}<extra>" + name + "</extra>",
        )
    return {"data": data, "layout": layout}


def component_layout(
    outputs: Sequence[str], legend: str | None, *, x_title: str = ""
) -> dict[str, Any]:
    """Return the layout of one panel per component; `panel_axes` gives the axes of a trace."""
    layout = _labelled(
        outputs,
        x_title,
        "",
        height=210 * -(-len(outputs) // 3) + 180,
        showlegend=legend is not None,
        margin={"l": 64, "r": 16, "t": 96, "b": 76},
    )
    layout["legend"] |= {"x": 1.0, "xanchor": "right", "y": 1.16}
    return layout


def text_map(values: F, text: Sequence[Sequence[str]], *, limit: float) -> dict[str, Any]:
    """Draw a stiffness (6, 6) as text, coloured by the sign and size of values up to the limit."""
    heatmap = {
        "type": "heatmap",
        "z": values.tolist(),
        "x": ["x", "y", "z", "θx", "θy", "θz"],
        "y": ["fx", "fy", "fz", "τx", "τy", "τz"],
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


_PLACES = 9


def view_of(meta: Meta, body: Mechanism | None = None) -> dict[str, Any]:
    """Return outline and frames of a mechanism.

    Parameters
    ----------
    meta
        What is known of the table.
    body
        The elastic body, where the description has none.

    Returns
    -------
    dict
        `length_m`: distance of the two frames at rest; `outline_m`: radius at places evenly from
        the base to the top, None where no body is described; `frames`: name, origin in m and axes
        as rows.

    Examples
    --------
    >>> view = view_of(Meta(), Mechanism())
    >>> view["length_m"], [round(radius, 3) for radius in view["outline_m"]][:3]
    (0.1034, [0.033, 0.033, 0.033])
    """
    body = meta.body() or body
    length_m = meta.length_m or (None if body is None else body.length_m)
    places = [("base", 0.0)] + ([] if length_m is None else [("top", length_m)])
    frames = [
        {"name": name, "origin_m": [x, 0.0, 0.0], "axes": np.eye(3).tolist()} for name, x in places
    ]
    return {"length_m": length_m, "outline_m": _outline(body, length_m), "frames": frames}


def mechanism_blocks(
    table: Table,
    caption: str,
    *,
    rows: I,
    values: F,
    title: str,
    unit: str,
    body: Mechanism | None = None,
    link: str = "",
) -> list[MechanismBlock]:
    """Return the mechanism bent into its poses; no block where the rows have no place in space.

    Parameters
    ----------
    table
        N rows.
    caption
        What the picture shows.
    rows
        (n,) rows that are drawn, from 0; of many those of `drawn_rows`.
    values
        (n,) that colour them.
    title, unit
        What the values are.
    body
        The body where the description has none.
    link
        A row that is marked here is marked in all figures and tables of the same link.
    """
    if not table.has(*POSE[:3]):
        return []
    chosen = drawn_rows(values[:, None])
    caption += drawn_sentence(values[:, None])
    rows, values = rows[chosen], values[chosen]
    columns = {
        name: short(table.column(name)[rows]) for name in (*POSE, *WRENCH[:3]) if table.has(name)
    }
    view = view_of(table.meta, body)
    view |= {"row": (rows + 1).tolist(), "columns": columns, "values": short(values)}
    view |= {"title": title, "unit": unit, "name": caption, "link": link}
    return [MechanismBlock(caption, view)]


def _outline(body: Mechanism | None, length_m: float | None) -> list[float] | None:
    if body is None or not body.has_body or length_m is None:
        return None
    x, y, z = np.asarray(body.mesh().nodes_m).T
    place = np.clip(np.round((_PLACES - 1) * x / length_m), 0, _PLACES - 1).astype(int)
    radius = np.zeros(_PLACES)
    np.maximum.at(radius, place, np.hypot(y, z))
    known = np.flatnonzero(radius)
    return short(np.interp(np.arange(_PLACES), known, radius[known]))


def short(values: F) -> list[float]:
    """Return numbers of five digits: a figure shows no more."""
    return [float(f"{value:.5g}") for value in np.asarray(values, dtype=float)]
