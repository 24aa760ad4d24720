"""The loop through the loop: the head misses, a campaign names why, and the head hits.

A neck hides an effect. A model without it is identified and exported; in an hour in which the neck
warms the head misses its set points. A campaign on the same neck is compared and diagnosed, what is
named is added and fitted, the model is exported again, and the head carries out the same motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import ecm
from ecm.designs import plain_plan
from ecm.effects import with_shape
from ecm.rig import CampaignOptions, PlantTable
from experiment import Record, Robot
from motions import Motion, Motions
from neck import TrueNeck
from robot import F, HeadSettings

_RIG = ecm.RigSettings(plant=PlantTable(room_cycle_degC=4.0))
"""A room whose heating is felt, so that a campaign can see what temperature does."""
_MIDDLE_M = 0.006
"""How far the tendons and the head press the neck at the middle of its workspace."""
_WORKSPACE = np.array([0.0035, 0.007, 0.007, 0.22, 0.26, 0.26])
"""Half of the box of poses that are worth measuring."""
DWELLS_S = (0.5, 2.0, 8.0, 30.0, 120.0)
"""Rests before a reading where effects of time are looked for. After 30 s a slow chain carries
so much that it would be taken for static stiffness."""
SLOW_AND_FAST = with_shape("stress_relaxation", {"tau_s": 1.0, "second_tau_s": 30.0})
"""The form of relaxation that is fitted: a head moves within a second and rests for minutes, which
one time constant cannot follow."""
_POSE = ("x_m", "y_m", "z_m", "theta_x_rad", "theta_y_rad", "theta_z_rad")


@dataclass(frozen=True)
class HeadLoop:
    """The head before and after the effect was found."""

    table: ecm.Table
    """The campaign."""
    before: ecm.Model
    after: ecm.Model
    named: tuple[str, ...]
    """Effects that the diagnosis names."""
    missed: Record
    hit: Record

    def lines(self) -> list[str]:
        """A few plain lines with the errors before and after."""
        return [
            _line("before", self.before, self.missed),
            f"named: {', '.join(self.named) or 'nothing'}",
            _line("after", self.after, self.hit),
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "named": list(self.named),
            "before": {"model": self.before.name, **self.missed.figures()},
            "after": {"model": self.after.name, **self.hit.figures()},
        }


def run_loop(
    neck: TrueNeck, folder: Path, settings: HeadSettings | None = None, *, seed: int = 0,
    model: str = "energy6", poses: int = 50, motion: Motion | None = None,
    say: Callable[[str], object] = lambda text: None,
) -> HeadLoop:  # fmt: skip
    """Miss, measure, diagnose, refit, export, hit.

    Parameters
    ----------
    neck
        The true neck, with what it hides.
    folder
        Where the compiled controllers are kept.
    settings
        The robot; default `without_integral` of its numbers.
    seed
        Of campaign and instruments.
    model
        Short name of the model that is fitted.
    poses
        Poses of the campaign; each is visited twice.
    motion
        What the head is asked for; default an hour of warming.
    say
        Told what is being done.
    """
    settings = without_integral(settings or HeadSettings())
    motion = motion or Motions(neck, settings).warming()

    def moved(found: ecm.Model) -> Record:
        return Robot.with_model(settings, neck, found, folder).run(motion, seed)

    say("campaign on the neck")
    table = campaign(neck, poses, model, seed, diagnosable=True)
    before = ecm.fit(table, model)
    say("the head with the model that lacks the effect")
    missed = moved(before)
    say("diagnosis")
    answer = ecm.diagnose(before, table, seed=seed).to_dict()["answer"]
    named = tuple(members[0] for members in answer)
    after = with_effects(before, named, table)
    say("the head with the model that has it")
    return HeadLoop(table, before, after, named, missed, moved(after))


def without_integral(settings: HeadSettings) -> HeadSettings:
    """The robot without integral: it would take away at rest what the model misses, and hide it."""
    return replace(settings, control=replace(settings.control, integral_per_s=0.0))


def campaign(
    neck: TrueNeck, poses: int, model: str, seed: int, *, diagnosable: bool = False,
    share: float = 1.0,
) -> ecm.Table:  # fmt: skip
    """Measure the true neck on the simulated rig; all that is hidden in it acts there as well.

    Parameters
    ----------
    neck
        The true neck.
    poses
        Poses of the campaign, an optimal design of the workspace.
    model
        Short name of the model that the design is for.
    seed
        Of design and instruments.
    diagnosable
        Each pose twice, from two sides, with several dwells; else once.
    share
        Size of the campaign's box over that of the workspace.
    """
    candidates = workspace_poses(neck, max(600, 3 * poses), [seed, 5], share)
    meta = {"mechanism": neck.mechanism.to_dict()}
    table = ecm.as_table(dict(zip(_POSE, candidates.T, strict=True)), meta=meta)
    design = ecm.DesignSettings(
        model=model, length_m=neck.length_m, seed=seed, starts=1, iterations=4
    )
    try:
        chosen = ecm.optimal_design(candidates, poses, design)
    except ecm.InputError:  # too few poses for the terms of this model
        chosen = ecm.optimal_design(candidates, poses, replace(design, model="energy4"))
    plan = (
        ecm.diagnosable_plan(table, chosen, seed=seed, dwells_s=DWELLS_S)
        if diagnosable
        else plain_plan(table, chosen, seed=seed)
    )
    options = CampaignOptions(source=neck, threads=1)
    return ecm.run_campaign(plan, _RIG, hide=neck.hidden(), seed=seed, options=options)


def workspace_poses(neck: TrueNeck, n: int, seed: int | Sequence[int], share: float = 1.0) -> F:
    """(n, 6) random poses about the middle of the workspace."""
    middle = neck.rest - [share * _MIDDLE_M, 0.0, 0.0, 0.0, 0.0, 0.0]
    away = np.random.default_rng(seed).uniform(-1.0, 1.0, (n, 6))
    return np.asarray(middle + share * _WORKSPACE * away)


def with_effects(model: ecm.Model, effects: Sequence[str], table: ecm.Table) -> ecm.Model:
    """The model fitted again with effects (ids)."""
    for effect in effects:
        model = model.add(SLOW_AND_FAST if effect == SLOW_AND_FAST.id else effect)
    return model.fit(table) if effects else model


def _line(when: str, model: ecm.Model, record: Record) -> str:
    found = record.figures()
    error = f"{found['settled_mm']:.2f} mm and {found['settled_deg']:.2f} degrees off"
    return f"{when}: {model.name} settles {error}"
