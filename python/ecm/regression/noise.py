"""Noise of a row: Sigma = Sigma_w + K_s Sigma_p K_s' + Sigma_base, a full matrix.

The pose noise acts through the stiffness: the stiff axis has most of it, and the components are
correlated. Its rotations are increments in base axes (isotropic, hence the same in top axes), which
act through K_s = K diag(I, J^-1).

The noise of the reading from which the zero was taken is the same in all rows: a constant wrench
in body axes, which more rows do not reduce. Later readings of the free sensor show its size.
Readings of exactly zero were new zeros; their errors are not seen and average out over the
campaign.

REML: the four standard deviations of a row, from repeats of a pose or from a residual. Repeats are
spread over the run, so they also vary with drift, temperature and side of approach. The part that
given columns can explain is projected out; the rest is noise. A weak prior keeps each figure near
the declared one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F, I, evenly, rest_of
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.regression.f_test import root_of_inverse
from ecm.regression.folds import repeat_contrasts
from ecm.regression.rows import Rows, is_whole
from ecm.regression.slow_noise import SlowPart, Whitener

Source = Literal["repeats", "declared", "assumed"]
_FIGURES = ("position_sd_m", "rotation_sd_rad", "force_sd_N", "torque_sd_Nm")


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one row, and where they come from.

    Parameters
    ----------
    position_sd_m, rotation_sd_rad, force_sd_N, torque_sd_Nm
        Standard deviations per axis.
    source
        `repeats`, `declared` or `assumed`.
    components
        (m,) standard deviations of the outputs instead, for tables of other columns; they hold the
        pose noise as well.
    growth_per_N, growth_per_Nm
        Heteroscedastic noise: sigma^2 (1 + (g h)^2) of forces and of torques.

    Examples
    --------
    >>> noise = Noise(force_sd_N=0.2, source="declared")
    >>> noise.to_dict()["force_sd_N"], noise == Noise.from_dict(noise.to_dict())
    (0.2, True)
    """

    position_sd_m: float = 40e-6
    rotation_sd_rad: float = 4e-4
    force_sd_N: float = 0.3
    torque_sd_Nm: float = 0.010
    source: Source = "assumed"
    components: tuple[float, ...] | None = None
    growth_per_N: float = 0.0
    growth_per_Nm: float = 0.0
    slow: SlowPart | None = None
    """Part of the noise of a log that stays alike for a while."""

    @property
    def is_assumed(self) -> bool:
        """Whether neither repeats nor figures tell the noise: an error has no floor to stand on.

        Whether the figures are those of a common rig or the spread of a residual (`is_residual`).
        """
        return self.source == "assumed"

    @property
    def is_residual(self) -> bool:
        """Whether nothing is known of the noise, and the spread of a residual stands in its place.

        Such figures weigh the components; they are no noise, and no error may be held against them.
        """
        return self.components is not None and self.source == "assumed"

    @property
    def unit(self) -> str:
        """What errors over these figures are multiples of, in words."""
        stand_in = "the base's own residual" if self.is_residual else "an assumed noise"
        return stand_in if self.is_assumed else "the noise"

    def parameters(self) -> F:
        """(4,) position, rotation, force, torque."""
        return np.array([getattr(self, name) for name in _FIGURES])

    def with_parameters(self, values: F, source: Source) -> Noise:
        """Other figures from another source."""
        named: dict[str, Any] = dict(zip(_FIGURES, map(float, values), strict=True))
        return replace(self, source=source, **named)

    def covariance(self, rows: Rows, base_error: F | None = None) -> F:
        """(N, m, m) covariance of the residual of each row."""
        if self.components is not None:  # they hold what the base errs as well
            covariance = np.tile(np.diag(np.square(self.components)), (len(rows), 1, 1))
            base_error = None
        else:
            outputs = rows.base.outputs
            of_wrench = [self.force_sd_N if n in WRENCH[:3] else self.torque_sd_Nm for n in outputs]
            acting = rows.acting_stiffness * self.pose_sd(rows.base.inputs)
            covariance = acting @ np.swapaxes(acting, 1, 2)
            covariance += np.diag(np.square(of_wrench))
        if self.growth_per_N > 0.0 or self.growth_per_Nm > 0.0:
            covariance += self.grown(rows)
        if base_error is not None:
            loaded = (~rows.unloaded).astype(np.float64)
            covariance += loaded[:, None, None] * np.diag(np.square(base_error))
        return np.asarray(covariance)

    def whitener(self, rows: Rows, base_error: F | None = None) -> Whitener:
        """What makes the noise of rows independent and of variance 1."""
        along = None if self.slow is None else self.slow.along(rows.table)
        return Whitener(whiteners(self.covariance(rows, base_error)), along)

    def pose_sd(self, inputs: Sequence[str]) -> F:
        """(n,) standard deviations of pose columns."""
        of_place = [name in POSE[:3] for name in inputs]
        return np.where(of_place, self.position_sd_m, self.rotation_sd_rad)

    def variances(self, rows: Rows, base_error: F | None = None) -> F:
        """(N, m) of the residual of each row."""
        return np.asarray(np.einsum("njj->nj", self.covariance(rows, base_error)))

    def grown(self, rows: Rows) -> F:
        """(N, m, m) diagonal (sigma g h)^2, by which the load raises the covariance."""
        force = np.array([name in WRENCH[:3] for name in rows.base.outputs])
        sd = np.where(force, self.force_sd_N, self.torque_sd_Nm)
        sd = sd if self.components is None else np.array(self.components)
        growth = np.where(force, self.growth_per_N, self.growth_per_Nm)
        own = (sd * growth * rows.wrench) ** 2
        return np.asarray(own[:, :, None] * np.eye(len(force)))

    def to_dict(self) -> dict[str, Any]:
        """For model files and reports."""
        grown = {"growth_per_N": self.growth_per_N, "growth_per_Nm": self.growth_per_Nm}
        known = {name: value for name, value in grown.items() if value > 0.0}
        if self.components is not None:
            return known | {"source": self.source, "components": list(self.components)}
        figures = {name: getattr(self, name) for name in _FIGURES}
        return known | {"source": self.source} | figures

    @staticmethod
    def from_dict(document: dict[str, Any]) -> Noise:
        """The noise of a model file."""
        if "components" in document:
            return Noise(**document | {"components": tuple(map(float, document["components"]))})
        return Noise(**document)


def covariance_parts(rows: Rows) -> F:
    """(4, N, m, m) covariance per unit variance of position, rotation, force, torque."""
    inputs, outputs = rows.base.inputs, rows.base.outputs
    stiffness = rows.acting_stiffness
    position = np.array([name in POSE[:3] for name in inputs])
    force = np.array([name in WRENCH[:3] for name in outputs])
    along, about = stiffness[:, :, position], stiffness[:, :, ~position]
    of_pose = (part @ np.swapaxes(part, 1, 2) for part in (along, about))
    of_wrench = (np.diag(own.astype(np.float64)) for own in (force, ~force))
    return np.stack(np.broadcast_arrays(*of_pose, *of_wrench))


_ALL = (*POSE, *WRENCH)
_OF_COLUMNS = {
    "pose_position_sd_m": POSE[:3],
    "pose_rotation_sd_rad": POSE[3:],
    "force_sd_N": WRENCH[:3],
    "torque_sd_Nm": WRENCH[3:],
}
"""The columns that each figure of `[instrument]` is of."""


def declared_noise(table: Table, columns: Sequence[str] = _ALL) -> Noise:
    """Noise by the `[instrument]` figures of a table's description.

    Figures that are not given are assumed. Where all are 0 the data are exact, and the noise of a
    common rig is assumed.

    Parameters
    ----------
    table
        Measurements with their description.
    columns
        Pose and wrench columns that are looked at: a displacement and a force need two of the four
        figures.

    Returns
    -------
    Noise
        Its source is `declared` where every figure that concerns the columns is given, else
        `assumed`.

    Examples
    --------
    >>> from ecm import as_table
    >>> from ecm.io.description import Instrument, Meta
    >>> meta = Meta(instrument=Instrument(pose_position_sd_m=2e-5, force_sd_N=0.1))
    >>> table = as_table({"x_m": [0.1, 0.2], "fx_N": [1.0, 2.0]}, meta=meta)
    >>> declared_noise(table).source, declared_noise(table, ("x_m", "fx_N")).source
    ('assumed', 'declared')
    """
    default = Noise()
    if is_exact(table, columns):
        return default
    given = _figures(table, _ALL).values()
    values = [d if f is None else f for f, d in zip(given, default.parameters(), strict=True)]
    source: Source = "assumed" if lacking_figures(table, columns) else "declared"
    return default.with_parameters(np.array(values), source)


def is_exact(table: Table, columns: Sequence[str] = _ALL) -> bool:
    """Whether the data's TOML declares their noise figures as 0, as simulated pairs do."""
    return all(figure == 0.0 for figure in _figures(table, columns).values())


def lacking_figures(table: Table, columns: Sequence[str]) -> tuple[str, ...]:
    """Names of the figures in `[instrument]` that concern these columns and are not given.

    Examples
    --------
    >>> from ecm import as_table
    >>> table = as_table({"x_m": [0.1, 0.2], "fx_N": [1.0, 2.0]})
    >>> lacking_figures(table, ("x_m", "fx_N"))
    ('pose_position_sd_m', 'force_sd_N')
    """
    figures = _figures(table, columns)
    return tuple(name for name, figure in figures.items() if figure is None)


def _figures(table: Table, columns: Sequence[str]) -> dict[str, float | None]:
    """The figures of `[instrument]` that concern some of these columns, by name."""
    return {
        name: getattr(table.meta.instrument, name)
        for name, own in _OF_COLUMNS.items()
        if set(own) & set(columns)
    }


def whiteners(covariance: F) -> F:
    """(N, m, m) inverse Cholesky factors: W r has unit covariance."""
    try:
        lower = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        if (np.einsum("nii->ni", covariance) > 0.0).all():
            raise InputError(
                "the stiffness of the model is so large that the noise of the poses alone gives "
                "more load than all else: these rows leave some of its coefficients open; fit a "
                "model with fewer, or add poses off the path of these rows"
            ) from None
        raise InputError(
            "a component of the wrench has no noise at all; in [instrument] give force_sd_N and "
            "torque_sd_Nm above 0, or all figures 0 where the data are exact"
        ) from None
    identity = np.broadcast_to(np.eye(covariance.shape[1]), covariance.shape)
    return np.asarray(np.linalg.solve(lower, identity))


LEAST_CONTRASTS = 20
"""Rows beyond the first of their pose that the four figures of full tables need."""
LEAST_CONTRASTS_OF_SOME_COLUMNS = 8
"""The same of tables with other columns, where each output has a figure of its own."""


def noise_source(table: Table, columns: Sequence[str] = ()) -> Source:
    """Where the noise of a table comes from: its repeats, else its `[instrument]`, else assumed.

    Parameters
    ----------
    table
        Measurements with their description.
    columns
        Pose and wrench columns that are looked at; left out: all that the table has.

    Returns
    -------
    Source
        `repeats` from 20 contrasts on (8 where some of the twelve columns are not there or not
        looked at); `declared` where every instrument figure that concerns the columns is given
        and not all are 0; else `assumed`.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table
    >>> columns = {"x_m": 0.1 + 0.001 * np.arange(9.0), "fx_N": np.arange(9.0)}
    >>> noise_source(as_table(columns))
    'assumed'
    >>> noise_source(as_table({**columns, "pose_id": np.zeros(9)}))
    'repeats'
    """
    columns = tuple(columns) or (*table.pose_columns, *table.wrench_columns)
    full = set(columns) == {*POSE, *WRENCH}
    least = LEAST_CONTRASTS if full else LEAST_CONTRASTS_OF_SOME_COLUMNS
    if repeat_contrasts(table) >= least:
        return "repeats"
    return declared_noise(table, columns).source


_LEAST_READINGS = 3


def shared_zero_error(rows: Rows, residual: F, noise: Noise) -> F:
    """(N, 6, 6 c) wrench of each row per standard deviation of the zero's error, in base axes.

    One column for each axis of the top frame and each of c campaigns, which have zeros of their
    own. Standard deviations of force and torque are those of the campaign's unloaded readings, one
    after the other, at most those of a row. A campaign with fewer than three has no columns.

    Parameters
    ----------
    residual
        (N, m) measured minus predicted.
    """
    if not is_whole(rows.base):
        return np.zeros((*residual.shape, 0))
    free = rows.unloaded & rows.table.wrenches.any(axis=1) & ~rows.dead_weight
    most = np.array([noise.force_sd_N, noise.torque_sd_Nm])
    columns = [np.zeros((*residual.shape, 0))]
    for campaign in np.unique(rows.campaign).tolist():
        own = rows.campaign == campaign
        read = free & own
        if read.sum() < _LEAST_READINGS:
            continue
        in_top = np.einsum("nji,nj->ni", rows.base_from_top[read], residual[read])
        # By differences of neighbours: what creeps from reading to reading is no error of one.
        variance = 0.5 * (np.diff(in_top, axis=0) ** 2).mean(axis=0).reshape(2, 3).mean(axis=1)
        sd = np.repeat(np.minimum(np.sqrt(variance), most), 3)
        columns.append(rows.base_from_top * sd * own[:, None, None])
    return np.concatenate(columns, axis=2)


_MOST_ROWS = 400
_ITERATIONS = 30
_OUTLIER = 30.0
"""Squared whitened length beyond which a contrast is left out; six components reach it with
probability 4e-5."""
_GROWS = 12.0
"""Fall of twice the negative log likelihood from which the noise grows with the load; chance makes
one of 2000 larger."""
_PRIOR_DECLARED = 0.5  # standard deviation of log variance around declared figures
_PRIOR_ASSUMED = 3.0
_MOST_NUISANCE = 0.7
"""Columns over readings up to which what they leave tells the noise."""


@dataclass(frozen=True)
class _Contrasts:
    response: F  # (M, m)
    nuisance: F  # (M, m, k)
    parts: F  # (4, M, m, m)


def reml_noise(rows: Rows, residual: F, cells: I, nuisance: F, prior: Noise) -> Noise | None:
    """REML noise of the rows.

    Parameters
    ----------
    rows
        N rows with the six pose and six wrench columns.
    residual
        (N, m) measured minus predicted.
    cells
        (N,) number of the pose that each row repeats; -1 leaves a row out.
    nuisance
        (N, m, k) columns that may vary within a cell without being noise.
    prior
        Declared or assumed noise.

    Returns
    -------
    Noise or None
        None with fewer than 20 contrasts.
    """
    contrasts = _contrasts(rows, residual, cells, nuisance)
    if contrasts is None or len(contrasts.response) < LEAST_CONTRASTS:
        return None
    log_prior = np.log(prior.parameters() ** 2)
    width = _PRIOR_DECLARED if prior.source == "declared" else _PRIOR_ASSUMED
    log_variance, _ = _of_inliers(contrasts, log_prior, width)
    return prior.with_parameters(np.sqrt(np.exp(log_variance)), "repeats")


def some_rows(count: int) -> I:
    """(M,) places of the rows, of so many, that tell the noise."""
    return evenly(count, _MOST_ROWS)


def weighed_by_rest(rows: Rows, residual: F, nuisance: F, assumed: Noise) -> Noise:
    """Assumed noise with the ratios of its figures as what no column explains shows them.

    How pose, force and torque err beside each other decides what is seen; a common rig's ratios
    may be wrong by a hundred. How large the noise is stays as assumed: a rest is no noise.

    Parameters
    ----------
    rows
        N rows with the six pose and six wrench columns.
    residual
        (N, m) measured minus predicted.
    nuisance
        (N, m, k) columns that explain what is no noise, or (M, m, k) of `some_rows(N)` only.
    assumed
        Noise without repeats and declared figures.

    Returns
    -------
    Noise
        As assumed, where the rows are too few for the columns.
    """
    take = some_rows(len(rows))
    nuisance = nuisance if len(nuisance) == len(take) else nuisance[take]
    data = _Contrasts(residual[take], nuisance, covariance_parts(rows)[:, take])
    if data.nuisance.shape[2] > _MOST_NUISANCE * data.response.size:
        return assumed
    log_prior = np.log(assumed.parameters() ** 2)
    log_variance, data = _of_inliers(data, log_prior, _PRIOR_ASSUMED)
    ratio = _left(data, log_prior).sum() / _left(data, log_variance).sum()
    return assumed.with_parameters(np.sqrt(np.exp(log_variance) / ratio), "assumed")


def grown_by_rest(noise: Noise, rows: Rows, squares: F) -> Noise:
    """The spread of each column as one that grows with its load, where a residual shows that.

    A likelihood of variances sigma^2 (1 + (g h)^2), g of all forces and of all torques.

    Parameters
    ----------
    noise
        With `components`; their mean squares stay.
    squares
        (N, m) of a residual, each over the share of it that a fit leaves.
    """
    loads, said = rows.wrench**2, noise
    force = np.array([name in WRENCH[:3] for name in rows.base.outputs])
    components = np.array(noise.components)
    for own, name in ((force, "growth_per_N"), (~force, "growth_per_Nm")):
        if not own.any() or not (largest := loads[:, own].max()) > 0.0:
            continue

        def fit(
            growth: float, load: F = loads[:, own], read: F = squares[:, own]
        ) -> tuple[float, F]:
            shape = 1.0 + growth**2 * load
            size = (read / shape).mean(axis=0)
            cost = np.log(np.maximum(size, 1e-300)).sum() * len(read) + np.log(shape).sum()
            return float(cost), np.sqrt(shape.mean(axis=0))

        tried = np.geomspace(0.1, 100.0, 40) / np.sqrt(largest)
        found = {growth: fit(growth) for growth in (0.0, *tried.tolist())}
        best = min(found, key=lambda growth: found[growth][0])
        if found[0.0][0] - found[best][0] > _GROWS:
            components[own] /= found[best][1]
            said = replace(said, **{name: best})
    return said if said is noise else replace(said, components=tuple(components.tolist()))


def _of_inliers(data: _Contrasts, log_prior: F, width: float) -> tuple[F, _Contrasts]:
    """(4,) log variances, once more where there were outliers, and the contrasts without them."""
    log_variance = log_prior
    for _ in range(2):
        log_variance = _reml(data, log_variance, log_prior, width)
        inliers = _without_outliers(data, log_variance)
        if len(inliers.response) == len(data.response):
            break
        data = inliers
    return log_variance, data


def _contrasts(rows: Rows, residual: F, cells: I, nuisance: F) -> _Contrasts | None:
    """Orthonormal contrasts within each cell: r rows give r - 1, of which some are taken.

    Contrast i is Helmert's: the first i rows of the cell against the next one.
    """
    order = np.argsort(cells, kind="stable")
    numbers, begins, counts = np.unique(cells[order], return_index=True, return_counts=True)
    repeated = (numbers >= 0) & (counts > 1)
    begins, counts = begins[repeated], counts[repeated]
    ends = np.cumsum(counts - 1)
    total = int(ends[-1]) if len(ends) else 0
    if total == 0:
        return None
    take = some_rows(total)
    cell = np.searchsorted(ends, take, side="right")
    place = take - (ends - counts + 1)[cell] + 1
    parts = covariance_parts(rows)
    means = {
        c: parts[:, order[begins[c] : begins[c] + counts[c]]].mean(axis=1)
        for c in np.unique(cell).tolist()
    }

    def contrast(values: F, c: int, i: int) -> F:
        members = order[begins[c] : begins[c] + i + 1]
        difference = values[members[:i]].sum(axis=0) - i * values[members[i]]
        return np.asarray(difference / np.sqrt(i * (i + 1.0)))

    chosen = list(zip(cell.tolist(), place.tolist(), strict=True))
    return _Contrasts(
        np.stack([contrast(residual, c, i) for c, i in chosen]),
        np.stack([contrast(nuisance, c, i) for c, i in chosen]),
        np.stack([means[c] for c, _ in chosen], axis=1),
    )


def _reml(data: _Contrasts, start: F, prior: F, width: float) -> F:
    """Fisher scoring of the restricted likelihood in log variances, with a normal prior."""
    log_variance, last, longest = start.copy(), np.zeros(len(start)), 1.0
    count, m = data.response.shape
    flat = data.nuisance.reshape(count * m, -1)
    norms = np.sqrt((flat**2).sum(axis=0))
    flat = flat[:, norms > 0.0] / norms[norms > 0.0]
    nuisance = flat.reshape(count, m, -1)
    for _ in range(_ITERATIONS):
        parts = data.parts * np.exp(log_variance)[:, None, None, None]
        inverse = np.linalg.inv(parts.sum(axis=0))
        # P = V^-1 - U U', U = V^-1 X R, R R' = (X' V^-1 X)^+: V is block diagonal.
        weighted = inverse @ nuisance
        root = root_of_inverse(weighted.reshape(count * m, -1).T @ flat, 1e-10)
        own = (weighted.reshape(count * m, -1) @ root).reshape(count, m, -1)
        along = own.reshape(count * m, -1).T @ data.response.ravel()
        py = np.einsum("cij,cj->ci", inverse, data.response) - own @ along
        products = inverse @ parts
        acting = parts @ own
        back = (inverse @ acting).reshape(len(parts), -1)
        seen = [own.reshape(count * m, -1).T @ a.reshape(count * m, -1) for a in acting]
        score = np.zeros(len(parts))
        information = np.zeros((len(parts), len(parts)))
        for q, part in enumerate(parts):
            quadratic = np.einsum("ci,cij,cj->", py, part, py)
            trace = np.einsum("cii->", products[q]) - np.trace(seen[q])
            score[q] = 0.5 * (quadratic - trace)
            for r in range(q, len(parts)):
                whole = np.einsum("cij,cji->", products[q], products[r])
                mixed, both = back[q] @ acting[r].ravel(), np.vdot(seen[q], seen[r])
                information[[q, r], [r, q]] = 0.5 * (whole - 2.0 * mixed + both)
        score -= (log_variance - prior) / width**2
        information += np.eye(4) / width**2
        step = np.clip(np.linalg.solve(information, score), -longest, longest)
        if float(step @ last) < 0.0:
            # Around a variance near zero steps may go to and fro.
            longest, step = 0.5 * longest, 0.5 * step
        last = step
        log_variance = np.clip(log_variance + step, prior - 9.0, prior + 9.0)
        if float(np.abs(step).max()) < 1e-3:
            break
    return np.asarray(log_variance)


def _without_outliers(data: _Contrasts, log_variance: F) -> _Contrasts:
    """The contrasts without outliers, whose whitened length beyond the nuisance is too large."""
    _, m = data.response.shape
    squares = _left(data, log_variance)
    # The median of chi-squared with m degrees of freedom is about m - 2/3.
    scale = max(1.0, float(np.median(squares)) / (m - 2.0 / 3.0))
    keep = squares < _OUTLIER * scale
    return _Contrasts(data.response[keep], data.nuisance[keep], data.parts[:, keep])


def _left(data: _Contrasts, log_variance: F) -> F:
    """(M,) whitened squares that the nuisance leaves."""
    covariance = (data.parts * np.exp(log_variance)[:, None, None, None]).sum(axis=0)
    count, m = data.response.shape
    whitener = np.linalg.inv(np.linalg.cholesky(covariance))
    y = np.einsum("cij,cj->ci", whitener, data.response).ravel()
    x = np.einsum("cij,cjk->cik", whitener, data.nuisance).reshape(count * m, -1)
    return np.asarray((rest_of(x, y).reshape(count, m) ** 2).sum(axis=1))
