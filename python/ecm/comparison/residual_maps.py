"""Residual maps: residuals of the measured poses against every variable they may follow.

They are drawn with a panel for each component, whose rows are linked between figures and table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm.comparison.residuals import dependence_shares, dependence_variables, second_degree
from ecm.comparison.structure import signature_shares
from ecm.errors import InputError
from ecm.io.arrays import B, F, I
from ecm.io.columns import POSE
from ecm.models.errors import Residuals
from ecm.regression.folds import spread_rows
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows, is_whole
from ecm.report import figures as draw
from ecm.report.blocks import Block, FigureBlock, Section, TableBlock, TextBlock, number
from ecm.report.figures import MOST_DRAWN, some_rows

WORST = 10
"""Worst rows of a table that reports list."""
_WORTH_SAYING = 0.05
LINK = "measured rows"
"""Points of all figures with this mark and the same row are marked together."""
_DRAWN = 2
"""Variables that the residual is drawn against; the menus give the others."""
_FRAMES = {"base": "base axes", "top": "top axes"}


@dataclass(frozen=True)
class ResidualMaps:
    """Residuals, measured minus predicted: N measured poses in file order, m components.

    Of a large table these are the rows that were chosen, and the worst ones of all.

    Examples
    --------
    >>> import numpy as np
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 20)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x + 1e10 * x**3})
    >>> maps = ecm.compare(ecm.fit_model(table, "linear"), table).where()
    >>> sorted(maps.residual_map("x_m"))
    ['fx_N', 'row', 'x_m']
    """

    outputs: tuple[str, ...]
    row: I
    """(N,) rows of the table, from 1."""
    variables: Mapping[str, F]
    """(N,) by name with unit: pose, bend, azimuth, |h|, time, order, covariates, approach side."""
    physical: Mapping[str, F]
    """`base`, and with a full pose and wrench `top`: (N, m) in the units of the outputs."""
    spread: Mapping[str, F]
    """Standard deviation of each component's noise in that row, in the same frames."""
    size: F
    """(N,) root mean square of the row's residual, whitened by its full covariance."""
    shares: Mapping[str, float]
    """Share of the residual's squares beyond chance, by signature."""
    follows: tuple[tuple[str, str, float], ...]
    """Variable, component and the share of that component's squares, strongest first."""
    stiffness: F | None
    """(6, 6) residual stiffness dK at the rest pose, from the residual's slope; N and N m per m
    and rad."""
    stiffness_sd: F | None
    leverage: F | None
    """(N,) leverage of the model, in units of one row's noise."""
    top_from_base: F | None
    """(N, 6, 6) turns a wrench to top axes, where pose and wrench are full."""
    drawn: I
    """(d,) places of the rows that figures draw: all of a small table, else some and the worst."""
    total: int
    """Measured poses of the table."""
    noise_is_assumed: bool
    """Whether nobody measured or declared the noise: then no more than ratios count."""

    @property
    def noise_word(self) -> str:
        """What residuals are divided by, in words."""
        return "an assumed noise" if self.noise_is_assumed else "its noise"

    @property
    def over_noise(self) -> dict[str, F]:
        """`physical` over `spread`; whitening would mix components."""
        return {frame: values / self.spread[frame] for frame, values in self.physical.items()}

    def worst(self, count: int = WORST) -> list[dict[str, Any]]:
        """Return the rows with the largest whitened residual."""
        rows = []
        over_noise = self.over_noise["base"]
        for i in np.argsort(-self.size, kind="stable")[:count]:
            j = int(np.argmax(np.abs(over_noise[i])))
            item = {
                "row": int(self.row[i]),
                "whitened": float(self.size[i]),
                "component": self.outputs[j],
                "residual": float(self.physical["base"][i, j]),
            }
            if self.leverage is not None:
                item["leverage"] = float(self.leverage[i])
            rows.append(item)
        return rows

    @property
    def drawn_sentence(self) -> str:
        """How many rows of the table the figures draw, where not all."""
        how = "spread over runs, time and poses, with the worst ones"
        return some_rows(len(self.drawn), self.total, how)

    def sentence(self) -> str:
        """Return in words what the residual follows most."""
        named: dict[str, str] = {}
        for variable, output, share in self.follows:
            if share >= _WORTH_SAYING:
                named.setdefault(variable, f"{variable} ({share:.0%} of {output})")
        parts = list(named.values())[:3]
        text = f"The residual follows {', '.join(parts)}." if parts else ""
        signed = [item for item in self.shares.items() if item[1] >= _WORTH_SAYING]
        if signed:
            name, share = max(signed, key=lambda item: item[1])
            text += f" Of the signatures, {name} explains most: {share:.0%}."
        return text.strip() or "The residual follows no single variable."

    def strongest(self, count: int = 2) -> list[str]:
        """Return the variables that the residual follows most, then the others in their order."""
        ranked = dict.fromkeys(variable for variable, _, _ in self.follows)
        return list(ranked | dict.fromkeys(self.variables))[:count]

    def residual_map(
        self,
        variable: str | None = None,
        *,
        frame: str = "base",
        over_noise: bool = True,
        predicted: F | None = None,
    ) -> dict[str, F]:
        """Return every component against a variable; `Comparison.plot` draws them.

        Parameters
        ----------
        variable
            Name in `variables`; default: the one that the residual follows most.
        frame
            Axes of the components: base or top.
        over_noise
            Divide by the noise; else in the units of the outputs.
        predicted
            (N, m) prediction of a candidate effect, in the units of the outputs and base axes; its
            columns are named `predicted fx_N` and so on.

        Returns
        -------
        dict
            `row`, the variable, and each component (N,).

        Raises
        ------
        InputError
            If there is no such variable or frame.
        """
        variable = self.strongest()[0] if variable is None else variable
        for given, known in ((variable, self.variables), (frame, self.physical)):
            if given not in known:
                raise InputError(f"no {given!r} in the map; there are {', '.join(known)}")
        shown = (self.over_noise if over_noise else self.physical)[frame]
        columns = {"row": self.row.astype(np.float64), variable: self.variables[variable]}
        columns |= dict(zip(self.outputs, shown.T, strict=True))
        if predicted is not None:
            if frame == "top" and self.top_from_base is not None:
                predicted = np.einsum("nij,nj->ni", self.top_from_base, predicted)
            values = predicted / self.spread[frame] if over_noise else predicted
            columns |= {f"predicted {n}": v for n, v in zip(self.outputs, values.T, strict=True)}
        return columns

    def workspace_map(self) -> dict[str, F]:
        """Return `row`, the pose columns (N,), and `over_noise`: the size of the residual."""
        pose = {name: values for name, values in self.variables.items() if name in POSE}
        return {"row": self.row.astype(np.float64), **pose, "over_noise": self.size}

    def signature_map(self) -> dict[str, float]:
        """Return the signature shares, the largest first."""
        return dict(sorted(self.shares.items(), key=lambda item: -item[1]))

    def stiffness_map(self) -> dict[str, F] | None:
        """Return `value` and `sd` (6, 6) of the residual stiffness; None with too few rows."""
        if self.stiffness is None or self.stiffness_sd is None:
            return None
        return {"value": self.stiffness, "sd": self.stiffness_sd}

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON."""
        return {
            "sentence": self.sentence(),
            "worst_rows": self.worst(),
            "signature": dict(self.shares),
            "follows": [
                {"variable": variable, "component": output, "share": share}
                for variable, output, share in self.follows[:10]
            ],
            "stiffness": None if self.stiffness is None else self.stiffness.tolist(),
            "stiffness_sd": None if self.stiffness_sd is None else self.stiffness_sd.tolist(),
        }


def residual_maps_of(
    rows: Rows, errors: Residuals, counted: B, leverage: F | None, noise: Noise
) -> ResidualMaps:
    """Return the maps of the rows that measure a pose.

    Parameters
    ----------
    counted
        (N,) rows on which shares and stiffness rest.
    leverage
        (n,) of the model at the poses that are measured; None where it is not known.
    noise
        Noise of the rows.
    """
    scored = rows.table.of_poses
    own = counted[scored]
    part = Rows(rows.table.subsample(np.flatnonzero(counted)), rows.base)
    left, whitener = errors.whitened[counted], errors.whitener[counted]
    outputs = rows.base.outputs
    variables = {name: values[scored] for name, values in dependence_variables(rows).items()}
    # A single row can still be drawn against its number.
    variables = {name: v for name, v in variables.items() if name == "row" or np.ptp(v) > 0.0}
    physical = {"base": errors.physical[scored]}
    spread = {"base": np.sqrt(np.einsum("nii->ni", errors.covariance[scored]))}
    full = is_whole(rows.base)
    stiffness = sd = turn = None
    shares: dict[str, float] = {}
    if full:
        turn = np.ascontiguousarray(np.swapaxes(rows.base_from_top[scored], 1, 2))
        physical["top"] = np.einsum("nij,nj->ni", turn, physical["base"])
        covariance = turn @ errors.covariance[scored] @ np.swapaxes(turn, 1, 2)
        spread["top"] = np.sqrt(np.einsum("nii->ni", covariance))
        shares = signature_shares(part, left, whitener)
        stiffness, sd = residual_stiffness(part, left, whitener)
    size = np.asarray(np.sqrt((errors.whitened[scored] ** 2).mean(axis=1)))
    worst = np.argsort(-size, kind="stable")[:WORST]
    return ResidualMaps(
        outputs=outputs,
        row=rows.table.row_numbers[scored] + 1,
        variables=variables,
        physical=physical,
        spread=spread,
        size=size,
        shares=shares,
        follows=dependence_shares(
            {name: values[own] for name, values in variables.items()},
            (physical["base"] / spread["base"])[own],
            outputs,
        ),
        stiffness=stiffness,
        stiffness_sd=sd,
        leverage=leverage,
        top_from_base=turn,
        drawn=np.union1d(spread_rows(rows.table.select(scored), MOST_DRAWN), worst),
        total=int(rows.table.full.of_poses.sum()),
        noise_is_assumed=noise.is_assumed,
    )


def residual_stiffness(rows: Rows, whitened: F, whitener: F) -> tuple[F, F] | tuple[None, None]:
    """Return the slope (6, 6) and its standard deviations, in N and N m per m and rad.

    Fitted beside a constant and, with enough rows, squares and products. None where the poses are
    too few, or do not span all six coordinates.
    """
    scored = rows.table.of_poses
    deflection = (rows.poses - rows.middle_pose)[scored]
    n = len(deflection)
    scale = np.maximum(np.abs(deflection).max(axis=0), 1e-12)
    unit = deflection / scale
    columns = [np.ones((n, 1)), unit]
    if n >= 84:
        columns.append(second_degree(unit))
    basis = np.concatenate(columns, axis=1)
    if n < 2 * basis.shape[1] or np.linalg.matrix_rank(basis) < basis.shape[1]:
        return None, None
    q = basis.shape[1]
    design = np.einsum("nij,nq->niqj", whitener[scored], basis).reshape(6 * n, 6 * q)
    covariance = np.linalg.inv(design.T @ design)
    y = whitened[scored].ravel()
    solution = covariance @ (design.T @ y)
    # What the slope does not explain is not noise alone: scale the errors by it.
    left = float(((y - design @ solution) ** 2).sum()) / (6 * n - 6 * q)
    sd = np.sqrt(np.diag(covariance) * max(1.0, left))
    slope = solution.reshape(q, 6)[1:7].T / scale
    return np.asarray(slope), np.asarray(sd.reshape(q, 6)[1:7].T / scale)


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
