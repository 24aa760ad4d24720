"""Residual maps: every component against one variable, rows linked between figures and table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ecm.comparison.residual_maps import ResidualMaps
from ecm.io.arrays import F
from ecm.report import figures as draw
from ecm.report.blocks import Block, FigureBlock, Section, TableBlock, TextBlock, number

LINK = "measured rows"
"""Points of all figures with this mark and the same row are marked together."""
_DRAWN = 2
"""Variables that the residual is drawn against; the menus give the others."""
_FRAMES = {"base": "base axes", "top": "top axes"}


def residual_figure(
    maps: ResidualMaps,
    variable: str | None = None,
    *,
    frame: str = "base",
    over_noise: bool = True,
    predicted: F | None = None,
) -> dict[str, Any]:
    """Return one panel per component against a variable; menus change variable, frame and unit.

    Parameters are those of `ResidualMaps.residual_map`.

    Returns
    -------
    dict
        A plotly figure as plain values.
    """
    variable = maps.strongest()[0] if variable is None else variable
    columns = maps.residual_map(variable, frame=frame, over_noise=over_noise, predicted=predicted)
    columns = {name: values[maps.drawn] for name, values in columns.items()}
    rows = maps.row[maps.drawn].tolist()
    data = draw.panel_traces(
        [(columns[variable], columns[name]) for name in maps.outputs],
        rows,
        link=LINK,
        marker={"size": 5, "symbol": "circle-open", "color": draw.COLOURS[0]},
        hovertemplate="row %{customdata}: %{y:.3g} at %{x:.4g}<extra></extra>",
    )
    if predicted is not None:
        data += draw.panel_traces(
            [(columns[variable], columns[f"predicted {name}"]) for name in maps.outputs],
            rows,
            name="what the effect predicts",
            marker={"size": 6, "symbol": "cross-thin-open", "color": draw.COLOURS[1]},
            hovertemplate="row %{customdata}: predicted %{y:.3g}<extra></extra>",
        )
    layout = draw.component_layout(maps.outputs, None if predicted is None else "")
    layout["annotations"].append(_x_title(variable))
    last = len(layout["annotations"]) - 1
    buttons = []
    for name, own in maps.variables.items():
        title = {f"annotations[{last}].text": _x_title(name)["text"]}
        args = [{"x": [draw.short(own[maps.drawn])]}, title]
        buttons.append({"label": draw.plain(name), "method": "update", "args": args})
    menus = [_menu(0.0, buttons, list(maps.variables).index(variable))]
    if predicted is None:
        over = f"over {maps.noise_word}"
        kinds = [(key, unit) for key in maps.physical for unit in (over, "in its unit")]
        buttons = []
        for key, unit in kinds:
            values = (maps.over_noise if unit == over else maps.physical)[key]
            arrays = [draw.short(values[maps.drawn, j]) for j in range(values.shape[1])]
            label = f"{_FRAMES[key]}, {unit}"
            buttons.append({"label": label, "method": "restyle", "args": [{"y": arrays}]})
        active = kinds.index((frame, over if over_noise else "in its unit"))
        menus.append(_menu(0.45, buttons, active))
    layout["updatemenus"] = menus
    return {"data": data, "layout": layout}


def residual_section(maps: ResidualMaps, variables: Sequence[str] = ()) -> Section:
    """Return the section of maps, signature, residual stiffness and the worst rows.

    Parameters
    ----------
    variables
        Variables to draw the residual against; default: those that it follows most.
    """
    given = [name for name in variables if name in maps.variables]
    first, *second = (given or maps.strongest())[:_DRAWN]
    turned = {"theta_y_rad", "theta_z_rad"} <= set(maps.variables)
    figures = (
        (
            "Residual, measured minus predicted, of each component. The menus choose the variable, "
            f"the axes and the unit.{maps.drawn_sentence} Click a point, or a row of the table, to "
            "mark that row everywhere; again to clear.",
            residual_figure(maps, first),
        ),
        *(("The same against another variable.", residual_figure(maps, name)) for name in second),
        (
            "Where in the workspace: the larger the marker, the larger the row's residual over "
            f"{maps.noise_word}.",
            workspace_figure(maps) if turned else None,
        ),
        (
            "Share of the residual, beyond chance, that each signature explains alone; shares "
            "overlap.",
            signature_figure(maps) if maps.shares else None,
        ),
        (
            "Stiffness ΔK at rest that the model lacks, ± its standard deviation, in N and N m per "
            "m and rad; bold and coloured where it is more than three of them.",
            stiffness_figure(maps),
        ),
    )
    worst = maps.worst()
    named = {"whitened": f"residual / {'assumed ' * maps.noise_is_assumed}noise"}
    header, rows = [named.get(key, key) for key in worst[0]], [[*item.values()] for item in worst]
    blocks: list[Block] = [
        TextBlock(maps.sentence(), strong=True),
        *(FigureBlock(caption, figure) for caption, figure in figures if figure is not None),
        TableBlock("The worst rows of the table.", header, rows, link=LINK),
    ]
    return Section("Where", blocks)


def workspace_figure(maps: ResidualMaps) -> dict[str, Any]:
    """Return views of the workspace, with markers as large as the residuals over the noise."""
    known = {name: values[maps.drawn] for name, values in maps.workspace_map().items()}
    size = known["over_noise"]
    return draw.views(
        known,
        (("theta_y_rad", "theta_z_rad"), ("y_m", "z_m"), ("x_m", "theta_x_rad")),
        maps.row[maps.drawn].tolist(),
        link=LINK,
        text=[f"{value:.2f} times {maps.noise_word}" for value in size],
        marker={
            "size": np.clip(4.0 + 3.0 * (size - 1.0), 3.0, 18.0).tolist(),
            "symbol": "circle-open",
            "color": draw.COLOURS[0],
        },
        hovertemplate="row %{customdata}: %{text}<extra></extra>",
    )


def signature_figure(maps: ResidualMaps) -> dict[str, Any]:
    """Return one bar per signature, the largest first."""
    shares = maps.signature_map()
    return draw.bars({"share": list(shares.values())}, list(shares), y_title="share")


def stiffness_figure(maps: ResidualMaps) -> dict[str, Any] | None:
    """Return the residual stiffness in numbers, coloured beyond three standard deviations."""
    known = maps.stiffness_map()
    if known is None:
        return None
    ratio = known["value"] / known["sd"]
    seen = np.abs(ratio) > 3.0
    text = [[""] * 6 for _ in range(6)]
    for i, j in np.ndindex(6, 6):
        cell = f"{number(known['value'][i, j], 2)} ± {number(known['sd'][i, j], 2)}"
        text[i][j] = f"<b>{cell}</b>" if seen[i, j] else cell
    shown = np.where(seen, np.clip(ratio, -20.0, 20.0), 0.0)
    return draw.text_map(shown, text, limit=20.0)


def _menu(x: float, buttons: list[dict[str, Any]], active: int) -> dict[str, Any]:
    return {
        "buttons": buttons,
        "active": active,
        "x": x,
        "xanchor": "left",
        "y": 1.16,
        "yanchor": "bottom",
        "bgcolor": "#f4f6f9",  # in both themes: plotly fixes the colour of the chosen entry
        "font": {"color": "#17202b"},
        "direction": "down",
        "showactive": True,
    }


def _x_title(name: str) -> dict[str, Any]:
    return {
        "text": f"against {draw.plain(name)}",
        "showarrow": False,
        "xref": "paper",
        "yref": "paper",
        "x": 0.5,
        "y": -0.12,
        "yanchor": "top",
    }
