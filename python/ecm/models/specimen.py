"""Another specimen of the same form: its loads are those of the model, times one factor."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ecm.effects.protocol import LinearEffect, Parameter
from ecm.errors import ModelError
from ecm.io.arrays import F
from ecm.regression.rows import taken_by

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.joint_fit import FittedEffect
    from ecm.models.model import Model
    from ecm.regression.rows import Rows


class OtherSpecimen(LinearEffect):
    """All loads times one number: the body is another one, and no effect of what was fitted."""

    id = "another_specimen"
    physics = "Another specimen, stiffer or softer as a whole."
    parameters = (Parameter("share", "1", 0.1, -0.9),)
    requires = ()
    of_six = False

    def columns(self, rows: Rows) -> F:
        """(N, m, 1): the wrench."""
        return rows.wrench[:, :, None]


def of_other_specimen(model: Model, fitted: FittedEffect) -> Model:
    """The model with the base of another specimen: its loads times a factor, which may err.

    A ModelError where the loads of the base are not proportional to its coefficients.
    """
    coefficients = model.base.coefficients
    poses = np.array(model.training.get("poses") or [[1e-3] * len(taken_by(model.base))])
    loads = model.base.predict(poses)
    if not np.allclose(model.base.columns(poses) @ coefficients, loads, atol=1e-9 * np.ptp(loads)):
        raise ModelError(
            f"the loads of {model.base.name} are not proportional to its coefficients: its form "
            "cannot be kept up to a factor, fit it again"
        )
    ((share,), (sd,)) = fitted.values, fitted.sd
    covariance = model.covariance
    if covariance is not None:
        covariance = (1.0 + share) ** 2 * covariance + sd**2 * np.outer(coefficients, coefficients)
    base = model.base.with_coefficients((1.0 + share) * coefficients)
    return replace(model, base=base, covariance=covariance)


def specimen_of(model: Model, table: Table) -> FittedEffect:
    """The factor between the loads of these rows and those of a base that is kept."""
    return model.add(OtherSpecimen()).fit(table, with_ceiling=False).effects[-1]


def said_of(specimen: FittedEffect) -> str:
    """What the fit report says of it."""
    ((share,), (sd,)) = specimen.values, specimen.sd
    return f"The base is kept up to one factor, its loads times {1.0 + share:.4g} +- {sd:.2g}"
