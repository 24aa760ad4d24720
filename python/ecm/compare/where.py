"""Where a model fails: residuals of the measured poses against everything they could follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.columns import POSE, WRENCH
from ecm.compare.lack_of_fit import orthonormal
from ecm.compare.residuals import Residuals
from ecm.compare.signature import signature_shares
from ecm.effects.history import sides
from ecm.effects.rows import Rows

F = NDArray[np.float64]
I = NDArray[np.int64]
B = NDArray[np.bool_]

_DEGREE = 3
"""Of the curve in one variable that a share is read from."""
_WORTH_SAYING = 0.05


@dataclass(frozen=True)
class Where:
    """Residuals, measured minus predicted, of the measured poses in file order."""

    outputs: tuple[str, ...]
    row: I
    """(N,) rows in the table, from 1."""
    variables: Mapping[str, F]
    """Name with unit to (N,): pose, bend, azimuth, |h|, time, order, covariates, approach side."""
    physical: Mapping[str, F]
    """`base`, and with a full pose and wrench `top`: (N, m) in the units of the outputs."""
    spread: Mapping[str, F]
    """Standard deviation of each component's noise in that row, in the same frames."""
    size: F
    """(N,) root mean square of the row's residual, whitened by its full covariance."""
    shares: Mapping[str, float]
    """Of the residual's squares beyond chance, by signature (effects.md)."""
    follows: tuple[tuple[str, str, float], ...]
    """Variable, component and the share of that component's squares, strongest first."""
    stiffness: F | None
    """(6, 6) residual stiffness dK at the rest pose, from the residual's slope; N and N m per m
    and rad."""
    stiffness_sd: F | None
    leverage: F | None
    """(N,) of the model there, in units of one row's noise."""

    @property
    def over_noise(self) -> dict[str, F]:
        """`physical` over `spread`: the full whitener would mix components."""
        return {frame: values / self.spread[frame] for frame, values in self.physical.items()}

    def worst(self, count: int = 10) -> list[dict[str, Any]]:
        """The rows with the largest whitened residual."""
        found = []
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
            found.append(item)
        return found

    def sentence(self) -> str:
        """What the residual follows most, in words."""
        told: dict[str, str] = {}
        for variable, output, share in self.follows:
            if share >= _WORTH_SAYING:
                told.setdefault(variable, f"{variable} ({share:.0%} of {output})")
        parts = list(told.values())[:3]
        text = f"The residual follows {', '.join(parts)}." if parts else ""
        signed = [item for item in self.shares.items() if item[1] >= _WORTH_SAYING]
        if signed:
            name, share = max(signed, key=lambda item: item[1])
            text += f" Of the signatures, {name} explains most: {share:.0%}."
        return text.strip() or "The residual follows no single variable."

    def figure(
        self,
        variable: str | None = None,
        *,
        frame: str = "base",
        over_noise: bool = True,
        predicted: F | None = None,
    ) -> dict[str, Any]:
        """Plotly figure (dict) of every component against a variable.

        Parameters
        ----------
        variable
            A name of `variables`; default the one that the residual follows most.
        predicted
            (N, m) in units of the outputs, base axes: what a candidate effect says.
        """
        from ecm.report.where import residual_map

        return residual_map(self, variable, frame=frame, over_noise=over_noise, predicted=predicted)

    def to_dict(self) -> dict[str, Any]:
        """For --json."""
        worst = self.worst()
        return {
            "sentence": self.sentence(),
            "worst_rows": worst,
            "signature": dict(self.shares),
            "follows": [
                {"variable": variable, "component": output, "share": share}
                for variable, output, share in self.follows[:10]
            ],
            "stiffness": None if self.stiffness is None else self.stiffness.tolist(),
            "stiffness_sd": None if self.stiffness_sd is None else self.stiffness_sd.tolist(),
        }


def where(rows: Rows, found: Residuals, scored: B, leverage: F | None) -> Where:
    """Maps of the residuals of the scored rows."""
    outputs = rows.base.outputs
    variables = {name: values[scored] for name, values in _variables(rows).items()}
    # Of a single row nothing varies; against its number it can be drawn.
    variables = {name: v for name, v in variables.items() if name == "row" or np.ptp(v) > 0.0}
    physical = {"base": found.physical[scored]}
    spread = {"base": np.sqrt(np.einsum("nii->ni", found.covariance[scored]))}
    full = rows.base.inputs == POSE and outputs == WRENCH
    stiffness = sd = None
    shares: dict[str, float] = {}
    if full:
        turn = np.swapaxes(rows.base_from_top[scored], 1, 2)
        physical["top"] = np.einsum("nij,nj->ni", turn, physical["base"])
        covariance = turn @ found.covariance[scored] @ np.swapaxes(turn, 1, 2)
        spread["top"] = np.sqrt(np.einsum("nii->ni", covariance))
        shares = signature_shares(rows, found.whitened, found.whitener)
        stiffness, sd = _residual_stiffness(rows, found, scored)
    return Where(
        outputs=outputs,
        row=np.flatnonzero(scored) + 1,
        variables=variables,
        physical=physical,
        spread=spread,
        size=np.asarray(np.sqrt((found.whitened[scored] ** 2).mean(axis=1))),
        shares=shares,
        follows=_follows(variables, physical["base"] / spread["base"], outputs),
        stiffness=stiffness,
        stiffness_sd=sd,
        leverage=leverage,
    )


def _variables(rows: Rows) -> dict[str, F]:
    table = rows.table
    found = {name: rows.poses[:, j] for j, name in enumerate(rows.base.inputs)}
    if rows.base.inputs == POSE:
        axis = rows.rotation[:, :, 0]
        found["bend_rad"] = np.arctan2(np.hypot(axis[:, 1], axis[:, 2]), axis[:, 0])
        found["azimuth_rad"] = np.arctan2(axis[:, 2], axis[:, 1])
    if rows.base.outputs == WRENCH:
        found["force_N"] = np.asarray(np.linalg.norm(rows.wrench[:, :3], axis=1))
        found["torque_Nm"] = np.asarray(np.linalg.norm(rows.wrench[:, 3:], axis=1))
    found["row"] = np.arange(1, len(table) + 1).astype(np.float64)
    named = ("time_s", "temperature_degC", "sensor_temperature_degC", "dwell_s", "repeat")
    for name in (*named, *table.covariates):
        if table.has(name):
            values = table.column(name)
            if np.isfinite(values).all():
                found[name] = values
    if table.has("approach") and rows.base.inputs == POSE:
        found["approach_side"] = sides(table, rows.length_m if rows.has_length else None)
    return found


def _follows(
    variables: Mapping[str, F], whitened: F, outputs: tuple[str, ...]
) -> tuple[tuple[str, str, float], ...]:
    """Share of each component's squares that a cubic in one variable explains beyond chance."""
    n = len(whitened)
    found = []
    for name, values in variables.items():
        distinct = len(np.unique(values))
        degree = min(_DEGREE, distinct - 1)
        if n < 4 * (degree + 1):
            continue
        x = 2.0 * (values - values.min()) / float(np.ptp(values)) - 1.0
        basis = orthonormal(np.polynomial.chebyshev.chebvander(x, degree))
        explained = ((basis.T @ whitened) ** 2).sum(axis=0)
        total = (whitened**2).sum(axis=0)
        # Of what it does not explain, chance gives each column its part.
        chance = basis.shape[1] * (total - explained) / max(1, n - basis.shape[1])
        for j, output in enumerate(outputs):
            if total[j] > 0.0:
                share = float((explained[j] - chance[j]) / total[j])
                found.append((name, output, max(0.0, share)))
    return tuple(sorted(found, key=lambda item: -item[2]))


def _residual_stiffness(rows: Rows, found: Residuals, scored: B) -> tuple[F | None, F | None]:
    """Slope of the residual at the rest pose, beside a constant and, with enough rows, squares."""
    deflection = (rows.poses - rows.middle_pose)[scored]
    n = len(deflection)
    scale = np.maximum(np.abs(deflection).max(axis=0), 1e-12)
    unit = deflection / scale
    columns = [np.ones((n, 1)), unit]
    if n >= 84:
        columns.append(
            np.stack([unit[:, i] * unit[:, j] for i in range(6) for j in range(i + 1)], axis=1)
        )
    basis = np.concatenate(columns, axis=1)
    if n < 2 * basis.shape[1] or np.linalg.matrix_rank(basis) < basis.shape[1]:
        return None, None
    whitener = found.whitener[scored]
    q = basis.shape[1]
    design = np.einsum("nij,nq->niqj", whitener, basis).reshape(6 * n, 6 * q)
    gram = np.linalg.inv(design.T @ design)
    y = found.whitened[scored].ravel()
    solution = gram @ (design.T @ y)
    # What the slope does not explain is not noise alone: scale the errors by it.
    left = float(((y - design @ solution) ** 2).sum()) / (6 * n - 6 * q)
    sd = np.sqrt(np.diag(gram) * max(1.0, left))
    slope = solution.reshape(q, 6)[1:7].T / scale
    return np.asarray(slope), np.asarray(sd.reshape(q, 6)[1:7].T / scale)
