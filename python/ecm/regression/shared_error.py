"""Shared error: the noise of the reading from which the sensor's zero was taken.

It is the same in all rows, a constant wrench in body axes, so that more rows do not reduce it.
Later readings of the free sensor show its size. Readings of exactly zero were new zeros; their
errors are not seen and average out over the campaign.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows, is_whole

_LEAST_READINGS = 3


def shared_zero_error(rows: Rows, residual: F, noise: Noise) -> F:
    """(N, 6, 6 c) wrench of each row per standard deviation of the zero's error, in base axes.

    One column for each axis of the top frame and each of c campaigns, which have zeros of their
    own. Standard deviations of force and torque are those of the campaign's unloaded readings about
    their mean, at most those of a row. A campaign with fewer than three readings has no columns.

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
        variance = in_top.var(axis=0, ddof=1).reshape(2, 3).mean(axis=1)
        sd = np.repeat(np.minimum(np.sqrt(variance), most), 3)
        columns.append(rows.base_from_top * sd * own[:, None, None])
    return np.concatenate(columns, axis=2)
