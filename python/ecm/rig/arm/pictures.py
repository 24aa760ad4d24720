"""Pictures of a campaign: the film of its first poses, and the paper's Fig. 7 of one of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.cache import cache_directory
from ecm.io.extras import require
from ecm.rig.arm.campaign import RobotCampaign
from ecm.rig.arm.film import write_film
from ecm.rig.arm.plot_style import COLOURS, PANELS
from ecm.rig.arm.run import require_arm
from ecm.rig.arm.sorties import SortieResult, Stop, full_trace
from ecm.rig.elastic import Progress, Source
from ecm.rig.plan import rest_pose
from ecm.rig.run import fem_source
from ecm.rig.settings import RigSettings

if TYPE_CHECKING:
    from ecm.io.table import Table


_FILMED = 3
_TRIED = 10
"""Poses that are driven, each for about a second, until one is reached."""
_RADIUS_M = 0.033
"""Drawn if the plan's mechanism names no radius."""


@dataclass(frozen=True)
class PictureSource:
    """What the pictures are made of: a plan, a rig, and how to solve the mechanism."""

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


def require_robot(rig: RigSettings, *options: tuple[str, Path | None]) -> None:
    """Raise InputError if a picture is requested without the arm, or with a wrong suffix."""
    for name, path in options:
        if path is None:
            continue
        if rig.rig.mode != "robot":
            raise InputError(f'{name} shows the arm; set [rig] mode = "robot" in the rig file')
        suffixes = (".gif",) if name == "--film" else (".png", ".svg", ".pdf")
        if path.suffix not in suffixes:
            raise InputError(f"{name} {path}: expected a file ending in {' or '.join(suffixes)}")


def write_pictures(
    pictures: PictureSource,
    *,
    film: Path | None = None,
    phases: Path | None = None,
    progress: Progress = None,
) -> list[str]:
    """Write the requested pictures; return a line about each.

    Parameters
    ----------
    pictures
        Plan and rig.
    film
        GIF of the first poses at four times their speed.
    phases
        Fig. 7 of the first pose that is reached, PNG, SVG or PDF.
    progress
        Called while poses are solved and filmed.
    """
    require_robot(pictures.rig, ("--film", film), ("--phases", phases))
    campaign = pictures.campaign(progress)
    lines = []
    if phases is not None:
        sortie, stop = _first_reached(campaign)
        draw_phases(sortie, stop, campaign.plant.length_m, phases)
        reason = sortie.stops[0].reason
        lines.append(
            f"{phases}: the phases of the first pose that the arm reaches"
            if not reason
            else f"{phases}: the phases of the first pose, which the arm does not reach: {reason}"
        )
    if film is not None:
        radius = float((pictures.plan.meta.mechanism or {}).get("radius_m", _RADIUS_M))
        stops = [sortie.stops[0] for sortie in campaign.sorties[:_FILMED]]
        frames = write_film(campaign.setup, stops, film, radius, progress)
        lines.append(f"{film}: {len(stops)} poses, {frames} frames")
    return lines


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
    sortie, stop = _first_reached(campaign)
    time_s, trace = full_trace(sortie)
    rest = rest_pose(campaign.plant.length_m)
    phases = [[*phase] for phase in (*sortie.stops[0].phases, *sortie.home.phases)]
    finite = np.isfinite(trace).all(axis=1)  # until it diverged, if it did
    arrays = {"time_s": time_s[finite], "way": trace[finite] - rest, "goal": stop.goal - rest}
    return arrays, phases, sortie.stops[0].reason


def _first_reached(campaign: RobotCampaign) -> tuple[SortieResult, Stop]:
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


def draw_phases(sortie: SortieResult, stop: Stop, length_m: float, path: Path) -> None:
    """Draw Fig. 7 of a sortie with one stop: each component of the pose, with the phases."""
    figure = require("matplotlib.figure", "report", "--phases").Figure(
        figsize=(9.0, 6.0), layout="constrained"
    )
    result = sortie.stops[0]
    time_s, trace = full_trace(sortie)
    rest = rest_pose(length_m)
    axes: Any = figure.subplots(2, 3, sharex=True)
    for j, axis in enumerate(axes.ravel()):
        for name, begin, end in (*result.phases, *sortie.home.phases):
            axis.axvspan(begin, end, color=COLOURS[name], lw=0, label=name if j == 0 else None)
        axis.plot(time_s, 1e3 * (trace[:, j] - rest[j]), color="#204a87", lw=1.5)
        axis.axhline(1e3 * (stop.goal[j] - rest[j]), color="#a40000", lw=1.0, ls="--")
        axis.set_title(PANELS[j], fontsize=10)
        axis.margins(x=0)
    for axis in axes[1]:
        axis.set_xlabel("time [s]")
    status = f"skipped: {result.reason}" if result.reason else "reached"
    figure.suptitle(f"One pose of the procedure ({status}); dashed: goal", fontsize=11)
    figure.legend(loc="outside lower center", ncols=len(COLOURS), fontsize=9, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Without a date the same picture gives the same bytes.
    figure.savefig(path, dpi=110, metadata={"Date": None} if path.suffix == ".svg" else {})
