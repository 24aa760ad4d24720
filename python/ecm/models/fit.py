"""Fit a model by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ecm._native import EnergyModel, PolynomialModel, polynomial_regressor
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.models.errors_in_variables import fit_with_pose_noise
from ecm.models.leverage import leverages
from ecm.models.maps import (
    EnergyMap,
    PolynomialMap,
    StiffnessMap,
    parse_energy_name,
    parse_groups,
    parse_polynomial_name,
)
from ecm.models.model import Model
from ecm.models.noise_estimate import declared_or_fitted
from ecm.models.pcr import singular_threshold
from ecm.models.physics.map import PhysicsMap, physics_map, reach_of
from ecm.models.polynomial_gls import fit_polynomial_gls
from ecm.models.training import domain_of, training_of
from ecm.regression.folds import row_groups
from ecm.regression.noise import Noise, declared_noise

if TYPE_CHECKING:
    from ecm.io.mechanism import Mechanism
    from ecm.io.table import Table


BASELINES = ("rod", "constant-curvature", "gp", "mlp")
"""Maps of the literature, for comparison."""
Weights = Literal["auto", "noise", "spread"]
"""How rows and components count (`fit_model`)."""


def fit_model(
    table: Table,
    name: str,
    *,
    pcr: float | str | None = None,
    mechanism: Mechanism | None = None,
    physics: PhysicsMap | None = None,
    threads: int = 0,
    zero_at_home: bool = False,
    stable: bool = False,
    weights: Weights = "auto",
) -> Model:
    """The model of that name (interfaces.md) fitted to the measured rows of a table.

    Parameters
    ----------
    name
        `poly:D`, `linear`, `quadratic`, `cubic`, `energyD`, `energyD-revolution`,
        `energyD-general`, `physics`; an energy with groups as `energy4+anisotropy+face_tilt`.
    pcr
        Threshold of principal component regression, polynomials only: B, or `B/sqrtN`, `rank:R`,
        `press` (pcr.py).
    mechanism, physics
        Of the physics model; default the table's `[mechanism]`.
    zero_at_home, stable
        No wrench, and a stable rest, at the undeformed pose (constraints.py).
    weights
        noise: by the declared noise of wrench and pose, errors in variables; for exact data a
        common rig's is assumed, which serves them better than the spread (docs/models.md).
        spread: each component over its own standard deviation (energies), which for polynomials
        is the paper's ordinary least squares. auto: noise for energies, spread for polynomials.
    """
    fitted = _fitted(
        table, name, pcr=pcr, body=(mechanism, physics), threads=threads, weights=weights
    )
    if zero_at_home or stable:
        from ecm.models.constraints import constrained

        fitted = constrained(fitted, zero_at_home=zero_at_home, stable=stable)
    return fitted


def _fitted(
    table: Table,
    name: str,
    *,
    pcr: float | str | None,
    body: tuple[Mechanism | None, PhysicsMap | None],
    threads: int,
    weights: Weights,
) -> Model:
    if pcr is not None and (name in ("physics", *BASELINES) or name.startswith("energy")):
        raise InputError(f"model {name}: a PCR threshold belongs to polynomials; leave it out")
    if pcr is not None and weights == "noise":
        raise InputError("a PCR threshold belongs to ordinary least squares; leave out one of both")
    if weights not in ("auto", "noise", "spread"):
        raise InputError(f"weights = {weights!r}: expected auto, noise or spread")
    if weights != "auto" and name in ("physics", *BASELINES):
        raise InputError(f"model {name}: weights are chosen for polynomials and energies only")
    measured = table.measured()
    if len(measured) == 0:
        raise InputError(f"{table.source}: no rows of kind pose to fit")
    if name == "physics":
        return _fit_physics(measured, *body, threads)
    if name.startswith("energy"):
        return _fit_energy(measured, name, weights)
    if name in BASELINES:
        return _fit_baseline(measured, name)
    return _fit_polynomial(measured, parse_polynomial_name(name), pcr, weights)


def _fit_polynomial(table: Table, degree: int, pcr: float | str | None, weights: Weights) -> Model:
    inputs, outputs = table.pose_columns, table.wrench_columns
    if not inputs or not outputs:
        what = "pose" if not inputs else "wrench"
        raise InputError(f"{table.source}: a fit needs at least one {what} column, found none")
    poses, wrenches = table.matrix(inputs), table.matrix(outputs)
    model = PolynomialModel.fit(
        np.ascontiguousarray(poses),
        np.ascontiguousarray(wrenches),
        degree,
        method="least_squares" if pcr is None else "pcr",
        threshold=0.0 if pcr is None else singular_threshold(pcr, poses, wrenches, degree),
    )
    base = PolynomialMap(model, inputs, outputs)
    if weights == "noise":
        noise = declared_noise(table)

        def solve(poses: F, wrenches: F, covariance: F) -> tuple[StiffnessMap, F, float]:
            return fit_polynomial_gls(base, poses, wrenches, covariance)

        found = fit_with_pose_noise(table, base, noise, solve)
        return _model(found.base, noise, found.covariance, table, found.residual_variance)
    noise = declared_or_fitted(base, table)
    residual = wrenches - base.predict(poses)
    k = len(model.coefficients)
    covariance = None
    if pcr is None and len(poses) > k:
        regressor = polynomial_regressor(
            np.ascontiguousarray(poses), degree, model.lower, model.upper
        )
        inverse = np.linalg.pinv(regressor.T @ regressor, hermitian=True)
        variance = (residual**2).sum(axis=0) / (len(poses) - k)
        covariance = np.asarray(np.kron(np.diag(variance), inverse), dtype=np.float64)
    return _model(base, noise, covariance, table)


def _fit_energy(table: Table, name: str, weights: Weights) -> Model:
    stem, groups = parse_groups(name)
    degree, symmetry = parse_energy_name(stem)
    length = table.meta.length_m
    if length is None:
        raise InputError(
            f"{table.source}: {name} needs the mechanism's length; "
            "give [mechanism] length_m in the data's TOML"
        )

    def fit(poses: F, wrenches: F, covariance: F | None) -> EnergyModel:
        return EnergyModel.fit(
            np.ascontiguousarray(poses),
            np.ascontiguousarray(wrenches),
            length_m=float(length),
            degree=degree,
            symmetry=symmetry,
            groups=groups,
            covariance=None if covariance is None else np.ascontiguousarray(covariance),
        )

    def solve(poses: F, wrenches: F, covariance: F) -> tuple[StiffnessMap, F, float]:
        model = fit(poses, wrenches, covariance)
        return EnergyMap(model), np.asarray(model.covariance), model.residual_variance

    noise = declared_noise(table)
    first = fit(table.poses, table.wrenches, None)
    if weights == "spread":
        return _model(EnergyMap(first), noise, np.asarray(first.covariance), table)
    found = fit_with_pose_noise(table, EnergyMap(first), noise, solve)
    return _model(found.base, noise, found.covariance, table, found.residual_variance)


def _fit_baseline(table: Table, name: str) -> Model:
    """Maps of the literature: no covariance, hence no standard deviations."""
    from ecm.models.learned import fit_gp, fit_mlp
    from ecm.models.rod import fit_constant_curvature, fit_rod

    base: StiffnessMap
    if name in ("gp", "mlp"):
        inputs, outputs = table.pose_columns, table.wrench_columns
        if not inputs or not outputs:
            raise InputError(f"{table.source}: a fit needs a pose and a wrench column")
        data = table.matrix(inputs), table.matrix(outputs), inputs, outputs
        base = fit_gp(*data) if name == "gp" else fit_mlp(*data)
    else:
        length = table.meta.length_m
        if length is None:
            raise InputError(
                f"{table.source}: {name} needs the mechanism's length; "
                "give [mechanism] length_m in the data's TOML"
            )
        spread = table.wrenches.std(axis=0)
        weights = np.where(spread > 0.0, spread, 1.0)
        pairs = np.ascontiguousarray(table.poses), np.ascontiguousarray(table.wrenches)
        if name == "rod":
            base = fit_rod(*pairs, length)
        else:
            base = fit_constant_curvature(*pairs, length, weights)
    return _model(base, declared_or_fitted(base, table), None, table)


def _fit_physics(
    table: Table, mechanism: Mechanism | None, physics: PhysicsMap | None, threads: int
) -> Model:
    from ecm.models.physics.refit import refit_physics

    base = physics
    if base is None:
        body = table.meta.body() if mechanism is None else mechanism
        if body is None:
            raise InputError(
                f"{table.source}: the physics model needs the body; "
                "give [mechanism] in the data's TOML"
            )
        base = physics_map(body, threads=threads, reach_rad=reach_of(table))
    noise = declared_noise(table)
    found = refit_physics(base, table, noise)
    return _model(found.base, noise, found.covariance, table)


def _model(
    base: StiffnessMap,
    noise: Noise,
    covariance: F | None,
    table: Table,
    residual_variance: float | None = None,
) -> Model:
    """With the covariance widened where the residuals are larger than the stated noise."""
    training = training_of(table)
    if residual_variance is not None and np.isfinite(residual_variance):
        training["residual_variance"] = residual_variance
        if covariance is not None:
            covariance = covariance * max(1.0, residual_variance)
    if covariance is not None and noise.components is None and base.inputs == POSE:
        found = leverages(base, covariance, noise, np.ascontiguousarray(table.poses))
        training["largest_leverage"] = float(found.max())
    return Model(
        base=base,
        noise=noise,
        covariance=covariance,
        training=training,
        domain=domain_of(table, base.inputs),
        length_m=base.length_m or table.meta.length_m,
        scene=table.meta.scene,
    )


@dataclass(frozen=True)
class CrossValidation:
    """Root mean square error on rows the fit has not seen."""

    rmse: dict[str, float]
    """Per wrench column, in its unit."""
    spread: dict[str, float]
    """Standard deviation of each wrench column, for scale."""
    folds: int
    grouped: bool
    """Whether groups (`[columns] group`, or pose_id) stayed together."""


def cross_validate(
    table: Table, name: str, *, folds: int = 10, grouped: bool = True, seed: int = 0
) -> CrossValidation:
    """Held-out errors of a named model; groups stay together unless asked otherwise.

    A random split flatters a model wherever rows come in groups: it is there for comparison.
    """
    measured = table.measured()
    groups = row_groups(measured) if grouped else np.arange(len(measured), dtype=np.int64)
    count = int(groups.max()) + 1
    parts = min(folds, count)
    if parts < 2:
        raise InputError(f"{table.source}: only one group of rows; cross-validation needs two")
    order = np.random.default_rng([seed, 7]).permutation(count)
    fold_of_group = np.empty(count, dtype=np.int64)
    fold_of_group[order] = np.arange(count) % parts
    fold = fold_of_group[groups]
    outputs = measured.wrench_columns
    truth = np.stack([measured.column(c) for c in outputs], axis=1)
    left = np.empty_like(truth)
    for part in range(parts):
        model = fit_model(measured.select(np.flatnonzero(fold != part)), name)
        held = measured.select(np.flatnonzero(fold == part))
        left[fold == part] = truth[fold == part] - model.predict(held)
    rmse = np.sqrt((left**2).mean(axis=0))
    spread = truth.std(axis=0)
    return CrossValidation(
        rmse=dict(zip(outputs, rmse.tolist(), strict=True)),
        spread=dict(zip(outputs, spread.tolist(), strict=True)),
        folds=parts,
        grouped=grouped,
    )
