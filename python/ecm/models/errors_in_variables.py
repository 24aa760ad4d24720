"""Fit with noise in the pose as well as in the wrench (errors in variables).

Maximum likelihood over the coefficients and the true poses p_i of

    sum_i |h_i - h(p_i)|^2_(Sigma_w^-1) + |p~_i - p_i|^2_(Sigma_p^-1),

p~ the measured poses. The poses are eliminated to first order: with K_s at the present p_i, in
rotation increments of base axes, and delta_i = p~_i - p_i,

    e_i = h_i - h(p_i) - K_s delta_i,      Sigma_i = Sigma_w + K_s Sigma_p K_s',
    delta_i <- -Sigma_p K_s' Sigma_i^-1 e_i,

and the coefficients follow by generalised least squares of h_i - K_s delta_i on the columns at
p_i. At the fixed point both gradients of the sum are zero. Weights Sigma_i alone, with the columns
at the measured poses, would leave every stiffness too small by the share of the pose noise in the
spread of the poses, however many rows there are (attenuation).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ecm._native import left_jacobians
from ecm.effects import Rows
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.table import Table
from ecm.models.maps import StiffnessMap
from ecm.regression.noise import Noise, whiteners

Solve = Callable[[F, F, F], tuple[StiffnessMap, F, float]]
"""poses, wrenches, covariance (N, m, m) to map, covariance (k, k), whitened residual variance."""

_MAX_ITERATIONS = 20
_TOLERANCE = 0.01
"""The iteration ends when no coefficient changes by this share of its standard deviation."""
_LARGEST_SHIFT = 6.0
"""Largest shift of a pose, in standard deviations of the pose noise."""


@dataclass(frozen=True)
class NoisyPoseFit:
    """Result of a fit with pose noise."""

    base: StiffnessMap
    covariance: F
    """(k, k) covariance of the coefficients, from the stated noise."""
    residual_variance: float
    """Whitened residual square per degree of freedom: 1 where noise and model are right."""
    poses: F
    """(N, n) most likely true poses."""
    converged: bool


def fit_with_pose_noise(
    table: Table, start: StiffnessMap, noise: Noise, solve: Solve
) -> NoisyPoseFit:
    """Maximum likelihood fit of the coefficients and the true poses.

    Parameters
    ----------
    table
        N measured rows.
    start
        Map of the family, where the iteration starts.
    noise
        Noise of pose and wrench.
    solve
        Generalised least squares of the map's family.
    """
    base = start
    measured = table.matrix(base.inputs)
    wrenches = np.ascontiguousarray(table.matrix(base.outputs))
    poses, shift = measured.copy(), np.zeros_like(measured)
    before, covariance, variance = base.coefficients, np.zeros((0, 0)), np.nan
    change = np.inf
    for _ in range(_MAX_ITERATIONS):
        here = table.with_columns(dict(zip(base.inputs, poses.T, strict=True)))
        rows = Rows(here, base)
        k_s = rows.screw_stiffness if base.inputs == POSE else rows.stiffness
        moved = wrenches - np.einsum("nij,nj->ni", k_s, shift)
        base, covariance, variance = solve(poses, moved, noise.covariance(rows))
        sd = np.sqrt(np.diag(covariance))
        changes = np.abs(base.coefficients - before) / np.where(sd > 0.0, sd, np.inf)
        before, last = base.coefficients, change
        change = float(changes.max())
        if change < _TOLERANCE or (change > last and change < 0.1):
            break
        shift = _pose_shift(Rows(here, base), wrenches, shift, noise)
        poses = _shifted(measured, shift, base.inputs)
    return NoisyPoseFit(base, covariance, variance, poses, change < 0.1)


def _pose_shift(rows: Rows, wrenches: F, shift: F, noise: Noise) -> F:
    """(N, n) measured minus most likely pose, rotations as increments in base axes."""
    inputs = rows.base.inputs
    k_s = rows.screw_stiffness if inputs == POSE else rows.stiffness
    sd = np.array([noise.position_sd_m if c in POSE[:3] else noise.rotation_sd_rad for c in inputs])
    whitener = whiteners(noise.covariance(rows))
    e = wrenches - rows.wrench - np.einsum("nij,nj->ni", k_s, shift)
    weighted = np.einsum("nji,nj->ni", whitener, np.einsum("nij,nj->ni", whitener, e))
    shift = -np.einsum("nij,ni->nj", k_s, weighted) * sd**2
    return np.asarray(np.clip(shift, -_LARGEST_SHIFT * sd, _LARGEST_SHIFT * sd))


def _shifted(measured: F, shift: F, inputs: tuple[str, ...]) -> F:
    """Poses with p~ - p = shift; exp([shift]x) R(theta) = R(theta~) to first order."""
    poses = measured - shift
    if inputs == POSE:
        jacobian = left_jacobians(np.ascontiguousarray(measured[:, 3:]))
        rotation = np.linalg.solve(jacobian, shift[:, 3:, None])[:, :, 0]
        poses[:, 3:] = measured[:, 3:] - rotation
    return np.ascontiguousarray(poses)
