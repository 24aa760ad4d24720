"""Joint refit of a base map and effects: generalised least squares, bounded, with priors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from scipy.linalg import cho_solve
from scipy.optimize import lsq_linear

from ecm.effects import effects_of
from ecm.effects.protocol import Effect, Parameter, correction_of, jacobian_of, linear_columns
from ecm.errors import InputError, ModelError
from ecm.io.arrays import B, F, I, eigh, lstsq
from ecm.io.columns import same_unit
from ecm.io.table import Table
from ecm.models.maps import StiffnessMap
from ecm.regression.f_test import independent_factor, root_of_inverse, within_cells
from ecm.regression.folds import repeat_cells
from ecm.regression.noise import (
    Noise,
    declared_noise,
    noise_source,
    reml_noise,
    shared_zero_error,
)
from ecm.regression.rows import Rows, driven_by, is_whole
from ecm.regression.slow_noise import SlowPart, Whitener, slow_part


@dataclass(frozen=True)
class CoefficientPrior:
    """A Gaussian prior: `root @ (coefficients - mean)` has unit variance in each entry.

    Directions that `root` maps to zero are free.

    Examples
    --------
    >>> prior = CoefficientPrior(np.array([2.0]), np.array([[10.0]]), "known to 0.1")
    >>> prior.rows(np.array([1.9]), 3)[0]
    array([[10.,  0.,  0.]])
    >>> prior.rows(np.array([1.9]), 3)[1].round(6)
    array([1.])
    """

    mean: F
    """(k,) expected coefficients."""
    root: F
    """(r, k) root of their precision."""
    sentence: str
    """Where it comes from and how much it weighs, for the fit report."""

    def rows(self, coefficients: F, columns: int) -> tuple[F, F]:
        """(r, columns) and (r,): the prior as whitened rows of a fit linearised here.

        The coefficients are the first of the columns.
        """
        design = np.zeros((len(self.root), columns))
        design[:, : len(self.mean)] = self.root
        return design, self.root @ (self.mean - coefficients)


_MAX_ITERATIONS = 8
_NULL = 1e-12
"""Share of a column's square below which a combination of columns counts as zero."""
_AT_BOUND = 1e-9
_TOLERANCE = 1e-4
_PARTS = 0.5 ** np.arange(8.0)
"""Parts of a step that are tried in turn."""
_NO_WORSE = 1.0 + 1e-6
"""Squares that a step may leave over those before: the last steps change them by rounding."""
_STEP = 1e-6
"""Share of what effects move the base's inputs by, over which its columns are compared."""
_RAN_AWAY = "the fit does not converge, its steps grow without end: fewer effects or a lower degree"


_ROUNDING = 1e-6
"""Share of its usual size up to which a parameter is the rounding of zero."""


@dataclass(frozen=True)
class FittedEffect:
    """An effect with its values; a frozen one keeps them in a refit."""

    effect: Effect
    values: F
    sd: F
    """(k,) standard deviations; infinite before a fit."""
    frozen: bool = False

    @staticmethod
    def unfitted(effect: Effect) -> FittedEffect:
        """The effect with values zero, before any fit."""
        k = len(effect.parameters)
        return FittedEffect(effect, np.zeros(k), np.full(k, np.inf))

    @property
    def id(self) -> str:
        """The effect's id."""
        return self.effect.id

    @property
    def listed(self) -> list[tuple[Parameter, float, float]]:
        """Each parameter with its value and standard deviation."""
        return list(
            zip(self.effect.parameters, self.values.tolist(), self.sd.tolist(), strict=True)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the part of a report or of a model file: plain values."""
        parameters = {
            one.name: {"value": value, "sd": sd if np.isfinite(sd) else None, "unit": one.unit}
            for one, value, sd in self.listed
        }
        return {"id": self.id, "shape": self.effect.shape, "parameters": parameters}

    @property
    def is_new(self) -> bool:
        """Whether it was never fitted: it may have no shape yet."""
        return not np.isfinite(self.sd).any()

    @property
    def at_bounds(self) -> B:
        """(k,) whether a value lies at its smallest or largest."""
        own = zip(self.effect.parameters, self.values, strict=True)
        near = [min(value - p.lower, p.upper - value) < 1e-6 * p.scale for p, value in own]
        return np.array(near, dtype=bool)

    @property
    def taken(self) -> B:
        """(k,) whether the base has taken a parameter: value and error are only rounding."""
        scale = np.array([parameter.scale for parameter in self.effect.parameters])
        return np.asarray(np.abs(self.values) + self.sd < _ROUNDING * scale)


@dataclass(frozen=True)
class JointFit:
    """Result of a joint refit."""

    base: StiffnessMap
    effects: tuple[FittedEffect, ...]
    rows: Rows
    residual: F
    """(N, m) measured minus predicted, in physical units."""
    whitened: F
    """(N, m)."""
    design: F
    """(N, m, k) whitened Jacobian: base coefficients, then the free effects."""
    covariance: F
    """(k, k) of the parameters, base first; errors that all rows share are included."""
    shared: F
    """(k, e) change of the parameters by one standard deviation of each of these errors."""
    converged: bool
    smallest_taken: bool
    """Whether effects and base hold a common column, of which the base got what it could."""
    prior: tuple[F, F]
    """(r, k) and (r,): whitened rows of the priors beside those of the table, at the fit."""

    @property
    def held_columns(self) -> I:
        """Columns of the design whose parameters are at their bounds."""
        own = [item.at_bounds for item in self.effects if not item.frozen]
        held = np.concatenate([np.zeros(0, dtype=bool), *own])
        return np.asarray(self.design.shape[2] - len(held) + np.flatnonzero(held))

    @cached_property
    def slow(self) -> SlowPart | None:
        """The slow part of what is left along a log; None where rows err independently."""
        table = self.rows.table
        return slow_part(table, self.whitened) if table.continuous else None

    def in_slow_noise(self) -> JointFit:
        """Return the fit with the standard deviations that noise with its slow part gives."""
        if self.slow is None:
            return self
        own = self.covariance - self.shared @ self.shared.T
        covariance = self.covariance + own @ self.slow.products(self.rows.table, self.design) @ own
        sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        free = sum(len(item.values) for item in self.effects if not item.frozen)
        effects = _with_each(self.effects, "sd", sd[len(sd) - free :])
        return replace(self, covariance=covariance, effects=effects)


def joint_fit(
    base: StiffnessMap,
    effects: Sequence[FittedEffect | Effect],
    table: Table,
    noise: Noise,
    *,
    row_weights: F | None = None,
    freeze_base: bool = False,
    prior: CoefficientPrior | None = None,
    kept: Mapping[str, Any] | None = None,
) -> JointFit:
    """Fit the base's coefficients and the effects' parameters to the table together.

    Minimises sum_i w_i r_i' Sigma_i^-1 r_i by Gauss-Newton steps; Sigma_i is that of the first
    base. A prior of the base's coefficients counts as one more reading of each. Parameters
    stay within their bounds; `converged` is false where the steps did not end.
    Where the table cannot distinguish effects from the base (all gains of a sensor at once, and the
    modulus), the smallest effects that fit equally well are taken.

    Parameters
    ----------
    base, effects
        Start of the fit; an effect without values starts at zero.
    table
        N measured rows.
    noise
        Gives Sigma_i (m, m), and the slow part of the noise of a log: beside one the rows are
        whitened along time as well.
    row_weights
        (N,) robust weights w_i; default 1.
    freeze_base
        Keep the base's coefficients.
    prior
        What is known of the base's coefficients beside the rows.
    kept
        What effects that are frozen took of the rows of their own fit, as `Rows.of_fit`.
    """
    kept = kept or {}
    fitted = tuple(e if isinstance(e, FittedEffect) else FittedEffect.unfitted(e) for e in effects)
    # In slow noise changes count alone, of which the noise of the poses would be the most.
    rows = Rows(table, base, dict(kept), quiet=noise.slow is not None and table.continuous)
    root = None if row_weights is None else np.sqrt(row_weights)
    whitener = noise.whitener(rows, base.error)
    priors = [] if prior is None else [prior]
    if base.prior is not None and not freeze_base:
        mean, sd = base.prior
        priors.append(CoefficientPrior(mean, np.diag(1.0 / sd)[np.isfinite(sd)], "stated"))
    data = _Data(table.matrix(base.outputs), whitener, root, priors, kept)
    at = _At(data, rows, base, fitted, 0 if freeze_base else len(base.coefficients))
    here = at.linearised()
    converged, iteration = False, 0
    while iteration < _MAX_ITERATIONS and not converged:
        iteration += 1
        step = at.step(here)
        change = float(np.linalg.norm(here.flat @ step))
        converged = change < _TOLERANCE * np.sqrt(max(1, at.residual.size))
        del here  # its columns are most of the memory
        at, here = at.stepped(step)
    rows, residual, z = at.rows, at.residual, here.columns
    size, products = unit_products(here.flat)
    least = at.least_effects(size, products)
    y = whitener @ residual
    covariance = np.asarray(least @ covariance_of(size, products) @ least.T)
    # Change of the parameters by one standard deviation of an error that all rows share.
    shared = whitener @ shared_zero_error(rows, residual, noise)
    if row_weights is not None:
        shared = shared * row_weights[:, None, None]
    shift = np.einsum("nik,nij->kj", z, shared)
    shift = covariance @ shift
    covariance = covariance + shift @ shift.T
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return JointFit(
        base=at.base,
        effects=_with_each(at.effects, "sd", sd[at.free_base :]),
        rows=rows.measured,
        residual=residual,
        whitened=y,
        design=z,
        covariance=covariance,
        shared=shift,
        converged=converged,
        smallest_taken=bool((least != np.eye(len(least))).any()),
        prior=_with_priors(np.zeros((0, z.shape[2])), np.zeros(0), at.base, priors),
    )


@dataclass(frozen=True)
class _Data:
    """What a fit is fitted to."""

    measured: F
    whitener: Whitener
    root: F | None
    """(N,) square roots of the rows' weights; None where all count alike."""
    priors: list[CoefficientPrior]
    kept: Mapping[str, Any]


@dataclass(frozen=True)
class _Linearised:
    """How what a fit leaves changes with its parameters, at one place."""

    columns: F
    """(N, m, k) whitened."""
    flat: F
    """(r, k) these by the weights of their rows, and the rows of the priors."""
    response: F
    """(r,)."""


def _with_each(
    effects: Sequence[FittedEffect], name: Literal["values", "sd"], numbers: F
) -> tuple[FittedEffect, ...]:
    """The effects, the free ones with their part of the numbers (k,) in this field."""
    found, at = [], 0
    for item in effects:
        k = 0 if item.frozen else len(item.values)
        own: dict[str, Any] = {name: numbers[at : at + k]}
        found.append(item if item.frozen else replace(item, **own))
        at += k
    return tuple(found)


@dataclass(frozen=True, eq=False)
class _At:
    """Where a fit stands; the free parameters are those of the base, then of the free effects."""

    data: _Data
    rows: Rows
    base: StiffnessMap
    effects: tuple[FittedEffect, ...]
    free_base: int
    """Number of the base's coefficients that are free: all or none."""

    @property
    def _free(self) -> list[FittedEffect]:
        return [item for item in self.effects if not item.frozen]

    @property
    def values(self) -> F:
        """(k,) free parameters."""
        own = [item.values for item in self._free]
        return np.concatenate([self.base.coefficients[: self.free_base], *own])

    @property
    def bounds(self) -> tuple[F, F]:
        """(k,) smallest and largest values."""
        limits = self.base.bounds
        if limits is None or not self.free_base:
            limits = np.full(self.free_base, -np.inf), np.full(self.free_base, np.inf)
        own = [p for item in self._free for p in item.effect.parameters]
        lower = np.concatenate([limits[0], [p.lower for p in own]])
        return lower, np.concatenate([limits[1], [p.upper for p in own]])

    @cached_property
    def _left(self) -> tuple[F, list[F | None]]:
        """(N, m) residual, and the columns of each effect that it followed from."""
        prediction, known = self.rows.measured.sensor_load.copy(), []
        for item in self.effects:
            columns = None if item.frozen else linear_columns(item.effect, self.rows)
            if columns is None:
                prediction += correction_of(item.effect, self.rows, item.values)
            else:
                prediction += columns @ item.values
            known.append(columns)
        return self.data.measured - prediction, known

    @property
    def residual(self) -> F:
        """(N, m)."""
        return self._left[0]

    @cached_property
    def squares(self) -> float:
        """Sum of the whitened squares that are left."""
        y = self._with_priors(np.zeros((0, len(self.values))))[1]
        with np.errstate(over="ignore", invalid="ignore"):
            return float(y @ y)

    def linearised(self) -> _Linearised:
        """The columns of what is left, which are most of the work and of the memory."""
        columns = self.data.whitener @ self._columns()
        root = self.data.root
        z = columns if root is None else columns * root[:, None, None]
        # The shape is given, so that it holds for zero columns as well.
        flat, response = self._with_priors(z.reshape(self.residual.size, z.shape[2]))
        return _Linearised(columns, flat, response)

    def _columns(self) -> F:
        """(N, m, k) derivative of the prediction; those of effects that are known are taken."""
        rows, blocks = self.rows, [base_columns(self.rows, self.base)] if self.free_base else []
        # What effects add through the base's actuators changes with its coefficients as well.
        if blocks and self.effects and (names := driven_by(self.base)):
            moves = sum(item.values.sum() * item.effect.moves(rows.whole) for item in self.effects)
            if np.any(moves):
                inputs = rows.table.matrix(names) + _STEP * rows.of_whole(moves)
                there = rows.table.with_columns(dict(zip(names, inputs.T, strict=True)))
                moved = base_columns(replace(rows, table=there), self.base)
                blocks[0] += (moved - blocks[0]) / _STEP
        for item, own in zip(self.effects, self._left[1], strict=True):
            if not item.frozen:
                blocks.append(jacobian_of(item.effect, rows, item.values) if own is None else own)
        if not blocks:
            blocks = [np.zeros((len(rows), len(self.base.outputs), 0))]
        return np.concatenate(blocks, axis=2)

    def _with_priors(self, design: F) -> tuple[F, F]:
        """Whitened columns (M, k) and the whitened residual, those of the priors below them."""
        y, root = self.data.whitener @ self.residual, self.data.root
        own = np.ravel(y if root is None else y * root[:, None])
        return _with_priors(design, own, self.base, self.data.priors)

    def stepped(self, step: F) -> tuple[_At, _Linearised]:
        """The fit after a step, or after the largest part of it that leaves no more squares.

        Where every part leaves more it is the largest that can be evaluated: steps of a fit may
        rise before they fall. So may a whole step of which a part falls: it and the next one are
        taken where they leave less. What acts in proportion to the base is a product with it; parts
        of steps crawl along its valley, and two whole ones cross it.
        """
        # So far from the rows that numbers overflow, nothing can be evaluated.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for place in self._places(step):
                # The columns, which are most of the work, only where the step ends.
                with suppress(ModelError):
                    return place, place.linearised()
        raise ModelError(_RAN_AWAY)

    def _places(self, step: F) -> Iterator[_At]:
        """Where a step may end, the best first."""
        worse: list[_At] = []
        for place in filter(None, (self._moved(part * step) for part in _PARTS)):
            if place.squares > _NO_WORSE * self.squares:
                worse.append(place)
                continue
            if worse and (two := worse[0]._after_next()) and two.squares < place.squares:
                yield two
            yield place
        yield from worse

    def _after_next(self) -> _At | None:
        """Where the whole next step leads; None where it cannot be evaluated."""
        try:
            return self._moved(self.step(self.linearised()))
        except ModelError:
            return None

    def _moved(self, step: F) -> _At | None:
        """Where a step (k,) of the free parameters leads; None where it cannot be evaluated."""
        base, rows, values = self.base, self.rows, self.values + step
        if self.free_base:
            base = base.with_coefficients(values[: self.free_base])
            rows = rows.under(base, dict(self.data.kept))
        effects = _with_each(self.effects, "values", values[self.free_base :])
        moved = replace(self, base=base, rows=rows, effects=effects)
        try:
            return moved if np.isfinite(moved.squares) else None
        except ModelError:
            return None

    def step(self, here: _Linearised) -> F:
        """The step to the least squares of the linearised fit, within the bounds."""
        size, products = unit_products(here.flat)
        step = self.bounded_step(here.flat, here.response, size, products)
        values, (lower, upper) = self.values, self.bounds
        smallest = self.least_effects(size, products) @ (values + step)
        # A value at its bound may miss it by a rounding of the projection.
        near = _AT_BOUND * np.maximum(1.0, np.abs(smallest))
        if np.all(smallest >= lower - near) and np.all(smallest <= upper + near):
            step = np.clip(smallest, lower, upper) - values
        return step

    def bounded_step(self, z: F, y: F, size: F, products: F) -> F:
        """Least-squares step; bounded where the plain one leaves the bounds."""
        if z.shape[1] == 0:
            return np.zeros(0)
        factor = independent_factor(products)
        if factor is None:
            # The triangle of Z = Q R has the same minima with k rows instead of N m.
            both = np.asarray(np.linalg.qr(np.column_stack([z / size, y]), mode="r"))
            triangle, along = both[:, :-1], both[:, -1]
            step = lstsq(triangle, along, rcond=1e-12)
        else:
            # A tenth of the work; the next iteration takes the rounding of the squares back.
            step = cho_solve((factor, False), z.T @ y / size, check_finite=False)
            triangle, along = factor, factor @ step
        slack = 1e-12
        lower, upper = (size * (bound - self.values) for bound in self.bounds)
        if not (np.all(step >= lower) and np.all(step <= upper)):
            bounds = lower - slack * size, upper + slack * size
            step = lsq_linear(triangle, along, bounds=bounds, method="bvls").x
        return np.asarray(step / size)

    def least_effects(self, size: F, products: F) -> F:
        """(k, k) projection along the null space of the columns, to the smallest effects.

        The identity where the columns of effects and base are independent. A combination of columns
        of the base alone moves no effect, though rounding gives it a little of each.
        """
        k, free_base = len(size), self.free_base
        scale = np.array([p.scale for item in self._free for p in item.effect.parameters])
        if not free_base or not len(scale) or not (np.diag(products) > 0.0).all():
            return np.eye(k)
        if independent_factor(products) is not None:  # far less work than the eigenvalues
            return np.eye(k)
        values, vectors = eigh(products)
        values, null = values[values < _NULL * k], vectors[:, values < _NULL * k]
        # With one of its effects counted once, a combination must still be zero.
        _, shares, turns = np.linalg.svd(null[free_base:], full_matrices=False)
        squares = np.maximum(turns**2 @ values, np.finfo(np.float64).eps)
        null = (null @ turns.T)[:, squares < _NULL * k * shares**2] / size[:, None]
        if not null.shape[1]:
            return np.eye(k)
        own = null[free_base:] / scale[:, None]
        onto = np.concatenate(
            [np.zeros((k, free_base)), null @ np.linalg.pinv(own) / scale], axis=1
        )
        return np.asarray(np.eye(k) - onto)


def _with_priors(
    design: F, response: F, base: StiffnessMap, priors: Sequence[CoefficientPrior]
) -> tuple[F, F]:
    """Whitened rows (M, k) and their response (M,), those of the priors below them."""
    for prior in priors:
        rows, expected = prior.rows(base.coefficients, design.shape[1])
        design, response = np.concatenate([design, rows]), np.concatenate([response, expected])
    return design, response


def of_fit(fit: JointFit, kept: Mapping[str, Any]) -> dict[str, Any]:
    """What the effects took of all rows of a fit: `Rows.of_fit` of predictions of other rows."""
    rows = Rows(fit.rows.table, fit.base, dict(kept))
    for item in fit.effects:
        correction_of(item.effect, rows, item.values)
    return rows.of_fit


def _acting(fit: JointFit) -> dict[str, F]:
    """(n, m) correction of each effect at the pose rows of a fit, by its id."""
    scored = fit.rows.table.of_poses
    return {
        item.id: correction_of(item.effect, fit.rows, item.values)[scored] for item in fit.effects
    }


def effect_sizes(fit: JointFit, noise: Noise) -> dict[str, float]:
    """Root mean square of each effect on the fitted rows over the noise, of its worst component."""
    variance = noise.variances(fit.rows, fit.base.error)[fit.rows.table.of_poses]
    return {
        id: float(np.sqrt((acts**2 / variance).mean(axis=0).max()))
        for id, acts in _acting(fit).items()
    }


def effect_shares(fit: JointFit) -> dict[str, float]:
    """Root mean square of each effect on the fitted rows over that of the wrench.

    The larger of the shares of the outputs with one unit, force or moment.
    """
    same, scored = same_unit(fit.base.outputs), fit.rows.table.of_poses
    wrench = same @ (fit.rows.table.matrix(fit.base.outputs)[scored] ** 2).sum(axis=0)
    return {
        id: float(np.sqrt(same @ (acts**2).sum(axis=0) / np.maximum(wrench, 1e-300)).max())
        for id, acts in _acting(fit).items()
    }


def base_columns(rows: Rows, base: StiffnessMap) -> F:
    """(N, m, k) derivative of the base wrench to its coefficients, zero where unloaded."""
    return rows.where_loaded(base.columns, rows.poses, len(base.outputs), len(base.coefficients))


def error_columns(rows: Rows, base: StiffnessMap) -> F:
    """(N, m, e) directions in which the base may err, each with sd 1; zero where unloaded."""
    count = base.error_columns(rows.poses[:0]).shape[2]
    return rows.where_loaded(base.error_columns, rows.poses, len(base.outputs), count)


def further_columns(rows: Rows, base: StiffnessMap) -> F:
    """(N, m, e) terms of the next degree of the base; zero where unloaded."""
    count = base.further_columns(rows.poses[:0]).shape[2]
    return rows.where_loaded(base.further_columns, rows.poses, len(base.outputs), count)


def unit_products(z: F) -> tuple[F, F]:
    """(k,) lengths of the columns z (M, k), and (k, k) products of the columns of unit length.

    Moduli and ratios differ by more than the rounding of a double; a length of zero is taken as 1.

    Raises
    ------
    ModelError
        If a product is too large for a double: the steps before went far from all data.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.sqrt(np.einsum("ij,ij->j", z, z))
        size = np.where(size > 0.0, size, 1.0)
        products = z.T @ z
    if not np.isfinite(products).all():
        raise ModelError(_RAN_AWAY)
    return size, products / np.outer(size, size)


def covariance_of(size: F, products: F) -> F:
    """(k, k) covariance of parameters by `unit_products` of their whitened columns."""
    factor = independent_factor(products)  # far less work than the eigenvalues
    zero = len(size) * np.finfo(np.float64).eps
    root = root_of_inverse(products, zero) if factor is None else np.asarray(np.linalg.inv(factor))
    return np.asarray(root @ root.T / np.outer(size, size))


def estimate_noise(rows: Rows, predicted: F, *, fallback: Noise | None = None) -> Noise:
    """Noise of the rows: from repeats, else declared, else `fallback`, else assumed.

    Changes between repeats of a pose that effects of time, temperature, dwell or approach can
    explain do not count as noise; else a hidden effect would raise its own noise floor.
    """
    table = rows.table
    columns = (*rows.base.inputs, *rows.base.outputs)
    repeated = noise_source(table, columns) == "repeats"
    if not is_whole(rows.base):
        if repeated:
            return _pure_error(rows, predicted)
        declared = declared_noise(table, columns)
        return declared if declared.source == "declared" else fallback or Noise()
    prior = declared_noise(table)
    if prior.source == "assumed" and fallback is not None and fallback.source != "assumed":
        prior = fallback
    if not repeated:
        return prior
    cells = np.where(table.of_poses, repeat_cells(table), -1)
    measured = table.wrenches
    estimated = reml_noise(rows, measured - predicted, cells, nuisance_columns(rows), prior)
    return prior if estimated is None else estimated


def quieter(rows: Rows, noise: Noise, predicted: F, *, fallback: Noise | None = None) -> Noise:
    """The least noise of the rows: this one, or that beside another prediction of their readings.

    Repeats scatter more beside an effect of time of other rows that does not act in these.
    """
    other = estimate_noise(rows, predicted, fallback=fallback)

    def size(one: Noise) -> float:
        return float(np.linalg.slogdet(one.covariance(rows))[1].mean())

    return min(noise, other, key=size)


def noise_for(base: StiffnessMap, table: Table, before: Noise, *, same_rows: bool) -> Noise:
    """Noise of the rows, else that of the fit before.

    For the same rows, whose repeats gave the noise of the fit before, that noise is kept: fits are
    compared under one noise.
    """
    if same_rows and before.source == "repeats":
        return before
    rows = Rows(table, base)
    # Effects have no shape for these rows yet, but their changes between repeats do not count.
    return estimate_noise(rows, rows.sensor_load, fallback=before)


def declared_or_fitted(base: StiffnessMap, table: Table) -> Noise:
    """Declared figures; for tables of other columns without any the spread of the residual."""
    declared = declared_noise(table, (*base.inputs, *base.outputs))
    if is_whole(base) or declared.source == "declared":
        return declared
    rows = Rows(table, base)
    measured = table.matrix(base.outputs)
    residual = measured - rows.sensor_load
    # The weights of a learned map, more than one for each row, are no degrees of freedom.
    own = len(base.coefficients) if base.kind == "polynomial" else 0
    dof = max(1, len(residual) - own // len(base.outputs))
    spread = np.sqrt((residual**2).sum(axis=0) / dof)
    return Noise(source="assumed", components=usable_sd(spread, measured))


def spread_noise(measured: F) -> Noise:
    """Each output (N, m) by its own spread: for the first fit of a model without a noise."""
    return Noise(source="assumed", components=usable_sd(measured.std(axis=0), measured))


def _pure_error(rows: Rows, predicted: F) -> Noise:
    """Spread of each output within repeats, for tables of other columns."""
    measured = rows.table.matrix(rows.base.outputs)
    within, cells = within_cells(measured - predicted, repeat_cells(rows.table))
    spread = np.sqrt((within**2).sum(axis=0) / (len(measured) - cells))
    return Noise(source="repeats", components=usable_sd(spread, measured))


def usable_sd(spread: F, measured: F) -> tuple[float, ...]:
    """Standard deviations above zero: 1 for an output that never varies."""
    varies = np.ptp(measured, axis=0) > 1e-12
    floor = 1e-9 * np.abs(measured).max(axis=0)
    return tuple(np.where(varies, np.maximum(spread, floor), 1.0).tolist())


def nuisance_columns(rows: Rows) -> F:
    """(N, m, k) derivatives of every testable effect that can vary between repeats of a pose."""
    blocks = [np.zeros((len(rows), len(rows.base.outputs), 0))]
    for effect in effects_of(rows.whole.table):
        if effect.kind != "time" or effect.missing(rows.whole.table) is not None:
            continue
        try:
            blocks += [jacobian_of(own, rows) for own in effect.variants(rows.whole.table)[:3]]
        except InputError:
            # Without the mechanism's length there is no rest pose: no such effect can be tested.
            if rows.has_length:
                raise
    return np.concatenate(blocks, axis=2)
