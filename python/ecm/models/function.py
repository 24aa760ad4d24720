"""Models that a user has as a Python function, with or without parameters to fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ecm.errors import EcmError, InputError
from ecm.io.arrays import F
from ecm.io.steps import Progress
from ecm.io.table import Table
from ecm.models.maps import central_differences, partial_to
from ecm.models.parameters import Parameter, ParametrisedMap, fit_parameters
from ecm.models.specification import (
    FittedMap,
    ModelSpecification,
    Weights,
    pose_and_wrench_columns,
)

_STEP = 1e-5
"""Step of central differences, m or rad."""


@dataclass(frozen=True, eq=False)
class FunctionMap(ParametrisedMap):
    """A Python function of poses (N, n), and of parameters by name, that gives wrenches (N, m)."""

    function: Callable[..., Any]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    kind = "function"

    @property
    def name(self) -> str:
        """The function's own name."""
        name = str(getattr(self.function, "__name__", ""))
        return name if name.isidentifier() else "lambda" if name == "<lambda>" else "own"

    @property
    def gives(self) -> str:
        """`the function NAME gives`."""
        return f"the function {self.name} gives"

    def raw(self, poses: F) -> F:
        """(N, m) what the function gives, also where it is no number."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        try:
            wrench = np.asarray(self.function(poses.copy(), **self.values), dtype=np.float64)
        except EcmError:
            raise
        except Exception as error:
            raise InputError(
                f"the function {self.name} failed at poses of shape {poses.shape} "
                f"({', '.join(self.inputs)}): {type(error).__name__}: {error}"
            ) from error
        m = len(self.outputs)
        if m == 1 and wrench.shape == (len(poses),):
            wrench = wrench[:, None]
        if wrench.shape != (len(poses), m):
            raise InputError(
                f"{self.gives} shape {wrench.shape} at poses of shape "
                f"{poses.shape}, expected {(len(poses), m)}: a row a pose, a column each of "
                f"{', '.join(self.outputs)}"
            )
        return wrench

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n) by central differences."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        slope = np.stack(central_differences(self.predict, poses, _STEP), axis=2)
        return partial_to(kind, slope, poses, self)

    def columns(self, poses: F) -> F:
        """(N, m, k) derivative to the parameters that vary, by central differences."""
        at, made = self.coefficients, np.zeros((len(poses), len(self.outputs), 0))
        lower, upper = self.bounds
        for j, value in enumerate(at):
            step = 1e-6 * max(abs(value), 1e-3 * min(upper[j] - lower[j], 1.0))
            ends = []
            for moved in (min(value + step, upper[j]), max(value - step, lower[j])):
                other = at.copy()
                other[j] = moved
                ends.append((moved, self.with_coefficients(other).raw(poses)))
            (high, above), (low, below) = ends
            made = np.concatenate([made, ((above - below) / (high - low))[:, :, None]], axis=2)
        return made

    def document(self) -> dict[str, Any]:
        """Raise InputError: a model file holds numbers and equations, no code."""
        raise InputError(
            f"the function {self.name} cannot be stored in a model file, which holds no code: keep "
            'it in your program, or write it as equations, ecm.Expression("fx_N = k * x_m", k=1e3)'
        )


@dataclass(frozen=True)
class FunctionModel(ModelSpecification):
    """A function with parameters to fit: f(poses (N, n), **parameters) -> wrenches (N, m)."""

    function: Callable[..., Any]
    parameters: dict[str, Parameter] = field(default_factory=dict)

    any_columns = True
    kind = "function"

    @property
    def name(self) -> str:
        """The function's own name."""
        return FunctionMap({}, {}, self.function, (), ()).name

    def map(self, table: Table) -> FunctionMap:
        """The map at the start of the parameters, of the table's columns."""
        inputs, outputs = pose_and_wrench_columns(table)
        values = {name: float(own.value) for name, own in self.parameters.items()}
        return FunctionMap(self.parameters, values, self.function, inputs, outputs)

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Least squares within bounds, priors counted as readings."""
        return fit_parameters(self.map(table), table, progress)

    @staticmethod
    def map_from_document(document: dict[str, Any]) -> FunctionMap:
        """Raise ValueError: no file holds a function."""
        raise ValueError("a function is in no model file")
