"""Fit of a body's E and nu, also L and D; the stated body as a prior of a free base.

Rows alone may not distinguish an effect from the stiffness of a free base: a load of constant arm
and a bending stiffness are one column there. The FEM of the body knows the stiffness but for E and
nu.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ecm.effects.protocol import correction_of, jacobian_of
from ecm.errors import EcmError, InputError
from ecm.io.arrays import F, rms, rms_of_columns, svd
from ecm.io.events import Progress, tell_part
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table
from ecm.models.errors import BETTER
from ecm.models.joint_fit import (
    CoefficientPrior,
    FittedEffect,
    JointFit,
    base_columns,
    joint_fit,
)
from ecm.models.layout import Layout, anything, array, items, named, number, one_of, record
from ecm.models.maps import CHOOSE, FittedMap, ModelSpecification, StiffnessMap, Weights
from ecm.models.partial import fit_measured, is_partial, need_pose
from ecm.models.physics.build import stated_rod
from ecm.models.physics.family import LAYOUT, PARAMETERS
from ecm.models.physics.map import PhysicsMap, physics_map, poses_meant
from ecm.regression.f_test import orthonormal
from ecm.regression.noise import Noise, declared_noise, whiteners
from ecm.regression.rows import Rows

_REWEIGHTINGS = 5
_TOLERANCE = 0.01
"""Reweighting ends when no parameter changes by this share of its standard deviation."""
_AT_BOUND = 1e-6
OWN_ERROR_LIMIT = 0.15
"""Error over noise above which the base imitates effects; the covariance includes it anyway."""


MEASURES: dict[str, tuple[str, str, float]] = {
    "young_modulus_Pa": ("E", "MPa", 1e-6),
    "poisson_ratio": ("nu", "", 1.0),
    "length_m": ("L", "mm", 1e3),
    "diameter_m": ("D", "mm", 1e3),
}
"""Symbol, unit and factor of what is shown of a body."""


(_MODULUS, _NU), SIZES = PARAMETERS[:2], PARAMETERS[2:]
_SIZE_DEVIATIONS = 4.0
"""Standard deviations by which a size must differ from the stated one to be said."""


def physics_sentences(base: PhysicsMap, covariance: F) -> list[str]:
    """The free parameters with their errors and correlations; (k, k) covariance of them."""
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    shown = [MEASURES.get(name, (name, "", 1.0)) for name in base.parameter_names]
    lines = [
        f"{symbol} = {scale * value:.5g} +- {scale * error:.2g} {unit}".strip()
        for (symbol, unit, scale), value, error in zip(shown, base.coefficients, sd, strict=True)
    ]
    scale = np.where(sd > 0.0, sd, 1.0)
    together = covariance / np.outer(scale, scale)
    pairs = [
        f"{shown[i][0]} with {shown[j][0]} {together[i, j]:+.2f}"
        for i in range(len(shown))
        for j in range(i + 1, len(shown))
    ]
    lines += [f"correlation of {', '.join(pairs)}"] if pairs else []
    lines += [f"{name} is at the limit of the model" for name in _at_limit(base)]
    own = 0.0 if base.family is None else float(base.family.error_over_noise[:2].max())
    if own > OWN_ERROR_LIMIT:
        lines.append(
            f"the model's own error is {own:.2g} times the noise of the paper's rig, above "
            f"{OWN_ERROR_LIMIT}: small effects cannot be distinguished from it (docs/models.md)"
        )
    shares = base.mesh_shares
    if shares is not None:
        parts = ", ".join(f"{name.split('_')[0]} {share:+.1%}" for name, share in shares.items())
        lines.append(f"error of the standard mesh against the fine one: {parts}")
    return lines


def _at_limit(base: PhysicsMap) -> list[str]:
    """Free parameters at the limit of the tabulated range, or at nu = 0.5."""
    values, (low, high) = base.coefficients, base.bounds
    near = _AT_BOUND * np.abs(values)
    outside = (values - low < near) | (high - values < near)
    return [name for name, out in zip(base.parameter_names, outside, strict=True) if out]


def refit_physics(
    base: PhysicsMap,
    table: Table,
    noise: Noise | None = None,
    *,
    free: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> FittedMap:
    """Generalised least squares of the free parameters, within the tabulated range.

    The weights use the stiffness of the fit before, until the parameters no longer change.

    Parameters
    ----------
    base
        The physics map to fit.
    table
        Measured rows.
    noise
        Default: as the table declares.
    free
        Names among young_modulus_Pa, poisson_ratio, length_m, diameter_m; default those of `base`.
    progress
        Called with the number of weightings that are done, and the most that there may be.
    """
    if base.family is not None:
        base = base.with_free(*(base.free if free is None else free))
    measured = table.measured()
    used = declared_noise(table) if noise is None else noise
    found = FittedMap(base, used)
    for i in range(_REWEIGHTINGS + 1):
        tell_part(progress, i, _REWEIGHTINGS + 1, f"weighting {i} of at most {_REWEIGHTINGS}")
        before = found.base.coefficients
        joint = joint_fit(found.base, (), measured, used)
        found = FittedMap(joint.base, used, joint.covariance)
        sd = np.sqrt(np.maximum(np.diag(joint.covariance), 0.0))
        change = np.abs(joint.base.coefficients - before) / np.where(sd > 0.0, sd, 1.0)
        if i > 0 and float(change.max(initial=0.0)) < _TOLERANCE:
            break
    return found


def fit_with_sizes(base: PhysicsMap, table: Table, noise: Noise) -> JointFit | None:
    """Fit E, nu and the length together; the diameter too, where that leaves far less.

    From the stated values on: E and nu that were fitted beside a wrong size may be anything. None
    without a family, or where there is no fit.
    """
    if base.family is None or base.values is None:
        return None
    stated = stated_body(base)
    found: JointFit | None = None
    for free in (PARAMETERS[:3], PARAMETERS):
        values = {**base.values, _MODULUS: stated.young_modulus_Pa, _NU: stated.poisson_ratio}
        begin = np.array([values[name] for name in free])
        try:
            fit = joint_fit(base.with_free(*free).with_coefficients(begin), (), table, noise)
        except (EcmError, np.linalg.LinAlgError):
            continue
        # Of a slender rod nothing but the shear tells a diameter from E and nu.
        sure = isinstance(fit.base, PhysicsMap) and _NU not in _at_limit(fit.base)
        if found is None or (sure and _beyond_noise(fit) < BETTER * _beyond_noise(found)):
            found = fit
    return found


def _beyond_noise(fit: JointFit) -> float:
    """Mean square over the noise beyond it."""
    return max(float((fit.whitened**2).mean()) - 1.0, 0.0)


def stated_body(base: PhysicsMap) -> Mechanism:
    """The body as `[mechanism]` states it."""
    stated = Mechanism.from_dict(base.mechanism)
    return stated_rod(stated) if stated.builtin == "rod" else stated


def sizes_sentence(base: PhysicsMap, other: PhysicsMap, covariance: F) -> str:
    """Sizes of a body that was fitted with its sizes beside the stated ones, in words.

    Those that differ by no more than chance are left out.
    """
    values, spread = other.coefficients, np.sqrt(np.diag(covariance))
    stated, ends = base.values or {}, np.array(other.bounds).T
    sizes = [(place, name) for place, name in enumerate(other.free) if name in SIZES]
    sure = [
        (place, name)
        for place, name in sizes
        if abs(values[place] - stated[name]) >= _SIZE_DEVIATIONS * spread[place]
    ]
    said = []
    for place, name in sure or sizes:
        value = values[place]
        beyond = np.select(np.isclose(value, ends[place]), (" or less", " or more"), "")
        size = name.removesuffix("_m")
        said.append(f"the {size} looks {value:.4g} m{beyond}, stated as {stated[name]:.4g} m")
    return " and ".join(said)


def sizes_that_fit(base: StiffnessMap, table: Table, noise: Noise) -> str:
    """The sizes, E and nu of a body that errs a third of this fit to these rows, in words."""
    if not isinstance(base, PhysicsMap):
        return ""
    measured = table.measured()
    read, poses = measured.matrix(base.outputs), measured.matrix(base.inputs)
    size = np.maximum(rms_of_columns(read), 1e-300)
    before = rms((read - base.predict(poses)) / size)
    fit = fit_with_sizes(base, measured, noise)
    if fit is None or not isinstance(fit.base, PhysicsMap) or not fit.base.factor > 0.0:
        return ""
    modulus, nu = fit.base.coefficients[:2]
    found = sizes_sentence(base, fit.base, fit.covariance)
    found = f"; {found}, with E = {1e-6 * modulus:.3g} MPa and nu = {nu:.3f}"
    return found if rms((read - fit.base.predict(poses)) / size) < before / 3.0 else ""


@dataclass(frozen=True)
class PhysicsModel(ModelSpecification):
    """The FEM body with E and nu to fit; short name `physics`.

    Parameters
    ----------
    mechanism
        The body. Default the table's `[mechanism]`.
    base
        A map that is built already (`physics_map`); it takes the place of the body.
    threads
        Threads of the FEM, 0 for all cores.

    Examples
    --------
    >>> PhysicsModel().name
    'physics'
    """

    mechanism: Mechanism | None = None
    base: PhysicsMap | None = None
    threads: int = 0

    kind = "physics"

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Generalised least squares of the free parameters by the declared noise."""
        base = self.base
        need_pose(table, self.name)
        if base is None:
            body = self.mechanism or table.meta.elastic_body()
            if body is None:
                raise InputError(
                    f"{table.source}: the physics model needs the body; "
                    "give [mechanism] builtin with its dimensions, or mesh, in the data's TOML",
                    remedy=CHOOSE,
                )
            base = physics_map(body, threads=self.threads, poses=poses_meant(table))
        if is_partial(table):
            return fit_measured(base, table, progress=progress)
        return refit_physics(base, table, progress=progress)

    @staticmethod
    def layout(n: int, m: int) -> Layout:
        """Layout of the body, its energies and their error in a model file."""
        # Beside misread rows E may be below zero.
        values = record(dict.fromkeys(PARAMETERS, number(positive=True)) | {_MODULUS: number()})
        free = items(one_of(*PARAMETERS), least=1)
        return record(
            {"own_error": array(6), "mechanism": named(anything), "factor": number()},
            {"parameters": values, "free": free, "mesh_difference": LAYOUT},
            others=True,
        )

    map_from_document = staticmethod(PhysicsMap.from_document)


_SIZES = np.geomspace(0.1, 30.0, 25)
"""Distances of base and physics that are tried, rms over the noise, equally likely in log."""


def physics_prior(
    base: StiffnessMap,
    physics: PhysicsMap,
    effects: tuple[FittedEffect, ...],
    table: Table,
    noise: Noise,
) -> CoefficientPrior:
    """A prior that holds a base near the physics of the stated body.

    The wrench of the base differs from that of the physics by a random field of the base's own
    form, of rms s times the noise over the rows (Zellner's g-prior, g = s^2 M / k with M readings
    and k coefficients). s is the most likely one, with the effects, E and nu free (type II maximum
    likelihood, Rasmussen and Williams, Gaussian Processes for Machine Learning, section 5.4.1).

    Parameters
    ----------
    base
        Map that is linear in its k coefficients.
    physics, effects
        Fitted to the same rows together.
    table
        Measured rows.
    noise
        Noise of a row.
    """
    rows = Rows(table, physics)
    whitener = whiteners(noise.covariance(rows, physics.error))

    def whitened(columns: F) -> F:
        """(M, q) of columns (N, 6, q)."""
        flat = np.einsum("nij,njq->niq", whitener, columns).reshape(-1, columns.shape[2])
        return np.asarray(flat)

    x, sensitivity = (whitened(base_columns(rows, own)) for own in (base, physics))
    target = whitened(rows.wrench[:, :, None])[:, 0]
    q, r = np.linalg.qr(x)
    # Coefficients of a base whose columns depend on each other: the smallest that fit.
    solve = np.linalg.pinv(r / np.linalg.norm(r, axis=0)) / np.linalg.norm(r, axis=0)[:, None]
    mean, along = solve @ (q.T @ target), q @ (q.T @ sensitivity)

    y = table.matrix(physics.outputs) - rows.sensor_load
    acting = [jacobian_of(item.effect, rows, item.values) for item in effects]
    for item in effects:
        y = y - correction_of(item.effect, rows, item.values)
    free = orthonormal(np.concatenate([along, *(whitened(columns) for columns in acting)], axis=1))
    y = whitened(y[:, :, None])[:, 0]
    y = y - free @ (free.T @ y)
    left, sizes, _ = svd(q - free @ (free.T @ q))
    part = (left.T @ y) ** 2
    g = _SIZES[:, None] ** 2 * len(y) / len(mean)
    grown = g * sizes**2
    likelihood = 0.5 * (part * grown / (1.0 + grown) - np.log1p(grown)).sum(axis=1)
    best = int(np.argmax(likelihood))
    flat = orthonormal(q.T @ sensitivity)
    root = (r - flat @ (flat.T @ r)) / np.sqrt(g[best, 0])
    names = ", ".join(item.id for item in effects)
    return CoefficientPrior(
        mean,
        root,
        f"The base is held near the physics of the stated body, {_SIZES[best]:.2g} times the noise "
        f"from it: these rows alone do not tell {names} from its stiffness.",
    )
