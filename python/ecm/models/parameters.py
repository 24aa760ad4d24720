"""Named parameters with start value, bounds and prior, and the fit of a map that has them.

The words are lmfit's: value, min, max, vary. A prior is a standard deviation about the value; it
counts as one more reading of the parameter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F
from ecm.io.events import Progress, tell_part
from ecm.io.settings import check_keys
from ecm.io.table import Table
from ecm.models.joint_fit import covariance_of, declared_or_fitted, spread_noise, unit_products
from ecm.models.maps import FittedMap, MapDefaults
from ecm.regression.noise import whiteners
from ecm.regression.rows import Rows

_MOST_STEPS = 300
_WEIGHTINGS = 3


@dataclass(frozen=True)
class Parameter:
    """A number of a model of one's own.

    Parameters
    ----------
    value
        Where the fit begins, and the mean of the prior.
    min, max
        Bounds.
    sd
        Standard deviation of what is known of it before; None: nothing.
    vary
        Whether a fit changes it.

    Examples
    --------
    >>> Parameter.of((1000.0, 0.0, 1e6), "k")
    Parameter(value=1000.0, min=0.0, max=1000000.0, sd=None, vary=True)
    >>> Parameter.of({"value": 0.3, "sd": 0.05}, "c").sd
    0.05
    """

    value: float
    min: float = -math.inf
    max: float = math.inf
    sd: float | None = None
    vary: bool = True

    def __post_init__(self) -> None:
        numbers = (self.value, self.min, self.max, *(() if self.sd is None else (self.sd,)))
        if not all(_is_number(number) for number in numbers) or not math.isfinite(self.value):
            raise InputError(f"{self}: expected numbers, and a finite value")
        if not self.min <= self.value <= self.max or self.min == self.max:
            raise InputError(f"{self}: expected min <= value <= max, and min < max")
        if self.sd is not None and not 0.0 < self.sd < math.inf:
            raise InputError(f"{self}: expected an sd above 0")
        if not isinstance(self.vary, bool):
            raise InputError(f"{self}: expected vary = True or False")

    @staticmethod
    def of(given: Any, name: str) -> Parameter:
        """A parameter of a number, of (value, min, max), or of a dict of what it has."""
        try:
            if isinstance(given, Parameter):
                return given
            if _is_number(given):
                return Parameter(float(given))
            if isinstance(given, tuple | list) and len(given) == 3:
                return Parameter(*given)
            if isinstance(given, Mapping) and "value" in given:
                check_keys(given, [item.name for item in fields(Parameter)], name)
                return Parameter(**given)
        except InputError as error:
            raise InputError(f"parameter {name}: {error}") from None
        raise InputError(
            f"parameter {name} = {given!r}: expected a number, (value, min, max), or value, min, "
            "max, sd and vary by name"
        )


@dataclass(frozen=True)
class FittedParameter(Parameter):
    """A parameter of a fitted model: `Model.params`.

    Parameters
    ----------
    value
        As fitted.
    sd
        Standard deviation of the fit; None where it is not known.
    vary
        Whether a refit changes it.
    unit
        Its unit; empty where the name has it, or there is none.
    effect
        The id of its effect, or `base`.

    Examples
    --------
    >>> FittedParameter(0.03, sd=0.0002, unit="N m", effect="hysteresis").sd
    0.0002
    """

    unit: str = ""
    effect: str = "base"

    @staticmethod
    def at(value: float, bounds: tuple[float, float], sd: float, **more: Any) -> FittedParameter:
        """A parameter within bounds, or at one of them up to rounding."""
        low, high = min(bounds[0], value), max(bounds[1], value)
        known = float(sd) if 0.0 < sd < math.inf else None
        return FittedParameter(float(value), float(low), float(high), known, **more)


def _is_number(value: Any) -> bool:
    known = isinstance(value, int | float | np.integer | np.floating)
    return known and not isinstance(value, bool) and not math.isnan(value)


def starts_of(parameters: Mapping[str, Parameter]) -> dict[str, float]:
    """Where the fit of each parameter begins."""
    return {name: float(own.value) for name, own in parameters.items()}


def parameters_of(given: Any) -> dict[str, Parameter]:
    """The parameters of a dict by name."""
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        raise InputError(f"parameters: found {given!r}, expected a dict: name -> (value, min, max)")
    return {name: Parameter.of(value, name) for name, value in given.items()}


@dataclass(frozen=True, eq=False)
class ParametrisedMap(MapDefaults):
    """A map with named parameters; those that vary are its coefficients."""

    parameters: Mapping[str, Parameter]
    values: Mapping[str, float]
    """Value of each parameter."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """(k,) names of the coefficients."""
        return tuple(name for name, own in self.parameters.items() if own.vary)

    @property
    def coefficients(self) -> F:
        """(k,) values of the parameters that vary."""
        return np.array([self.values[name] for name in self.parameter_names], dtype=np.float64)

    def with_coefficients(self, coefficients: F) -> Any:
        """The same map with other values."""
        changed = dict(zip(self.parameter_names, map(float, coefficients), strict=True))
        return replace(self, values={**self.values, **changed})

    @property
    def bounds(self) -> tuple[F, F]:
        """(k,) smallest and largest values."""
        own = [self.parameters[name] for name in self.parameter_names]
        return np.array([p.min for p in own]), np.array([p.max for p in own])

    @property
    def prior(self) -> tuple[F, F]:
        """(k,) means and standard deviations, infinite where nothing is known before."""
        own = [self.parameters[name] for name in self.parameter_names]
        sd = [math.inf if p.sd is None else p.sd for p in own]
        return np.array([p.value for p in own]), np.array(sd)

    @property
    def gives(self) -> str:
        """Subject and verb of a message about what the map gives."""
        raise NotImplementedError

    def raw(self, poses: F) -> F:
        """(N, m) wrench, also where it is no number."""
        raise NotImplementedError

    def predict(self, poses: F) -> F:
        """(N, n) poses to (N, m) wrenches; InputError where one is no number."""
        wrench = self.raw(poses)
        self.refuse_unreal(wrench, poses, f"{self.gives} no number")
        return wrench

    def refuse_unreal(self, numbers: F, poses: F, what: str) -> None:
        """Raise InputError where a number is none: `what`, the pose and the parameters."""
        wrong = np.flatnonzero(~np.isfinite(numbers.reshape(len(poses), -1)).all(axis=1))
        if len(wrong):
            pairs = [*zip(self.inputs, poses[wrong[0]], strict=True)], self.values.items()
            at, held = (", ".join(f"{name} = {value:g}" for name, value in own) for own in pairs)
            row = f"row {wrong[0] + 1} of {len(poses)}"
            raise InputError(f"{what} at {at} ({'; '.join(filter(None, (row, held)))})")

    def sentences(self, covariance: F | None) -> list[str]:
        """A line for each parameter: value and error, and whether it is at a bound."""
        sd = np.full(len(self.parameters), np.nan)
        if covariance is not None:
            sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        errors = dict(zip(self.parameter_names, sd, strict=False))
        lines = []
        for name, own in self.parameters.items():
            value, error = self.values[name], errors.get(name, np.nan)
            text = f"{name} = {value:.6g}" + ("" if np.isnan(error) else f" +- {error:.2g}")
            text += "" if own.vary else " (held)"
            at_bound = any(math.isclose(value, bound, rel_tol=1e-6) for bound in (own.min, own.max))
            text += ", at its bound" if own.vary and at_bound else ""
            lines.append(text)
        return lines


def fit_parameters(base: Any, table: Table, progress: Progress | None = None) -> FittedMap:
    """Least squares of a `ParametrisedMap` from its values, within bounds, with the priors.

    First each component counts by its spread; then rows count by the noise, declared or else what
    the first fit leaves, with the stiffness of the fit before.

    Raises
    ------
    InputError
        Where a parameter changes nothing on these rows, or the start gives no number.
    ComputationError
        Where the steps do not converge.
    """
    measured, poses = table.matrix(base.outputs), table.matrix(base.inputs)
    base.predict(poses)  # refuses what gives no number
    if not base.parameter_names:
        return FittedMap(base, declared_or_fitted(base, table))
    noise, fitted, jacobian, squares = spread_noise(measured), base, np.zeros((0, 0)), 0.0
    for i in range(_WEIGHTINGS):
        tell_part(progress, i, _WEIGHTINGS, f"weighting {i + 1} of {_WEIGHTINGS}")
        whitener = whiteners(noise.covariance(Rows(table, fitted), fitted.error))
        fitted, jacobian, squares = _least_squares(fitted, poses, measured, whitener)
        noise = declared_or_fitted(fitted, table)
    freedom = measured.size - len(fitted.parameter_names)
    variance = None if noise.is_residual or freedom <= 0 else squares / freedom
    return FittedMap(fitted, noise, covariance_of(*unit_products(jacobian)), variance)


def _least_squares(base: Any, poses: F, measured: F, whitener: F) -> tuple[Any, F, float]:
    """The fitted map, the whitened Jacobian with the priors' rows, and the squares left."""
    mean, sd = base.prior
    known = np.isfinite(sd)

    def residual(at: F) -> F:
        errors = measured - base.with_coefficients(at).raw(poses)
        own = np.einsum("nij,nj->ni", whitener, errors).ravel()
        return np.concatenate([own, ((mean - at) / sd)[known]])

    def jacobian(at: F) -> F:
        columns = base.with_coefficients(at).columns(poses)
        own = (whitener @ columns).reshape(measured.size, -1)
        return -np.concatenate([own, np.diag(1.0 / sd)[known]])

    start = base.coefficients
    sizes = np.linalg.norm(jacobian(start), axis=0)
    for name, size in zip(base.parameter_names, sizes, strict=True):
        if not size > 0.0:
            raise InputError(
                f"parameter {name} changes nothing on these rows at its start {name} = "
                f"{base.values[name]:g}: begin at another value, hold it (vary = False), give it a "
                "prior (sd), or leave it out"
            )
    with np.errstate(all="ignore"):
        found = least_squares(
            residual, start, jacobian, base.bounds, x_scale="jac", max_nfev=_MOST_STEPS
        )
    fitted = base.with_coefficients(found.x)
    if not found.success:
        raise ComputationError(
            f"the parameters did not converge in {_MOST_STEPS} steps (last: "
            f"{'; '.join(fitted.sentences(None))}): begin nearer, or give narrower bounds or priors"
        )
    left = residual(found.x)
    return fitted, jacobian(found.x), float((left[: measured.size] ** 2).sum())
