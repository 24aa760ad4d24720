"""A base map with its effects of the pose as one map, and poses to compare the two at."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol, TypeVar

import numpy as np

from ecm._native import EnergyModel, PolynomialModel, rotation_matrices
from ecm.effects import Rows
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.degrees import MOST_OF_ONE_INPUT, POLYNOMIAL_DEGREES
from ecm.models.joint_fit import FittedEffect
from ecm.models.maps import EnergyMap, PolynomialMap, StiffnessMap, Symmetry
from ecm.models.physics.map import PhysicsMap
from ecm.regression.noise import Noise

Form = TypeVar("Form")
Map = TypeVar("Map", EnergyMap, PolynomialMap)
_ENERGIES: tuple[tuple[int, Symmetry], ...]
_ENERGIES = ((6, "alike"), (6, "revolution"), (4, "general"), (6, "general"))
"""Degree and symmetry of the energies that are tried."""
_POSES = 2000
_SEED = 11
_SMALL_ERROR = 0.15
"""An energy whose error over the noise is smaller is near enough to fold effects into."""


class Fitted(Protocol):
    """The members of a model that are needed here."""

    @property
    def base(self) -> StiffnessMap:
        """Base map."""

    @property
    def effects(self) -> Sequence[FittedEffect]:
        """Effects beside it."""

    @property
    def noise(self) -> Noise:
        """Noise of a row."""

    @property
    def domain(self) -> Mapping[str, tuple[float, float]]:
        """Range of each pose column."""

    @property
    def conditions(self) -> Mapping[str, tuple[float, float]]:
        """Range of temperature and time in the training data."""

    @property
    def training(self) -> Mapping[str, Any]:
        """What the model file says of its training data."""

    @property
    def known_length_m(self) -> float | None:
        """Undeformed length."""

    def rest_pose(self, purpose: str) -> F:
        """(1, 6) undeformed pose."""

    def predict(self, data: F) -> F:
        """(N, m) wrench at poses."""

    def rows_at(self, poses: F) -> Rows:
        """Rows of poses (N, n) without a table."""


def folded(model: Fitted) -> tuple[EnergyMap, float]:
    """The smallest energy that is near enough to the base with its effects.

    Also how far it differs from the two: rms of the worst component over the noise.
    """
    rest = model.rest_pose("a model with effects of physics is exported as an energy, which")
    poses = poses_in_domain(model, _POSES)
    wrenches = model.predict(poses)

    def fitted(form: tuple[int, Symmetry], poses: F, wrenches: F) -> EnergyMap:
        length = float(rest[0, 0])
        return EnergyMap(
            EnergyModel.fit(poses, wrenches, length_m=length, degree=form[0], symmetry=form[1])
        )

    return _first_near_enough(_ENERGIES, fitted, poses, wrenches, noise_sd(model))


def folded_polynomial(model: Fitted, base: PolynomialMap) -> tuple[PolynomialMap, float]:
    """The lowest polynomial that is near enough to one with its effects, and how far it differs.

    For models of few columns, which have no energy.
    """
    low, high = np.array([model.domain[name] for name in base.inputs]).T
    poses = np.random.default_rng(_SEED).uniform(low, high, (_POSES, len(low)))
    poses[0], poses[2] = low, high  # among those of the fit: inside it nothing extrapolates
    most = MOST_OF_ONE_INPUT if len(low) == 1 else POLYNOMIAL_DEGREES[1]

    def fitted(degree: int, poses: F, wrenches: F) -> PolynomialMap:
        return PolynomialMap(
            PolynomialModel.fit(poses, wrenches, degree), base.inputs, base.outputs
        )

    degrees, noise = range(base.model.degree, most + 1), noise_sd(model, poses[:200])
    return _first_near_enough(degrees, fitted, poses, model.predict(poses), noise)


def _first_near_enough(
    forms: Iterable[Form], fitted: Callable[[Form, F, F], Map], poses: F, wrenches: F, noise: F
) -> tuple[Map, float]:
    """The first of several forms whose error over the noise is small, else the best, and its error.

    Every other pose is fitted, and the error is that of the rest.
    """
    trials: list[tuple[float, Map]] = []
    for form in forms:
        found = fitted(form, poses[::2].copy(), wrenches[::2].copy())
        error = np.sqrt(((found.predict(poses[1::2]) - wrenches[1::2]) ** 2).mean(axis=0))
        trials.append((float(np.max(error / noise)), found))
        if trials[-1][0] < _SMALL_ERROR:
            break
    share, best = min(trials, key=lambda trial: trial[0])
    return best, share


def noise_sd(model: Fitted, poses: F | None = None) -> F:
    """(m,) root mean square noise of a row of each component over the model's poses."""
    rows = model.rows_at(poses_in_domain(model, 200) if poses is None else poses)
    return np.asarray(np.sqrt(np.einsum("njj->j", model.noise.covariance(rows)) / len(rows)))


def poses_in_domain(model: Fitted, count: int) -> F:
    """(count, 6) random poses like those of the training data, which the model does not contain.

    An energy states how far its data went in mid-frame coordinates: |c| and |theta| at most
    `scale`. Otherwise the ranges of the pose columns are shrunk by half about their middle,
    because no mechanism reaches the corners of the whole box.
    """
    random = np.random.default_rng(_SEED)
    base = model.base.surrogate if isinstance(model.base, PhysicsMap) else model.base
    if isinstance(base, EnergyMap):
        directions = random.standard_normal((2, count, 3))
        directions /= np.linalg.norm(directions, axis=2, keepdims=True)
        radii = random.uniform(0.0, 1.0, (2, count, 1)) ** (1.0 / 3.0)
        c, theta = directions * radii * np.minimum(base.model.scale, 3.0)[:, None, None]
        half = rotation_matrices(np.ascontiguousarray(0.5 * theta))
        position = np.einsum("nij,nj->ni", half, c + np.array([base.model.length_m, 0.0, 0.0]))
        return np.hstack([position, theta])
    length = model.known_length_m or 0.1
    lower = np.array([0.9 * length, -0.1 * length, -0.1 * length, -0.3, -0.3, -0.3])
    upper = np.array([1.1 * length, 0.1 * length, 0.1 * length, 0.3, 0.3, 0.3])
    for j, column in enumerate(POSE):
        if column in model.domain:
            low, high = model.domain[column]
            quarter = 0.25 * (high - low)
            lower[j], upper[j] = low + quarter, high - quarter
    return np.asarray(random.uniform(lower, upper, (count, 6)))
