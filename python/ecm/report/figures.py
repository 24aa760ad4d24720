"""Figures in plotly's dict form: readable without colour (markers, dashes, patterns differ)."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ecm.io.arrays import F

INK = "#1c2430"
# Wong's palette, distinct for colour-blind readers; order by darkness for print.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000")
DASHES = ("solid", "dash", "dot", "dashdot", "longdash")
MARKERS = ("circle", "square", "diamond", "cross", "triangle-up")
PATTERNS = ("", "/", "x", ".", "-")
COMPONENT_LABELS = ("fx [N]", "fy [N]", "fz [N]", "τx [N m]", "τy [N m]", "τz [N m]")


def plain(text: str) -> str:
    """A name from a data file as a label: plotly draws tags and links that stand in its texts."""
    return html.escape(text, quote=False)


def _layout(**own: Any) -> dict[str, Any]:
    layout: dict[str, Any] = {
        "font": {"family": "system-ui, DejaVu Sans, Arial, sans-serif", "size": 13, "color": INK},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "margin": {"l": 64, "r": 16, "t": 60, "b": 48},
        "height": 420,
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0},
    }
    layout.update(own)
    return layout


def _axis(title: str = "", **own: Any) -> dict[str, Any]:
    axis: dict[str, Any] = {
        "title": {"text": title, "standoff": 6},
        "gridcolor": "#e4e8ed",
        "linecolor": "#8a94a2",
        "ticks": "outside",
        "zeroline": False,
        "showline": True,
    }
    axis.update(own)
    return axis


def _grid(n: int, columns: int = 3) -> list[tuple[str, dict[str, Any], dict[str, Any], str]]:
    """Axis suffix and domains of n panels: (suffix, x domain, y domain)."""
    rows = -(-n // columns)
    gap_x, gap_y = 0.075, 0.26 / rows
    width = (1.0 - gap_x * (columns - 1)) / columns
    height = (1.0 - gap_y * (rows - 1)) / rows
    panels = []
    for i in range(n):
        column, row = i % columns, i // columns
        x0 = column * (width + gap_x)
        y0 = 1.0 - row * (height + gap_y) - height
        suffix = "" if i == 0 else str(i + 1)
        panels.append(
            (
                suffix,
                {"domain": [x0, x0 + width], "anchor": f"y{suffix}"},
                {"domain": [y0, y0 + height], "anchor": f"x{suffix}"},
                f"x{suffix}",
            )
        )
    return panels


def histograms(
    series: dict[str, F],
    labels: Sequence[str],
    *,
    limit: float,
    x_title: str,
    y_title: str = "pairs",
    bins: int = 40,
) -> dict[str, Any]:
    """One panel per column; each series is (N, len(labels)); values beyond the limit left out."""
    edges = np.linspace(-limit, limit, bins + 1)
    centres = 0.5 * (edges[1:] + edges[:-1])
    data: list[dict[str, Any]] = []
    columns = 3 if len(labels) > 2 else len(labels)
    rows = -(-len(labels) // columns)
    layout = _layout(height=200 * rows + 130, barmode="overlay", bargap=0.05)
    layout["legend"] |= {"y": 1.06}
    layout["annotations"] = []
    for i, (suffix, x, y, _) in enumerate(_grid(len(labels), columns)):
        for k, (name, values) in enumerate(series.items()):
            counts, _edges = np.histogram(values[:, i], bins=edges)
            data.append(
                {
                    "type": "bar",
                    "x": centres.tolist(),
                    "y": counts.tolist(),
                    "name": name,
                    "legendgroup": name,
                    "showlegend": i == 0 and len(series) > 1,
                    "xaxis": f"x{suffix}",
                    "yaxis": f"y{suffix}",
                    "opacity": 0.65,
                    "marker": {"color": COLOURS[k], "pattern": {"shape": PATTERNS[k]}},
                }
            )
        layout[f"xaxis{suffix}"] = _axis(x_title if i >= len(labels) - columns else "", **x)
        layout[f"yaxis{suffix}"] = _axis(y_title if i % columns == 0 else "", **y)
        layout["annotations"].append(_panel_title(labels[i], x, y))
    return {"data": data, "layout": layout}


def actual_predicted(observed: F, predicted: F, labels: Sequence[str]) -> dict[str, Any]:
    """One panel per component, with the dashed line of an exact prediction (Fig. 9)."""
    data: list[dict[str, Any]] = []
    layout = _layout(height=560, showlegend=False)
    layout["annotations"] = []
    for i, (suffix, x, y, _) in enumerate(_grid(len(labels))):
        axes = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
        ends = [
            float(min(observed[:, i].min(), predicted[:, i].min())),
            float(max(observed[:, i].max(), predicted[:, i].max())),
        ]
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": ends,
                "y": ends,
                "line": {"color": INK, "dash": "dash", "width": 1},
                "hoverinfo": "skip",
                **axes,
            }
        )
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": observed[:, i].tolist(),
                "y": predicted[:, i].tolist(),
                "marker": {"size": 4, "color": COLOURS[0]},
                "customdata": list(range(len(observed))),
                "hovertemplate": "row %{customdata}<br>measured %{x:.3g}<br>predicted %{y:.3g}"
                "<extra></extra>",
                **axes,
            }
        )
        layout[f"xaxis{suffix}"] = _axis("measured" if i >= len(labels) - 3 else "", **x)
        layout[f"yaxis{suffix}"] = _axis("predicted" if i % 3 == 0 else "", **y)
        layout["annotations"].append(_panel_title(labels[i], x, y))
    return {"data": data, "layout": layout}


def _panel_title(text: str, x: dict[str, Any], y: dict[str, Any]) -> dict[str, Any]:
    return {
        "text": f"<b>{text}</b>",
        "showarrow": False,
        "xref": "paper",
        "yref": "paper",
        "x": 0.5 * sum(x["domain"]),
        "y": y["domain"][1],
        "yanchor": "bottom",
    }


def histogram(values: F, *, x_title: str, y_title: str, bins: int = 40) -> dict[str, Any]:
    """One histogram over the whole range of its values."""
    counts, edges = np.histogram(values, bins=bins)
    centres = 0.5 * (edges[1:] + edges[:-1])
    return {
        "data": [
            {
                "type": "bar",
                "x": centres.tolist(),
                "y": counts.tolist(),
                "marker": {"color": COLOURS[0]},
            }
        ],
        "layout": _layout(xaxis=_axis(x_title), yaxis=_axis(y_title), bargap=0.05, height=320),
    }


def times(fem_s: Sequence[float], model_s: Sequence[float]) -> dict[str, Any]:
    """Evaluation times of the FEM and of the model, logarithmic (Fig. 11)."""
    data = []
    for k, (name, values) in enumerate((("FEM", fem_s), ("model", model_s))):
        logs = np.log10(np.asarray(values))
        counts, edges = np.histogram(logs, bins=20)
        centres = 10.0 ** (0.5 * (edges[1:] + edges[:-1]))
        widths = 10.0 ** edges[1:] - 10.0 ** edges[:-1]
        data.append(
            {
                "type": "bar",
                "x": centres.tolist(),
                "y": counts.tolist(),
                "width": widths.tolist(),
                "name": name,
                "marker": {"color": COLOURS[k], "pattern": {"shape": PATTERNS[k]}},
            }
        )
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
    """Curves with markers, told apart by dash and marker as well as colour."""
    data = [
        {
            "type": "scatter",
            "mode": "lines+markers",
            "x": list(x),
            "y": list(y),
            "name": name,
            "line": {"color": COLOURS[k % 5], "dash": DASHES[k % 5]},
            "marker": {"symbol": MARKERS[k % 5], "size": 8},
        }
        for k, (name, (x, y)) in enumerate(series.items())
    ]
    return {
        "data": data,
        "layout": _layout(
            xaxis=_axis(x_title, type="log" if log_x else "linear"),
            yaxis=_axis(y_title, type="log" if log_y else "linear", exponentformat="power"),
        ),
    }


def bars(
    groups: dict[str, Sequence[float]], labels: Sequence[str], *, y_title: str
) -> dict[str, Any]:
    """Grouped bars, told apart by pattern as well as colour."""
    data = [
        {
            "type": "bar",
            "x": list(labels),
            "y": list(values),
            "name": name,
            "marker": {"color": COLOURS[k % 5], "pattern": {"shape": PATTERNS[k % 5]}},
        }
        for k, (name, values) in enumerate(groups.items())
    ]
    return {
        "data": data,
        "layout": _layout(
            xaxis=_axis(automargin=True), yaxis=_axis(y_title), barmode="group", height=360
        ),
    }


def stiffness_map(stiffness: F, title: str) -> dict[str, Any]:
    """A 6 x 6 matrix as numbers on a map of sign and magnitude."""
    names = ["x", "y", "z", "θx", "θy", "θz"]
    rows = ["fx", "fy", "fz", "τx", "τy", "τz"]
    diagonal = np.sqrt(np.abs(np.diag(stiffness)))
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.nan_to_num(stiffness / np.outer(diagonal, diagonal))
    text = [[f"{value:.4g}" for value in row] for row in stiffness]
    figure = text_map(relative, text, names, rows, limit=1.6)
    figure["layout"] |= {
        "title": {"text": title, "font": {"size": 14}},
        "margin": {"l": 48, "r": 16, "t": 70, "b": 16},
    }
    return figure


def pose_cloud(poses: F) -> dict[str, Any]:
    """Positions (mm) and rotation vectors (rad), each in two views."""
    views = (
        ("x [mm]", "y [mm]", 1e3 * poses[:, 0], 1e3 * poses[:, 1]),
        ("y [mm]", "z [mm]", 1e3 * poses[:, 1], 1e3 * poses[:, 2]),
        ("θy [rad]", "θz [rad]", poses[:, 4], poses[:, 5]),
    )
    data: list[dict[str, Any]] = []
    layout = _layout(height=340, showlegend=False)
    for (suffix, x, y, _), (x_title, y_title, a, b) in zip(_grid(3), views, strict=True):
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": np.round(a, 5).tolist(),
                "y": np.round(b, 5).tolist(),
                "marker": {"size": 3, "color": COLOURS[0], "opacity": 0.6},
                "xaxis": f"x{suffix}",
                "yaxis": f"y{suffix}",
            }
        )
        layout[f"xaxis{suffix}"] = _axis(x_title, **x)
        layout[f"yaxis{suffix}"] = _axis(y_title, **y)
    return {"data": data, "layout": layout}


def residuals_over(x: F, series: dict[str, F], *, x_title: str) -> dict[str, Any]:
    """Whitened residuals of six components against a covariate, one panel each."""
    data: list[dict[str, Any]] = []
    layout = _layout(height=540)
    layout["legend"] |= {"y": 1.06}
    layout["annotations"] = []
    for i, (suffix, x_axis, y_axis, _) in enumerate(_grid(6)):
        for k, (name, values) in enumerate(series.items()):
            data.append(
                {
                    "type": "scatter",
                    "mode": "markers",
                    "x": np.round(x, 4).tolist(),
                    "y": np.round(values[:, i], 4).tolist(),
                    "name": name,
                    "legendgroup": name,
                    "showlegend": i == 0,
                    "marker": {
                        "size": 5 if k == 0 else 4,
                        "symbol": ("circle-open", "cross-thin-open")[k % 2],
                        "color": COLOURS[(1, 0)[k % 2]],
                    },
                    "customdata": list(range(len(x))),
                    "hovertemplate": "row %{customdata}: %{y:.2f}<extra>" + name + "</extra>",
                    "xaxis": f"x{suffix}",
                    "yaxis": f"y{suffix}",
                }
            )
        layout[f"xaxis{suffix}"] = _axis(x_title if i >= 3 else "", **x_axis)
        layout[f"yaxis{suffix}"] = _axis("residual / noise" if i % 3 == 0 else "", **y_axis)
        layout["annotations"].append(
            _panel_title(COMPONENT_LABELS[i].split(" [")[0], x_axis, y_axis)
        )
    return {"data": data, "layout": layout}


def component_layout(outputs: Sequence[str], legend: str | None) -> dict[str, Any]:
    """Layout of one panel per component; `component_axes` says which axes a trace uses."""
    columns = min(3, len(outputs))
    rows = -(-len(outputs) // columns)
    layout = _layout(
        height=210 * rows + 180,
        showlegend=legend is not None,
        margin={"l": 64, "r": 16, "t": 96, "b": 76},
    )
    layout["legend"] |= {"x": 1.0, "xanchor": "right", "y": 1.16}
    layout["annotations"] = []
    for name, (suffix, x_axis, y_axis, _) in zip(
        outputs, _grid(len(outputs), columns), strict=True
    ):
        layout[f"xaxis{suffix}"] = _axis("", **x_axis)
        layout[f"yaxis{suffix}"] = _axis("", **y_axis)
        layout["annotations"].append(_panel_title(name, x_axis, y_axis))
    return layout


def component_axes(component: int) -> dict[str, str]:
    """The axes of that component's panel."""
    suffix = "" if component == 0 else str(component + 1)
    return {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}


def linked_views(
    views: Sequence[tuple[str, Sequence[float], str, Sequence[float]]],
    *,
    size: F,
    rows: Sequence[int],
    text: Sequence[str],
    link: str,
) -> dict[str, Any]:
    """Scatter plots of the same rows side by side, linked by row."""
    layout = _layout(height=360, showlegend=False)
    data = []
    for i, ((x_title, x, y_title, y), (suffix, x_axis, y_axis, _)) in enumerate(
        zip(views, _grid(len(views)), strict=True)
    ):
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": list(x),
                "y": list(y),
                "text": list(text),
                "marker": {
                    "size": size.tolist(),
                    "symbol": "circle-open",
                    "color": COLOURS[0],
                },
                "selected": {"marker": {"color": COLOURS[1], "size": 20}},
                "unselected": {"marker": {"opacity": 0.35}},
                "meta": link,
                "customdata": list(rows),
                "hovertemplate": "row %{customdata}: %{text}<extra></extra>",
                **component_axes(i),
            }
        )
        layout[f"xaxis{suffix}"] = _axis(x_title, **x_axis)
        layout[f"yaxis{suffix}"] = _axis(y_title, **y_axis)
    return {"data": data, "layout": layout}


def text_map(
    values: F,
    text: Sequence[Sequence[str]],
    columns: Sequence[str],
    rows: Sequence[str],
    *,
    limit: float,
) -> dict[str, Any]:
    """A matrix as text on a map of sign and size."""
    return {
        "data": [
            {
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
        ],
        "layout": _layout(
            xaxis=_axis("", side="top"),
            yaxis=_axis("", autorange="reversed"),
            height=380,
            margin={"l": 48, "r": 16, "t": 70, "b": 16},
        ),
    }
