"""Maps of all six wrench columns where only some of them are measured: six poses, three forces.

Such a map is fitted to the components that exist. Where these determine all of its coefficients
(the two of a stated body), the map is as good as any and predicts all six; where they do not (an
energy, whose pure turns do no work at the forces), it keeps to the measured ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any, cast

import numpy as np

from ecm.errors import InputError, Remedy
from ecm.io.arrays import F, eigh
from ecm.io.columns import POSE, WRENCH
from ecm.io.events import Progress, tell_part
from ecm.io.table import Table
from ecm.models.joint_fit import declared_or_fitted, joint_fit, spread_noise, unit_products
from ecm.models.maps import FittedMap, MapDefaults, StiffnessMap, partial_to
from ecm.regression.rows import BaseMap, BodyChange

MEASURED = "measured"
"""Kind of such a map in a model file: what reads files by kind must not take it for a whole one."""
_WEIGHTINGS = 4
_UNSEEN = 1e-6
"""Share of the largest square of a unit combination of coefficients that counts as unseen."""


def _of_whole(name: str) -> Any:
    """What the whole map says of itself by this name."""
    return property(attrgetter(f"whole.{name}"))


@dataclass(frozen=True, eq=False)
class MeasuredMap(MapDefaults):
    """Some wrench columns of a map.

    Examples
    --------
    >>> from ecm.models import surrogate_of
    >>> poses = np.random.default_rng(0).uniform(-0.01, 0.01, (60, 6)) + [0.1, 0, 0, 0, 0, 0]
    >>> wrenches = 1000.0 * (poses - [0.1, 0, 0, 0, 0, 0])
    >>> whole = surrogate_of(poses, wrenches, 0.1, test_poses=poses, test_wrenches=wrenches)
    >>> MeasuredMap(whole, ("fx_N", "fz_N")).predict(poses).shape
    (60, 2)
    """

    whole: StiffnessMap
    outputs: tuple[str, ...]

    name = _of_whole("name")
    kind = _of_whole("kind")
    inputs = _of_whole("inputs")
    actuators = _of_whole("actuators")
    length_m = _of_whole("length_m")
    coefficients = _of_whole("coefficients")
    parameter_names = _of_whole("parameter_names")
    parameter_unit = _of_whole("parameter_unit")
    bounds = _of_whole("bounds")
    prior = _of_whole("prior")

    @property
    def places(self) -> list[int]:
        """Places of the columns in the whole map's."""
        return [self.whole.outputs.index(name) for name in self.outputs]

    @property
    def error(self) -> F:
        """(m,) own error of these columns."""
        return np.asarray(self.whole.error[self.places])

    def error_columns(self, poses: F) -> F:
        """(N, m, e) of these columns."""
        return np.ascontiguousarray(self.whole.error_columns(poses)[:, self.places])

    def further_columns(self, poses: F) -> F:
        """(N, m, e) of these columns."""
        return np.ascontiguousarray(self.whole.further_columns(poses)[:, self.places])

    def predict(self, poses: F) -> F:
        """(N, n) poses to (N, m) wrenches."""
        return np.ascontiguousarray(self.whole.predict(poses)[:, self.places])

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n); kinds other than `partial` need all six wrench columns."""
        partial = np.ascontiguousarray(self.whole.stiffness(poses)[:, self.places])
        return partial_to(kind, partial, poses, self)

    def actuation_jacobian(self, poses: F) -> F:
        """(N, m, a) slope to the inputs of actuators, of a map that has some."""
        whole: Any = self.whole
        return np.ascontiguousarray(whole.actuation_jacobian(poses)[:, self.places])

    def columns(self, poses: F) -> F:
        """(N, m, k) derivative to the coefficients."""
        return np.ascontiguousarray(self.whole.columns(poses)[:, self.places])

    def with_coefficients(self, coefficients: F) -> MeasuredMap:
        """The same columns with other coefficients."""
        return replace(self, whole=self.whole.with_coefficients(coefficients))

    def other_body(self, change: BodyChange) -> BaseMap | None:
        """These columns of a changed body; None where the map knows one body only."""
        other = self.whole.other_body(change)
        return None if other is None else replace(self, whole=cast("StiffnessMap", other))

    def document(self) -> dict[str, Any]:
        """The whole map, and the columns that it is good for."""
        return self.head(parameters=self.whole.document()) | {"kind": MEASURED}


def measured_outputs(table: Table, base: StiffnessMap) -> tuple[str, ...]:
    """The outputs of a map that the table has."""
    return tuple(name for name in base.outputs if table.has(name))


def measured_part(base: StiffnessMap, table: Table) -> StiffnessMap:
    """The map, or where the table lacks some of its wrench columns, the part that was measured.

    A polynomial or a learned map has a fit of its own for each column as well.
    """
    there = measured_outputs(table, base)
    if len(there) in (0, len(base.outputs)):
        return base
    return MeasuredMap(whole_map(base), there)


def whole_map(base: StiffnessMap) -> StiffnessMap:
    """The map itself, or the whole of which a few wrench columns were measured."""
    return base.whole if isinstance(base, MeasuredMap) else base


def is_partial(table: Table) -> bool:
    """Whether all six pose columns are there, and some of the six wrench columns."""
    return table.has(*POSE) and 0 < len(table.wrench_columns) < len(WRENCH)


def need_whole_wrench(table: Table, name: str) -> None:
    """Raise InputError where a fit by name cannot do with fewer than the twelve columns."""
    lacking = [column for column in (*POSE, *WRENCH) if not table.has(column)]
    if not lacking:
        return
    word = "energy4" if is_partial(table) and table.meta.length_m is not None else "linear"
    raise InputError(
        f"{table.source}: {name} needs all six pose and six wrench columns, and there is no "
        f"{', '.join(lacking)}",
        remedy=Remedy("fit one of the columns there are", f"ecm fit DATA --model {word} --out OUT"),
    )


def need_pose(table: Table, name: str) -> None:
    """Raise InputError where one of the six pose columns or every wrench column is missing."""
    if not table.has(*POSE) or not table.wrench_columns:
        need_whole_wrench(table, name)


def fit_measured(
    start: StiffnessMap, table: Table, spread: bool = False, progress: Progress | None = None
) -> FittedMap:
    """Generalised least squares of a map's coefficients by the wrench columns of the table.

    Parameters
    ----------
    start
        Map of all six columns, where the fit begins.
    table
        N measured rows of six pose columns and some wrench columns.
    spread
        Each component over its own standard deviation, in place of the noise.
    progress
        Called with the weightings that are done, of all.

    Raises
    ------
    InputError
        Where there are fewer readings than coefficients that they could determine.
    """
    base: StiffnessMap = MeasuredMap(start, measured_outputs(table, start))
    measured = table.matrix(base.outputs)
    joint = joint_fit(base, (), table, spread_noise(measured))
    seen = int(np.count_nonzero((joint.design**2).sum(axis=(0, 1)) > 0.0))
    if measured.size < seen:
        raise InputError(
            f"{table.source}: {measured.size} readings of {', '.join(base.outputs)} for {seen} "
            f"coefficients of {base.name}: give more rows, or take a lower degree"
        )
    noise = declared_or_fitted(joint.base, table)
    for i in range(0 if spread else _WEIGHTINGS):
        tell_part(progress, i, _WEIGHTINGS, f"weighting {i + 1} of {_WEIGHTINGS}")
        joint = joint_fit(joint.base, (), table, noise)
        noise = declared_or_fitted(joint.base, table)
    unseen = _unseen(joint.design.reshape(measured.size, -1))
    fitted = joint.base if unseen else cast("MeasuredMap", joint.base).whole
    freedom = measured.size - len(base.coefficients) + unseen
    variance = None
    if not noise.is_residual and freedom > 0 and not spread:
        variance = float((joint.whitened**2).sum()) / freedom
    # The spread of what was measured is no noise of the columns that a whole map predicts beside.
    known = declared_or_fitted(fitted, table) if noise.is_residual else noise
    return FittedMap(fitted, known, joint.covariance, variance)


def _unseen(design: F) -> int:
    """Number of combinations of the coefficients that change nothing that was measured."""
    return int(design.shape[1] - seen_combinations(design).shape[1])


def seen_combinations(design: F) -> F:
    """(k, s) combinations of the coefficients that change what was measured, of rows (N, k).

    Examples
    --------
    >>> abs(seen_combinations(np.array([[3.0, 3.0], [1.0, 1.0]]))).round(3).tolist()
    [[0.224], [0.224]]
    """
    scale, products = unit_products(design)
    squares, vectors = eigh(products)
    seen = squares >= _UNSEEN * max(float(squares[-1]), 1e-300)
    return np.asarray(vectors[:, seen] / scale[:, None])
