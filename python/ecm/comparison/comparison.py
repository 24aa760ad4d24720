"""Compare a model with measurements: floor, excess error, one plain sentence."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.comparison.reference_models import ReferenceModels, fit_reference_models
from ecm.comparison.residual_maps import ResidualMaps, residual_maps_of
from ecm.comparison.residuals import Residuals, residuals
from ecm.comparison.run_outliers import run_outliers
from ecm.errors import InputError
from ecm.io.arrays import B, F, I
from ecm.io.columns import unit_of
from ecm.models.noise_estimate import estimate_noise
from ecm.regression.f_test import FTest, lack_of_fit
from ecm.regression.folds import is_pose_row, row_groups, without_zero_readings
from ecm.regression.noise import Noise
from ecm.regression.repeats import repeat_cells
from ecm.regression.rows import Rows

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.model import Model


_BOOTSTRAPS = 400
_LEVEL = 0.9


@dataclass(frozen=True)
class Component:
    """One wrench component, in its unit."""

    name: str
    rmse: float
    bias: float
    floor: float
    """Standard deviation that noise alone gives, pose noise through K."""
    excess: float
    """sqrt(rmse^2 - floor^2), 0 where the noise explains it."""
    excess_low: float
    excess_high: float
    """90 % interval, groups of rows resampled."""
    lack_of_fit: FTest | None
    """Of this component alone, over its own noise; None without repeats."""


@dataclass(frozen=True)
class _Compared:
    """What a comparison was made of."""

    model: Model
    rows: Rows
    residuals: Residuals
    scored: B


@dataclass(frozen=True)
class Comparison:
    """What `compare` found."""

    model: str
    rows: int
    components: tuple[Component, ...]
    whitened_rms: float
    """1 where noise explains everything."""
    excess: float
    """sqrt(whitened_rms^2 - 1), the strength s of what is missing."""
    excess_low: float
    excess_high: float
    noise: Noise
    lack_of_fit: FTest | None
    outside_domain: int
    """Rows outside the poses that the model was trained on."""
    whitened: F
    """(N, m) of the measured poses, in file order."""
    physical: F
    """(N, m)."""
    row: I
    """(N,) their rows in the table, from 0."""
    compared: _Compared
    warnings: tuple[str, ...] = ()

    @cached_property
    def references(self) -> ReferenceModels | None:
        """Physics base, symmetric energy, ceiling and floor; None for tables of other columns.

        Fits two bases, and runs the FEM of a `[mechanism]` that is new: made when it is asked for.
        """
        return fit_reference_models(self.compared.model, self.compared.rows.table, self.noise)

    @cached_property
    def _where(self) -> ResidualMaps:
        made = self.compared
        at = np.ascontiguousarray(made.rows.poses[made.scored])
        return residual_maps_of(made.rows, made.residuals, made.scored, made.model.leverage(at))

    def sentence(self) -> str:
        """One plain sentence."""
        worst = max(self.components, key=lambda c: c.excess / max(c.floor, 1e-300))
        unit = unit_of(worst.name)
        if self.noise.components is not None and self.noise.source == "assumed":
            return (
                f"{self.model} errs {worst.rmse:.3g} {unit} in {worst.name.rsplit('_', 1)[0]}; "
                "without repeats or [instrument] figures nothing says how much of it is noise."
            )
        where = {"repeats": "from repeats", "declared": "as declared", "assumed": "assumed"}
        floor = f"the noise floor {where[self.noise.source]}"
        if self.excess_low <= 0.0:
            return (
                f"{self.model} is as good as the measurements can show: its error is "
                f"{self.whitened_rms:.2f} times {floor}."
            )
        return (
            f"{self.model} errs {self.whitened_rms:.2f} times {floor}: "
            f"{worst.excess:.3g} {unit} in {worst.name.rsplit('_', 1)[0]} is not noise."
        )

    def where(self) -> ResidualMaps:
        """Residual maps, signature shares, residual stiffness and the worst rows."""
        return self._where

    def to_dict(self) -> dict[str, Any]:
        """For --json."""
        return {
            "schema": 1,
            "model": self.model,
            "rows": self.rows,
            "sentence": self.sentence(),
            "noise": self.noise.to_dict(),
            "rmse": {c.name: c.rmse for c in self.components},
            "components": [asdict(c) for c in self.components],
            "whitened_rms": self.whitened_rms,
            "excess": {"value": self.excess, "low": self.excess_low, "high": self.excess_high},
            "lack_of_fit": None if self.lack_of_fit is None else asdict(self.lack_of_fit),
            "outside_domain": self.outside_domain,
            "where": self.where().to_dict(),
            "warnings": list(self.warnings),
            "references": None if self.references is None else self.references.to_dict(),
        }


def compare(model: Model, table: Table, *, noise: Noise | None = None, seed: int = 0) -> Comparison:
    """Residuals of a model on a table, beside the noise of the table.

    The floor comes from repeats, else from the table's instrument figures, else it is assumed.
    """
    lacking = [name for name in (*model.inputs, *model.outputs) if not table.has(name)]
    if lacking:
        raise InputError(
            f"{table.source}: no column {lacking[0]}, which the model {model.name} needs; "
            f"it has inputs {', '.join(model.inputs)} and outputs {', '.join(model.outputs)}"
        )
    table = table.with_length(model.known_length_m)
    rows = Rows(table, model.base)
    predicted = model.predict(table)
    if noise is None:
        noise = estimate_noise(rows, predicted, fallback=model.noise)
    found = residuals(rows, predicted, noise, model.base.error)
    scored = is_pose_row(table)
    physical, whitened = found.physical[scored], found.whitened[scored]
    variance = np.einsum("nii->ni", found.covariance[scored])
    groups = row_groups(table)[scored]
    measured = np.stack([table.column(name) for name in model.outputs], axis=1)
    excited = np.ptp(measured[scored], axis=0) > 1e-12
    if not excited.any():
        excited[:] = True
    mean = float((whitened[:, excited] ** 2).mean())
    draws = _bootstrap(physical**2 - variance, whitened[:, excited] ** 2 - 1.0, groups, seed)
    cells, fitted = repeat_cells(table)[scored], _fitted_here(model, table)
    # A whitened component holds those before it: each by itself is over its own deviation.
    alone = physical / np.sqrt(variance)
    components = tuple(
        Component(
            name=name,
            rmse=float(np.sqrt((physical[:, j] ** 2).mean())),
            bias=float(physical[:, j].mean()),
            floor=float(np.sqrt(variance[:, j].mean())),
            excess=_root(float((physical[:, j] ** 2 - variance[:, j]).mean())),
            excess_low=_root(float(draws[0][0, j])),
            excess_high=_root(float(draws[0][1, j])),
            lack_of_fit=_lack(alone[:, [j]], cells, fitted / len(model.outputs))
            if excited[j]
            else None,
        )
        for j, name in enumerate(model.outputs)
    )
    return Comparison(
        model=model.name,
        rows=int(scored.sum()),
        components=components,
        whitened_rms=float(np.sqrt(mean)),
        excess=_root(mean - 1.0),
        excess_low=_root(float(draws[1][0])),
        excess_high=_root(float(draws[1][1])),
        noise=noise,
        lack_of_fit=_lack(whitened, cells, fitted),
        outside_domain=_outside(model, rows, scored),
        whitened=whitened,
        physical=physical,
        row=np.flatnonzero(scored),
        warnings=tuple(r.sentence() for r in run_outliers(table, model.inputs, model.outputs)),
        compared=_Compared(model, rows, found, scored),
    )


def _fitted_here(model: Model, table: Table) -> int:
    """How many numbers of the model were fitted to this very table; none where it is new to it."""
    from ecm.models.training import training_of  # Late: models stand on the comparison.

    known, count = model.training.get("hash"), model.training.get("rows")
    # A hash reads every number: only of as many rows as the fit had.
    fitted = (
        rows for rows in (table.measured(), without_zero_readings(table)) if len(rows) == count
    )
    if not any(training_of(rows)["hash"] == known for rows in fitted):
        return 0
    base = 0 if model.base_frozen else len(model.base.coefficients)
    return base + sum(len(item.values) for item in model.effects if not item.frozen)


def _lack(residual: F, cells: I, fitted: float) -> FTest | None:
    """F of the lack of fit; None where nothing is repeated or as much is fitted as was measured.

    What all components share is fitted to each in equal parts.
    """
    found = lack_of_fit(residual, cells, fitted)
    return found if found is not None and np.isfinite(found.F) else None


def _bootstrap(physical: F, whitened: F, groups: I, seed: int) -> tuple[F, F]:
    """90 % intervals of the excess variances, groups resampled."""
    _, packed = np.unique(groups, return_inverse=True)
    count = int(packed.max()) + 1
    sizes = np.bincount(packed).astype(np.float64)
    sums = np.stack([np.bincount(packed, column) for column in physical.T], axis=1)
    whole = np.bincount(packed, whitened.mean(axis=1))
    rng = np.random.default_rng([seed, 11])
    drawn = rng.multinomial(count, np.full(count, 1.0 / count), size=_BOOTSTRAPS)
    totals = drawn @ sizes
    tails = [0.5 - 0.5 * _LEVEL, 0.5 + 0.5 * _LEVEL]
    parts = np.quantile((drawn @ sums) / totals[:, None], tails, axis=0)
    return np.asarray(parts), np.asarray(np.quantile((drawn @ whole) / totals, tails))


def _root(value: float) -> float:
    return float(np.sqrt(max(value, 0.0)))


def _outside(model: Model, rows: Rows, scored: B) -> int:
    if not model.domain:
        return 0
    low = np.array([model.domain[name][0] for name in model.inputs])
    high = np.array([model.domain[name][1] for name in model.inputs])
    slack = 0.02 * (high - low)
    poses = rows.poses[scored]
    return int(((poses < low - slack) | (poses > high + slack)).any(axis=1).sum())
