"""The first pose of a campaign that the arm reaches, from home and back: the paper's Fig. 7."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.cache import cache_directory
from ecm.rig.arm.campaign import RobotCampaign
from ecm.rig.arm.run import require_arm
from ecm.rig.arm.sorties import SortieResult, Stop, full_trace
from ecm.rig.elastic import Progress, Source
from ecm.rig.plan import rest_pose
from ecm.rig.run import fem_source
from ecm.rig.settings import RigSettings

if TYPE_CHECKING:
    from ecm.io.table import Table


_TRIED = 10
"""Poses that are driven, each for about a second, until one is reached."""


@dataclass(frozen=True)
class PictureSource:
    """What is driven: a plan, a rig, and how to solve the mechanism."""

    plan: Table
    rig: RigSettings
    seed: int = 0
    threads: int = 0
    source: Source | None = None
    """Solves the mechanism; None: FEM of the plan's `[mechanism]`."""
    folder: Path | None = None
    """Folder of the solved poses and the compiled controller; None: the user's cache."""

    def campaign(self, progress: Progress = None) -> RobotCampaign:
        """Return the campaign, not carried out."""
        folder = cache_directory() if self.folder is None else self.folder
        require_arm(folder)
        return RobotCampaign(
            self.plan,
            self.rig,
            fem_source(self.plan, self.threads) if self.source is None else self.source,
            seed=self.seed,
            folder=folder,
            progress=progress,
        )


def first_pose_trace(pictures: PictureSource) -> tuple[dict[str, F], list[list[Any]], str]:
    """Return the data of Fig. 7: the first pose of a plan that is reached, from home and back.

    If none of the first ten poses is reached, it is the very first, as far as the arm came.

    Returns
    -------
    arrays
        `time_s` (n,), `way` (n, 6) and `goal` (6,) minus the rest pose, m and rad.
    phases
        Name, begin and end in s.
    reason
        Why the pose was not reached; empty if it was.
    """
    campaign = pictures.campaign()
    sortie, stop = first_reached(campaign)
    time_s, trace = full_trace(sortie)
    rest = rest_pose(campaign.plant.length_m)
    phases = [[*phase] for phase in (*sortie.stops[0].phases, *sortie.home.phases)]
    finite = np.isfinite(trace).all(axis=1)  # until it diverged, if it did
    arrays = {"time_s": time_s[finite], "way": trace[finite] - rest, "goal": stop.goal - rest}
    return arrays, phases, sortie.stops[0].reason


def first_reached(campaign: RobotCampaign) -> tuple[SortieResult, Stop]:
    """Drive the first poses; return the first that is reached, or else the first."""
    arm = campaign.setup.build()
    first: tuple[SortieResult, Stop] | None = None
    for planned in campaign.sorties[:_TRIED]:
        stop = planned.stops[0]
        sortie = arm.sortie([stop])
        if not sortie.stops[0].reason:
            return sortie, stop
        first = first or (sortie, stop)
    if first is None:
        raise InputError("the plan has no pose that the arm could show")
    return first
