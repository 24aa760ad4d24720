"""A base map with its effects of the pose as one map, compared at measured poses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol, TypeVar

import numpy as np

from ecm._native import EnergyModel, ModelError, PolynomialModel
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.degrees import MOST_OF_ONE_INPUT, POLYNOMIAL_DEGREES
from ecm.models.joint_fit import FittedEffect
from ecm.models.maps import EnergyMap, PolynomialMap, Symmetry
from ecm.models.measured_poses import Posed, measured_poses, near_poses, noise_sd

Form = TypeVar("Form")
Map = TypeVar("Map", EnergyMap, PolynomialMap)
_ENERGIES: tuple[tuple[int, Symmetry], ...]
_ENERGIES = ((6, "alike"), (6, "revolution"), (4, "general"), (6, "general"))
"""Degree and symmetry of the energies that are tried."""
_POSES = 1000
_AROUND = 0.1
"""Share of their extent by which poses are moved: rows along a line tell no stiffness beside it."""
_SMALL_ERROR = 0.15
"""An energy whose error over the noise is smaller is near enough to fold effects into."""


class Fitted(Posed, Protocol):
    """The members of a model that are needed here."""

    @property
    def effects(self) -> Sequence[FittedEffect]:
        """Effects beside the base."""

    @property
    def conditions(self) -> Mapping[str, tuple[float, float]]:
        """Range of temperature and time in the training data."""

    def rest_pose(self, purpose: str) -> F:
        """(1, 6) undeformed pose."""


def folded(model: Fitted) -> tuple[EnergyMap, float]:
    """The smallest energy that is near enough to the base with its effects.

    Also how far it differs from the two at measured poses: rms of the worst component over the
    noise.
    """
    rest = model.rest_pose("a model with effects of physics is exported as an energy, which")
    length = float(rest[0, 0])

    def fitted(form: tuple[int, Symmetry], poses: F, wrenches: F) -> EnergyMap:
        return EnergyMap(
            EnergyModel.fit(poses, wrenches, length_m=length, degree=form[0], symmetry=form[1])
        )

    return _first_near_enough(_ENERGIES, fitted, model)


def folded_polynomial(model: Fitted) -> tuple[PolynomialMap, float]:
    """The lowest polynomial that is near enough to a map with effects, and how far it differs.

    For models of few columns, which have no energy: polynomials, and equations of one's own.
    """
    base = model.base
    least = base.model.degree if isinstance(base, PolynomialMap) else POLYNOMIAL_DEGREES[0]
    most = MOST_OF_ONE_INPUT if len(base.inputs) == 1 else POLYNOMIAL_DEGREES[1]

    def fitted(degree: int, poses: F, wrenches: F) -> PolynomialMap:
        return PolynomialMap(
            PolynomialModel.fit(poses, wrenches, degree), base.inputs, base.outputs
        )

    return _first_near_enough(range(least, most + 1), fitted, model)


def _first_near_enough(
    forms: Iterable[Form], fitted: Callable[[Form, F, F], Map], model: Fitted
) -> tuple[Map, float]:
    """The first of several forms whose error over the noise is small, else the best, and its error.

    Mixes of near measured poses are fitted, and the error is that at the measured ones, which lie
    around them. The form that is taken is then fitted to both.
    """
    rows, near = measured_poses(model), near_poses(model, _POSES, around=_AROUND)
    noise, truth, between = noise_sd(model), model.predict(rows), model.predict(near)
    trials: list[tuple[float, Form]] = []
    for form in forms:
        try:
            found = fitted(form, near, between)
        except ModelError:  # more terms than these poses tell
            continue
        error = np.sqrt(((found.predict(rows) - truth) ** 2).mean(axis=0))
        trials.append((float(np.max(error / noise)), form))
        if trials[-1][0] < _SMALL_ERROR:
            break
    if not trials:
        raise InputError(
            f"{len(rows)} measured poses tell no map that effects could be folded into: measure "
            "more poses"
        )
    share, best = min(trials, key=lambda trial: trial[0])
    return fitted(best, np.vstack([rows, near]), np.vstack([truth, between])), share
