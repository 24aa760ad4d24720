"""What all rows share: the noise of the reading from which the sensor's zero was taken.

It is no scatter of the rows, however many there are, and yet every one of them holds it: a constant
wrench in body axes. Readings of the free sensor that follow show how much such a reading scatters.
Where each of them reads exactly zero it was the zero of the rows about it; these errors are not
seen, and they average out over the campaign.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows

_LEAST_READINGS = 3


def shared_zero_error(rows: Rows, residual: F, noise: Noise) -> F:
    """(N, 6, 6 c) of each row per standard deviation of the zero's error, in N and N m, base axes.

    One column per axis of the top frame for each of c campaigns, which have a zero of their own:
    the scatter of its unloaded readings about their mean, whatever drew that aside, gives a force's
    and a torque's standard deviation; a reading scatters no more than a row. None where fewer than
    three were read.

    Parameters
    ----------
    residual
        (N, m) measured minus predicted.
    """
    if rows.base.inputs != POSE or rows.base.outputs != WRENCH:
        return np.zeros((*residual.shape, 0))
    free = rows.unloaded & rows.table.wrenches.any(axis=1) & ~rows.dead_weight
    most = np.array([noise.force_sd_N, noise.torque_sd_Nm])
    found = [np.zeros((*residual.shape, 0))]
    for campaign in np.unique(rows.campaign).tolist():
        own = rows.campaign == campaign
        read = free & own
        if read.sum() < _LEAST_READINGS:
            continue
        left = np.einsum("nji,nj->ni", rows.base_from_top[read], residual[read])
        variance = left.var(axis=0, ddof=1).reshape(2, 3).mean(axis=1)
        sd = np.repeat(np.minimum(np.sqrt(variance), most), 3)
        found.append(rows.base_from_top * sd * own[:, None, None])
    return np.concatenate(found, axis=2)
