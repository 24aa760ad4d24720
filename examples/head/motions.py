"""What the head is asked to do: wanted poses over time, pushes, payloads, temperature.

Wanted poses are in equilibrium on the true neck at rest and at its reference temperature, so that a
perfect controller could hold them; every controller is asked for the same.

Six equations of equilibrium, h(p) = gravity + A(p) t, have four forces to meet them: of the poses
near rest a family of four dimensions can be held. The three rotations and the pretension are a
choice of coordinates on it; the position of the head then follows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from ecm import InputError
from neck import TrueNeck
from robot import F, HeadSettings, gravity_wrench, tendon_matrix

SET_POINTS_RAD = (
    (0.0, 0.12, 0.0), (0.0, -0.2, 0.0), (0.0, 0.0, 0.2), (0.15, 0.0, 0.0), (-0.12, 0.06, -0.1),
    (0.1, -0.1, 0.12), (0.0, 0.15, -0.15), (-0.1, -0.12, -0.08),
)  # fmt: skip
"""Rotation vectors (turn about the neck, to the front, to the side) over the workspace."""
_MOVE_S, _HOLD_S = 0.7, 2.0
"""Move to a set point, and stay: three time constants of the integral leave 5 % of an error."""
_NODES = 7
_MEASURED_S = 0.3
"""Length of the end of a hold over which the settled error is averaged."""


class HeldPose(NamedTuple):
    """A pose (6,) and the forces (4,) with which the head rests there."""

    pose: F
    forces_N: F
    held: bool
    """Whether the forces are within their limits and the equations are met."""


def held_pose(
    neck: TrueNeck, settings: HeadSettings, turned_rad: F, start: HeldPose | None = None
) -> HeldPose:
    """The pose with a rotation vector (3,) in equilibrium, with forces nearest to the pretension.

    Newton's method for position and forces; the seventh unknown goes to the pretension.

    Parameters
    ----------
    neck
        The true neck.
    settings
        The robot.
    turned_rad
        (3,) wanted rotation vector of the head.
    start
        A solution nearby.
    """
    tendons = settings.tendons
    pose, forces, _ = start or HeldPose(neck.rest, np.full(4, tendons.rest_N), False)
    pose = np.concatenate([pose[:3], turned_rad])
    size = np.repeat([1.0, neck.length_m], 3)  # N of each equation
    # 1 N counts as much as 0.1 m: the position follows, the forces stay near the pretension.
    unit = np.repeat([0.1, 1.0], [3, 4])

    def unbalanced(at: F) -> F:
        wrench = neck.statics(at)[0] - gravity_wrench(settings, at)
        return np.asarray(wrench - tendon_matrix(tendons, at) @ forces)

    for _ in range(60):
        residual = unbalanced(pose) / size
        steps = 1e-6 * np.eye(6)[:3]
        slope = np.stack([(unbalanced(pose + d) - unbalanced(pose - d)) / 2e-6 for d in steps], 1)
        scaled = np.hstack([slope, -tendon_matrix(tendons, pose)]) * unit / size[:, None]
        inverse = np.linalg.pinv(scaled)
        free = np.eye(7) - inverse @ scaled
        offset = np.concatenate([np.zeros(3), forces - tendons.rest_N])
        change = unit * (-inverse @ residual - free @ (offset / unit))
        change *= min(1.0, 0.01 / max(1e-12, float(np.abs(change[:3]).max())))
        pose[:3] += change[:3]
        forces = forces + change[3:]
        if np.abs(residual).max() < 1e-9 and np.abs(change[3:]).max() < 1e-7:
            break
    inside = (forces >= tendons.least_N).all() and (forces <= tendons.most_N).all()
    return HeldPose(pose, forces, bool(inside and np.abs(residual).max() < 1e-6))


@dataclass(frozen=True)
class Motion:
    """A wanted motion at the rate of the controller."""

    name: str
    poses: F
    """(N, 6) wanted."""
    twists: F
    """(N, 6) their rates, rotation in base axes."""
    accelerations: F
    """(N, 6) rates of the twists."""
    holds: tuple[tuple[int, int], ...] = ()
    """Steps (begin, end) over which a settled error is taken."""
    push: Callable[[float], F | None] = lambda time_s: None
    """Wrench (6,) on the head that the controller does not know, over time."""
    pauses: tuple[tuple[int, float, float], ...] = ()
    """(step, length in s, temperature afterwards in degC): time that is passed at rest."""


class Motions:
    """Makes the motions for a neck; poses between are held poses as well.

    Raises
    ------
    InputError
        For a pose that four tendons cannot hold.
    """

    def __init__(self, neck: TrueNeck, settings: HeadSettings) -> None:
        self._neck, self._settings, self._dt = neck, settings, settings.control.dt_s
        self.upright = self._held(np.zeros(3), None)
        """Where every motion begins."""

    def set_points(self, turned_rad: Sequence[Sequence[float]] = SET_POINTS_RAD) -> Motion:
        """From one set point to the next, with a rest at each."""
        legs = [(np.asarray(turn), _MOVE_S, _HOLD_S) for turn in turned_rad]
        return self._legs("set points", 0.4, legs)

    def nod(self, rate_Hz: float, seconds: float, size_rad: float = 0.12) -> Motion:
        """Nodding at a rate, beginning softly."""
        time = np.arange(round(seconds / self._dt)) * self._dt
        swell = np.minimum(1.0, time * rate_Hz) ** 2
        way = self._way(np.array([0.0, -size_rad, 0.0]), np.array([0.0, size_rad, 0.0]))
        poses = way(0.5 + 0.5 * swell * np.sin(2.0 * np.pi * rate_Hz * time))
        return self._motion(f"nod {rate_Hz:g} Hz", poses)

    def saccade(self) -> Motion:
        """A fast turn about the neck by 0.15 rad in 0.2 s."""
        return self._legs("saccade", 0.3, [(np.array([0.15, 0.0, 0.0]), 0.2, 0.9)])

    def pushed(self) -> Motion:
        """At rest; 20 N from the side at the middle of the head for 50 ms."""
        wrench = np.array([0.0, 0.0, 20.0, 0.0, -20.0 * 0.08, 0.0])
        push = lambda time_s: wrench if 0.3 <= time_s < 0.35 else None  # noqa: E731
        return self._legs("push", 1.6, [], push=push)

    def payload(self, mass_kg: float = 0.2) -> Motion:
        """At rest; the weight of a payload on the forehead from 0.3 s on."""
        weight = mass_kg * np.asarray(self._settings.gravity_m_s2)
        wrench = np.concatenate([weight, np.cross([0.12, 0.07, 0.0], weight)])
        push = lambda time_s: wrench if time_s >= 0.3 else None  # noqa: E731
        return self._legs("payload", 1.6, [], push=push)

    def warming(self, degC: float = 10.0, times: int = 5) -> Motion:
        """An hour: a turn and back some times, at rest for the rest of the hour between them.

        The rests are passed in one step, in plant and controller: their answer to it is exact.
        """
        turn = (np.array([0.0, 0.12, 0.1]), 0.5, 0.7)
        cycle, first = round((0.5 + 0.7 + 0.5) / self._dt), round(0.3 / self._dt)
        part = 1.0 / (times - 1)
        pauses = tuple(
            (first + i * cycle, 3600.0 * part, 22.0 + degC * i * part) for i in range(1, times)
        )
        legs = [turn, (np.zeros(3), 0.5, 0.0)] * times
        return self._legs("hour of warming", 0.3, legs, pauses=pauses)

    def all(self) -> tuple[Motion, ...]:
        """Every motion, the set points first."""
        return (
            self.set_points(), self.nod(0.5, 4.0), self.nod(1.5, 2.0), self.saccade(),
            self.pushed(), self.payload(), self.warming(),
        )  # fmt: skip

    def _held(self, turned_rad: F, start: HeldPose | None) -> HeldPose:
        found = held_pose(self._neck, self._settings, turned_rad, start)
        if not found.held:
            forces = ", ".join(f"{force:.0f}" for force in found.forces_N)
            raise InputError(
                f"the head cannot be held turned by {np.round(turned_rad, 3).tolist()} rad: forces "
                f"of {forces} N, expected {self._settings.tendons.least_N:g} to "
                f"{self._settings.tendons.most_N:g}; turn it less"
            )
        return found

    def _way(self, begin: F, end: F) -> CubicSpline:
        """Held poses along the straight line from one rotation vector to another, 0 to 1."""
        nodes = np.linspace(0.0, 1.0, _NODES)
        poses, at = [], self.upright
        for share in nodes:
            at = self._held((1.0 - share) * begin + share * end, at)
            poses.append(at.pose)
        return CubicSpline(nodes, np.stack(poses))

    def _legs(
        self, name: str, wait_s: float, legs: Sequence[tuple[F, float, float]],
        push: Callable[[float], F | None] = lambda time_s: None,
        pauses: tuple[tuple[int, float, float], ...] = (),
    ) -> Motion:  # fmt: skip
        """Wait upright, then go legs (end, time of way, time of rest); each rest is a hold."""
        measured, before = round(_MEASURED_S / self._dt), np.zeros(3)
        poses = np.tile(self.upright.pose, (round(wait_s / self._dt), 1))
        holds = [] if legs else [(len(poses) - measured, len(poses))]
        for end, move_s, hold_s in legs:
            u = (np.arange(round(move_s / self._dt)) + 1.0) / round(move_s / self._dt)
            way = self._way(before, end)(10 * u**3 - 15 * u**4 + 6 * u**5)
            rest = np.tile(way[-1], (round(hold_s / self._dt), 1))
            poses, before = np.concatenate([poses, way, rest]), end
            if len(rest):
                holds.append((len(poses) - measured, len(poses)))
        return self._motion(name, poses, tuple(holds), push, pauses)

    def _motion(
        self, name: str, poses: F, holds: tuple[tuple[int, int], ...] = (),
        push: Callable[[float], F | None] = lambda time_s: None,
        pauses: tuple[tuple[int, float, float], ...] = (),
    ) -> Motion:  # fmt: skip
        turns = Rotation.from_rotvec(poses[:, 3:])
        steps = (turns[1:] * turns[:-1].inv()).as_rotvec()  # small: also mean rates, times dt
        between = np.concatenate([steps[:1], 0.5 * (steps[1:] + steps[:-1]), steps[-1:]])
        rates = np.gradient(poses[:, :3], self._dt, axis=0)
        twists = np.hstack([rates, between / self._dt])
        accelerations = np.gradient(twists, self._dt, axis=0)
        return Motion(name, poses, twists, accelerations, holds, push, pauses)
