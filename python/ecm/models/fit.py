"""Fit a model by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecm import _native
from ecm.columns import POSE, WRENCH
from ecm.compare.estimate import usable_sd
from ecm.compare.folds import row_groups
from ecm.compare.noise import Noise, declared_noise
from ecm.errors import InputError
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
from ecm.models.pcr import singular_threshold
from ecm.models.physics import PhysicsMap, physics_map
from ecm.models.training import domain_of, training_of

if TYPE_CHECKING:
    from ecm.mechanism import Mechanism
    from ecm.table import Table

F = NDArray[np.float64]

BASELINES = ("rod", "constant-curvature", "gp", "mlp")
"""Maps of the literature, for comparison."""
_MAX_REWEIGHTINGS = 6
_MOVED = 0.01
"""Reweighting ends when no coefficient moves by this share of its standard deviation."""


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
    """
    fitted = _fitted(table, name, pcr=pcr, body=(mechanism, physics), threads=threads)
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
) -> Model:
    if pcr is not None and (name in ("physics", *BASELINES) or name.startswith("energy")):
        raise InputError(f"model {name}: a PCR threshold belongs to polynomials; leave it out")
    measured = table.measured()
    if len(measured) == 0:
        raise InputError(f"{table.source}: no rows of kind pose to fit")
    if name == "physics":
        return _fit_physics(measured, *body, threads)
    if name.startswith("energy"):
        return _fit_energy(measured, name)
    if name in BASELINES:
        return _fit_baseline(measured, name)
    return _fit_polynomial(measured, parse_polynomial_name(name), pcr)


def _fit_polynomial(table: Table, degree: int, pcr: float | str | None) -> Model:
    inputs, outputs = table.pose_columns, table.wrench_columns
    if not inputs or not outputs:
        what = "pose" if not inputs else "wrench"
        raise InputError(f"{table.source}: a fit needs at least one {what} column, found none")
    poses = np.ascontiguousarray(np.stack([table.column(c) for c in inputs], axis=1))
    wrenches = np.ascontiguousarray(np.stack([table.column(c) for c in outputs], axis=1))
    model = _native.PolynomialModel.fit(
        poses,
        wrenches,
        degree,
        method="least_squares" if pcr is None else "pcr",
        threshold=0.0 if pcr is None else singular_threshold(pcr, poses, wrenches, degree),
    )
    base = PolynomialMap(model, inputs, outputs)
    residual = wrenches - base.predict(poses)
    k = len(model.coefficients)
    if inputs == POSE and outputs == WRENCH:
        noise = declared_noise(table)
    else:
        dof = max(1, len(poses) - k)
        spread = np.sqrt((residual**2).sum(axis=0) / dof)
        noise = Noise(source="assumed", components=usable_sd(spread, wrenches))
    covariance = None
    if pcr is None and len(poses) > k:
        regressor = _native.polynomial_regressor(poses, degree, model.lower, model.upper)
        inverse = np.linalg.pinv(regressor.T @ regressor, hermitian=True)
        variance = (residual**2).sum(axis=0) / (len(poses) - k)
        covariance = np.asarray(np.kron(np.diag(variance), inverse), dtype=np.float64)
    return _model(base, noise, covariance, table)


def _fit_energy(table: Table, name: str) -> Model:
    stem, groups = parse_groups(name)
    degree, symmetry = parse_energy_name(stem)
    length = table.meta.mechanism.get("length_m")
    if length is None:
        raise InputError(
            f"{table.source}: {name} needs the mechanism's length; "
            "give [mechanism] length_m in the data's TOML"
        )
    poses = np.ascontiguousarray(table.poses)
    wrenches = np.ascontiguousarray(table.wrenches)
    noise = declared_noise(table)
    first = _native.EnergyModel.fit(
        poses, wrenches, length_m=float(length), degree=degree, symmetry=symmetry, groups=groups
    )
    from ecm.effects import Rows

    # Errors in variables: the pose noise acts through the stiffness, which is that of the fit
    # before, until the coefficients stay.
    model, before = first, first.coefficients
    for _ in range(_MAX_REWEIGHTINGS):
        covariance = noise.covariance(Rows(table, EnergyMap(model)))
        model = _native.EnergyModel.fit(
            poses,
            wrenches,
            length_m=float(length),
            degree=degree,
            symmetry=symmetry,
            groups=groups,
            covariance=np.ascontiguousarray(covariance),
        )
        sd = np.sqrt(np.diag(model.covariance))
        moved = float(np.max(np.abs(model.coefficients - before) / np.where(sd > 0.0, sd, 1.0)))
        before = model.coefficients
        if moved < _MOVED:
            break
    return _model(EnergyMap(model), noise, np.asarray(model.covariance), table)


def _fit_baseline(table: Table, name: str) -> Model:
    """Maps of the literature: no covariance, hence no standard deviations."""
    from ecm.models.backbone import fit_constant_curvature, fit_rod
    from ecm.models.learned import fit_gp, fit_mlp

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
    return _model(base, declared_noise(table), None, table)


def _fit_physics(
    table: Table, mechanism: Mechanism | None, physics: PhysicsMap | None, threads: int
) -> Model:
    from ecm.refit import joint_fit

    base = physics
    if base is None:
        body = table.meta.body() if mechanism is None else mechanism
        if body is None:
            raise InputError(
                f"{table.source}: the physics model needs the body; "
                "give [mechanism] in the data's TOML"
            )
        base = physics_map(body, threads=threads)
    noise = declared_noise(table)
    found = joint_fit(base, (), table, noise)
    return _model(found.base, noise, found.covariance, table)


def _model(base: StiffnessMap, noise: Noise, covariance: F | None, table: Table) -> Model:
    training = training_of(table)
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
