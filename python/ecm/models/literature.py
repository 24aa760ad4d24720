"""Models of the literature: constant curvature, a Cosserat rod, a Gaussian process, a network.

Constant curvature: the backbone is an arc that stretches, bends and twists, but does not shear.
U = k_e (s - L)^2/2 + k_b |theta_perp|^2/2 + k_t theta_x^2/2 with the arc's length
s = (L + c_x) (b/2)/sin(b/2), b = |theta_perp|, in mid-frame coordinates.

Rod: shear-flexible, uniform, straight; EA, GA, EI, GJ. Its wrench at a pose comes from
`rod_wrenches`, the inverse of `rod_poses`.

The other two have no mechanics. They are fitted by scikit-learn (extra `learn`) and evaluated by
numpy alone: a model file needs no extra. Their stiffness is the derivative of their prediction;
nothing makes it symmetric.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from scipy.optimize import least_squares

from ecm._native import mid_frame, rod_poses, rod_wrenches
from ecm.effects.rod import wrench_of
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F, central_differences
from ecm.io.columns import POSE, WRENCH
from ecm.io.events import Progress, after_a_part, tell_part
from ecm.io.extras import require
from ecm.io.mechanism import ROD_SECTIONS
from ecm.io.table import Table
from ecm.models.joint_fit import declared_or_fitted
from ecm.models.layout import Layout, array, exactly, items, number, record, row
from ecm.models.maps import (
    EnergyTerms,
    FittedMap,
    MapDefaults,
    ModelSpecification,
    SixAxisMap,
    Weights,
    finite,
    length_of,
    partial_to,
    pose_and_wrench_columns,
    refuse_long_rotations,
)
from ecm.models.partial import fit_measured, is_partial, need_pose, need_whole_wrench, whole_map

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
        return partial_to(kind, slope, poses, self)

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

    name = kind = "gp"

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

    name = kind = "mlp"

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


_FIT_ITERATIONS = 15


@dataclass(frozen=True)
class _Backbone(SixAxisMap):
    """A length and a few parameters."""

    names: ClassVar[tuple[str, ...]]
    """Names of the parameters, with their units."""
    length: float
    coefficients: F

    @property
    def length_m(self) -> float:
        """Length of the mechanism, m."""
        return self.length

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """(k,) names with their units."""
        return self.names

    def with_coefficients(self, coefficients: F) -> Any:
        """The same map with other parameters."""
        return replace(self, coefficients=np.asarray(coefficients, dtype=np.float64))

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters by name."""
        return dict(zip(self.names, self.coefficients.tolist(), strict=True))

    def document(self) -> dict[str, Any]:
        """Length and parameters by name."""
        return self.head(length_m=self.length, parameters=self.parameters)

    @classmethod
    def from_document(cls, document: dict[str, Any]) -> Any:
        """Return the map of an opened model file."""
        values = [float(document["parameters"][name]) for name in cls.names]
        return cls(float(document["length_m"]), np.array(values))


@dataclass(frozen=True)
class ConstantCurvatureMap(_Backbone):
    """An arc with three springs k_e, k_b, k_t; the wrench is linear in them."""

    name = kind = "constant-curvature"
    names = ("stretch_N_per_m", "bend_Nm_per_rad", "twist_Nm_per_rad")

    def columns(self, poses: F) -> F:
        """(N, 6, 3) wrench of each spring alone."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        q = mid_frame(poses, self.length)
        bend = np.linalg.norm(q[:, 4:], axis=1)
        half = 0.5 * bend
        small = half < 1e-4
        safe = np.where(small, 1.0, half)
        ratio = np.where(small, 1.0 + half**2 / 6.0, safe / np.sin(safe))
        # d ratio/d bend over bend
        slope = np.where(
            small,
            1.0 / 12.0,
            (np.sin(safe) - safe * np.cos(safe)) / np.sin(safe) ** 2 / (4.0 * safe),
        )
        chord = self.length + q[:, 0]
        stretch = chord * ratio - self.length
        force = np.zeros((len(poses), 6, 3))
        force[:, 0, 0] = stretch * ratio
        force[:, 4:, 0] = (stretch * chord * slope)[:, None] * q[:, 4:]
        force[:, 4:, 1] = q[:, 4:]
        force[:, 3, 2] = q[:, 3]
        return np.stack([wrench_of(poses, each) for each in np.moveaxis(force, 2, 0)], axis=2)

    def predict(self, poses: F) -> F:
        """(N, 6) poses to (N, 6) wrenches."""
        return finite("the prediction", lambda: self.columns(poses) @ self.coefficients)

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, 6, 6) by central differences."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        slope = finite(
            "the stiffness",
            lambda: np.stack(central_differences(self.predict, poses, 1e-6), axis=2),
        )
        return partial_to(kind, slope, poses, self)


def rod_sections(compliance: F, length_m: float) -> dict[str, float]:
    """EA, GA, EI, GJ of the clamped rod with this compliance (6,) at rest; means over y and z."""
    bending = 2.0 * length_m / (compliance[4] + compliance[5])
    lateral = 0.5 * (compliance[1] + compliance[2])
    # c_yy = L/GA + L^3/(3 EI); for a body that is no rod the shear part may be too small.
    shear = max(lateral - length_m**3 / (3.0 * bending), 0.05 * lateral)
    sections = (length_m / compliance[0], length_m / shear, bending, length_m / compliance[3])
    return dict(zip(ROD_SECTIONS, map(float, sections), strict=True))


@dataclass(frozen=True)
class RodMap(_Backbone):
    """A Cosserat rod with section stiffnesses EA, GA (N), EI, GJ (N m^2)."""

    name = kind = "rod"
    names = ROD_SECTIONS

    def predict(self, poses: F) -> F:
        """(N, 6) to (N, 6); NaN where no equilibrium exists."""
        return self._solved(np.ascontiguousarray(poses, dtype=np.float64))[0]

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, 6, 6): the inverse of the slope of pose over wrench; NaN where `predict` is."""
        return self.wrench_and_stiffness(poses, kind)[1]

    def wrench_and_stiffness(self, poses: F, kind: str = "partial") -> tuple[F, F]:
        """(N, 6) wrenches and (N, 6, 6) stiffnesses from one solution."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        h, slope = self._solved(poses)
        known = np.isfinite(slope).all(axis=(1, 2))
        stiffness = np.full_like(slope, np.nan)
        stiffness[known] = np.linalg.inv(slope[known])
        return h, partial_to(kind, stiffness, poses, self)

    def _solved(self, poses: F) -> tuple[F, F]:
        """(N, 6) wrenches and (N, 6, 6) d pose / d wrench; NaN where no equilibrium exists."""
        with np.errstate(over="ignore", invalid="ignore"):
            start = np.ascontiguousarray(self._start(poses))
        return rod_wrenches(poses, start, length_m=self.length, **self.parameters)

    def _poses(self, wrenches: F) -> F:
        loads = np.ascontiguousarray(wrenches)
        poses, converged = rod_poses(loads, length_m=self.length, **self.parameters)
        poses[~converged] = np.nan
        return poses

    def _start(self, poses: F) -> F:
        """The linear rod in mid-frame coordinates."""
        ea, ga, ei, gj = self.coefficients
        q = mid_frame(poses, self.length)
        lateral = 1.0 / (self.length / ga + self.length**3 / (12.0 * ei))
        k = np.array(
            [ea / self.length, lateral, lateral, gj / self.length, *[ei / self.length] * 2]
        )
        return wrench_of(poses, q * k)

    def columns(self, poses: F) -> F:
        """(N, 6, 4) derivative to the parameters, by central differences."""
        steps = (1e-5 * self.coefficients).tolist()
        slopes = central_differences(
            lambda at: self.with_coefficients(at).predict(poses), self.coefficients, steps
        )
        return np.stack(slopes, axis=2)


def _layout(names: Sequence[str], parameter: Layout) -> Layout:
    """Layout of the keys of a backbone: six columns on both sides, a length, parameters."""
    six = {"inputs": exactly(list(POSE)), "outputs": exactly(list(WRENCH))}
    parameters = record(dict.fromkeys(names, parameter))
    return record({**six, "length_m": number(positive=True), "parameters": parameters}, others=True)


@dataclass(frozen=True)
class ConstantCurvatureModel(ModelSpecification):
    """An arc that stretches, bends and twists: three springs; short name `constant-curvature`.

    Examples
    --------
    >>> from ecm.models import parse_model
    >>> parse_model("constant-curvature")
    ConstantCurvatureModel()
    """

    kind = "constant-curvature"

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Least squares, each component over its own standard deviation."""
        need_pose(table, self.name)
        start = ConstantCurvatureMap(length_of(table, self.name), np.zeros(3))
        if is_partial(table):
            return fit_measured(start, table, progress=progress)
        found = fit_measured(start, table, spread=True)
        return FittedMap(whole_map(found.base), found.noise)

    @staticmethod
    def layout(n: int, m: int) -> Layout:
        """Layout of the springs in a model file."""
        return _layout(ConstantCurvatureMap.names, number())

    map_from_document = staticmethod(ConstantCurvatureMap.from_document)


@dataclass(frozen=True)
class RodModel(ModelSpecification):
    """A uniform, shear-flexible Cosserat rod: EA, GA, EI, GJ; short name `rod`.

    Examples
    --------
    >>> from ecm.models import parse_model
    >>> parse_model("rod")
    RodModel()
    """

    kind = "rod"

    most_rows = 2000  # each step solves the rod of every row nine times, for four numbers

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Least squares of the poses that the rod takes under the measured wrenches."""
        need_whole_wrench(table, self.name)
        poses, wrenches = map(np.ascontiguousarray, (table.poses, table.wrenches))
        base = fit_rod(poses, wrenches, length_of(table, self.name), progress)
        return FittedMap(base, declared_or_fitted(base, table))

    @staticmethod
    def layout(n: int, m: int) -> Layout:
        """Layout of the section stiffnesses in a model file."""
        return _layout(ROD_SECTIONS, number(positive=True))

    map_from_document = staticmethod(RodMap.from_document)


def fit_rod(poses: F, wrenches: F, length: float, progress: Progress | None = None) -> RodMap:
    """Least squares of the logarithms of the four section stiffnesses.

    On poses, not wrenches: `rod_poses` always answers, its inverse not. It starts from the
    stiffness at rest of an energy of degree 4, where lateral = 1/(L/GA + L^3/(12 EI)).
    `progress` is told how often the rod was solved, of the most that it may be.
    """
    scale = np.array([length] * 3 + [1.0] * 3)
    start = EnergyTerms(length, 4).fit(poses, wrenches)
    home = np.array([[length, 0.0, 0.0, 0.0, 0.0, 0.0]])
    # Wrenches that follow no pose leave a singular stiffness: a pseudoinverse, which is not
    # positive, and so is refused below.
    rest = np.diag(np.linalg.pinv(start.stiffness(home, "generalised")[0]))
    if not np.all(rest > 0.0):
        raise ComputationError(
            "the measured stiffness at rest is not that of a rod: not positive. Check units and "
            "signs of the wrench (ecm check), or fit energy4"
        )
    logs = np.log([*rod_sections(rest, length).values()])
    solved, most = 0, 9 * _FIT_ITERATIONS

    def left(at: F) -> F:
        nonlocal solved
        words = f"step {solved // 9 + 1} of at most {_FIT_ITERATIONS}"
        tell_part(progress, min(solved, most), most, words)
        solved += 1
        errors = (poses - RodMap(length, np.exp(at))._poses(wrenches)) / scale
        # A pose that the rod does not take errs by the whole length, or by a radian.
        return np.where(np.isfinite(errors), errors, 1.0).ravel()

    found = least_squares(
        left,
        logs,
        "3-point",
        (-20.0, 20.0),
        diff_step=np.full(4, 1e-4),
        max_nfev=_FIT_ITERATIONS,
        xtol=1e-10,
    )
    return RodMap(length, np.exp(found.x))
