"""The free pose at given inputs, and inputs for a pose: nearest, and of least or largest stiffness.

Parameters and errors are those of the methods of `Model` that call them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, least_squares, minimize

from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.models.actuated_energy import ActuatedMap, power_of, slope_of
from ecm.regression.rows import equilibrium

_STARTS = (0.5, 0.0, 1.0)
"""Starts between the limits of the inputs of a search."""
_HELD_N = 1e-5
"""Largest force, and moment over the length, by which an inequality may be missed."""


def free_pose(
    energy: ActuatedMap, inputs: F, wrench: F | None = None, *, start: F | None = None
) -> tuple[F, F]:
    """Pose (6,) that takes a wrench (6,) at these inputs (m,), and its change dp/da (6, m)."""
    goal = np.zeros(6) if wrench is None else np.asarray(wrench, dtype=np.float64)
    a = np.asarray(inputs, dtype=np.float64)
    rest = np.array([energy.terms.length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
    pose = rest if start is None else np.asarray(start, dtype=np.float64)
    none, share, step = np.zeros((1, 0)), 0.0, 1.0
    while share < 1.0:
        aim = min(1.0, share + step)
        moved, found = equilibrium(energy.at(aim * a), pose[None], none, aim * goal, rest[0])
        if found[0]:
            pose, share = moved[0], aim
            continue
        step *= 0.5
        if step < 1.0 / 64.0:
            raise ComputationError(
                f"free_pose: no equilibrium was found beyond {100.0 * share:.0f} % of the "
                "inputs and the wrench; give smaller ones, or a start that is closer"
            )
    row = np.concatenate([pose, a])[None]
    slope = np.linalg.solve(energy.stiffness(row)[0], energy.actuation_jacobian(row)[0])
    return pose, np.asarray(-slope)


@dataclass(frozen=True)
class Held:
    """A pose that is held against a wrench by inputs within limits, over `input_scale`."""

    base: ActuatedMap
    pose: F
    wrench: F | None
    limits: Sequence[tuple[float, float]]
    caller: str

    @cached_property
    def bounds(self) -> F:
        """(m, 2) dimensionless."""
        bounds, m = np.asarray(self.limits, dtype=np.float64), len(self.base.actuators)
        if bounds.shape != (m, 2) or (bounds[:, 0] >= bounds[:, 1]).any():
            raise InputError(
                f"{self.caller}: limits has shape {bounds.shape}, expected least and largest input "
                f"of each of the {m} actuators"
            )
        return bounds / self.base.input_scale[:, None]

    @cached_property
    def unit(self) -> F:
        """(6,) that make moments count as forces, over the length."""
        return np.repeat([1.0, 1.0 / self.base.terms.length_m], 3)

    def row(self, a: F) -> F:
        """(1, 6 + m)."""
        pose = np.asarray(self.pose, dtype=np.float64)
        return np.concatenate([pose, a * self.base.input_scale])[None]

    def left(self, a: F) -> F:
        """(6,) wrench that is still needed, N and N m."""
        goal = np.zeros(6) if self.wrench is None else np.asarray(self.wrench, dtype=np.float64)
        return np.asarray(self.base.predict(self.row(a))[0] - goal)

    def slope(self, a: F) -> F:
        """(6, m) its derivative."""
        return np.asarray(self.base.actuation_jacobian(self.row(a))[0] * self.base.input_scale)

    def nearest(self, start: F, weights: F | None = None) -> F:
        """(m,) inputs of least squares of what is left."""
        unit = self.unit if weights is None else weights

        def left(a: F) -> F:
            return self.left(a) * unit

        def slope(a: F) -> F:
            return self.slope(a) * unit[:, None]

        found = least_squares(left, start, jac=slope, bounds=tuple(self.bounds.T), x_scale="jac")
        return np.asarray(found.x)

    def closest(self) -> tuple[F, F]:
        """Inputs (m,) that leave the least, in their own units, and what is left (6,)."""
        a = self.nearest(self.bounds.mean(axis=1))
        return a * self.base.input_scale, self.left(a)

    def stiffness_range(
        self, along: str | F, tolerance: float | F
    ) -> tuple[tuple[float, F], tuple[float, F]]:
        """Least and largest stiffness along a direction, each with its inputs."""
        own = [name == along for name in POSE] if isinstance(along, str) else along
        d = np.asarray(own, dtype=np.float64)
        tolerances = np.broadcast_to(np.asarray(tolerance, dtype=np.float64), 6)
        if d.shape != (6,) or not d.any() or not (tolerances >= 0.0).all():
            raise InputError(
                f"stiffness_range: along = {along!r}, tolerance = {tolerance!r}: expected one of "
                f"{', '.join(POSE)} or a direction (6,), and 0 or more"
            )
        return self.extreme(1.0, d, tolerances), self.extreme(-1.0, d, tolerances)

    def extreme(self, sign: float, d: F, tolerance: F) -> tuple[float, F]:
        """The least (sign 1) or largest (-1) stiffness d'Kd, and its inputs in their own units."""
        at = np.asarray(self.pose, dtype=np.float64)[None]
        parts = [(product, float(d @ u.stiffness(at)[0] @ d)) for product, u in self.base.parts]
        size = max(abs(value) for _, value in parts)
        m = len(self.bounds)

        def stiffness(a: F) -> float:
            return float(sum(power_of(a[None], product)[0] * value for product, value in parts))

        def worth(a: F) -> float:
            return sign * stiffness(a) / size

        def rise(a: F) -> F:
            slopes = [
                sum(slope_of(a[None], product, (i,))[0] * value for product, value in parts)
                for i in range(m)
            ]
            return np.asarray(slopes) * sign / size

        free = np.isinf(tolerance)
        unit, within = self.unit[~free], (tolerance * self.unit)[~free]

        def room(a: F) -> F:
            off = self.left(a)[~free] * unit
            return np.concatenate([within - off, within + off])

        def room_slope(a: F) -> F:
            slope = self.slope(a)[~free] * unit[:, None]
            return np.vstack([-slope, slope])

        bounds: Any = Bounds(*self.bounds.T)
        limits: Any = [NonlinearConstraint(room, 0.0, np.inf, jac=room_slope)] * (not free.all())
        best: tuple[float, F] | None = None
        worst = np.full(6, np.inf)
        for share in _STARTS:
            start = self.bounds @ np.array([1.0 - share, share])
            start = self.nearest(start, np.where(free, 0.0, self.unit))
            found = minimize(
                worth, start, jac=rise, bounds=bounds, constraints=limits, method="SLSQP"
            )
            a = np.clip(found.x, *self.bounds.T)
            beyond = np.maximum(np.abs(self.left(a)) - tolerance, 0.0) * self.unit
            if beyond.max() < worst.max():
                worst = beyond
            if beyond.max() < _HELD_N and (best is None or sign * stiffness(a) < sign * best[0]):
                best = stiffness(a), a * self.base.input_scale
        if best is None:
            j = int(np.argmax(worst))
            raise ComputationError(
                f"stiffness_range: no inputs within the limits hold the pose: {WRENCH[j]} stays "
                f"{worst[j] / self.unit[j]:.3g} beyond its tolerance; give a larger tolerance or "
                "wider limits"
            )
        return best
