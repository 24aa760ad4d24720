"""The true neck: an energy fitted to FEM poses, with the physics that the controller does not know.

The hidden physics are the true effects of the simulated rig, so that a campaign measures the very
neck that carries the head. Here they go on step by step: the chains of the relaxation by their
exact answer to a step, friction along the way between two steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path

import numpy as np

import ecm
from ecm._native import EnergyEvaluator  # ecm.EnergyModel ends at degree 6
from ecm.models import EnergyMap, Model
from ecm.rig import Hidden, SolvedPoses
from ecm.rig.physics.material import Hysteresis, Relaxation, Temperature
from ecm.rig.physics.true_effect import Conditions
from robot import F, rotation

TrueEffect = Relaxation | Hysteresis | Temperature
USUAL: tuple[TrueEffect, ...] = (Relaxation(0.10), Hysteresis(1.5e-4), Temperature(-0.006))
"""10 % of the stress relax, friction holds 0.15 mm, and the modulus falls by 0.6 % per kelvin:
assumed sizes of a filled silicone."""
HIDDEN: dict[str, TrueEffect] = {
    effect.effect: effect for effect in (Temperature(-0.015), Relaxation(0.25), Hysteresis(4e-4))
}
"""What can be hidden in the neck, large enough to be seen by eye."""
_DEGREE, _FEM_POSES = 8, 420
_SPREAD = np.array([0.006, 0.012, 0.012, 0.4, 0.45, 0.45])
"""Half of the box of FEM poses; x is mostly pressed."""


@dataclass(frozen=True)
class TrueNeck:
    """Energy and hidden effects of the true neck: also the plant that `ecm.campaign` measures."""

    elastic: EnergyMap
    effects: tuple[TrueEffect, ...] = ()
    mechanism: ecm.Mechanism = field(default_factory=ecm.Mechanism)
    """The body that the description of a campaign names."""

    @property
    def length_m(self) -> float:
        """Undeformed length."""
        return self.elastic.model.length_m

    @property
    def rest(self) -> F:
        """(6,) undeformed pose."""
        return np.array([self.length_m, 0.0, 0.0, 0.0, 0.0, 0.0])

    def statics(self, pose: F) -> tuple[F, F]:
        """Elastic wrench (6,) and stiffness (6, 6) at a pose (6,)."""
        wrench, stiffness = self.elastic.wrench_and_stiffness(pose[None])
        return wrench[0], stiffness[0]

    def key(self) -> str:
        """Names the energy, for the rig's cache (see `ecm.rig.Source`)."""
        return f"true-neck-{sha256(self.elastic.coefficients.tobytes()).hexdigest()}"

    def solve(self, poses: F, grade: str, progress: object = None) -> SolvedPoses:
        """Wrenches and stiffness at poses (N, 6), as the rig asks a solver for them."""
        wrenches, stiffness = self.elastic.wrench_and_stiffness(poses)
        return SolvedPoses(poses, wrenches, stiffness, ("solved",) * len(poses))

    def surrogate(self, solved: SolvedPoses) -> EnergyMap:
        """The energy itself, between the solved poses."""
        return self.elastic

    def hidden(self) -> tuple[Hidden, ...]:
        """The effects with their sizes, to be hidden in a campaign."""
        return tuple(
            Hidden(effect.effect, 1.0, tuple(sorted(asdict(effect).items())))
            for effect in self.effects
        )


class NeckMemory:
    """Wrench beyond the elastic one along a motion that begins after a long rest."""

    def __init__(self, neck: TrueNeck) -> None:
        self._length = neck.length_m
        self._relaxation: Relaxation | None = None
        self._friction: Hysteresis | None = None
        self._temperature: Callable[[Conditions], F] | None = None
        for effect in neck.effects:
            if isinstance(effect, Temperature):
                self._temperature = effect.factor
            elif isinstance(effect, Relaxation):
                self._relaxation = effect
            else:
                self._friction = effect
                stiffness = neck.elastic.stiffness(neck.rest[None])[0]
                self._held = effect.wrench(np.eye(6), stiffness, neck.length_m).T
        self._before: tuple[F, F] | None = None
        self._chains: F = np.zeros((3, 6))
        self._slip: F = np.zeros(6)
        self._factor = 1.0

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
        before = self._before or (pose, section)
        moved, loaded = pose - before[0], section - before[1]
        self._before = pose.copy(), section.copy()
        added: F = (self._factor - 1.0) * elastic
        if self._relaxation is not None:
            times = np.asarray(self._relaxation.times_s)[:, None]
            share = self._relaxation.size * np.asarray(self._relaxation.shares)[:, None]
            gain = share * times / dt * -np.expm1(-dt / times)
            self._chains = np.exp(-dt / times) * self._chains + gain * loaded
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
    axes = rotation(0.5 * pose[3:])
    found = np.zeros((6, 6))
    found[:3, :3] = found[3:, 3:] = axes
    x, y, z = -0.5 * pose[:3]  # moments about the top are smaller by lever x force
    found[3:, :3] = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ axes
    return found


def fem_neck(
    file: Path,
    effects: tuple[TrueEffect, ...] = USUAL,
    progress: Callable[[int, int], object] | None = None,
) -> TrueNeck:
    """Return the neck of the paper: an energy of degree 8 fitted to 420 FEM poses.

    Parameters
    ----------
    file
        Model file of the energy; where there is none it is solved, for half a minute, and written.
    effects
        What is hidden in the neck.
    progress
        Called with the FEM poses that are done, and all.
    """
    if not file.exists():
        mechanism = ecm.Mechanism()
        offsets = np.random.default_rng(3).uniform(-1.0, 1.0, (_FEM_POSES, 6)) * _SPREAD
        offsets[:, 0] += mechanism.length_m - 0.75 * _SPREAD[0]
        solved = mechanism.fem().solve_poses(offsets, progress=progress)
        good = np.asarray(solved.status) == "solved"
        energy = EnergyEvaluator.fit(
            offsets[good], solved.wrenches[good],
            length_m=mechanism.length_m, degree=_DEGREE, symmetry="revolution",
        )  # fmt: skip
        Model(EnergyMap(energy)).save(file)
    elastic = ecm.load_model(file).base
    assert isinstance(elastic, EnergyMap)
    return TrueNeck(elastic, effects)
