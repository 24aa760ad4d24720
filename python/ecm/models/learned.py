"""Two models of the literature without mechanics: a Gaussian process and a neural network.

They are fitted by scikit-learn (extra `learn`) and evaluated by numpy alone: a model file needs no
extra. Their stiffness is the derivative of their prediction; nothing makes it symmetric.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.events import Progress, after_a_part
from ecm.io.extras import require
from ecm.io.table import Table
from ecm.models.layout import Layout, array, items, record, row
from ecm.models.maps import MapDefaults, StiffnessMap, finite, partial_to, refuse_long_rotations
from ecm.models.noise_estimate import declared_or_fitted
from ecm.models.specification import FittedMap, ModelSpecification, Weights, pose_and_wrench_columns

LEARNED = ("gp", "mlp")
"""Kinds of maps without columns of coefficients that a refit could change."""
_HIDDEN = (32, 32)
_STEPS, _FIRST_STEPS = 3000, 50
"""Most steps of the network's fit, and those whose time tells that of all."""


@dataclass(frozen=True)
class _Learned(MapDefaults):
    """Inputs and outputs scaled to zero mean and unit variance."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_scale: F
    """(2, n) mean and standard deviation."""
    output_scale: F
    """(2, m)."""

    def columns(self, poses: F) -> F:
        """Not linear in anything: it cannot be refitted together with effects."""
        raise InputError(
            f"a {type(self).__name__.removesuffix('Map').lower()} model is a baseline and "
            "cannot be refitted with effects; take an energy or a polynomial"
        )

    def with_coefficients(self, coefficients: F) -> Any:
        """As `columns`."""
        return self.columns(coefficients)

    def _scaled(self, poses: F) -> F:
        scaled = (np.asarray(poses, dtype=np.float64) - self.input_scale[0]) / self.input_scale[1]
        return np.asarray(scaled)

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n); other kinds need all six columns on both sides."""
        refuse_long_rotations(poses, self.inputs)
        units = self.output_scale[1][:, None] / self.input_scale[1]
        slope = finite("the stiffness", lambda: self._slope(self._scaled(poses)) * units)
        return partial_to(kind, slope, poses, cast(StiffnessMap, self))

    def predict(self, poses: F) -> F:
        """(N, n) poses to (N, m) wrenches."""
        refuse_long_rotations(poses, self.inputs)
        mean, sd = self.output_scale
        return finite("the prediction", lambda: self._value(self._scaled(poses)) * sd + mean)

    def _value(self, x: F) -> F:
        raise NotImplementedError

    def _slope(self, x: F) -> F:
        raise NotImplementedError

    def _document(self, **parameters: Any) -> dict[str, Any]:
        scales = {"input_scale": self.input_scale, "output_scale": self.output_scale}
        stored = {name: np.asarray(scale).tolist() for name, scale in scales.items()}
        return self.head(length_m=None, parameters=stored | parameters)


@dataclass(frozen=True)
class GpMap(_Learned):
    """Posterior mean of a process with a squared exponential kernel, one length per input."""

    points: F
    """(N, n) scaled training poses."""
    lengths: F
    """(n,)."""
    weights: F
    """(N, m)."""

    name = "gp"
    kind = "gp"

    @property
    def coefficients(self) -> F:
        """One weight per training pose and output."""
        return np.asarray(self.weights.ravel())

    def _kernel(self, x: F) -> F:
        a, b = x / self.lengths, self.points / self.lengths
        square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2.0 * a @ b.T
        return np.asarray(np.exp(-0.5 * np.maximum(square, 0.0)))

    def _value(self, x: F) -> F:
        return np.asarray(self._kernel(x) @ self.weights)

    def _slope(self, x: F) -> F:
        # d k(x, p)/dx_j = (p_j - x_j) / l_j^2 k
        k = self._kernel(x)
        through = np.stack([k @ (self.weights * p[:, None]) for p in self.points.T], axis=2)
        here = (k @ self.weights)[:, :, None] * x[:, None, :]
        return np.asarray((through - here) / self.lengths**2)

    def document(self) -> dict[str, Any]:
        """Points, lengths and weights."""
        own = {"points": self.points, "lengths": self.lengths, "weights": self.weights}
        return self._document(**{name: values.tolist() for name, values in own.items()})


@dataclass(frozen=True)
class MlpMap(_Learned):
    """Layers of tanh, the last one linear."""

    layers: tuple[tuple[F, F], ...]
    """Matrix (in, out) and shift (out) of each."""

    name = "mlp"
    kind = "mlp"

    @property
    def coefficients(self) -> F:
        """All weights and shifts."""
        return np.concatenate([part.ravel() for layer in self.layers for part in layer])

    def _value(self, x: F) -> F:
        for matrix, shift in self.layers[:-1]:
            x = np.tanh(x @ matrix + shift)
        matrix, shift = self.layers[-1]
        return np.asarray(x @ matrix + shift)

    def _slope(self, x: F) -> F:
        slope = np.broadcast_to(np.eye(x.shape[1]), (len(x), x.shape[1], x.shape[1]))
        for matrix, shift in self.layers[:-1]:
            x = np.tanh(x @ matrix + shift)
            slope = (matrix.T @ slope) * (1.0 - x**2)[:, :, None]
        return np.asarray(self.layers[-1][0].T @ slope)

    def document(self) -> dict[str, Any]:
        """The layers."""
        layers = [{"matrix": m.tolist(), "shift": s.tolist()} for m, s in self.layers]
        return self._document(layers=layers)


def _array(value: Any) -> F:
    return np.asarray(value, dtype=np.float64)


def _shared(document: dict[str, Any]) -> tuple[tuple[str, ...], tuple[str, ...], F, F]:
    """Columns and scales of a map in a model file."""
    parameters = document["parameters"]
    scales = _array(parameters["input_scale"]), _array(parameters["output_scale"])
    return tuple(document["inputs"]), tuple(document["outputs"]), *scales


def _scales(n: int, m: int) -> dict[str, Layout]:
    """Layout of mean and standard deviation of the columns."""
    sizes = {"input_scale": n, "output_scale": m}
    return {name: row(array(k), array(k, positive=True)) for name, k in sizes.items()}


def _layers(n: int, m: int) -> Layout:
    """Layout of layers that take n numbers to m: what one gives, the next takes."""
    layers = items(record({"matrix": array(None, None), "shift": array(None)}), least=1)

    def check(value: Any, place: str) -> None:
        layers(value, place)
        width = n
        for i, layer in enumerate(value):
            last = i == len(value) - 1
            array(width, m if last else None)(layer["matrix"], f"{place}[{i}].matrix")
            width = len(layer["matrix"][0])
            array(width)(layer["shift"], f"{place}[{i}].shift")

    return check


def _standardised(table: Table) -> tuple[tuple[tuple[str, ...], tuple[str, ...], F, F], F, F]:
    """Columns and scales, and the scaled poses and wrenches."""
    inputs, outputs = pose_and_wrench_columns(table)
    scales, scaled = [], []
    for values in (table.matrix(inputs), table.matrix(outputs)):
        spread = values.std(axis=0)
        scale = np.stack([values.mean(axis=0), np.where(spread > 0.0, spread, 1.0)])
        scales.append(scale)
        scaled.append((values - scale[0]) / scale[1])
    return (inputs, outputs, *scales), *scaled


def _fitted(regressor: Any, x: F, y: F) -> Any:
    """The regressor of scikit-learn, fitted without its warnings about convergence."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return regressor.fit(x, y)


def _sklearn(module: str) -> Any:
    return require(f"sklearn.{module}", "learn", "fitting gp and mlp models")


@dataclass(frozen=True)
class GaussianProcessModel(ModelSpecification):
    """A Gaussian process with a squared exponential kernel; short name `gp`, extra `learn`.

    One length for each input, the same kernel for all outputs; lengths and noise by the largest
    likelihood.

    Examples
    --------
    >>> from ecm.models import parse_model
    >>> parse_model("gp")
    GaussianProcessModel()
    """

    any_columns = True
    kind = "gp"

    most_rows = 2000  # its matrices grow with the square of the rows, its time with the cube

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Fit lengths and noise to at most 300 rows, the weights to all."""
        process, kernels = _sklearn("gaussian_process"), _sklearn("gaussian_process.kernels")
        shared, x, y = _standardised(table)
        n = x.shape[1]
        kernel = kernels.ConstantKernel(10.0, (1e-3, 1e5)) * kernels.RBF(
            np.full(n, 3.0), (1e-1, 1e3)
        ) + kernels.WhiteKernel(1e-4, (1e-10, 1e1))
        # Each step of the likelihood costs N^3.
        part = np.random.default_rng(0).permutation(len(x))[:300]
        regressor = process.GaussianProcessRegressor(kernel, alpha=1e-10, random_state=0)
        fitted = _fitted(regressor, x[part], y[part]).kernel_
        size = float(fitted.k1.k1.constant_value)
        lengths = np.broadcast_to(_array(fitted.k1.k2.length_scale), (n,)).copy()
        covariance = size * GpMap(*shared, x, lengths, np.zeros_like(y))._kernel(x)
        covariance[np.diag_indices(len(x))] += float(fitted.k2.noise_level) + 1e-10
        base = GpMap(*shared, x, lengths, _array(size * np.linalg.solve(covariance, y)))
        return FittedMap(base, declared_or_fitted(base, table))

    @staticmethod
    def layout(n: int, m: int) -> Layout:
        """Layout of points, lengths and weights in a model file."""

        def check(value: Any, place: str) -> None:
            points = value.get("points") if isinstance(value, dict) else None
            rows = len(points) if isinstance(points, list) else None
            own = {"points": array(rows, n), "lengths": array(n, positive=True)}
            record({**_scales(n, m), **own, "weights": array(rows, m)})(value, place)

        return record({"parameters": check}, others=True)

    @staticmethod
    def map_from_document(document: dict[str, Any]) -> GpMap:
        """Return the map of an opened model file."""
        parameters = document["parameters"]
        parts = (_array(parameters[key]) for key in ("points", "lengths", "weights"))
        return GpMap(*_shared(document), *parts)


@dataclass(frozen=True)
class NeuralNetworkModel(ModelSpecification):
    """A network with two hidden layers of 32 tanh units; short name `mlp`, extra `learn`.

    Examples
    --------
    >>> from ecm.models import parse_model
    >>> parse_model("mlp")
    NeuralNetworkModel()
    """

    any_columns = True
    kind = "mlp"

    most_rows = 5000  # its steps go over all rows, thousands of times

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Fit by L-BFGS with a little weight decay."""
        network = _sklearn("neural_network")
        shared, x, y = _standardised(table)

        def trained(steps: int) -> Any:
            regressor = network.MLPRegressor(
                hidden_layer_sizes=_HIDDEN, activation="tanh", solver="lbfgs", alpha=1e-4,
                max_iter=steps, tol=1e-9, max_fun=20000, random_state=0,
            )  # fmt: skip
            return _fitted(regressor, x, y)

        words = f"at most {_STEPS} steps"
        fitted = after_a_part(trained, _STEPS, _FIRST_STEPS, progress, words)
        layers = zip(fitted.coefs_, fitted.intercepts_, strict=True)
        base = MlpMap(*shared, tuple((_array(m), _array(s)) for m, s in layers))
        return FittedMap(base, declared_or_fitted(base, table))

    @staticmethod
    def layout(n: int, m: int) -> Layout:
        """Layout of the layers in a model file."""
        parameters = record({**_scales(n, m), "layers": _layers(n, m)})
        return record({"parameters": parameters}, others=True)

    @staticmethod
    def map_from_document(document: dict[str, Any]) -> MlpMap:
        """Return the map of an opened model file."""
        layers = document["parameters"]["layers"]
        parts = tuple((_array(layer["matrix"]), _array(layer["shift"])) for layer in layers)
        return MlpMap(*_shared(document), parts)
