"""Prediction over the workspace: rows whose variance is that of h, and of K times half the range.

In units of one reading's noise. I-optimal designs average over these rows, and `design_sizes`
takes its expected errors from them.
"""

from __future__ import annotations

import numpy as np

from ecm._native import polynomial_regressor
from ecm.designs.nominal import NominalModel
from ecm.designs.regressors import COMPONENT_SD, model_columns, polynomial_degree
from ecm.designs.settings import DesignSettings
from ecm.io.arrays import F, I

_REGION = 1000
"""Poses over which an I-optimal design averages at most, as in `ecm-design`."""
_STEP = 1e-4
"""Step of the derivative of the columns, over the candidates' range."""


def prediction_region(
    poses: F, settings: DesignSettings, base: NominalModel | None, terms: int
) -> F:
    """Rows whose mean variance is that of h plus that of K times half the range.

    Of evenly chosen poses; each of the d coordinates weighs 1/d in K. `terms` may exceed those of
    the model by the parameters of effects: what they add to a reading is no part of h.
    """
    stride = max(1, -(-len(poses) // _REGION))
    seen = np.arange(0, len(poses), stride)
    values, slopes = predicted_columns(poses, seen, settings, base)
    count = slopes.shape[1] // values.shape[1]
    # The mean is over all rows there: what is wanted is over the poses of the sample.
    whole = np.sqrt(1.0 + count)
    rows = [whole * values, whole / np.sqrt(count) * slopes]
    joined = np.concatenate([part.reshape(-1, part.shape[2]) for part in rows])
    return np.ascontiguousarray(np.pad(joined, ((0, 0), (0, terms - joined.shape[1]))))


def predicted_columns(
    poses: F, seen: I, settings: DesignSettings, base: NominalModel | None
) -> tuple[F, F]:
    """Columns of the sample in units of the noise, and of K times half the pose's range."""
    low, high = poses.min(axis=0), poses.max(axis=0)
    moving = np.flatnonzero(high > low)
    degree = polynomial_degree(settings.model)

    def columns(at: F) -> F:
        if degree is None:
            blocks = model_columns(at, settings, base)
            sd = COMPONENT_SD if base is None else _component_sd(base, poses)
            return blocks / sd[None, :, None]
        own = np.ascontiguousarray(at[:, moving])
        return polynomial_regressor(own, degree, low[moving], high[moving])[:, None, :]

    sample = poses[seen]
    steps = []
    for j in moving:
        step = np.zeros(poses.shape[1])
        step[j] = _STEP * (high[j] - low[j])
        steps.append((columns(sample + step) - columns(sample - step)) / (4.0 * _STEP))
    return columns(sample), np.concatenate(steps, axis=1)


def _component_sd(base: NominalModel, poses: F) -> F:
    """(6,) root mean variance of a reading's components over the candidates."""
    covariance = base.noise.covariance(base.rows(poses))
    return np.asarray(np.sqrt(np.einsum("nii->ni", covariance).mean(axis=0)))
