"""Maps from pose to wrench: the protocol, the polynomial, the energy; and their leverage.

Both are linear in their coefficients, h(p) = columns(p) @ coefficients, so that they can be
refitted together with effects.

With Phi (m, k) the columns of a pose, P the covariance of the coefficients and Sigma the noise of
one row there, the leverage is the largest eigenvalue of Sigma^-1/2 Phi P Phi' Sigma^-1/2: 1 says
that the prediction is as uncertain as one measurement in its worst direction. A free polynomial is
fitted output by output: there it is the largest ratio of the components' own variances, which
hold the misfit of the polynomial too.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, Protocol, cast, get_args

import numpy as np

from ecm import _native
from ecm._native import check_rotations, convert_stiffness, polynomial_regressor
from ecm.errors import InputError, ModelError, Remedy
from ecm.io.arrays import F, I, eigh
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.events import Progress
from ecm.io.settings import Checked
from ecm.io.table import Table
from ecm.models.layout import Layout, anything
from ecm.regression.noise import Noise, whiteners
from ecm.regression.normal_equations import in_blocks
from ecm.regression.rows import BaseMap, BodyChange, Rows, columns_of, is_whole

StiffnessKind = Literal["partial", "generalised", "screw"]
Symmetry = Literal["alike", "revolution", "general"]
SYMMETRIES: tuple[Symmetry, ...] = get_args(Symmetry)


class StiffnessMap(BaseMap, Protocol):
    """Pose in, wrench and stiffness out; what every map has, also one of your own.

    Examples
    --------
    >>> from ecm.models import surrogate_of
    >>> poses = np.random.default_rng(0).uniform(-0.01, 0.01, (60, 6)) + [0.1, 0, 0, 0, 0, 0]
    >>> wrenches = 1000.0 * (poses - [0.1, 0, 0, 0, 0, 0])
    >>> base: StiffnessMap = surrogate_of(
    ...     poses, wrenches, 0.1, test_poses=poses, test_wrenches=wrenches
    ... )
    >>> base.kind, base.stiffness(poses).shape
    ('physics', (60, 6, 6))
    """

    @property
    def name(self) -> str:
        """Short name, as on the command line."""

    @property
    def kind(self) -> str:
        """Family of the map, as in model files."""

    @property
    def coefficients(self) -> F:
        """(k,) numbers that a refit may change."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """(k,) names of the coefficients, with the unit where they have one."""

    @property
    def parameter_unit(self) -> str:
        """Unit of all coefficients; empty where their names have it, or there is none."""

    @property
    def error(self) -> F:
        """(m,) root mean square error of the map itself; zero where it is fitted to data."""

    def error_columns(self, poses: F) -> F:
        """(N, n) poses to (N, m, e): by how much the map may err as a whole, each with sd 1."""

    def further_columns(self, poses: F) -> F:
        """(N, n) poses to (N, m, e): terms of the next degree, which the choice of one left out."""

    def wrench_and_stiffness(self, poses: F, kind: str = "partial") -> tuple[F, F]:
        """(N, m) wrenches and (N, m, n) stiffnesses in one call."""

    def columns(self, poses: F) -> F:
        """(N, m, k) derivative of the wrench to the coefficients."""

    def with_coefficients(self, coefficients: F) -> StiffnessMap:
        """The same map with other coefficients."""

    @property
    def bounds(self) -> tuple[F, F] | None:
        """(k,) lower and upper limits of the coefficients; None where there are none."""

    @property
    def prior(self) -> tuple[F, F] | None:
        """(k,) means and standard deviations of what is known of the coefficients before a fit."""

    def document(self) -> dict[str, Any]:
        """The map as part of a model file."""


class MapDefaults:
    """What most maps share: no own error, coefficients without limits, and one body only."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameter_unit = ""

    def head(self: Any, **more: Any) -> dict[str, Any]:
        """What the document of a map begins with, and more of it."""
        columns = {"inputs": list(self.inputs), "outputs": list(self.outputs)}
        return {"kind": self.kind, "name": self.name, **columns, **more}

    def wrench_and_stiffness(self: StiffnessMap, poses: F, kind: str = "partial") -> tuple[F, F]:
        """(N, m) and (N, m, n), one after the other."""
        return self.predict(poses), self.stiffness(poses, kind)

    @property
    def length_m(self) -> float | None:
        """None: not needed."""
        return None

    @property
    def parameter_names(self: StiffnessMap) -> tuple[str, ...]:
        """(k,) numbers from 1: they mean nothing by themselves."""
        return tuple(f"base.{j + 1}" for j in range(len(self.coefficients)))

    @property
    def error(self) -> F:
        """(m,) zeros: the map stands for the data."""
        return np.zeros(len(self.outputs))

    def error_columns(self, poses: F) -> F:
        """(N, m, 0): no direction is known in which the map errs."""
        return np.zeros((len(poses), len(self.outputs), 0))

    def further_columns(self, poses: F) -> F:
        """(N, m, 0): there are no degrees, or one more takes in nearly anything."""
        return np.zeros((len(poses), len(self.outputs), 0))

    @property
    def bounds(self) -> tuple[F, F] | None:
        """None: no limits."""
        return None

    @property
    def prior(self) -> tuple[F, F] | None:
        """None: nothing is known of the coefficients before."""
        return None

    def other_body(self, change: BodyChange) -> BaseMap | None:
        """None: one body only."""
        return None


class SixAxisMap(MapDefaults):
    """Defaults of a map from all six pose columns to all six wrench columns."""

    inputs = POSE
    outputs = WRENCH


@dataclass(frozen=True)
class PolynomialMap(MapDefaults):
    """A polynomial from any pose columns to any wrench columns.

    Parameters
    ----------
    model
        Degree, ranges of the normalisation, and coefficients of each output.
    inputs, outputs
        Names of the n pose and m wrench columns.

    Source
    ------
    Deutschmann et al., equation (4).

    Examples
    --------
    >>> from ecm.io.table import as_table
    >>> from ecm.models import fit_model
    >>> x = np.linspace(-0.01, 0.01, 9)
    >>> base = fit_model(as_table({"x_m": x, "fx_N": 2000.0 * x}), "linear").base
    >>> base.name, base.outputs, len(base.coefficients)
    ('poly:1', ('fx_N',), 2)
    """

    model: _native.PolynomialEvaluator
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    kind = "polynomial"

    @cached_property
    def _turns(self) -> bool:
        """Whether the last three columns are a rotation vector."""
        return self.inputs[-3:] == POSE[3:]

    @property
    def name(self) -> str:
        """`poly:D`."""
        return f"poly:{self.model.degree}"

    @property
    def coefficients(self) -> F:
        """(k,) all coefficients, output by output."""
        return np.asarray(self.model.coefficients.T.ravel())

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """(k,) `fx_N:x^2`: the output, in whose unit it is, and the term; each x from -1 to 1."""
        short = [name.rpartition("_")[0] for name in self.inputs]
        terms = [_monomial(short, powers) for powers in self.document()["terms"]]
        return tuple(f"{output}:{term or 1}" for output in self.outputs for term in terms)

    def predict(self, poses: F) -> F:
        """(N, n) poses to (N, m) wrenches."""
        return self.model.predict(np.ascontiguousarray(poses), self._turns)

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n); kinds other than `partial` need all six columns on both sides."""
        partial = self.model.jacobian(np.ascontiguousarray(poses), self._turns)
        return partial_to(kind, partial, poses, self)

    def regressor(self, poses: F) -> F:
        """(N, k / m) terms of one output at poses (N, n), normalised as in the fit."""
        refuse_long_rotations(poses, self.inputs)
        return polynomial_regressor(
            np.ascontiguousarray(poses), self.model.degree, self.model.lower, self.model.upper
        )

    def columns(self, poses: F) -> F:
        """(N, m, k) block diagonal: the same regressor for each output."""
        regressor, each = self.regressor(poses), np.arange(len(self.outputs))
        (n, k), m = regressor.shape, len(each)
        columns = np.zeros((n, m, m, k))
        columns[:, each, each] = regressor[:, None]
        return columns.reshape(n, m, m * k)

    def with_coefficients(self, coefficients: F) -> PolynomialMap:
        """The same terms with other coefficients (k,)."""
        shaped = coefficients.reshape(len(self.outputs), -1).T
        model = _native.PolynomialEvaluator.from_coefficients(
            self.model.degree, self.model.lower, self.model.upper, np.ascontiguousarray(shaped)
        )
        return PolynomialMap(model, self.inputs, self.outputs)

    def document(self) -> dict[str, Any]:
        """Terms, ranges and coefficients for a model file."""
        return self.model.document(self.inputs, self.outputs)

    def __reduce__(self) -> tuple[Any, ...]:
        """As its document: what is compiled has no copy of its own."""
        return PolynomialMap.from_document, (self.document(),)

    @staticmethod
    def from_document(document: dict[str, Any]) -> PolynomialMap:
        """Return the map of an opened model file."""
        ranges = document["normalisation"]
        model = _native.PolynomialEvaluator.from_coefficients(
            int(document["degree"]),
            np.asarray(ranges["lower"], dtype=np.float64),
            np.asarray(ranges["upper"], dtype=np.float64),
            np.asarray(document["coefficients"], dtype=np.float64),
        )
        return PolynomialMap(model, tuple(document["inputs"]), tuple(document["outputs"]))


@dataclass(frozen=True)
class EnergyMap(SixAxisMap):
    """A polynomial energy of mid-frame coordinates: every such map has a potential.

    Parameters
    ----------
    model
        Length (m), degree, symmetry, scales and coefficients of the energy.

    Source
    ------
    docs/explain/energies.md.

    Examples
    --------
    >>> poses = np.random.default_rng(0).uniform(-0.01, 0.01, (30, 6)) + [0.1, 0, 0, 0, 0, 0]
    >>> wrenches = 1000.0 * (poses - [0.1, 0, 0, 0, 0, 0])
    >>> base = EnergyTerms(0.1, 4).fit(poses, wrenches)
    >>> base.name, len(base.coefficients)
    ('energy4', 22)
    """

    model: _native.EnergyEvaluator

    kind = "energy"

    @property
    def name(self) -> str:
        """`energyD`, `energyD-revolution` or `energyD-general`, then `+group` for each group."""
        return self.model.name

    @property
    def length_m(self) -> float:
        """Length of the mechanism, m."""
        return self.model.length_m

    @property
    def coefficients(self) -> F:
        """(k,) one per term of the energy."""
        return np.asarray(self.model.coefficients)

    parameter_unit = "J"
    """Coordinates are taken over `normalisation.scale` of the model file."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """(k,) `c_x^2 b`: the term; of a group the real or imaginary part of `c_x C D*` and so on.

        C = c_y + i c_z, D = -theta_z + i theta_y, and * conjugates.
        """
        own = self.model
        variables = _VARIABLES[own.symmetry == "general"]
        terms = (_monomial(variables, powers) for powers in own.terms.tolist())
        groups = (
            f"{('Re', 'Im')[kind]} {_monomial(_GROUP_VARIABLES, powers)}"
            for *powers, kind in own.group_terms.tolist()
        )
        return (*terms, *groups)

    def predict(self, poses: F) -> F:
        """(N, 6) poses to (N, 6) wrenches."""
        return self.model.predict(np.ascontiguousarray(poses))

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, 6, 6) stiffness."""
        return self.model.stiffness(np.ascontiguousarray(poses), cast(StiffnessKind, kind))

    def wrench_and_stiffness(self, poses: F, kind: str = "partial") -> tuple[F, F]:
        """(N, 6) wrenches and (N, 6, 6) stiffnesses."""
        return self.model.wrench_and_stiffness(
            np.ascontiguousarray(poses), cast(StiffnessKind, kind)
        )

    def columns(self, poses: F) -> F:
        """(N, 6, k) wrench of each term."""
        return self.terms.regressor(poses, self.model.scale)

    def further_columns(self, poses: F) -> F:
        """(N, 6, k) wrench of each term of an energy of one degree more."""
        return replace(self.terms, degree=self.model.degree + 1).regressor(poses, self.model.scale)

    def with_coefficients(self, coefficients: F) -> EnergyMap:
        """The same terms with other coefficients (k,)."""
        return self.terms.map(self.model.scale, coefficients)

    @property
    def terms(self) -> EnergyTerms:
        """The terms of the energy."""
        own = self.model
        symmetry = cast(Symmetry, own.symmetry)
        return EnergyTerms(own.length_m, own.degree, symmetry, tuple(own.groups))

    def document(self) -> dict[str, Any]:
        """Terms, scales and coefficients for a model file."""
        return self.model.document()

    def __reduce__(self) -> tuple[Any, ...]:
        """As its document: what is compiled has no copy of its own."""
        return EnergyMap.from_document, (self.document(),)

    @staticmethod
    def from_document(document: dict[str, Any]) -> EnergyMap:
        """Return the map of an opened model file."""
        terms = EnergyTerms(
            float(document["length_m"]),
            int(document["degree"]),
            cast(Symmetry, document["symmetry"]),
            tuple(document.get("groups", ())),
        )
        scale = np.asarray(document["normalisation"]["scale"], dtype=np.float64)
        return terms.map(scale, np.asarray(document["coefficients"], dtype=np.float64))


_VARIABLES = (
    ("c_x", "|c_perp|^2", "|theta_perp|^2", "theta_x", "a", "b"),
    ("c_x", "c_y", "c_z", "theta_x", "theta_y", "theta_z"),
)
"""Variables of an energy (docs/explain/energies.md): of a body of revolution, and of any."""
_GROUP_VARIABLES = ("c_x", "theta_x", "C", "C*", "D", "D*")


def _monomial(names: Sequence[str], powers: Sequence[int]) -> str:
    """A product of powers: `x^2 y`."""
    pairs = [(name, power) for name, power in zip(names, powers, strict=True) if power]
    return " ".join(f"({n})^{p}" if "^" in n and p > 1 else n + f"^{p}" * (p > 1) for n, p in pairs)


Solved = tuple[StiffnessMap, F, float]
"""Map, covariance (k, k), whitened residual variance."""


@dataclass(frozen=True)
class EnergyTerms:
    """The terms of an energy: their wrenches, and their fits in whole or block by block.

    Examples
    --------
    >>> poses = np.random.default_rng(0).uniform(-0.01, 0.01, (30, 6)) + [0.1, 0, 0, 0, 0, 0]
    >>> wrenches = 1000.0 * (poses - [0.1, 0, 0, 0, 0, 0])
    >>> EnergyTerms(0.1, 4).fit(poses, wrenches).name
    'energy4'
    """

    length_m: float
    degree: int
    symmetry: Symmetry = "alike"
    groups: tuple[str, ...] = ()

    def regressor(self, poses: F, scale: F) -> F:
        """(N, 6, k) wrench of each term at poses (N, 6); `scale` (2,) of length and angle."""
        poses = np.ascontiguousarray(poses)
        return _native.EnergyEvaluator.regressor(poses, scale=scale, **vars(self))

    def map(self, scale: F, coefficients: F) -> EnergyMap:
        """The map with these coefficients (k,)."""
        values = np.ascontiguousarray(coefficients)
        model = _native.EnergyEvaluator.from_coefficients
        return EnergyMap(model(scale=scale, coefficients=values, **vars(self)))

    def fit(self, poses: F, wrenches: F) -> EnergyMap:
        """The fit that weighs each component by its own spread."""
        pairs = np.ascontiguousarray(poses), np.ascontiguousarray(wrenches)
        return EnergyMap(_native.EnergyEvaluator.fit(*pairs, **vars(self)))

    def frame(self, poses: F) -> F:
        """(2,) scale of length and angle, which all blocks of a fit share."""
        return _native.EnergyEvaluator.scale_of(poses, self.length_m)

    def reduce(self, frame: F, poses: F, wrenches: F, covariance: F) -> F:
        """(c, c) triangle of the whitened rows of a block."""
        triangle = _native.EnergyEvaluator.triangle
        return triangle(poses, wrenches, covariance, scale=frame, **vars(self))

    def solve(self, frame: F, parts: Sequence[F], rows: int) -> Solved:
        """The fit of the blocks' triangles."""
        model = _native.EnergyEvaluator.fit_triangles(parts, rows, scale=frame, **vars(self))
        return EnergyMap(model), np.asarray(model.covariance), model.residual_variance


def finite(what: str, evaluate: Callable[[], F]) -> F:
    """Numbers (N, ...) of a function that may overflow; native maps refuse such rows themselves.

    Raises
    ------
    ModelError
        A number is not finite, with its row.

    Examples
    --------
    >>> finite("the prediction", lambda: np.array([[2.0]]) ** 2)
    array([[4.]])
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        values = np.asarray(evaluate())
    if not np.isfinite(values).all():
        row, *_ = np.argwhere(~np.isfinite(values))[0]
        raise ModelError(
            f"{what}: row {row} is not finite, because a number of the pose or of the model is too "
            "large; leave the row out"
        )
    return values


def refuse_long_rotations(poses: F, inputs: tuple[str, ...]) -> None:
    """Refuse poses (N, n) beyond half a turn, of which no model knows anything.

    Energies refuse them on their own; this is for maps of any columns.

    Raises
    ------
    ModelError
        A rotation vector longer than pi, with its row.

    Examples
    --------
    >>> refuse_long_rotations(np.array([[0.1, 0.0, 0.0, 0.0, 3.1, 0.0]]), POSE)
    """
    places = [inputs.index(name) for name in POSE[3:] if name in inputs]
    if len(places) == len(POSE[3:]):
        check_rotations(np.ascontiguousarray(poses[:, places]))


def partial_to(kind: str, partial: F, poses: F, base: Any) -> F:
    """(N, m, n) another kind of stiffness of a map or model, from K; needs all twelve columns."""
    if kind == "partial":
        return partial
    if not is_whole(base):
        raise InputError(
            f"stiffness kind {kind} needs a model of all six pose and six wrench columns; "
            f"this one has {len(base.inputs)} and {len(base.outputs)}: ask for partial"
        )
    return convert_stiffness(
        np.ascontiguousarray(partial),
        np.ascontiguousarray(poses),
        base.predict(poses),
        source="partial",
        target=cast(StiffnessKind, kind),
    )


def wrench_variances(base: StiffnessMap, covariance: F, poses: F) -> F:
    """(N, m) variances of the wrench at poses (N, n) from those of the coefficients, in N and N m.

    Examples
    --------
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 9)
    >>> model = ecm.fit({"x_m": x, "fx_N": 1e4 * x + 0.1 * np.sin(9e4 * x)}, "linear")
    >>> wrench_variances(model.base, model.covariance, np.zeros((2, 1))).shape
    (2, 1)
    """
    by_block = _own_variances(base, covariance)

    def of_block(block: slice) -> F:
        part = np.ascontiguousarray(poses[block])
        return by_block(part) if by_block else variances_of(base.columns(part), covariance)

    blocks = in_blocks(len(poses), of_block)
    return np.concatenate([np.zeros((0, len(base.outputs))), *blocks])


def variances_of(columns: F, covariance: F) -> F:
    """(N, m) c' P c of columns c (N, m, k), by one product of two matrices.

    Examples
    --------
    >>> variances_of(np.ones((1, 1, 2)), np.diag([1.0, 4.0]))
    array([[5.]])
    """
    images = (columns.reshape(-1, columns.shape[2]) @ covariance).reshape(columns.shape)
    return np.asarray(np.einsum("nmk,nmk->nm", images, columns))


def leverages(base: StiffnessMap, covariance: F, noise: Noise, poses: F) -> F:
    """(N,) leverage of poses (N, 6)."""
    known = {} if base.length_m is None else {"length_m": base.length_m}
    by_block = _own_variances(base, covariance)
    # P = R R', so that only the columns' images are needed, block by block.
    values, vectors = (np.zeros(0), np.zeros(0)) if by_block else eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))

    def of_block(block: slice) -> F:
        part = np.ascontiguousarray(poses[block])
        table = Table(columns_of(base, part), Meta(mechanism=known), "poses")
        row_covariance = noise.covariance(Rows(table, base))
        if by_block is not None:
            own = by_block(part) / np.einsum("njj->nj", row_covariance)
            return np.asarray(own.max(axis=1))
        columns = base.columns(part)
        # One product of two matrices: many small ones are slow.
        images = (columns.reshape(-1, columns.shape[2]) @ root).reshape(columns.shape)
        whitener = whiteners(row_covariance)
        own = whitener @ (images @ np.swapaxes(images, 1, 2)) @ np.swapaxes(whitener, 1, 2)
        return np.asarray(np.linalg.eigvalsh(own)[:, -1])

    return np.concatenate([np.zeros(0), *in_blocks(len(poses), of_block)])


def _own_variances(base: StiffnessMap, covariance: F) -> Callable[[F], F] | None:
    """(N, m) variances of a free polynomial at poses (N, n), an output by itself; None of others.

    The block of each output is often a multiple of one before it, and its form that of the other.
    """
    if not isinstance(base, PolynomialMap):
        return None
    k = len(covariance) // len(base.outputs)
    blocks: list[F] = []
    outputs: list[tuple[int, float]] = []
    for j in range(len(base.outputs)):
        own = covariance[j * k : (j + 1) * k, j * k : (j + 1) * k]
        for i, block in enumerate(blocks):
            factor = float(np.trace(own) / max(np.trace(block), 1e-300))
            if np.allclose(own, factor * block, rtol=1e-12, atol=0.0):
                outputs.append((i, factor))
                break
        else:
            outputs.append((len(blocks), 1.0))
            blocks.append(own)

    def variances(poses: F) -> F:
        x = base.regressor(poses)
        forms = [np.einsum("nk,nk->n", x @ block, x) for block in blocks]
        return np.stack([factor * forms[i] for i, factor in outputs], axis=1)

    return variances


Weights = Literal["auto", "noise", "spread"]
"""How rows and components count in a fit (`fit_model`)."""


@dataclass(frozen=True)
class FittedMap:
    """A map fitted to measured rows, and how uncertain its coefficients are."""

    base: StiffnessMap
    noise: Noise
    covariance: F | None = None
    """(k, k) covariance of the coefficients; None where it is not known."""
    residual_variance: float | None = None
    """Whitened residual square per degree of freedom; None where the noise was not used."""
    converged: bool = True


@dataclass(frozen=True)
class ModelSpecification(Checked, ABC):
    """The kind of model to fit; each subclass is one family of models.

    A subclass states its `kind` and how to fit and read its map; one line in `registry.py` makes it
    known to `fit_model`, to the command line and to model files.

    Examples
    --------
    >>> from ecm.models import parse_model
    >>> parse_model("poly:3").alias
    'cubic'
    """

    kind: ClassVar[str]
    """Kind of map in a model file; also the short name, unless the subclass has another."""
    usage: ClassVar[str] = ""
    """How short names are written, for messages; empty where the kind is the only one."""
    weighted: ClassVar[bool] = False
    """Whether `weights` may be chosen."""
    any_columns: ClassVar[bool] = False
    """Whether it fits any pose columns; else it needs all six."""
    takes_inputs: ClassVar[bool] = False
    """Whether it takes the inputs of actuators after six pose columns."""

    @property
    def name(self) -> str:
        """Short name, as on the command line."""
        return self.kind

    @property
    def most_rows(self) -> int | None:
        """Largest number of rows that are fitted: of more, some that are spread over all."""
        return None

    @property
    def alias(self) -> str:
        """The short name that people use: `cubic` for `poly:3`."""
        return self.name

    @property
    def title(self) -> str:
        """The alias with all else that was chosen, as options of the command line."""
        return self.alias

    @classmethod
    def from_name(cls, name: str) -> ModelSpecification | None:
        """Return the specification with this short name; None where it is of another family."""
        return cls() if name == cls.kind else None

    @abstractmethod
    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Fit the map to a table that holds measured rows only; `progress` is told the share."""

    def maps_without(
        self, table: Table, fold: I, fitted: StiffnessMap | None, progress: Progress | None = None
    ) -> list[StiffnessMap] | None:
        """Maps fitted without each fold of many rows, at the cost of one fit; None by default.

        Parameters
        ----------
        table
            N measured rows.
        fold
            (N,) number of each row's fold, from 0.
        fitted
            Map that was fitted to all rows, if there is one.
        progress
            Called with the rows that are read, of all.
        """
        return None

    @staticmethod
    def layout(n: int, m: int) -> Layout:
        """Layout of the family's own keys in a model file of n pose and m wrench columns.

        Polynomials and energies have none here: the reader in Rust checks theirs.
        """
        return anything

    @staticmethod
    def map_from_document(document: dict[str, Any]) -> StiffnessMap:
        """Return the map of an opened model file; only families of the registry have files."""
        raise NotImplementedError


CHOOSE = Remedy("let held-out rows choose the model", "ecm fit DATA --model choose --out OUT")
"""The way out where a model does not fit the rows or the columns of a table."""


def way_of_few_rows(table: Table) -> Remedy | None:
    """What rows leave that are too few for a model; None where only more rows help.

    Held-out rows choose where a linear model can be fitted without one of them. Fewer still carry
    an energy, which needs the length.
    """
    measured = table.measured()
    if len(measured) > len((*table.pose_columns, *table.actuation_columns)) + 1:
        return CHOOSE
    if len(measured) < 2 or not table.has(*POSE, *WRENCH):
        return None  # a single row leaves nothing to choose by
    if table.meta.length_m is not None:
        return CHOOSE
    return Remedy("state [mechanism] length_m in the data's TOML: an energy needs fewer poses")


def length_of(table: Table, name: str) -> float:
    """Length of the mechanism, m; InputError where the table does not state it."""
    if table.meta.length_m is None:
        raise InputError(
            f"{table.source}: {name} needs the mechanism's length; "
            "give [mechanism] length_m in the data's TOML",
            remedy=way_of_few_rows(table),
        )
    return float(table.meta.length_m)


def pose_and_wrench_columns(table: Table) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Pose columns with those of actuators, and wrench columns; InputError where one is none."""
    inputs, outputs = (*table.pose_columns, *table.actuation_columns), table.wrench_columns
    if not inputs or not outputs:
        lacking = "pose" if not inputs else "wrench"
        raise InputError(f"{table.source}: a fit needs at least one {lacking} column, found none")
    return inputs, outputs
