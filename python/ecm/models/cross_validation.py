"""Errors on rows that a fit has not seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arguments import check_arguments
from ecm.io.arrays import I
from ecm.io.extras import require
from ecm.io.table import MetaLike, Table, TableLike, as_table
from ecm.models.fit import fit_rows
from ecm.models.maps import StiffnessMap
from ecm.models.partial import measured_part
from ecm.models.registry import parse_model
from ecm.models.specification import ModelSpecification
from ecm.regression.blocks import MANY_ROWS
from ecm.regression.folds import row_groups


@dataclass(frozen=True)
class CrossValidation:
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


def cross_validate(
    table: TableLike,
    model: ModelSpecification | str,
    *,
    meta: MetaLike = None,
    folds: int = 10,
    grouped: bool = True,
    seed: int = 0,
    fitted: StiffnessMap | None = None,
    progress: Callable[[float, float], object] | None = None,
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
        Map that was fitted to all rows, if there is one. From 10,000 rows on a polynomial or energy
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
    check_arguments(cross_validate, locals())
    table = as_table(table, meta=meta)
    specification, measured = parse_model(model), table.measured()
    if not measured.wrench_columns:
        raise InputError(f"{table.source}: no wrench column to predict; name one such as fx_N")
    groups = row_groups(measured) if grouped else np.arange(len(measured), dtype=np.int64)
    fold = random_folds(measured, groups, folds, seed)
    outputs = measured.wrench_columns
    truth = measured.matrix(outputs)
    residual = np.empty_like(truth)
    count = int(fold.max()) + 1
    told = progress or (lambda done, total: None)
    maps = None
    if len(measured) >= MANY_ROWS:
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
            base = fit_rows(train, specification, progress=waiting).base
        else:
            base = maps[part]
        predicted = measured_part(base, test).predict(test.matrix(base.inputs))
        residual[fold == part] = truth[fold == part] - predicted
        told(part + 1, count)
    rmse = np.sqrt((residual**2).mean(axis=0))
    return CrossValidation(
        rmse=dict(zip(outputs, rmse.tolist(), strict=True)),
        spread=dict(zip(outputs, truth.std(axis=0).tolist(), strict=True)),
        folds=count,
        grouped=grouped,
    )


def random_folds(table: Table, groups: I, folds: int, seed: int) -> I:
    """(N,) number of each row's fold; rows of one group stay together."""
    count = int(groups.max()) + 1
    parts = min(folds, count)
    if parts < 2:
        raise InputError(f"{table.source}: only one group of rows; cross-validation needs two")
    of_group = np.empty(count, dtype=np.int64)
    of_group[np.random.default_rng([seed, 7]).permutation(count)] = np.arange(count) % parts
    return np.asarray(of_group[groups])
