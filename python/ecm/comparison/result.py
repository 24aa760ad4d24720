"""The result of a comparison, and its report: errors, pose errors, references, residual maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ecm.comparison.reference_models import (
    FEM_REMEDY,
    HELD_OUT,
    USELESS,
    ReferenceModels,
    fit_reference_models,
)
from ecm.comparison.residual_maps import (
    LINK,
    WORST,
    ResidualMaps,
    residual_figure,
    residual_maps_of,
    residual_section,
)
from ecm.comparison.structure import (
    StructureTest,
    beside_coefficients,
    neighbours_alike,
    nothing_follows,
    structure_test,
)
from ecm.errors import Remedy
from ecm.io.arrays import F, I, rms
from ecm.io.columns import unit_of
from ecm.io.events import Progress, Steps
from ecm.io.extras import require
from ecm.io.table import Table
from ecm.models.errors import NEAR_NOISE, Residuals, residuals
from ecm.models.evaluation import PoseError, pose_error
from ecm.models.fit import remedy_of_inputs
from ecm.models.joint_fit import base_columns
from ecm.models.literature import LEARNED
from ecm.models.measured_poses import beyond_inputs
from ecm.models.model import Model
from ecm.models.refit import FAR_BEYOND_NOISE, base_and_error, is_far_behind
from ecm.models.registry import was_trained_on
from ecm.regression.blas import one_blas_thread
from ecm.regression.f_test import FTest
from ecm.regression.folds import RowsUsed, without_zero_readings
from ecm.regression.noise import Noise, lacking_figures
from ecm.regression.rows import Rows, unused_inputs
from ecm.report import figures as draw
from ecm.report.blocks import (
    Block,
    Cell,
    CodeBlock,
    FigureBlock,
    Report,
    Section,
    Shown,
    TableBlock,
    TextBlock,
    number,
)
from ecm.report.figures import mechanism_blocks

STEPS = {
    "errors": 2,
    "structure of the errors": 6,
    "pose errors": 1,
    "reference models": 3,
    "residual maps": 1,
}
"""Shares of the time that the steps take, measured on 12,000 rows."""


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
class Compared:
    """The inputs of a comparison, for the parts that are made when they are asked for."""

    model: Model
    table: Table
    """N rows."""
    predicted: F
    """(N, m)."""
    chosen: I
    """Rows of a large table that the noise and these parts rest on; else all."""


_TOGETHER = ", which no component shows alone: their noise goes together."


@dataclass(frozen=True, repr=False, eq=False)
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
    compared: Compared
    warnings: tuple[str, ...] = ()
    rows_used: RowsUsed | None = None
    """Rows of a large table that noise, references and maps rest on; None where they are all."""

    @cached_property
    @one_blas_thread()
    def structure(self) -> StructureTest:
        """Whether the residual holds more than chance; tested when it is asked for.

        Coefficients that were fitted to these rows count; on other rows they err.
        """
        made, (rows, errors), own = self.compared, self._errors, None
        rows = rows.quieted
        refitted = not made.model.base_frozen and made.model.base.kind not in LEARNED
        if refitted and fitted_here(made.model, made.table):
            own = errors.whitener @ base_columns(rows, made.model.base)
        return structure_test(rows, self._beside_coefficients, errors.whitener, fitted=own)

    @cached_property
    def _errors(self) -> tuple[Rows, Residuals]:
        made = self.compared
        rows = Rows(made.table.subsample(made.chosen), made.model.base)
        return rows, residuals(rows, made.predicted[made.chosen], self.noise, made.model.base.error)

    @cached_property
    def _beside_coefficients(self) -> F:
        """(n, m) residual over the noise and, on other rows than its own, what coefficients err."""
        made, (rows, errors) = self.compared, self._errors
        known = made.model.covariance
        if known is None or fitted_here(made.model, made.table):
            return errors.whitened
        columns = errors.whitener @ base_columns(rows.quieted, made.model.base)
        return beside_coefficients(errors.whitened, columns, known)

    @cached_property
    @one_blas_thread()
    def references(self) -> ReferenceModels | None:
        """Reference models of the table; None where its columns do not allow them.

        Made when it is asked for: fits two bases; no FEM runs for it.
        """
        made = self.compared
        some = made.table.subsample(made.chosen)
        return fit_reference_models(
            made.model, some, self.noise, missing=self.missing, own=self.whitened_rms
        )

    @property
    def unused_inputs(self) -> tuple[str, ...]:
        """Inputs of actuators that vary in the table and that the model does not take."""
        return unused_inputs(self.compared.model.base, self.compared.table)

    @cached_property
    @one_blas_thread()
    def pose_error(self) -> PoseError:
        """Errors of the pose that the errors of the wrench stand for, dp = K^-1 dh, of all rows."""
        made = self.compared
        errors = made.table.matrix(made.model.outputs) - made.predicted
        return pose_error(made.model, made.table, errors, noise=self.noise)

    @cached_property
    def _where(self) -> ResidualMaps:
        return self._maps(0)

    @one_blas_thread()
    def _maps(self, most: int) -> ResidualMaps:
        made = self.compared
        size = np.zeros(len(made.table))
        size[self.row] = (self.whitened**2).sum(axis=1)
        worst = np.argsort(-size, kind="stable")[:WORST]
        more = self.row[:: -(-len(self.row) // most)] if most else worst
        shown = np.unique(np.concatenate([made.chosen, worst, more]))
        rows = Rows(made.table.subsample(shown), made.model.base)
        errors = residuals(rows, made.predicted[shown], self.noise, made.model.base.error)
        leverage = made.model.leverage(np.ascontiguousarray(rows.poses[rows.table.of_poses]))
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
        steps = Steps(STEPS, progress)
        for name, make in (
            ("structure of the errors", lambda: self.structure),
            ("pose errors", lambda: self.pose_error),
            ("reference models", lambda: self.references),
            ("residual maps", self.where),
        ):
            steps.begin(name)
            make()

    def blocks(self) -> list[Block]:
        """Return one sentence, the error of each component, and the same as pose error."""
        pose = TextBlock(self.pose_error.sentence())
        said = [TextBlock(self.sentence(), strong=True), *_unused(self, {})]
        return [*said, _errors(self)[0], pose, *_rows(self)]

    def report(self) -> Report:
        """Return what terminal, notebook and page show: `print(result.report().text())`."""
        return comparison_report(self, self.warnings)

    def sentence(self) -> str:
        """Return one plain sentence."""
        worst = max(self.components, key=lambda c: c.excess / max(c.floor, 1e-300))
        unit, name = unit_of(worst.name), worst.name.rsplit("_", 1)[0]
        follows = "follows the pose, the order or another column"
        if self.noise.is_assumed:
            part = f" A part of it {follows}." if self.missing else ""
            share = self.shares_of_spread[self.components.index(worst)]
            made = self.compared
            columns = (*made.model.inputs, *made.model.outputs)
            figures = ", ".join(lacking_figures(made.table, columns)) or "figures"
            return (
                f"{self.model} errs {worst.rmse:.3g} {unit} in {name}, {share:.3g} % of its "
                f"spread; without enough repeats or [instrument] {figures} nothing says how much "
                f"of it is noise.{part}"
            )
        where = {"repeats": "from repeats", "declared": "as declared"}
        times = f"{self.whitened_rms:.2f} times the noise floor {where[self.noise.source]}"
        if self.excess_low <= 0.0 and not self.missing:
            good = f"{self.model} is as good as the measurements can show"
            return f"{good}: its error is {times}."
        errs, behind = f"{self.model} errs {times}", self._error_of_base_ahead
        if not self.missing:
            why = nothing_follows(self.whitened_rms, self.neighbours_alike)
            if self.whitened_rms > NEAR_NOISE:
                why += "; a diagnosis tests the known effects"
                if self.is_as_known:
                    why = "as much as its coefficients err on rows that it was not fitted to"
            return f"{errs}, {why}."
        if behind is not None:
            return (
                f"{errs}, a base fitted to these rows {behind:.2f} times on held-out ones: "
                "something is missing in the model."
            )
        if self.excess_low <= 0.0:
            return (
                f"{errs}, yet a part of it {follows}: something is missing, and that noise is "
                "likely too large."
            )
        shown = f": {worst.excess:.3g} {unit} in {name} is not noise."
        return errs + (shown if worst.excess > 0.0 else _TOGETHER)

    @property
    def shares_of_spread(self) -> F:
        """(m,) RMSE of each component, % of the standard deviation of all its readings."""
        made = self.compared
        spread = made.table.matrix(made.model.outputs)[self.row].std(axis=0)
        rmse = np.array([one.rmse for one in self.components])
        return np.asarray(100.0 * rmse / np.where(spread > 0.0, spread, np.inf))

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

    @property
    def is_as_known(self) -> bool:
        """Whether the error is noise and, on other rows than those of the fit, its coefficients."""
        scored = self.compared.table.of_poses[self.compared.chosen]
        return rms(self._beside_coefficients[scored]) <= NEAR_NOISE

    @cached_property
    def _error_of_base_ahead(self) -> float | None:
        """Error over the noise of a base that leaves the model far behind; None where none does.

        Fitted only where the model errs far beyond the noise and no test sees why.
        """
        known = not self.noise.is_residual and self.whitened_rms > FAR_BEYOND_NOISE
        if self.structure.found or self.is_as_known or not known:
            return None
        made = self.compared
        base = base_and_error(made.model, made.table.subsample(made.chosen), self.noise)
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
        return draw.plotly_figure(residual_figure(self.where(), variable))

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
            "unused_inputs": list(self.unused_inputs),
            "where": self.where().to_dict(),
            "warnings": list(self.warnings),
            **({} if self.rows_used is None else {"rows_used": self.rows_used.to_dict()}),
            "references": None if self.references is None else self.references.to_dict(),
        }


_CAN_FIT = {
    "physics base": "FEM of the body with E and ν free: what it leaves, no elasticity explains",
    "symmetric energy": "any elasticity or geometry that keeps the symmetry",
    "ceiling": "the better of the two with a free cubic of the pose: any function of the pose",
    "noise floor": "what no model can take",
}


def comparison_report(
    result: Comparison, warnings: Sequence[str] = (), files: Mapping[str, str] | None = None
) -> Report:
    """Return errors of each component, reference models, and residuals in units of the noise.

    Parameters
    ----------
    result
        The comparison.
    warnings
        About the data.
    files
        Names of the files in what the report advises.
    """
    table, figures = _errors(result)
    blocks = [
        TextBlock(result.sentence(), strong=True),
        *_unused(result, files or {}),
        *workspace_blocks(result),
        table,
        *_lack_of_fit(result),
        *figures,
        *_pose_error(result),
        *_rows(result),
    ]
    fem = FEM_REMEDY.filled(files or {})
    references = reference_blocks(result.references, fem, assumed=result.noise.is_assumed)
    sections = [
        Section("Compare", blocks),
        Section("References", references),
        residual_section(result.where()),
    ]
    return Report(f"{result.model} against measurements", f"{result.rows} rows", sections, warnings)


def _unused(result: Comparison, files: Mapping[str, str]) -> list[Block]:
    """The inputs of actuators that are not in the model, and how to fit one that has them."""
    names, table = result.unused_inputs, result.compared.table
    if not names:
        return []
    advice = remedy_of_inputs(table, "with_inputs.json").filled(files)
    words = (
        f"{', '.join(names)} {'vary' if len(names) > 1 else 'varies'}, and {result.model} does not "
        f"take {'them' if len(names) > 1 else 'it'}: what the inputs of actuators do to the wrench "
        f"is counted as its error. {Remedy(advice.words)}"
    )
    return [CodeBlock(words, advice.shown)]


def _rows(result: Comparison) -> list[Block]:
    """How many rows lie beyond those of the fit, and which ones of a large table are used."""
    blocks: list[Block] = []
    if result.outside_domain:
        made = result.compared
        beyond = f"{result.outside_domain} of {result.rows} rows lie outside the poses of the fit"
        blocks.append(TextBlock(f"{beyond}{beyond_inputs(made.model, made.table)}."))
    if result.rows_used is not None:
        blocks.append(TextBlock(result.rows_used.sentence()))
    return blocks


def _errors(result: Comparison) -> tuple[TableBlock, list[FigureBlock]]:
    """Errors beside the noise, or where it is not known the spread, of what varies."""
    made, every = result.compared, result.components
    measured = made.table.matrix(made.model.outputs)[result.row]
    varies = np.ptp(measured, axis=0) > 0.0
    at = np.flatnonzero(varies) if varies.any() else np.arange(len(every))
    items = [every[j] for j in at]
    names = [one.name for one in items]
    header, rmse = ["component", "RMSE", "bias"], np.array([one.rmse for one in items])
    if result.noise.is_assumed:
        share = result.shares_of_spread[at]
        header.append("RMSE, % of the spread")
        more: list[list[Cell]] = [[value] for value in share.tolist()]
        bars: dict[str, Sequence[float]] = {"RMSE": share.tolist()}
        unit, over, scale = "% of the spread", "its spread", np.maximum(rmse, 1e-300)
    else:
        header += ["noise floor", "excess", "90 % interval"]
        scale = np.array([one.floor for one in items])
        more = [
            [one.floor, one.excess, f"{number(one.excess_low)} to {number(one.excess_high)}"]
            for one in items
        ]
        excess = np.array([one.excess for one in items])
        sizes = {"noise floor": scale, "RMSE": rmse, "excess": excess}
        bars = {name: (values / scale).tolist() for name, values in sizes.items()}
        unit, over = "over the noise floor", "its noise floor"
    # A bias of rounding alone is none.
    bias = [one.bias if abs(one.bias) > 1e-9 * one.rmse else 0.0 for one in items]
    rows = [
        [one.name, one.rmse, off, *own] for one, off, own in zip(items, bias, more, strict=True)
    ]
    each = "its error" if result.noise.is_assumed else over
    values = {"rows": result.physical[:, at] / scale}
    histograms = draw.histograms(values, names, limit=8.0, x_title=f"over {each}", y_title="rows")
    return TableBlock("", header, rows), [
        FigureBlock(f"Error of each component over {over}.", draw.bars(bars, names, y_title=unit)),
        FigureBlock(f"Residuals of each component over {each}.", histograms),
    ]


def _lack_of_fit(result: Comparison) -> list[Block]:
    """F of the model's error between repeated poses over the scatter of the repeats."""
    if result.lack_of_fit is None:
        return []
    alone = {one.name: one.lack_of_fit for one in result.components}
    rows: list[list[Cell]] = [
        [name, f"{test.F:.6g}", f"{test.dof:.4g}", f"{test.dof_error:.4g}", f"{test.p:.2g}"]
        for name, test in ({"all": result.lack_of_fit} | alone).items()
        if test is not None
    ]
    caption = "Error at repeated poses over the scatter of the repeats."
    return [TableBlock(caption, ("lack of fit", "F", "dof", "of error", "p"), rows)]


def _pose_error(result: Comparison) -> list[Block]:
    """The error as millimetres and degrees of the pose, and the worst rows."""
    found = result.pose_error
    blocks: list[Block] = [TextBlock(found.sentence(), strong=True)]
    if rows := found.worst():
        heads = {"row": "row", "position_mm": "position [mm]", "rotation_deg": "rotation [°]"}
        caption = (
            "The rows with the largest pose error, dp = K⁻¹ dh: to first order the mechanism would "
            "settle so far from a pose that is commanded by this model."
        )
        header, cells = [heads[name] for name in rows[0]], [[*item.values()] for item in rows]
        blocks.append(TableBlock(caption, header, cells, link=LINK))
    return blocks


def workspace_blocks(result: Comparison) -> Sequence[Block]:
    """Return the mechanism in its measured poses, coloured by residual."""
    maps = result.where()
    return mechanism_blocks(
        result.compared.table,
        "The mechanism bent into measured poses, coloured by the residual of the row over "
        f"{maps.noise_word}.{maps.drawn_sentence}",
        rows=maps.row[maps.drawn] - 1,
        values=maps.size[maps.drawn],
        title="residual",
        unit=f"times {maps.noise_word}",
        link=LINK,
    )


def reference_blocks(
    known: ReferenceModels | None, fem: Remedy = FEM_REMEDY, *, assumed: bool = False
) -> list[Block]:
    """Return the errors of the reference models, and the family that they point to.

    Parameters
    ----------
    known
        The reference models; None where the columns do not allow them.
    fem
        How the FEM of a body is made that did not run yet.
    assumed
        Whether the noise is only assumed.
    """
    if known is None:
        text = "No references: they need all six pose and wrench columns and the length."
        return [TextBlock(text)]
    levels = known.levels()
    if assumed:
        levels.pop("noise floor")
    lost = [name for name, value in levels.items() if value >= USELESS]
    shown = {name: value for name, value in levels.items() if name not in lost}
    over = "an assumed noise: only the ratios count" if assumed else "the noise"
    quotient = f"error / {'assumed ' * assumed}noise"
    blocks: list[Block] = [] if assumed else [TextBlock(known.sentence(), strong=True)]
    if known.fem_needed:
        blocks.append(CodeBlock(str(Remedy(fem.words)), fem.shown))
    if lost:
        names = f"The {' and the '.join(lost)} do{'es' * (len(lost) == 1)}"
        blocks.append(TextBlock(f"{names} not extrapolate to the held-out rows."))
    rows = [[name, shown.get(name), _CAN_FIT[name]] for name in levels]
    caption = f"Error over {over}, {HELD_OUT[known.by]} held out. What each reference leaves."
    return [
        *blocks,
        TableBlock(caption, ("reference", quotient, "what it can fit"), rows),
        FigureBlock(
            "The same side by side. A fall from one to the next is the family of what is "
            "missing: symmetric, asymmetric, or no function of the pose.",
            draw.bars({"held-out rows": list(shown.values())}, list(shown), y_title=quotient),
        ),
    ]


def fitted_here(model: Model, table: Table) -> int:
    """Return how many values of the model were fitted to this very table."""
    tables = (table.measured(), without_zero_readings(table))
    if not any(was_trained_on(model.training, rows) for rows in tables):
        return 0
    base = 0 if model.base_frozen else len(model.base.coefficients)
    return base + sum(len(item.values) for item in model.effects if not item.frozen)
