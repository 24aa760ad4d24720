"""The free pose at given inputs, and inputs for a pose: nearest, and of least or largest stiffness.

Parameters and errors are those of the methods of `Model` with the same names.
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
    share, step = 0.0, 1.0
    while share < 1.0:
        aim = min(1.0, share + step)
        found = _newton(energy, pose, aim * a, aim * goal)
        if found is not None:
            pose, share = found, aim
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


def _newton(energy: ActuatedMap, pose: F, a: F, goal: F) -> F | None:
    unit = np.repeat([1.0, energy.terms.length_m], 3)
    there = energy.at(a)
    for _ in range(30):
        gap = goal - there.predict(pose[None])[0]
        step = np.linalg.solve(there.stiffness(pose[None])[0], gap)
        largest = np.abs(step * np.repeat([1.0 / energy.terms.length_m, 1.0], 3)).max()
        if not np.isfinite(largest):
            return None
        pose = pose + step * min(1.0, 0.3 / max(largest, 1e-300))
        if np.linalg.norm(pose[3:]) > np.pi:
            return None
        if largest < 1e-12 and np.abs(gap / unit).max() < 1e-6:
            return np.asarray(pose)
    return None


def actuation_for(
    energy: ActuatedMap,
    pose: F,
    wrench: F | None = None,
    *,
    limits: Sequence[tuple[float, float]],
) -> tuple[F, F]:
    """Inputs (m,) within limits that hold a pose (6,) against a wrench, and what is left (6,)."""
    held = _Held(energy, pose, wrench, limits, "actuation_for")
    a = held.nearest(held.bounds.mean(axis=1))
    return a * energy.input_scale, held.left(a)


def stiffness_range(
    energy: ActuatedMap,
    pose: F,
    wrench: F | None = None,
    *,
    limits: Sequence[tuple[float, float]],
    along: str | F,
    tolerance: float | F = 0.0,
) -> tuple[tuple[float, F], tuple[float, F]]:
    """Least and largest stiffness that inputs give which hold a pose against a wrench."""
    held = _Held(energy, pose, wrench, limits, "stiffness_range")
    d = np.asarray([name == along for name in POSE] if isinstance(along, str) else along, float)
    tolerances = np.broadcast_to(np.asarray(tolerance, dtype=np.float64), 6)
    if d.shape != (6,) or not d.any() or not (tolerances >= 0.0).all():
        raise InputError(
            f"stiffness_range: along = {along!r}, tolerance = {tolerance!r}: expected one of "
            f"{', '.join(POSE)} or a direction (6,), and 0 or more"
        )
    ends = [held.extreme(sign, d, tolerances) for sign in (1.0, -1.0)]
    return ends[0], ends[1]


@dataclass(frozen=True)
class _Held:
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
