"""Errors on rows that a fit has not seen; choice of a model and of the number of poses.

The one-standard-error rule: of all candidates whose error is within one standard error of the
best one's, the one with the fewest coefficients. With all six pose and wrench columns errors are
whitened by the noise of each row, so that 1 is the noise floor and all components count alike. The
noise of other columns may not be known: their errors are over their spread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm.effects import Rows
from ecm.errors import EcmError, InputError
from ecm.io.arrays import F, I, rms_of_columns
from ecm.io.columns import POSE, WRENCH
from ecm.io.events import Printed, Progress, tell_part
from ecm.io.extras import require
from ecm.io.settings import MOST_OF_ONE_INPUT, POLYNOMIAL_DEGREES
from ecm.io.table import MetaLike, Table, TableLike, takes_table
from ecm.models.actuated import ActuatedModel
from ecm.models.energy import EnergyModel
from ecm.models.fit import fit_base, polynomial
from ecm.models.joint_fit import estimate_noise
from ecm.models.maps import (
    CHOOSE,
    ModelSpecification,
    PolynomialMap,
    StiffnessMap,
    way_of_few_rows,
)
from ecm.models.partial import measured_part
from ecm.models.polynomial import PolynomialModel
from ecm.models.registry import parse_model
from ecm.regression.blas import one_blas_thread
from ecm.regression.folds import groups_to_hold_out
from ecm.regression.noise import whiteners
from ecm.regression.rows import inputs_of
from ecm.report import figures

Told = Callable[[float, float], object] | None
"""Called with the part that is done, and the whole."""


_MANY_ROWS = 1000
"""Rows from which each fold's equations are left out of those of all rows.

Below it a step from the fit to all rows errs, though by less than 1 % at 60 rows.
"""


@dataclass(frozen=True, repr=False)
class CrossValidation(Printed):
    """Root mean square error on rows that the fit has not seen.

    Examples
    --------
    >>> print(CrossValidation({"fx_N": 0.5}, {"fx_N": 10.0}, 10, True))
    10 folds of groups of rows: held-out error over the spread fx_N 0.050
    """

    rmse: dict[str, float]
    """Root mean square error of each wrench column, N or N m."""
    spread: dict[str, float]
    """Standard deviation of each wrench column, for scale."""
    folds: int
    grouped: bool
    """Whether groups (`[columns] group`, or pose_id) stayed together."""

    @property
    def shares(self) -> dict[str, float]:
        """Error over spread of each wrench column that varies."""
        return {name: self.rmse[name] / s for name, s in self.spread.items() if s > 0.0}

    def __str__(self) -> str:
        of = "groups of rows" if self.grouped else "random rows"
        shares = ", ".join(f"{name} {share:.3f}" for name, share in self.shares.items())
        return f"{self.folds} folds of {of}: held-out error over the spread {shares}"

    def to_pandas(self) -> Any:
        """Return a DataFrame with a row for each wrench column; needs the extra `data`."""
        pandas = require("pandas", "data", "CrossValidation.to_pandas")
        return pandas.DataFrame({"rmse": self.rmse, "spread": self.spread})


@takes_table()
@one_blas_thread()
def cross_validate(
    table: TableLike,
    model: ModelSpecification | str,
    *,
    meta: MetaLike = None,
    folds: int = 10,
    grouped: bool = True,
    seed: int = 0,
    fitted: StiffnessMap | None = None,
    progress: Told = None,
) -> CrossValidation:
    """Held-out errors of a model; groups of rows stay together unless asked otherwise.

    A random split flatters a model wherever rows come in groups: it is there for comparison.

    Parameters
    ----------
    table
        Pose and wrench columns, as a table, a data frame, a dict or a file; only measured rows
        count.
    model
        A specification or its short name.
    meta
        Description of the data, as a dict of what the TOML beside it would hold, or that file.
    folds
        Number of parts; at most the number of groups.
    grouped
        Keep groups (`[columns] group`, or pose_id) together.
    seed
        Seed of the random generator.
    fitted
        Map that was fitted to all rows, if there is one. From 1,000 rows on a polynomial or energy
        is not fitted anew for each fold: its equations without the fold are solved, for energies
        linearised at the fit to all rows.
    progress
        Called with the number of folds that are done, and of all; before it, of many rows, with
        those that are read.

    Raises
    ------
    InputError
        Where there is only one group, or a part of the rows is too few for the model.

    Examples
    --------
    >>> x = np.linspace(-0.01, 0.01, 20)
    >>> errors = cross_validate({"x_m": x, "fx_N": 2000.0 * x}, "linear", folds=4)
    >>> errors.rmse["fx_N"] < 1e-9
    True
    """
    specification, measured = parse_model(model), table.measured()
    if not measured.wrench_columns:
        raise InputError(f"{table.source}: no wrench column to predict; name one such as fx_N")
    groups = groups_to_hold_out(measured) if grouped else np.arange(len(measured), dtype=np.int64)
    fold = random_folds(measured, groups, folds, seed)
    outputs = measured.wrench_columns
    truth = measured.matrix(outputs)
    residual = np.empty_like(truth)
    count = int(fold.max()) + 1
    told = progress or (lambda done, total: None)
    maps = None
    if len(measured) >= _MANY_ROWS:
        maps = specification.maps_without(
            measured, fold, fitted, lambda done, total, _: told(done, total)
        )
    told(0, count)
    reached = 0.0

    def part_told(done: float, total: float, words: str) -> None:
        # A fit counts each of its steps anew.
        nonlocal reached
        reached = max(reached, part + done / total)
        told(reached, count)

    for part in range(count):
        test = measured.select(np.flatnonzero(fold == part))
        if maps is None:
            train = measured.select(np.flatnonzero(fold != part))
            waiting = None if progress is None else part_told
            base = fit_base(train, specification, waiting)
        else:
            base = maps[part]
        predicted = measured_part(base, test).predict(inputs_of(base, test))
        residual[fold == part] = truth[fold == part] - predicted
        told(part + 1, count)
    rmse = rms_of_columns(residual)
    return CrossValidation(
        rmse=dict(zip(outputs, rmse.tolist(), strict=True)),
        spread=dict(zip(outputs, truth.std(axis=0).tolist(), strict=True)),
        folds=count,
        grouped=grouped,
    )


def random_folds(table: Table, groups: I, folds: int, seed: int) -> I:
    """(N,) number of each row's fold; rows of one group stay together."""
    if folds < 2:
        raise InputError(f"folds = {folds}: expected 2 or more, a part to hold out and one to fit")
    count = int(groups.max()) + 1
    parts = min(folds, count)
    if parts < 2:
        raise InputError(f"{table.source}: all rows are one pose. Measure more, to hold some out.")
    of_group = np.empty(count, dtype=np.int64)
    of_group[np.random.default_rng([seed, 7]).permutation(count)] = np.arange(count) % parts
    return np.asarray(of_group[groups])


@dataclass(frozen=True, repr=False)
class ModelChoice(Printed):
    """Cross-validation error of each candidate, and which one to take.

    Examples
    --------
    >>> models = (PolynomialModel(1), EnergyModel(4))
    >>> errors = np.array([45.5, 1.07]), np.array([2.1, 0.03])
    >>> print(ModelChoice(models, (42, 22), *errors, chosen=1).best.name)
    energy4
    """

    candidates: tuple[ModelSpecification, ...]
    coefficients: tuple[int, ...]
    error: F
    """(c,) root mean square whitened error on held-out folds; infinite where a fit failed."""
    standard_error: F
    """(c,) of `error`, over folds."""
    chosen: int
    over: str = "noise"
    """What 1 is in `error`: the noise, as assumed or known, or the spread of the readings."""

    @property
    def best(self) -> ModelSpecification:
        """The one to take."""
        return self.candidates[self.chosen]

    def sentences(self) -> list[str]:
        """The held-out error of each candidate, and the rule of the choice."""
        lines = [
            f"{candidate.title}: {size} coefficients, held-out error {error:.3g} +- {sd:.2g} "
            f"of the {self.over}"
            for candidate, size, error, sd in zip(
                self.candidates, self.coefficients, self.error, self.standard_error, strict=True
            )
            if np.isfinite(error)
        ]
        rule = "the fewest coefficients within one standard error of the smallest error"
        return [*lines, f"chosen: {rule}"]

    def __str__(self) -> str:
        return "\n".join([*self.sentences(), f"that is {self.best.title}"])

    def to_dict(self) -> dict[str, Any]:
        """The candidates as plain values."""
        listed = [
            {
                "model": candidate.alias,
                "pcr": candidate.pcr if isinstance(candidate, PolynomialModel) else None,
                "coefficients": self.coefficients[i],
                "error": float(self.error[i]) if np.isfinite(self.error[i]) else None,
                "chosen": i == self.chosen,
            }
            for i, candidate in enumerate(self.candidates)
        ]
        return {"candidates": listed}

    def to_pandas(self) -> Any:
        """Return a DataFrame with a row for each candidate; needs the extra `data`."""
        columns = {
            "coefficients": self.coefficients,
            "error": self.error,
            "standard_error": self.standard_error,
        }
        pandas = require("pandas", "data", "ModelChoice.to_pandas")
        return pandas.DataFrame(columns, [candidate.title for candidate in self.candidates])


def default_candidates(table: Table) -> list[ModelSpecification]:
    """Models of `ecm fit --model choose`: polynomials, and energies where the length is known."""
    if not table.has(*POSE):
        most = MOST_OF_ONE_INPUT if len(table.pose_columns) == 1 else POLYNOMIAL_DEGREES[1]
        return [PolynomialModel(degree) for degree in range(1, most + 1)]
    candidates: list[ModelSpecification] = [PolynomialModel(degree) for degree in (1, 2, 3)]
    candidates += [PolynomialModel(3, "press"), PolynomialModel(3, "0.01/sqrtN")]
    if table.meta.length_m is not None and table.actuation_columns:
        candidates += [ActuatedModel(degree) for degree in (3, 4, 5)]
        # Of ends that differ, and of chambers of any size and place, each of which acts for itself.
        candidates.append(ActuatedModel(4, "revolution"))
        candidates += [ActuatedModel(degree, "general", 1) for degree in (3, 4)]
    elif table.meta.length_m is not None:
        candidates += [EnergyModel(degree) for degree in (4, 5, 6)]
        # Of bodies whose ends differ, and of those without symmetry.
        candidates += [EnergyModel(degree, "revolution") for degree in (4, 6)]
        candidates.append(EnergyModel(4, "general"))
    return candidates


@one_blas_thread()
def choose_model(
    table: Table,
    candidates: Sequence[ModelSpecification | str] | None = None,
    *,
    folds: int = 10,
    seed: int = 0,
    progress: Progress | None = None,
) -> ModelChoice:
    """Grouped cross-validation with the one-standard-error rule.

    Parameters
    ----------
    table
        Pose and wrench columns; rows of one group, or one pose_id, stay together.
    candidates
        Specifications or short names; else `default_candidates`.
    folds
        Number of parts; at most the number of groups.
    seed
        Seed of the random generator.
    progress
        Called with the number of fits that are done, of all, and the candidate that begins.

    Raises
    ------
    InputError
        Without candidates, or where the rows are too few for all of them.

    Examples
    --------
    >>> from ecm.io.columns import POSE, WRENCH
    >>> from ecm.io.table import as_table
    >>> random = np.random.default_rng(0)
    >>> poses = random.uniform(-0.01, 0.01, (60, 6))
    >>> wrenches = 1000.0 * poses + random.normal(0.0, 0.01, (60, 6))
    >>> names = (*POSE, *WRENCH)
    >>> table = as_table(dict(zip(names, np.hstack([poses, wrenches]).T, strict=True)))
    >>> choose_model(table, ["linear", "quadratic"], folds=3).best.name
    'poly:1'
    """
    tried = default_candidates(table) if candidates is None else candidates
    listed = tuple(parse_model(candidate) for candidate in tried)
    if not listed:
        raise InputError("choose_model: no candidates; give at least one model name")
    measured = table.measured()
    fold = random_folds(measured, groups_to_hold_out(measured), folds, seed)
    whitener, over = _whitener(measured, listed)
    error, spread, sizes = [], [], []
    parts = int(fold.max()) + 1
    for place, candidate in enumerate(listed):
        squares, size, maps = [], 0, None
        try:
            if len(measured) >= _MANY_ROWS:
                tell_part(progress, place * parts, len(listed) * parts, candidate.title)
                maps = candidate.maps_without(measured, fold, None)
            for part in range(parts):
                tell_part(progress, place * parts + part, len(listed) * parts, candidate.title)
                base = maps[part] if maps else fit_base(measured.select(fold != part), candidate)
                square, size = _square(base, measured, np.flatnonzero(fold == part), whitener)
                squares.append(square)
        except EcmError:
            squares = [np.inf]
        sizes.append(size)
        mean = float(np.mean(squares))
        error.append(np.sqrt(mean))
        spread.append(_standard_error(squares))
    if not np.isfinite(error).any():
        raise _too_few(measured)
    best = int(np.argmin(error))
    within = np.asarray(error) <= error[best] + spread[best]
    order = [i for i in np.argsort(sizes, kind="stable") if within[i]]
    errors, sd = np.array(error), np.array(spread)
    return ModelChoice(listed, tuple(sizes), errors, sd, int(order[0]), over)


_TESTED, _ALIKE = 0.25, 0.05


@dataclass(frozen=True, repr=False)
class LearningCurve(Printed):
    """Held-out error against the number of poses.

    Examples
    --------
    >>> error = np.array([1.6, 1.1])
    >>> curve = LearningCurve("energy4", (10, 20), error, error, error, 20, 20)
    >>> print(curve)
    energy4 from 10 poses: held-out error 1.6 of the noise
    energy4 from 20 poses: held-out error 1.1 of the noise
    enough: 20 poses are within 5 %, 20 within one standard error of the best
    """

    model: str
    """Short name of the model."""
    sizes: tuple[int, ...]
    error: F
    """(s,) median over draws of the whitened held-out error; infinite where no fit was possible."""
    lower: F
    """(s,) quartile."""
    upper: F
    """(s,) quartile."""
    enough: int | None
    """The fewest poses that the stop rule accepts, None where more are needed."""
    one_standard_error: int | None
    """The fewest poses whose mean error over draws is within one standard error of the best's."""
    over: str = "noise"
    """What 1 is in `error`: the noise, as assumed or known, or the spread of the readings."""

    def sentences(self) -> list[str]:
        """The error at each number of poses, and how many are enough."""
        lines = [
            f"{self.model} from {n} poses: held-out error {error:.3g} of the {self.over}"
            for n, error in zip(self.sizes, self.error, strict=True)
            if np.isfinite(error)
        ]
        enough = "not enough: the curve still falls at the last of these; measure more poses"
        if self.enough is not None:
            enough = (
                f"enough: {self.enough} poses are within 5 %, {self.one_standard_error} within "
                "one standard error of the best"
            )
        return [*lines, enough]

    def __str__(self) -> str:
        return "\n".join(self.sentences())

    def to_dict(self) -> dict[str, Any]:
        """The curve as plain values."""
        return {
            "sizes": list(self.sizes),
            "error": [float(e) if np.isfinite(e) else None for e in self.error],
            "enough": self.enough,
            "one_standard_error": self.one_standard_error,
        }

    def plot(self) -> Any:
        """Return a plotly figure of the curve with its quartiles; needs the extra `report`."""
        bands = {"median": self.error, "lower quartile": self.lower, "upper quartile": self.upper}
        series = {name: (list(self.sizes), band.tolist()) for name, band in bands.items()}
        figure = figures.lines(series, x_title="poses", y_title=f"error / {self.over}", log_y=True)
        return figures.plotly_figure(figure)

    def to_pandas(self) -> Any:
        """Return a DataFrame with a row for each number of poses; needs the extra `data`."""
        columns = {"error": self.error, "lower": self.lower, "upper": self.upper}
        return require("pandas", "data", "LearningCurve.to_pandas").DataFrame(columns, self.sizes)


def learning_curve(
    table: Table,
    model: ModelSpecification | str,
    sizes: Sequence[int],
    *,
    draws: int = 8,
    seed: int = 0,
    progress: Progress | None = None,
) -> LearningCurve:
    """How many poses are enough for a model.

    The error is that on a quarter of the poses. The stop rule: the fewest poses whose error is
    within 5 % of the smallest on the curve, provided that the curve has become flat there: the
    largest size must not be better than the one before by more than 5 %. `one_standard_error` uses
    the standard error over the draws in place of the share.

    Parameters
    ----------
    table
        Pose and wrench columns.
    model
        A specification or its short name.
    sizes
        Numbers of poses to fit to; those that leave too few to test are left out.
    draws
        Random choices of poses for each size.
    seed
        Seed of the random generator.
    progress
        Called with the poses that were fitted so far, those of all fits, and those of the next.

    Raises
    ------
    InputError
        Where every size leaves too few poses to test.

    Examples
    --------
    >>> from ecm.io.columns import POSE, WRENCH
    >>> from ecm.io.table import as_table
    >>> random = np.random.default_rng(0)
    >>> poses = random.uniform(-0.01, 0.01, (60, 6))
    >>> wrenches = 1000.0 * poses + random.normal(0.0, 0.01, (60, 6))
    >>> names = (*POSE, *WRENCH)
    >>> table = as_table(dict(zip(names, np.hstack([poses, wrenches]).T, strict=True)))
    >>> learning_curve(table, "linear", [10, 20, 40], draws=2).sizes
    (10, 20, 40)
    """
    specification, measured = parse_model(model), table.measured()
    groups = groups_to_hold_out(measured)
    count = int(groups.max()) + 1
    tests = max(1, round(_TESTED * count))
    whitener, over = _whitener(measured, [specification])
    usable = [n for n in sizes if n <= count - tests]
    if not usable:
        raise InputError(
            f"{table.source}: {count} poses, {tests} of them held out: give sizes up to "
            f"{count - tests}, found {list(sizes)}"
        )
    errors = np.full((len(usable), draws), np.inf)
    steps = 0
    for d in range(draws):
        order = np.random.default_rng([seed, d]).permutation(count)
        test = np.flatnonzero(np.isin(groups, order[:tests]))
        for s, n in enumerate(usable):
            rows = np.flatnonzero(np.isin(groups, order[tests : tests + n]))
            tell_part(progress, steps, draws * sum(usable), f"{n} poses")
            steps += n
            with suppress(EcmError):
                base = fit_base(measured.select(rows), specification)
                square, _ = _square(base, measured, test, whitener)
                errors[s, d] = np.sqrt(square)
    middle = np.median(errors, axis=1)
    lower, upper = np.sort(errors, axis=1)[:, [draws // 4, -1 - draws // 4]].T
    enough = None
    flat = len(usable) > 1 and middle[-2] <= (1.0 + _ALIKE) * middle[-1]
    if flat and np.isfinite(middle[-1]):
        within = middle <= (1.0 + _ALIKE) * middle.min()
        enough = usable[int(np.argmax(within))]
    mean, few = errors.mean(axis=1), None
    if np.isfinite(mean).any() and draws > 1:
        best = int(np.argmin(mean))
        spread = float(errors[best].std(ddof=1)) / np.sqrt(draws)
        few = usable[int(np.argmax(mean <= mean[best] + spread))]
    return LearningCurve(
        specification.alias, tuple(usable), middle, lower, upper, enough, few, over
    )


def _standard_error(squares: Sequence[float]) -> float:
    """Standard error of the root of the mean square, by d sqrt(s) = ds / (2 sqrt(s))."""
    mean = float(np.mean(squares))
    if not np.isfinite(mean):
        return np.inf
    deviation = float(np.std(squares, ddof=1))
    return float(deviation / np.sqrt(len(squares)) / (2 * np.sqrt(mean)))


def _whitener(table: Table, models: Sequence[ModelSpecification]) -> tuple[F, str]:
    """(N, m, m) from the noise, the stiffness from a smooth fit of all rows; what 1 is then.

    Of fewer columns one over the spread; a column that never varies has none.
    """
    if not table.has(*POSE, *WRENCH):
        truth = table.matrix(table.wrench_columns)
        varies = np.ptp(truth, axis=0) > 1e-12
        spread = np.where(varies, truth.std(axis=0), np.inf)
        return np.tile(np.diag(1.0 / spread), (len(table), 1, 1)), "spread"
    rows = Rows(table, _smooth(table, models))
    noise = estimate_noise(rows, rows.sensor_load)
    return whiteners(noise.covariance(rows)), "assumed noise" if noise.is_assumed else "noise"


def _smooth(table: Table, models: Sequence[ModelSpecification]) -> StiffnessMap:
    """The polynomial; of rows that are too few for one the first of the models that they carry."""
    with suppress(EcmError):
        return polynomial(table)
    for model in models:
        with suppress(EcmError):
            return measured_part(fit_base(table, model), table)
    raise _too_few(table)


def _too_few(measured: Table) -> InputError:
    way = way_of_few_rows(measured)
    return InputError(
        f"{measured.source}: {len(measured)} rows are too few for every candidate; "
        "measure more poses or name smaller models",
        remedy=None if way is CHOOSE else way,  # that was tried
    )


def _square(base: StiffnessMap, table: Table, test: I, whitener: F) -> tuple[float, int]:
    """Mean whitened square on the rows `test` of a fit to others, and its free coefficients.

    Those of a principal component regression are of its rank.
    """
    part = table.select(test)
    residual = part.matrix(base.outputs) - base.predict(inputs_of(base, part))
    square = float((np.einsum("nij,nj->ni", whitener[test], residual) ** 2).mean())
    if isinstance(base, PolynomialMap) and base.model.rank > 0:
        return square, base.model.rank * len(base.outputs)
    return square, len(base.coefficients)
