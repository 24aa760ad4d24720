"""Maps from pose to wrench: polynomial and energy, with what a refit needs of them.

A map is linear in its coefficients, h(p) = columns(p) @ coefficients, so that any map can be
refitted together with effects.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol, cast, get_args

import numpy as np

from ecm._native import EnergyModel, PolynomialModel, convert_stiffness, polynomial_regressor
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.regression.rows import BaseMap, BodyChange

StiffnessKind = Literal["partial", "generalised", "screw"]
Symmetry = Literal["alike", "revolution", "general"]
SYMMETRIES: tuple[Symmetry, ...] = get_args(Symmetry)


class StiffnessMap(Protocol):
    """Pose in, wrench and stiffness out."""

    @property
    def name(self) -> str:
        """As on the command line."""

    @property
    def kind(self) -> str:
        """Family of the map: polynomial, energy, physics, or a baseline's own name."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Pose columns, n of them."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Wrench columns, m of them."""

    @property
    def length_m(self) -> float | None:
        """Length of the mechanism, where the map needs it."""

    @property
    def coefficients(self) -> F:
        """(k,) what a refit may change."""

    @property
    def error(self) -> F:
        """(m,) the map's own error against what it stands for, zero where it stands for data."""

    def predict(self, poses: F) -> F:
        """(N, n) poses to (N, m) wrenches."""

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n) stiffness of the kind (conventions.md)."""

    def columns(self, poses: F) -> F:
        """(N, m, k) derivative of the wrench to the coefficients."""

    def with_coefficients(self, coefficients: F) -> StiffnessMap:
        """The same map with other coefficients."""

    @property
    def bounds(self) -> tuple[F, F] | None:
        """(k,) lower and upper limits of the coefficients; None where there are none."""

    def other_body(self, change: BodyChange) -> BaseMap | None:
        """The map of a changed body (regression/rows.py); None where it knows one body only."""

    def document(self) -> dict[str, Any]:
        """The map's part of a model file."""


class MapDefaults:
    """What most maps share: coefficients without limits, and one body only."""

    @property
    def bounds(self) -> tuple[F, F] | None:
        """None: no limits."""
        return None

    def other_body(self, change: BodyChange) -> BaseMap | None:
        """None: one body only."""
        return None


@dataclass(frozen=True)
class PolynomialMap(MapDefaults):
    """A polynomial from any pose columns to any wrench columns (the paper's equation (4))."""

    model: PolynomialModel
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def name(self) -> str:
        """`poly:D`."""
        return f"poly:{self.model.degree}"

    @property
    def kind(self) -> Literal["polynomial", "energy", "physics"]:
        """`polynomial`."""
        return "polynomial"

    @property
    def length_m(self) -> float | None:
        """Not needed."""
        return None

    @property
    def coefficients(self) -> F:
        """All coefficients, output by output."""
        return np.asarray(self.model.coefficients.T.ravel())

    @property
    def error(self) -> F:
        """Zero: it stands for the data."""
        return np.zeros(len(self.outputs))

    def predict(self, poses: F) -> F:
        """(N, n) to (N, m)."""
        return self.model.predict(np.ascontiguousarray(poses))

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n); kinds other than `partial` need all six columns on both sides."""
        partial = self.model.jacobian(np.ascontiguousarray(poses))
        return partial_to(kind, partial, poses, self)

    def regressor(self, poses: F) -> F:
        """(N, k / m) terms of one output at poses (N, n), normalised as in the fit."""
        return polynomial_regressor(
            np.ascontiguousarray(poses), self.model.degree, self.model.lower, self.model.upper
        )

    def columns(self, poses: F) -> F:
        """Block diagonal: the same regressor for each output."""
        regressor = self.regressor(poses)
        n, k = regressor.shape
        m = len(self.outputs)
        columns = np.zeros((n, m, m * k))
        for j in range(m):
            columns[:, j, j * k : (j + 1) * k] = regressor
        return columns

    def with_coefficients(self, coefficients: F) -> PolynomialMap:
        """The same terms with other coefficients."""
        shaped = coefficients.reshape(len(self.outputs), -1).T
        model = PolynomialModel.from_coefficients(
            self.model.degree, self.model.lower, self.model.upper, np.ascontiguousarray(shaped)
        )
        return PolynomialMap(model, self.inputs, self.outputs)

    def document(self) -> dict[str, Any]:
        """Terms, ranges and coefficients."""
        return self.model.document(self.inputs, self.outputs)

    @staticmethod
    def from_document(document: dict[str, Any]) -> PolynomialMap:
        """The map of an opened model file."""
        ranges = document["normalisation"]
        model = PolynomialModel.from_coefficients(
            int(document["degree"]),
            np.asarray(ranges["lower"], dtype=np.float64),
            np.asarray(ranges["upper"], dtype=np.float64),
            np.asarray(document["coefficients"], dtype=np.float64),
        )
        return PolynomialMap(model, tuple(document["inputs"]), tuple(document["outputs"]))


@dataclass(frozen=True)
class EnergyMap(MapDefaults):
    """A polynomial energy of mid-frame coordinates: every such map has a potential."""

    model: EnergyModel

    @property
    def name(self) -> str:
        """`energyD`, `energyD-revolution` or `energyD-general`, then `+group` for each group."""
        return self.model.name

    @property
    def kind(self) -> Literal["polynomial", "energy", "physics"]:
        """`energy`."""
        return "energy"

    @property
    def inputs(self) -> tuple[str, ...]:
        """All six."""
        return POSE

    @property
    def outputs(self) -> tuple[str, ...]:
        """All six."""
        return WRENCH

    @property
    def length_m(self) -> float | None:
        """Length of the mechanism."""
        return self.model.length_m

    @property
    def coefficients(self) -> F:
        """One per term of the energy."""
        return np.asarray(self.model.coefficients)

    @property
    def error(self) -> F:
        """Zero: it stands for the data."""
        return np.zeros(6)

    def predict(self, poses: F) -> F:
        """(N, 6) to (N, 6)."""
        return self.model.predict(np.ascontiguousarray(poses))

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, 6, 6)."""
        return self.model.stiffness(np.ascontiguousarray(poses), cast(StiffnessKind, kind))

    def columns(self, poses: F) -> F:
        """(N, 6, k) wrench of each term."""
        return EnergyModel.regressor(
            np.ascontiguousarray(poses),
            length_m=self.model.length_m,
            degree=self.model.degree,
            symmetry=cast(Symmetry, self.model.symmetry),
            scale=self.model.scale,
            groups=self.model.groups,
        )

    def with_coefficients(self, coefficients: F) -> EnergyMap:
        """The same terms with other coefficients."""
        return EnergyMap(
            EnergyModel.from_coefficients(
                length_m=self.model.length_m,
                degree=self.model.degree,
                symmetry=cast(Symmetry, self.model.symmetry),
                scale=self.model.scale,
                coefficients=np.ascontiguousarray(coefficients),
                groups=self.model.groups,
            )
        )

    def document(self) -> dict[str, Any]:
        """Terms, scales and coefficients."""
        return self.model.document()

    @staticmethod
    def from_document(document: dict[str, Any]) -> EnergyMap:
        """The map of an opened model file."""
        return EnergyMap(
            EnergyModel.from_coefficients(
                length_m=float(document["length_m"]),
                degree=int(document["degree"]),
                symmetry=cast(Symmetry, document["symmetry"]),
                scale=np.asarray(document["normalisation"]["scale"], dtype=np.float64),
                coefficients=np.asarray(document["coefficients"], dtype=np.float64),
                groups=list(document.get("groups", ())),
            )
        )


def partial_to(kind: str, partial: F, poses: F, base: StiffnessMap) -> F:
    """(N, m, n) another kind of stiffness from K = dh/dp; needs all six columns on both sides."""
    if kind == "partial":
        return partial
    if base.inputs != POSE or base.outputs != WRENCH:
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
