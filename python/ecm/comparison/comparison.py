"""Compare a model with measurements: noise floor, excess error, one plain sentence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ecm.comparison.result import STEPS, Compared, Comparison, Component, fitted_here
from ecm.comparison.structure import run_outliers
from ecm.errors import InputError
from ecm.io.arrays import F, I, rms
from ecm.io.events import Progress, Steps
from ecm.io.table import MetaLike, Table, TableLike, takes_table
from ecm.models.errors import residuals_by_block
from ecm.models.fit import as_model
from ecm.models.joint_fit import estimate_noise, quieter
from ecm.models.model import Model
from ecm.models.prediction import beyond_reach
from ecm.regression.blas import one_blas_thread
from ecm.regression.f_test import FTest, lack_of_fit
from ecm.regression.folds import HOW, RowsUsed, repeat_cells, row_groups, spread_rows
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows, inputs_of, taken_by

_BOOTSTRAPS = 400
_LEVEL = 0.9
_DRAWN_AT_ONCE = 4_000_000
"""Numbers of resampled groups that are held at once."""


@takes_table()
@one_blas_thread()
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
    model = as_model(model, table)
    taken = taken_by(model.base)
    lacking = [name for name in (*taken, *model.outputs) if not table.has(name)]
    if lacking:
        raise InputError(
            f"{table.source}: no column {lacking[0]}, which the model {model.name} needs; "
            f"it has inputs {', '.join(taken)} and outputs {', '.join(model.outputs)}"
        )
    steps = Steps(STEPS, progress)
    steps.begin("errors")
    table = table.with_length(model.known_length_m)
    rows = Rows(table, model.base)
    predicted = model.readings(table)
    chosen = spread_rows(table, most_rows)
    if noise is None:
        some = Rows(table.subsample(chosen), model.base)
        noise = estimate_noise(some, predicted[chosen], fallback=model.noise)
        if model.effects and noise.source == "repeats":
            noise = quieter(some, noise, some.sensor_load, fallback=model.noise)
    scored = table.of_poses
    physical, whitened, variance = (
        values[scored] for values in residuals_by_block(rows, predicted, noise, model.base.error)
    )
    groups = row_groups(table)[scored]
    excited = np.ptp(table.matrix(model.outputs)[scored], axis=0) > 1e-12
    if not excited.any():
        excited[:] = True
    mean = float((whitened[:, excited] ** 2).mean())
    draws = _bootstrap(physical**2 - variance, whitened[:, excited] ** 2 - 1.0, groups, seed)
    cells, fitted = repeat_cells(table)[scored], fitted_here(model, table)
    # Whitening mixes components: each by itself is divided by its own standard deviation.
    alone = physical / np.sqrt(variance)
    components = tuple(
        Component(
            name=name,
            rmse=rms(physical[:, j]),
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
        outside_domain=int(model.extrapolates(inputs_of(model.base, table)[scored]).sum()),
        whitened=whitened,
        physical=physical,
        row=np.flatnonzero(scored),
        warnings=(
            *(r.sentence() for r in run_outliers(table, model.inputs, model.outputs)),
            *beyond_reach(model, rows.poses[scored]),
            *_by_another_clock(model, table, of_fit=fitted > 0),
        ),
        compared=Compared(model, table, predicted, chosen),
        rows_used=_rows_used(len(table), len(chosen), len(model.outputs)),
    )


def _by_another_clock(model: Model, table: Table, *, of_fit: bool) -> Iterator[str]:
    """Say of each effect that acts from a moment on where that lies in rows of another clock.

    Nothing of the rows of the fit, and of rows that are all read later.
    """
    if not table.has("time_s"):
        return
    time_s = table.column("time_s")
    for item in model.effects:
        moment = item.effect.acts_after_s
        if moment is None or time_s.min() > moment or (of_fit and time_s.max() > moment):
            continue
        before, last = time_s <= moment, ""
        rows = f"all of these rows, {time_s.min():g} to {time_s.max():g} s, are"
        if not before.all():
            rows = f"{before.sum()} of these rows, up to that, are"
            last = (
                f"; where it did not come, ecm refit MODEL DATA --remove {item.id} --out "
                "MODEL.json is the model without it"
            )
        yield (
            f"{item.id} acts after {moment:g} s by the clock of its fit: {rows} predicted as if "
            "it had not come yet; where they were read later, let their time_s go on from that of "
            f"the fit{last}"
        )


def _rows_used(total: int, used: int, outputs: int) -> RowsUsed | None:
    if used == total:
        return None
    enough = (
        "the errors and their intervals are those of all rows; noise, references and maps rest on "
        "these, where chance changes a share of the residual by "
        f"{np.sqrt(2.0 / (used * outputs)):.1g}"
    )
    return RowsUsed(total, used, HOW, enough)


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
