"""Whether a model errs far beyond the noise where a base that is fitted to the same rows does not.

With few rows of many columns no test of a residual can show what a model lacks; the base can.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ecm.errors import EcmError
from ecm.models.base_choice import choose_base
from ecm.models.history import held_out_rms
from ecm.models.joint_fit import joint_fit
from ecm.regression.folds import folds, held_out_by, is_pose_row, row_groups, without_zero_readings

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.model import Model
    from ecm.regression.noise import Noise

FAR_BEYOND_NOISE = 2.2
"""Error over the noise that a noise stated half as large does not explain."""
_TIMES = 2.0
"""A model that errs so many times as much as a base fitted to the rows lacks something."""


def is_far_behind(error: float, of_base: float, most: float = FAR_BEYOND_NOISE) -> bool:
    """Whether a model errs far beyond the noise and a base fitted to the rows does not.

    Parameters
    ----------
    error, of_base
        Over the noise, of the model as it stands and of the base on held-out rows.
    most
        Error over the noise up to which the noise may be to blame.

    Examples
    --------
    >>> is_far_behind(6.0, 1.1), is_far_behind(6.0, 5.0), is_far_behind(1.9, 0.5)
    (True, False, False)
    """
    return error > max(most, _TIMES * of_base)


def base_and_error(model: Model, table: Table, noise: Noise) -> tuple[str, float] | None:
    """The name and the held-out error over the noise of the base that names would be against.

    Returns
    -------
    tuple or None
        None where these rows cannot carry a base.
    """
    kept = without_zero_readings(table)
    groups = row_groups(kept)
    try:
        base = choose_base(model, kept)
        if noise.components is not None and base.outputs != model.outputs:
            return None  # noise of other columns
        fit = joint_fit(base, (), kept, noise)
        parts = folds(kept, fit.rows.poses, groups, held_out_by(kept, "time"))
    except (EcmError, np.linalg.LinAlgError):
        return None
    if len(np.unique(parts)) < 2:
        return None
    error = held_out_rms(fit.design, fit.whitened, groups, parts, is_pose_row(kept))
    return base.name, error
