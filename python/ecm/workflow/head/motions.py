"""What the head is asked to do: wanted poses over time, pushes, payloads, temperature.

Wanted poses are in equilibrium on the true neck at rest and at its reference temperature, so that a
perfect controller could hold them; every controller is asked for the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.rig.frames import left_jacobian_inverse
from ecm.workflow.head.allocation import HeldPose, Statics, held_pose
from ecm.workflow.head.settings import HeadSettings

SET_POINTS_RAD = (
    (0.0, 0.12, 0.0), (0.0, -0.2, 0.0), (0.0, 0.0, 0.2), (0.15, 0.0, 0.0), (-0.12, 0.06, -0.1),
    (0.1, -0.1, 0.12), (0.0, 0.15, -0.15), (-0.1, -0.12, -0.08),
)  # fmt: skip
"""Rotation vectors (turn about the neck, to the front, to the side) over the workspace."""
_MOVE_S, _HOLD_S = 0.7, 2.0
"""Move to a set point, and stay: three time constants of the integral leave 5 % of an error."""
_NODES = 7
MEASURED_S = 0.3
"""Length of the end of a hold over which the settled error is averaged."""


@dataclass(frozen=True)
class Motion:
    """A wanted motion at the rate of the controller.

    Examples
    --------
    >>> Motion("rest", np.zeros((3, 6)), np.zeros((3, 6)), np.zeros((3, 6)), ()).steps
    3
    """

    name: str
    poses: F
    """(N, 6) wanted."""
    twists: F
    """(N, 6) their rates, rotation in base axes."""
    accelerations: F
    """(N, 6) rates of the twists."""
    holds: tuple[tuple[int, int], ...]
    """Steps (begin, end) over which a settled error is taken."""
    push: Callable[[float], F | None] = lambda time_s: None
    """Wrench (6,) on the head that the controller does not know, over time."""
    pauses: tuple[tuple[int, float, float], ...] = ()
    """(step, length in s, temperature afterwards in degC): time that is passed at rest."""

    @property
    def steps(self) -> int:
        """Number of steps of the controller."""
        return len(self.poses)


class Motions:
    """Makes the motions for a neck; poses between are held poses as well.

    Parameters
    ----------
    neck
        Statics of the true neck.
    settings
        The robot.
    length_m
        Length of the neck.
    """

    def __init__(self, neck: Statics, settings: HeadSettings, length_m: float) -> None:
        self.neck, self._settings, self._length = neck, settings, length_m
        self.upright = self._held(np.zeros(3), None)
        """Where every motion begins."""

    def set_points(self, turned_rad: tuple[tuple[float, ...], ...] = SET_POINTS_RAD) -> Motion:
        """From one set point to the next, with a rest at each."""
        legs = [(np.zeros(3), 0.0, 0.4)]
        legs += [(np.asarray(turn), _MOVE_S, _HOLD_S) for turn in turned_rad]
        return self._motion("set points", self._legs(legs), holds=True)

    def nod(self, rate_Hz: float, seconds: float, size_rad: float = 0.12) -> Motion:
        """Nodding at a rate, beginning softly."""
        time = np.arange(round(seconds / self._dt)) * self._dt
        swell = np.minimum(1.0, time * rate_Hz) ** 2
        way = self._way(np.array([0.0, -size_rad, 0.0]), np.array([0.0, size_rad, 0.0]))
        poses = way(0.5 + 0.5 * swell * np.sin(2.0 * np.pi * rate_Hz * time))
        return self._motion(f"nod {rate_Hz:g} Hz", poses)

    def saccade(self) -> Motion:
        """A fast turn about the neck by 0.15 rad in 0.2 s."""
        legs = [(np.zeros(3), 0.0, 0.3), (np.array([0.15, 0.0, 0.0]), 0.2, 0.9)]
        return self._motion("saccade", self._legs(legs), holds=True)

    def pushed(self) -> Motion:
        """At rest; 20 N from the side at the middle of the head for 50 ms."""
        wrench = np.array([0.0, 0.0, 20.0, 0.0, -20.0 * 0.08, 0.0])
        still = self._legs([(np.zeros(3), 0.0, 1.6)])
        push = lambda time_s: wrench if 0.3 <= time_s < 0.35 else None  # noqa: E731
        return self._motion("push", still, holds=True, push=push)

    def payload(self, mass_kg: float = 0.2) -> Motion:
        """At rest; the weight of a payload on the forehead from 0.3 s on."""
        weight = mass_kg * np.asarray(self._settings.gravity_m_s2)
        wrench = np.concatenate([weight, np.cross([0.12, 0.07, 0.0], weight)])
        still = self._legs([(np.zeros(3), 0.0, 1.6)])
        push = lambda time_s: wrench if time_s >= 0.3 else None  # noqa: E731
        return self._motion("payload", still, holds=True, push=push)

    def warming(self, degC: float = 10.0, times: int = 5) -> Motion:
        """An hour: a turn and back some times, at rest for the rest of the hour between them.

        The rests are passed in one step, in plant and controller: their answer to it is exact.
        """
        legs = [(np.zeros(3), 0.0, 0.3)]
        for _ in range(times):
            legs += [(np.array([0.0, 0.12, 0.1]), 0.5, 0.7), (np.zeros(3), 0.5, 0.0)]
        cycle = round((0.5 + 0.7 + 0.5) / self._dt)
        first = round(0.3 / self._dt)
        part = 1.0 / (times - 1)
        pauses = tuple(
            (first + i * cycle, 3600.0 * part, 22.0 + degC * i * part) for i in range(1, times)
        )
        motion = self._motion("hour of warming", self._legs(legs), holds=True, pauses=pauses)
        return motion

    def all(self) -> tuple[Motion, ...]:
        """Every motion of the table."""
        return (
            self.set_points(), self.nod(0.5, 4.0), self.nod(1.5, 2.0), self.saccade(),
            self.pushed(), self.payload(), self.warming(),
        )  # fmt: skip

    @property
    def _dt(self) -> float:
        return self._settings.control.dt_s

    def _held(self, turned_rad: F, start: HeldPose | None) -> HeldPose:
        found = held_pose(self.neck, self._settings, turned_rad, start, length_m=self._length)
        if not found.held:
            forces = ", ".join(f"{force:.0f}" for force in found.forces_N)
            raise InputError(
                f"the head cannot be held turned by {np.round(turned_rad, 3).tolist()} rad: forces "
                f"of {forces} N, expected {self._settings.tendons.least_N:g} to "
                f"{self._settings.tendons.most_N:g}; turn it less"
            )
        return found

    def _way(self, begin: F, end: F) -> Callable[[F], F]:
        """Held poses along the straight line from one rotation vector to another, 0 to 1."""
        nodes = np.linspace(0.0, 1.0, _NODES)
        poses, at = [], self.upright
        for share in nodes:
            at = self._held((1.0 - share) * begin + share * end, at)
            poses.append(at.pose)
        spline = CubicSpline(nodes, np.stack(poses))
        return lambda shares: np.asarray(spline(shares))

    def _legs(self, legs: list[tuple[F, float, float]]) -> tuple[F, list[tuple[int, int]]]:
        """Wanted poses over legs (end, time of way, time of rest), and the holds at their ends."""
        parts, holds, before, count = list[F](), list[tuple[int, int]](), np.zeros(3), 0
        for end, move_s, hold_s in legs:
            steps = round(move_s / self._dt)
            if steps:
                u = (np.arange(steps) + 1.0) / steps
                parts.append(self._way(before, end)(10 * u**3 - 15 * u**4 + 6 * u**5))
            rest = round(hold_s / self._dt)
            last = parts[-1][-1] if parts else self.upright.pose
            parts.append(np.tile(last, (rest, 1)))
            count += steps + rest
            if rest * self._dt > MEASURED_S and steps:
                holds.append((count - round(MEASURED_S / self._dt), count))
            before = end
        if not holds:
            holds.append((count - round(MEASURED_S / self._dt), count))
        return np.concatenate(parts), holds

    def _motion(
        self, name: str, wanted: F | tuple[F, list[tuple[int, int]]], *, holds: bool = False,
        push: Callable[[float], F | None] = lambda time_s: None,
        pauses: tuple[tuple[int, float, float], ...] = (),
    ) -> Motion:  # fmt: skip
        poses, ends = wanted if isinstance(wanted, tuple) else (wanted, [])
        rates = np.gradient(poses, self._dt, axis=0)
        inverse = left_jacobian_inverse(poses[:, 3:])
        turn = np.linalg.solve(inverse, rates[:, 3:, None])[:, :, 0]
        twists = np.hstack([rates[:, :3], turn])
        accelerations = np.gradient(twists, self._dt, axis=0)
        return Motion(
            name, poses, twists, accelerations, tuple(ends) if holds else (), push, pauses
        )
