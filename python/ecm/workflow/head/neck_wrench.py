"""The true neck: an energy fitted to FEM poses, with the physics that the controller does not know.

Its hidden physics are the true effects of the simulated rig (`ecm.rig.physics.material`), so that a
campaign measures the very neck that carries the head. Here they go on step by step: the chains of
the relaxation by their exact answer to a step, friction along the way between two steps.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ecm._native import EnergyModel
from ecm.io.arrays import F
from ecm.io.mechanism import Mechanism
from ecm.rig import Hidden
from ecm.rig.elastic import UNIFORM, Anchors, Progress, Smooth, solve_cached
from ecm.rig.fem_source import FemSource
from ecm.rig.frames import rotation
from ecm.rig.physics.material import Hysteresis, Relaxation, Temperature
from ecm.rig.physics.true_effect import Conditions

RELAXATION = Relaxation(0.10)
HYSTERESIS = Hysteresis(1.5e-4)
TEMPERATURE = Temperature(-0.006)
"""What is hidden in the neck unless the caller says otherwise: 10 % of the stress relax, friction
holds 0.15 mm, and the modulus falls by 0.6 % per kelvin. Assumed sizes of a filled silicone."""

_DEGREE = 8
_FEM_POSES = 420
_SPREAD = np.array([0.006, 0.012, 0.012, 0.4, 0.45, 0.45])
"""Half of the box of FEM poses; x is mostly pressed."""


@dataclass(frozen=True)
class TrueNeck:
    """Energy and hidden effects of the true neck; also a source of anchors for the rig.

    Examples
    --------
    >>> random = np.random.default_rng(0)
    >>> poses = np.array([0.1, 0, 0, 0, 0, 0]) + 0.01 * random.normal(size=(60, 6))
    >>> wrenches = (poses - [0.1, 0, 0, 0, 0, 0]) * [2e4, 3e3, 3e3, 4.0, 9.0, 9.0]
    >>> energy = EnergyModel.fit(poses, wrenches, length_m=0.1, degree=4)
    >>> neck = TrueNeck(energy, (Temperature(-0.01),))
    >>> [hidden.effect for hidden in neck.hidden()]
    ['temperature_modulus']
    """

    energy: EnergyModel
    effects: tuple[Relaxation | Hysteresis | Temperature, ...] = ()

    @property
    def length_m(self) -> float:
        """Undeformed length."""
        return self.energy.length_m

    @property
    def rest(self) -> F:
        """(6,) undeformed pose."""
        return np.array([self.length_m, 0.0, 0.0, 0.0, 0.0, 0.0])

    def key(self) -> str:
        """Names the energy, for the rig's cache."""
        return f"true-neck-{hashlib.sha256(self.energy.coefficients.tobytes()).hexdigest()}"

    def solve(self, poses: F, grade: str, progress: Progress = None) -> Anchors:
        """Wrenches and stiffness at poses (N, 6), as the rig asks a solver for them."""
        wrenches, stiffness = self.energy.wrench_and_stiffness(poses)
        return Anchors(poses, wrenches, stiffness, ("solved",) * len(poses))

    def surrogate(self, anchors: Anchors) -> Smooth | None:
        """The energy itself, between the anchors."""
        return self.energy

    def hidden(self) -> tuple[Hidden, ...]:
        """The effects with their sizes, to be hidden in a campaign."""
        return tuple(
            Hidden(effect.effect, 1.0, tuple(sorted(asdict(effect).items())))
            for effect in self.effects
        )

    def memory(self) -> NeckMemory:
        """Return the hidden effects as they go on in time, after a long rest."""
        return NeckMemory(self)


class NeckMemory:
    """Wrench beyond the elastic one along a motion; `step` is called at even intervals."""

    def __init__(self, neck: TrueNeck) -> None:
        self._temperature: Callable[[Conditions], F] | None = None
        self._relaxation: Relaxation | None = None
        self._friction: Hysteresis | None = None
        for effect in neck.effects:
            if isinstance(effect, Temperature):
                self._temperature = effect.factor
            elif isinstance(effect, Relaxation):
                self._relaxation = effect
            else:
                self._friction = effect
        self._length = neck.length_m
        stiffness = neck.energy.stiffness(neck.rest[None])[0]
        self._held = np.zeros((6, 6))  # wrench of friction per state
        if self._friction is not None:
            self._held = self._friction.wrench(np.eye(6), stiffness, neck.length_m).T
        self._before: tuple[F, F] | None = None
        self._chains: F = np.zeros((3, 6))
        self._slip: F = np.zeros(6)
        self._factor = 1.0
        self._dt = 0.0

    def set_temperature(self, degC: float) -> None:
        """Set the temperature of the neck."""
        if self._temperature is not None:
            at = Conditions(self._length, temperature_degC=np.array([degC]))
            self._factor = float(self._temperature(at)[0])

    def step(self, pose: F, elastic: F, dt: float) -> F:
        """(6,) what is added to the elastic wrench (6,) at a pose, dt after the step before."""
        section = elastic
        if self._relaxation is not None:
            # Stress turns with the body: chains are loaded by the resultants of the middle section.
            to_top = _top_from_section(pose)
            section = np.asarray(np.linalg.solve(to_top, elastic), dtype=np.float64)
        if self._before is None:
            self._before = pose.copy(), section.copy()
        moved, loaded = pose - self._before[0], section - self._before[1]
        self._before = pose.copy(), section.copy()
        added: F = (self._factor - 1.0) * elastic
        if self._relaxation is not None:
            if dt != self._dt:
                times = np.asarray(self._relaxation.times_s)
                self._decay = np.exp(-dt / times)[:, None]
                share = self._relaxation.size * np.asarray(self._relaxation.shares)
                self._gain = (share * times / dt * -np.expm1(-dt / times))[:, None]
                self._dt = dt
            self._chains = self._decay * self._chains + self._gain * loaded
            added = added + self._factor * (to_top @ self._chains.sum(axis=0))
        if self._friction is not None:
            self._slip = self._friction.state_after(self._slip, moved, self._length)
            added = added + self._held @ self._slip
        return added

    def rest(self, seconds: float) -> None:
        """Let the chains relax without motion, also for hours."""
        if self._relaxation is not None:
            times = np.asarray(self._relaxation.times_s)
            self._chains = np.exp(-seconds / times)[:, None] * self._chains


def _top_from_section(pose: F) -> F:
    """(6, 6) from resultants of the middle section, in its axes, to the wrench at the top.

    The section is turned by half of the rotation and stands half way to the top.
    """
    axes = rotation(0.5 * pose[None, 3:])[0]
    x, y, z = 0.5 * pose[:3]
    found = np.zeros((6, 6))
    found[:3, :3] = found[3:, 3:] = axes
    found[3:, :3] = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]) @ axes
    return found


def fem_neck(
    mechanism: Mechanism | None = None,
    effects: tuple[Relaxation | Hysteresis | Temperature, ...] = (
        RELAXATION,
        HYSTERESIS,
        TEMPERATURE,
    ),
    *,
    folder: Path | None = None,
    progress: Progress = None,
) -> TrueNeck:
    """Return the neck of a mechanism: an energy of degree 8 fitted to FEM poses.

    Parameters
    ----------
    mechanism
        Body of the neck; default that of the paper.
    effects
        What is hidden in it.
    folder
        Cache of the FEM poses; without it they are solved each time.
    progress
        Called with (done, total, what).
    """
    source = FemSource(mechanism or Mechanism())
    random = np.random.default_rng(3)
    rest = np.array([source.length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
    offsets = random.uniform(-1.0, 1.0, (_FEM_POSES, 6)) * _SPREAD
    offsets[:, 0] -= 0.75 * _SPREAD[0]
    anchors = solve_cached(source, rest + offsets, UNIFORM, folder, progress)
    solved = np.asarray([status == "solved" for status in anchors.status])
    energy = EnergyModel.fit(
        anchors.poses[solved],
        anchors.wrenches[solved],
        length_m=source.length_m,
        degree=_DEGREE,
        symmetry="revolution",
    )
    return TrueNeck(energy, effects)
