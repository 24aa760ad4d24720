"""Whether a model lacks something on given rows: structure in its residual that is no chance.

One function answers for every command. Two tests look at the residual of the model as it stands:
its lack of fit against repeats, and smooth functions of the pose, the order, the motion of a
continuous test and every other column.
Both compare with what is left in the same rows, so that noise that was stated too small or too
large does not decide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.comparison.residuals import feature_columns
from ecm.io.arrays import B, F, I
from ecm.io.columns import JOINT_SIGNS, JOINTS, VELOCITY
from ecm.io.table import Table
from ecm.regression.approach import order_of_visits
from ecm.regression.f_test import Beside, lack_of_fit
from ecm.regression.folds import is_continuous
from ecm.regression.repeats import repeat_cells
from ecm.regression.rows import Rows
from ecm.regression.speed import speeds

LEVEL = 0.01
"""Chance of a wrong rejection."""
NEAR_NOISE = 1.1
"""An error over the noise that is no more than this says nothing: no noise is known better."""
_NOTHING = "nothing in it follows the pose, the order or another column"
_ALIKE, _SURE = 0.2, 5.0
"""Correlation of neighbouring residuals that is said, and how far beyond chance it must be."""
LEAST_STRENGTH = 0.15
"""Structure weaker than this, in units of the noise, does not count: no base is better."""


@dataclass(frozen=True)
class StructureTest:
    """The more significant of two tests of a residual.

    Examples
    --------
    >>> StructureTest(F=8.0, p=1e-6, strength=0.5).found
    True
    >>> StructureTest(F=8.0, p=1e-6, strength=0.05).found
    False
    """

    F: float
    p: float
    strength: float
    """Root mean square of what the tests explain beyond chance, in units of the noise."""

    @property
    def found(self) -> bool:
        """Whether structure is seen, and strong enough to count."""
        return self.p < LEVEL and self.strength >= LEAST_STRENGTH


def structure_test(
    rows: Rows, whitened: F, whitener: F, scored: B, *, fitted: F | None = None
) -> StructureTest:
    """Test the residual of a model for structure.

    Parameters
    ----------
    rows
        N rows with their map.
    whitened
        (N, m) residual over its noise.
    whitener
        (N, m, m) of the rows.
    scored
        (N,) rows that measure a pose.
    fitted
        (N, m, k) whitened columns of the coefficients that were fitted to these rows; default none.
    """
    n, m = whitened.shape
    own = np.zeros((n, m, 0)) if fitted is None else fitted
    weights = scored.astype(np.float64)
    values = np.hstack([other_columns(rows), _higher_degrees(rows), _motion(rows)])
    columns = np.concatenate(
        [
            feature_columns(rows, whitener, max(1, min(90, n // 3))),
            np.einsum("nij,nq->niqj", whitener, values).reshape(n, m, -1),
        ],
        axis=2,
    )
    smooth = Beside.of(whitened, columns, own, weights)
    tests = [smooth.with_sign_chance(smooth.omnibus_test())]
    cells = np.where(scored, repeat_cells(rows.table), -1 - np.arange(n))
    repeated = lack_of_fit(whitened, cells, own.shape[2], weights)
    if repeated is not None:
        tests.append(repeated)
    tests = [test for test in tests if np.isfinite(test.F)]
    if not tests:
        return StructureTest(float("nan"), 1.0, 0.0)
    best = min(tests, key=lambda test: test.p)
    # Over the noise of the row, not over the rest: so far the noise is believed.
    chance = best.dof * best.rest / best.dof_error
    beyond = max(0.0, best.explained - chance) / max(1.0, float(weights.sum()) * m)
    return StructureTest(best.F, min(1.0, best.p * len(tests)), float(np.sqrt(beyond)))


def _higher_degrees(rows: Rows) -> F:
    """Return (N, q) polynomials above the quadratic in each coordinate: up to 6 of one or two."""
    poses = rows.poses
    wide = np.ptp(poses, axis=0)
    low = poses.min(axis=0)
    most = 6 if poses.shape[1] <= 2 else 3
    columns = []
    for j in np.flatnonzero(wide > 0.0):
        scaled = 2.0 * (poses[:, j] - low[j]) / wide[j] - 1.0
        columns.append(np.polynomial.chebyshev.chebvander(scaled, most)[:, 3:])
    return np.hstack(columns) if columns else np.zeros((len(poses), 0))


def _motion(rows: Rows) -> F:
    """Return (N, q) velocities and ways of a continuous test; of few columns loops over the pose.

    A damper follows the velocity, a loop its sign, and the width of a loop the pose.
    """
    columns: list[F] = []
    found = speeds(rows.table) if is_continuous(rows.table) else {}
    few = len(rows.base.inputs) <= 2
    for j, name in enumerate(rows.base.inputs):
        velocity = found.get(f"v_{name}")
        if velocity is None:
            continue
        way = np.sign(velocity)
        columns += [velocity / velocity.std(), way]
        if few:
            pose = rows.poses[:, j]
            scaled = 2.0 * (pose - pose.min()) / max(float(np.ptp(pose)), 1e-300) - 1.0
            columns += list(way * np.polynomial.chebyshev.chebvander(scaled, 4)[:, 1:].T)
    return np.stack(columns, axis=1) if columns else np.zeros((len(rows), 0))


def nothing_follows(over_noise: float, alike: float | None) -> str:
    """Return what is said of an error beyond the noise without structure.

    Parameters
    ----------
    over_noise
        Error over the noise.
    alike
        Correlation of neighbouring rows where it is no chance: `neighbours_alike`.

    Examples
    --------
    >>> nothing_follows(1.04, None)
    'and nothing in it follows the pose, the order or another column'
    """
    if alike is not None:
        return (
            f"and {_NOTHING}, but neighbouring rows err alike (correlation {alike:.2f}), which the "
            "noise of single readings does not: a period, a memory, or noise that changes slowly"
        )
    if over_noise <= NEAR_NOISE:
        return f"and {_NOTHING}"
    return (
        f"but {_NOTHING}: that noise is likely too small, or these rows are too few to show what "
        "is missing"
    )


def neighbours_alike(table: Table, rows: I, whitened: F) -> float | None:
    """Return the correlation of the residuals of rows that follow each other in time, if it is one.

    Parameters
    ----------
    rows
        (n,) rows of the table.
    whitened
        (n, m) their residuals over the noise.

    Returns
    -------
    float or None
        None without time, or where chance gives as much.
    """
    if not table.has("time_s"):
        return None
    place = np.full(len(table), -1)
    place[rows] = np.arange(len(rows))
    together, count = 0.0, 0
    for order in order_of_visits(table):
        own = place[order]
        first, second = own[:-1], own[1:]
        both = (first >= 0) & (second >= 0)
        together += float((whitened[first[both]] * whitened[second[both]]).sum())
        count += int(both.sum()) * whitened.shape[1]
    if count == 0:
        return None
    correlation = together / count / max(float((whitened**2).mean()), 1e-300)
    return correlation if correlation > max(_ALIKE, _SURE / np.sqrt(count)) else None


def other_columns(rows: Rows) -> F:
    """Return (N, q) standardised velocities, joints, their signs and tendons: no `features`."""
    table = rows.table
    names = [name for name in (*VELOCITY, *JOINTS, *JOINT_SIGNS) if table.has(name)]
    names += [name for name in table.columns if name.startswith("tendon")]
    values = [np.nan_to_num(table.column(name)) for name in names]
    varying = [(v - v.mean()) / v.std() for v in values if float(np.ptp(v)) > 0.0]
    return np.stack(varying, axis=1) if varying else np.zeros((len(rows), 0))
