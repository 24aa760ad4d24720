"""The physics of the stated body as a prior on the coefficients of a free base.

Rows alone may not distinguish an effect from the stiffness of a free base: a load of constant arm
and a bending stiffness are one column there. The FEM of the body knows the stiffness but for E and
nu.
"""

from __future__ import annotations

import numpy as np

from ecm.effects.thinned import correction_of, jacobian_of
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.models.joint_fit import FittedEffect
from ecm.models.maps import StiffnessMap
from ecm.models.physics.map import PhysicsMap
from ecm.models.prior import CoefficientPrior
from ecm.regression.f_test import orthonormal
from ecm.regression.noise import Noise, whiteners
from ecm.regression.rows import Rows

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
    loaded = ~rows.unloaded
    whitener = whiteners(noise.covariance(rows, physics.error))
    poses = rows.poses[loaded]

    def whitened(columns: F) -> F:
        """(M, q) of columns (N, 6, q)."""
        flat = np.einsum("nij,njq->niq", whitener, columns).reshape(-1, columns.shape[2])
        return np.asarray(flat)

    def of_poses(columns: F) -> F:
        every = np.zeros((len(table), *columns.shape[1:]))
        every[loaded] = columns
        return whitened(every)

    x = of_poses(base.columns(poses))
    sensitivity = of_poses(physics.columns(poses))
    target = of_poses(physics.predict(poses)[:, :, None])[:, 0]
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
    left, sizes, _ = np.linalg.svd(q - free @ (free.T @ q), full_matrices=False)
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
