"""What else a user gives for a model: a function, an expression, a table of predicted wrenches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ecm.errors import InputError, Remedy
from ecm.io.arrays import F
from ecm.io.table import Table, as_table
from ecm.models.expression import Expression, FunctionModel
from ecm.models.fit import polynomial
from ecm.models.maps import MapDefaults, StiffnessMap
from ecm.models.model import Model, load_model
from ecm.models.noise_estimate import declared_or_fitted
from ecm.models.partial import measured_part
from ecm.models.specification import ModelSpecification, pose_and_wrench_columns

_NEAR = 1e-6
"""Two poses are the same within this share of the range of each column."""

EXPECTED = (
    "a Model, a function of poses (N, n) that returns wrenches (N, m), an ecm.Expression, the path "
    "of a model file, or a table of predicted wrenches"
)


@dataclass(frozen=True, eq=False)
class PredictedMap(MapDefaults):
    """Predicted wrenches at the poses of a table; between them a polynomial carries the slope."""

    table: Table
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    kind = "predictions"

    @property
    def name(self) -> str:
        """The file's name without folder and ending."""
        return Path(self.table.source).stem or "predictions"

    @property
    def coefficients(self) -> F:
        """None: (0,)."""
        return np.zeros(0)

    @cached_property
    def _smooth(self) -> StiffnessMap:
        return polynomial(self.table)

    @cached_property
    def _span(self) -> F:
        span = np.ptp(self.table.matrix(self.inputs), axis=0)
        return np.asarray(np.where(span > 0.0, span, 1.0))

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.table.matrix(self.inputs) / self._span)

    @cached_property
    def _left(self) -> F:
        poses = self.table.matrix(self.inputs)
        return self.table.matrix(self.outputs) - self._smooth.predict(poses)

    def predict(self, poses: F) -> F:
        """(N, m): as predicted at a pose of the table, elsewhere by the slope from the nearest."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        nearest = self._tree.query(poses / self._span)[1]
        return self._smooth.predict(poses) + self._left[nearest]

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n) slope of the polynomial."""
        return self._smooth.stiffness(np.ascontiguousarray(poses, dtype=np.float64), kind)

    def columns(self, poses: F) -> F:
        """(N, m, 0)."""
        return np.zeros((len(poses), len(self.outputs), 0))

    def with_coefficients(self, coefficients: F) -> PredictedMap:
        """The same map."""
        return self

    def refuse_other_poses(self, table: Table) -> None:
        """Raise InputError where a row of the table is at no pose of the predictions."""
        distance, _ = self._tree.query(table.matrix(self.inputs) / self._span)
        far = np.flatnonzero(~(distance <= _NEAR))
        if len(far):
            raise InputError(
                f"{self.table.source} predicts no wrench at the pose of row {far[0] + 1} of "
                f"{table.source} ({len(far)} of {len(table)} rows): expected a prediction at each "
                "measured pose; compute them at the pose columns of that table"
            )

    def document(self) -> dict[str, Any]:
        """Raise InputError: predictions at some poses are no model of others."""
        raise InputError(
            f"{self.name}: a table of predicted wrenches is no model that a file could hold; fit "
            "one to it",
            remedy=Remedy(
                "fit a model to the predictions", "ecm fit MODEL --model linear --out OUT"
            ),
        )


def predicted_map(table: Table) -> PredictedMap:
    """The map of a table of predicted wrenches.

    Raises
    ------
    InputError
        Without pose and wrench columns, or where one pose has two wrenches.
    """
    inputs, outputs = pose_and_wrench_columns(table)
    made = PredictedMap(table.measured(), inputs, outputs)
    wrench = made.table.matrix(outputs)
    size = np.abs(wrench).max(axis=0)
    for i, j in made._tree.query_pairs(_NEAR, output_type="ndarray").tolist():
        if np.any(np.abs(wrench[i] - wrench[j]) > 1e-9 * size):
            raise InputError(
                f"{table.source}: rows {i + 1} and {j + 1} have the same pose and other wrenches; "
                "expected one prediction a pose"
            )
    return made


def as_model(given: Any, table: Table) -> Model:
    """A model of what a user gave for one, for the rows of a table.

    Parameters
    ----------
    given
        A `Model`, a map, a function of poses (N, n) that returns wrenches (N, m), an `Expression`
        at its start, the path of a model file, or a table of predicted wrenches.
    table
        Measured rows; a function gets their pose columns.

    Raises
    ------
    InputError
        For anything else; the message says what was expected.

    Examples
    --------
    >>> table = as_table({"x_m": [0.0, 0.01, 0.02], "fx_N": [0.0, 1.0, 2.1]})
    >>> as_model(lambda poses: 100.0 * poses, table).predict(np.array([0.02]))
    array([2.])
    """
    base: Any
    if isinstance(given, str | Path) and Path(given).suffix.lower() == ".json":
        given = load_model(given)
    if isinstance(given, Model):
        base = measured_part(given.base, table)
        return given if base is given.base else replace(given, base=base)
    if isinstance(given, Expression):
        base = given.map()
    elif isinstance(given, ModelSpecification):
        raise InputError(
            f"the model {given.name} is not fitted: fit it first, ecm.fit(table, ...)",
            remedy=Remedy("fit it first", f"ecm fit DATA --model {given.name} --out MODEL"),
        )
    elif all(hasattr(given, name) for name in ("inputs", "outputs", "predict", "stiffness")):
        base = given
    elif callable(given) and not isinstance(given, type):
        base = FunctionModel(given).map(table)
        base.predict(table.matrix(base.inputs))
    else:
        try:
            base = predicted_map(as_table(given, source="predictions", need="fit"))
        except InputError as error:
            kind = type(given).__name__
            raise InputError(f"model: found a {kind}, expected {EXPECTED} ({error})") from None
        base.refuse_other_poses(table.measured())
    return Model(base=base, noise=declared_or_fitted(base, table.measured()))
