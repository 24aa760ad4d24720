"""The residual of every measured pose beside every variable: the points of a figure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ecm.comparison.comparison import Comparison
from ecm.comparison.dependence import dependence_variables
from ecm.comparison.residuals import residuals_by_block
from ecm.io.arrays import F, I
from ecm.regression.folds import is_pose_row
from ecm.regression.rows import Rows

_WORST = 10


@dataclass(frozen=True)
class ResidualPoints:
    """Residuals, measured minus predicted, of n measured poses in file order, m components."""

    row: I
    """(n,) rows of the table, from 1."""
    variables: Mapping[str, F]
    """(n,) by name with unit, those that vary."""
    physical: F
    """(n, m) in the units of the outputs."""
    over_noise: F
    """(n, m) over the standard deviation of that row's noise."""
    size: F
    """(n,) root mean square of the row's residual, whitened by its full covariance."""
    total: int
    """Measured poses of the table."""

    @property
    def sentence(self) -> str:
        """How many rows these are, where not all."""
        if len(self.row) == self.total:
            return ""
        return (
            f"{len(self.row)} of {self.total} rows are drawn: evenly over their order, and the "
            "worst ones."
        )


def residual_points(result: Comparison, most: int = 20_000) -> ResidualPoints:
    """Return the residuals of all measured poses, of more than `most` some and the worst ones.

    Parameters
    ----------
    result
        A comparison. `where` rests on chosen rows of a large table; this does not.
    most
        Rows above which every k-th is taken.

    Examples
    --------
    >>> import numpy as np
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 20)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x + 1e10 * x**3})
    >>> result = ecm.compare(ecm.fit_model(table, "linear"), table)
    >>> points = residual_points(result, most=10)
    >>> points.total, len(points.row) < 20, points.size.argmax() in (0, len(points.row) - 1)
    (20, True, True)
    """
    made = result.compared
    rows = Rows(made.table, made.model.base)
    physical, whitened, variance = residuals_by_block(
        rows, made.predicted, result.noise, made.model.base.error
    )
    scored = np.flatnonzero(is_pose_row(made.table))
    size = np.sqrt((whitened**2).mean(axis=1))
    at = scored
    if len(scored) > most:
        worst = scored[np.argsort(-size[scored], kind="stable")[:_WORST]]
        at = np.union1d(scored[:: -(-len(scored) // most)], worst)
    variables = {name: values[at] for name, values in dependence_variables(rows).items()}
    return ResidualPoints(
        row=made.table.row_numbers[at] + 1,
        variables={n: v for n, v in variables.items() if n == "row" or np.ptp(v) > 0.0},
        physical=physical[at],
        over_noise=physical[at] / np.sqrt(variance[at]),
        size=size[at],
        total=len(scored),
    )
