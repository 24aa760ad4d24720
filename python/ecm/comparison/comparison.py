"""Compare a model with measurements: noise floor, excess error, one plain sentence."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.comparison.reference_models import ReferenceModels, fit_reference_models
from ecm.comparison.residual_figures import residual_figure
from ecm.comparison.residual_maps import WORST, ResidualMaps, residual_maps_of
from ecm.comparison.residuals import residuals, residuals_by_block
from ecm.comparison.sections import comparison_report
from ecm.comparison.structure import (
    StructureTest,
    neighbours_alike,
    nothing_follows,
    run_outliers,
    structure_test,
)
from ecm.errors import InputError
from ecm.io.arguments import check_arguments
from ecm.io.arrays import B, F, I
from ecm.io.columns import unit_of
from ecm.io.events import Progress, Steps
from ecm.io.extras import require
from ecm.io.table import as_table
from ecm.models.file import was_trained_on
from ecm.models.given import as_model
from ecm.models.joint_fit import base_columns
from ecm.models.learned import LEARNED
from ecm.models.noise_estimate import estimate_noise
from ecm.models.pose_error import PoseError, pose_error
from ecm.models.prediction import beyond_reach
from ecm.models.refit import FAR_BEYOND_NOISE, base_and_error, is_far_behind
from ecm.regression.f_test import FTest, lack_of_fit
from ecm.regression.folds import (
    HOW,
    RowsUsed,
    is_pose_row,
    repeat_cells,
    row_groups,
    spread_rows,
    without_zero_readings,
)
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows
from ecm.report.page import Report, Shown

if TYPE_CHECKING:
    from ecm.io.table import MetaLike, Table, TableLike
    from ecm.models.model import Model


_BOOTSTRAPS = 400
_LEVEL = 0.9
_STEPS = {
    "errors": 2,
    "structure of the errors": 6,
    "pose errors": 1,
    "reference models": 3,
    "residual maps": 1,
}
"""Shares of the time that the steps take, measured on 12,000 rows."""
_DRAWN_AT_ONCE = 4_000_000
"""Numbers of resampled groups that are held at once."""


@dataclass(frozen=True)
class Component:
    """Errors of one wrench component, in its unit.

    Examples
    --------
    >>> Component("fx_N", 1.25, 0.0, 0.75, 1.0, 0.9, 1.1, None).excess
    1.0
    """

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
    """Test of this component alone, over its own noise; None without repeats."""


@dataclass(frozen=True)
class _Compared:
    """The inputs of a comparison, for the parts that are made when they are asked for."""

    model: Model
    table: Table
    """N rows."""
    predicted: F
    """(N, m)."""
    chosen: I
    """Rows of a large table that the noise and these parts rest on; else all."""


@dataclass(frozen=True)
class Comparison(Shown):
    """Errors of a model beside the noise of the measurements: N measured poses, m components.

    `print` shows one sentence and the components, `report` the rest in words, tables and figures,
    `plot` the residuals, `to_pandas` the components, `where` where the model fails, `pose_error`
    the same in mm and degrees, and `to_dict` plain JSON.

    Examples
    --------
    >>> import numpy as np
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 20)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x + 1e10 * x**3})
    >>> result = ecm.compare(ecm.fit_model(table, "linear"), table)
    >>> len(result.where().worst(3))
    3
    """

    model: str
    rows: int
    components: tuple[Component, ...]
    whitened_rms: float
    """Root mean square of the whitened residual; 1 where noise explains everything."""
    excess: float
    """sqrt(whitened_rms^2 - 1), the strength s of what is missing."""
    excess_low: float
    excess_high: float
    noise: Noise
    lack_of_fit: FTest | None
    outside_domain: int
    """Rows outside the poses that the model was trained on."""
    whitened: F
    """(N, m) residuals over their noise, in file order."""
    physical: F
    """(N, m) residuals, measured minus predicted, in the units of the outputs."""
    row: I
    """(N,) rows in the table, from 0."""
    compared: _Compared
    warnings: tuple[str, ...] = ()
    rows_used: RowsUsed | None = None
    """Rows of a large table that noise, references and maps rest on; None where they are all."""

    @cached_property
    def structure(self) -> StructureTest:
        """Whether the residual holds more than chance; tested when it is asked for."""
        made = self.compared
        return _structure(made.model, made.table, made.predicted, made.chosen, self.noise)

    @cached_property
    def references(self) -> ReferenceModels | None:
        """Reference models of the table; None where its columns do not allow them.

        Made when it is asked for: fits two bases; no FEM runs for it.
        """
        made = self.compared
        return fit_reference_models(made.model, made.table.thinned(made.chosen), self.noise)

    @cached_property
    def pose_error(self) -> PoseError:
        """Errors of the pose that the errors of the wrench stand for, dp = K^-1 dh, of all rows."""
        made = self.compared
        errors = made.table.matrix(made.model.outputs) - made.predicted
        return pose_error(made.model, made.table, errors, noise=self.noise)

    @cached_property
    def _where(self) -> ResidualMaps:
        return self._maps(0)

    def _maps(self, most: int) -> ResidualMaps:
        made = self.compared
        size = np.zeros(len(made.table))
        size[self.row] = (self.whitened**2).sum(axis=1)
        worst = np.argsort(-size, kind="stable")[:WORST]
        more = self.row[:: -(-len(self.row) // most)] if most else worst
        shown = np.unique(np.concatenate([made.chosen, worst, more]))
        rows = Rows(made.table.thinned(shown), made.model.base)
        errors = residuals(rows, made.predicted[shown], self.noise, made.model.base.error)
        leverage = made.model.leverage(np.ascontiguousarray(rows.poses[is_pose_row(rows.table)]))
        # The other rows of a large table are shown, but would count too much.
        counted = np.isin(shown, made.chosen)
        return residual_maps_of(rows, errors, counted, leverage, self.noise)

    def complete(self, progress: Progress | None = None) -> None:
        """Make the parts that are made when they are asked for.

        Parameters
        ----------
        progress
            Called with the part that is done, the whole, and the step that begins.
        """
        steps = Steps(_STEPS, progress)
        for name, make in (
            ("structure of the errors", lambda: self.structure),
            ("pose errors", lambda: self.pose_error),
            ("reference models", lambda: self.references),
            ("residual maps", self.where),
        ):
            steps.begin(name)
            make()

    def report(self) -> Report:
        """Return what terminal, notebook and page show: `print(result.report().text())`."""
        return comparison_report(self, self.warnings)

    def sentence(self) -> str:
        """Return one plain sentence."""
        worst = max(self.components, key=lambda c: c.excess / max(c.floor, 1e-300))
        unit = unit_of(worst.name)
        follows = "follows the pose, the order or another column"
        if self.noise.is_assumed:
            part = f" A part of it {follows}." if self.missing else ""
            spread = float(self.compared.table.column(worst.name)[self.compared.chosen].std())
            share = 100.0 * worst.rmse / max(spread, 1e-300)
            return (
                f"{self.model} errs {worst.rmse:.3g} {unit} in {worst.name.rsplit('_', 1)[0]}, "
                f"{share:.3g} % of its spread; "
                "without repeats or [instrument] figures nothing says how much of it is noise."
                + part
            )
        where = {"repeats": "from repeats", "declared": "as declared"}
        floor = f"the noise floor {where[self.noise.source]}"
        if self.excess_low <= 0.0 and not self.missing:
            return (
                f"{self.model} is as good as the measurements can show: its error is "
                f"{self.whitened_rms:.2f} times {floor}."
            )
        if not self.missing:
            why = nothing_follows(self.whitened_rms, self.neighbours_alike)
            return f"{self.model} errs {self.whitened_rms:.2f} times {floor}, {why}."
        behind = self._error_of_base_ahead
        if behind is not None:
            return (
                f"{self.model} errs {self.whitened_rms:.2f} times {floor}, a base fitted to these "
                f"rows {behind:.2f} times on held-out ones: something is missing in the model."
            )
        if self.excess_low <= 0.0:
            return (
                f"{self.model} errs {self.whitened_rms:.2f} times {floor}, yet a part of it "
                f"{follows}: something is missing, and that noise is likely too large."
            )
        return (
            f"{self.model} errs {self.whitened_rms:.2f} times {floor}: "
            f"{worst.excess:.3g} {unit} in {worst.name.rsplit('_', 1)[0]} is not noise."
        )

    @property
    def missing(self) -> bool:
        """Whether the model lacks something on these rows.

        Its residual holds structure, or it errs far beyond the noise and a base that is fitted to
        these rows does not.
        """
        return self.structure.found or self._error_of_base_ahead is not None

    @cached_property
    def neighbours_alike(self) -> float | None:
        """Correlation of the errors of rows that follow each other; None where it is chance."""
        return neighbours_alike(self.compared.table, self.row, self.whitened)

    @cached_property
    def _error_of_base_ahead(self) -> float | None:
        """Error over the noise of a base that leaves the model far behind; None where none does.

        Fitted only where the model errs far beyond the noise and no test sees why.
        """
        known = not self.noise.is_residual and self.whitened_rms > FAR_BEYOND_NOISE
        if self.structure.found or not known:
            return None
        made = self.compared
        base = base_and_error(made.model, made.table.thinned(made.chosen), self.noise)
        ahead = base is not None and is_far_behind(self.whitened_rms, base[1])
        return base[1] if base is not None and ahead else None

    def where(self, most: int | None = None) -> ResidualMaps:
        """Return residual maps, signature shares, residual stiffness and the worst rows.

        Parameters
        ----------
        most
            Rows up to which all are in the maps, of more every k-th; default: those on which noise
            and references rest. Shares and stiffness rest on these in both cases.
        """
        return self._where if most is None else self._maps(most)

    def to_pandas(self) -> Any:
        """Return the components as a DataFrame; needs pandas.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        pandas = require("pandas", "data", "The components as a DataFrame")
        return pandas.DataFrame([asdict(c) for c in self.components]).drop(columns="lack_of_fit")

    def plot(self, variable: str | None = None) -> Any:
        """Return a plotly figure of the residual of each component.

        Parameters
        ----------
        variable
            Name in `where().variables`; default: the one that the residual follows most.

        Raises
        ------
        MissingExtra
            If plotly is not installed.
        """
        plotly = require("plotly.graph_objects", "report", "The figure of the residuals")
        return plotly.Figure(residual_figure(self.where(), variable))

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain JSON."""
        return {
            "schema": 1,
            "model": self.model,
            "rows": self.rows,
            "sentence": self.sentence(),
            "noise": {**self.noise.to_dict(), "is_assumed": self.noise.is_assumed},
            "rmse": {c.name: c.rmse for c in self.components},
            "components": [asdict(c) for c in self.components],
            "whitened_rms": self.whitened_rms,
            "excess": {"value": self.excess, "low": self.excess_low, "high": self.excess_high},
            "lack_of_fit": None if self.lack_of_fit is None else asdict(self.lack_of_fit),
            "pose_error": self.pose_error.to_dict(),
            "missing": self.missing,
            "structure": asdict(self.structure),
            "outside_domain": self.outside_domain,
            "where": self.where().to_dict(),
            "warnings": list(self.warnings),
            **({} if self.rows_used is None else {"rows_used": self.rows_used.to_dict()}),
            "references": None if self.references is None else self.references.to_dict(),
        }


def compare(
    model: Model | Any,
    table: TableLike,
    *,
    meta: MetaLike = None,
    noise: Noise | None = None,
    seed: int = 0,
    most_rows: int = 3000,
    progress: Progress | None = None,
) -> Comparison:
    """Compare a model with measurements.

    The noise comes from repeats, else from the table's instrument figures, else it is assumed.

    Parameters
    ----------
    model
        Model with the pose and wrench columns of the table; or a function of poses (N, n) that
        returns wrenches (N, m), an `Expression`, the path of a model file, or a table of predicted
        wrenches with a row for each measured pose.
    table
        Measurements, as a table, a data frame, a dict or a file; poses count, home and unloaded
        rows do not.
    meta
        Description of the data, as a dict of what the TOML beside it would hold, or that file.
    noise
        Noise of the rows, where it is known better than the table tells.
    seed
        Seed of the random generator of the bootstraps.
    most_rows
        Largest number of rows on which noise, references and maps rest; of a larger table they are
        spread over runs, time and poses. The errors are those of all rows.
    progress
        Called with the part that is done, the whole, and the step that begins; the whole counts
        what `Comparison.complete` makes.

    Returns
    -------
    Comparison
        Error of each component against its noise, and where the model fails.

    Raises
    ------
    InputError
        If the table lacks a column of the model.

    Examples
    --------
    >>> import numpy as np
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 20)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x + 1e9 * x**3})
    >>> result = ecm.compare(ecm.fit_model(table, "cubic"), table)
    >>> [c.name for c in result.components]
    ['fx_N']
    """
    check_arguments(compare, locals())
    table = as_table(table, meta=meta)
    model = as_model(model, table)
    lacking = [name for name in (*model.inputs, *model.outputs) if not table.has(name)]
    if lacking:
        raise InputError(
            f"{table.source}: no column {lacking[0]}, which the model {model.name} needs; "
            f"it has inputs {', '.join(model.inputs)} and outputs {', '.join(model.outputs)}"
        )
    steps = Steps(_STEPS, progress)
    steps.begin("errors")
    table = table.with_length(model.known_length_m)
    rows = Rows(table, model.base)
    predicted = model.predict(table)
    chosen = spread_rows(table, most_rows)
    if noise is None:
        some = Rows(table.thinned(chosen), model.base)
        noise = estimate_noise(some, predicted[chosen], fallback=model.noise)
    scored = is_pose_row(table)
    physical, whitened, variance = (
        values[scored] for values in residuals_by_block(rows, predicted, noise, model.base.error)
    )
    groups = row_groups(table)[scored]
    measured = np.stack([table.column(name) for name in model.outputs], axis=1)
    excited = np.ptp(measured[scored], axis=0) > 1e-12
    if not excited.any():
        excited[:] = True
    mean = float((whitened[:, excited] ** 2).mean())
    draws = _bootstrap(physical**2 - variance, whitened[:, excited] ** 2 - 1.0, groups, seed)
    cells, fitted = repeat_cells(table)[scored], _fitted_here(model, table)
    # Whitening mixes components: each by itself is divided by its own standard deviation.
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
        warnings=(
            *(r.sentence() for r in run_outliers(table, model.inputs, model.outputs)),
            *beyond_reach(model, rows.poses[scored]),
        ),
        compared=_Compared(model, table, predicted, chosen),
        rows_used=_rows_used(len(table), len(chosen), len(model.outputs)),
    )


def _structure(model: Model, table: Table, predicted: F, chosen: I, noise: Noise) -> StructureTest:
    """Return the test of the residual; coefficients that were fitted to these rows count."""
    rows = Rows(table.thinned(chosen), model.base)
    errors = residuals(rows, predicted[chosen], noise, model.base.error)
    own = None
    refitted = not model.base_frozen and model.base.kind not in LEARNED
    if refitted and _fitted_here(model, table):
        own = errors.whitener @ base_columns(rows, model.base)
    scored = is_pose_row(rows.table)
    return structure_test(rows, errors.whitened, errors.whitener, scored, fitted=own)


def _rows_used(total: int, used: int, outputs: int) -> RowsUsed | None:
    if used == total:
        return None
    enough = (
        "the errors and their intervals are those of all rows; noise, references and maps rest on "
        "these, where chance changes a share of the residual by "
        f"{np.sqrt(2.0 / (used * outputs)):.1g}"
    )
    return RowsUsed(total, used, HOW, enough)


def _fitted_here(model: Model, table: Table) -> int:
    """Return how many values of the model were fitted to this very table."""
    tables = (table.measured(), without_zero_readings(table))
    if not any(was_trained_on(model.training, rows) for rows in tables):
        return 0
    base = 0 if model.base_frozen else len(model.base.coefficients)
    return base + sum(len(item.values) for item in model.effects if not item.frozen)


def _lack(residual: F, cells: I, fitted: float) -> FTest | None:
    """Return the test of the lack of fit; None without repeats or without degrees of freedom."""
    test = lack_of_fit(residual, cells, fitted)
    return test if test is not None and np.isfinite(test.F) else None


def _bootstrap(physical: F, whitened: F, groups: I, seed: int) -> tuple[F, F]:
    """Return 90 % intervals of the excess variances, groups resampled."""
    _, packed = np.unique(groups, return_inverse=True)
    count = int(packed.max()) + 1
    sizes = np.bincount(packed).astype(np.float64)
    sums = np.stack([np.bincount(packed, column) for column in physical.T], axis=1)
    all_components = np.bincount(packed, whitened.mean(axis=1))
    rng = np.random.default_rng([seed, 11])
    at_once = max(1, min(_BOOTSTRAPS, _DRAWN_AT_ONCE // count))
    means, alone = [], []
    for first in range(0, _BOOTSTRAPS, at_once):
        draws = min(at_once, _BOOTSTRAPS - first)
        drawn = rng.multinomial(count, np.full(count, 1.0 / count), size=draws)
        totals = drawn @ sizes
        means.append((drawn @ sums) / totals[:, None])
        alone.append((drawn @ all_components) / totals)
    tails = [0.5 - 0.5 * _LEVEL, 0.5 + 0.5 * _LEVEL]
    parts = np.quantile(np.concatenate(means), tails, axis=0)
    return np.asarray(parts), np.asarray(np.quantile(np.concatenate(alone), tails))


def _root(value: float) -> float:
    return float(np.sqrt(max(value, 0.0)))


def _outside(model: Model, rows: Rows, scored: B) -> int:
    return int(model.extrapolates(np.ascontiguousarray(rows.poses[scored])).sum())
