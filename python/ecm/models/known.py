"""A map whose coefficients are known from a fit to other rows, up to the covariance of that fit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.io.arrays import F, eigh
from ecm.models.left_out import LeftOut
from ecm.models.literature import LEARNED
from ecm.models.maps import MapDefaults, StiffnessMap
from ecm.models.measured_poses import has_rows_of_fit
from ecm.models.refit import FAR_BEYOND_NOISE
from ecm.regression.noise import whiteners

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.model import Model

_UNSEEN = 1e-12
"""Share of the largest variance of a direction below which its coefficients are known exactly."""


def _of_map(name: str) -> Any:
    """What the map says of itself by this name."""
    return property(attrgetter(f"map.{name}"))


@dataclass(frozen=True, eq=False)
class KnownMap(MapDefaults):
    """A map as it was fitted: nothing of it is free, and its coefficients err by a covariance."""

    map: StiffnessMap
    covariance: F
    """(k, k) of the coefficients."""
    left: float
    """What its fit left of its own rows over their noise, at least 1: so far its form may err."""
    left_out: LeftOut
    """Terms of one degree more, by the rows of its fit."""
    factor: float = 1.0
    """Its loads over those that were fitted: of another specimen."""

    name = _of_map("name")
    kind = _of_map("kind")
    inputs = _of_map("inputs")
    outputs = _of_map("outputs")
    actuators = _of_map("actuators")
    length_m = _of_map("length_m")
    error = _of_map("error")
    actuation_jacobian = _of_map("actuation_jacobian")
    amounts = _of_map("amounts")

    @property
    def keeps(self) -> str:
        """What a refit keeps of it: the `base`, or its `form` up to a factor."""
        return "base" if self.factor == 1.0 else "form"

    @property
    def coefficients(self) -> F:
        """(0,): none is free."""
        return np.zeros(0)

    @cached_property
    def _directions(self) -> F:
        """(k, e) of the coefficients, each one standard deviation long."""
        variances, turns = eigh(self.covariance)
        seen = variances > _UNSEEN * variances.max(initial=0.0)
        return np.asarray(turns[:, seen] * np.sqrt(variances[seen]))

    def error_columns(self, poses: F) -> F:
        """(N, m, e): what one standard deviation of the fit does, and the map's own errors."""
        own = self.map.columns(poses)
        further = self.left_out.columns(own, self.map.further_columns(poses))
        parts = own @ self._directions, self.map.error_columns(poses), further
        return np.concatenate(parts, axis=2)

    def predict(self, poses: F) -> F:
        """(N, m) wrenches."""
        return self.map.predict(poses)

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n)."""
        return self.map.stiffness(poses, kind)

    def columns(self, poses: F) -> F:
        """(N, m, 0)."""
        return np.zeros((len(poses), len(self.outputs), 0))

    def with_coefficients(self, coefficients: F) -> KnownMap:
        """The same: there is nothing to change."""
        return self

    def document(self) -> dict[str, Any]:
        """That of the map."""
        return self.map.document()


def known_map(model: Model, table: Table, most: int, factor: float = 1.0) -> KnownMap | None:
    """Return the base of a model as other rows than these tell it; None where they may be the same.

    None, too, where its fit does not say how sure it is, and of more than the most coefficients.
    Where the fit left more than the noise, so much less is known, and of one that is far off
    nothing. Of a body the two numbers are found from any rows.
    """
    base, covariance = model.base, model.covariance
    if covariance is None or model.noise.is_assumed or not 0 < len(base.coefficients) <= most:
        return None
    if has_rows_of_fit(model, table) or base.kind in (*LEARNED, "physics"):
        return None
    left = max(1.0, float(model.training.get("over_noise", 1.0)))
    if left > FAR_BEYOND_NOISE:
        return None
    return KnownMap(base, covariance * left**2, left, _left_out(model), factor)


def _left_out(model: Model) -> LeftOut:
    """Return the terms of one degree more, as large as the choice of the degree left them."""
    poses, base = np.array(model.training["poses"]), model.base
    rows, share = model.rows_at(poses), len(poses) / max(model.training["rows"], len(poses))
    root = whiteners(model.noise.covariance(rows, base.error)) / np.sqrt(share)
    own, terms = (root @ part(poses) for part in (base.columns, base.further_columns))
    n, m, _ = own.shape
    return LeftOut.of(own.reshape(n * m, own.shape[2]), terms.reshape(n * m, terms.shape[2]))
