"""Pictures of a campaign: the film of its first poses, and Fig. 7 of one of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.cache import cache_directory
from ecm.rig.arm.campaign import RobotCampaign
from ecm.rig.arm.procedure import Sortie, Stop, whole_way
from ecm.rig.arm.run import need_arm
from ecm.rig.elastic import Progress, Source
from ecm.rig.run import fem_source
from ecm.rig.settings import RigSettings

if TYPE_CHECKING:
    from ecm.io.table import Table


FILMED = 3
_TRIED = 10
"""Poses that are driven, each for about a second, in search of one that is reached."""
_RADIUS_M = 0.033
"""Drawn where the plan's mechanism names no radius."""


def need_robot(rig: RigSettings, *options: tuple[str, Path | None]) -> None:
    """InputError where a picture is asked for that only the arm has, or has another suffix."""
    for name, path in options:
        if path is None:
            continue
        if rig.rig.mode != "robot":
            raise InputError(f'{name} shows the arm; set [rig] mode = "robot" in the rig file')
        known = (".gif",) if name == "--film" else (".png", ".svg", ".pdf")
        if path.suffix not in known:
            raise InputError(f"{name} {path}: expected a file ending in {' or '.join(known)}")


def show(
    plan: Table,
    rig: RigSettings,
    *,
    film: Path | None = None,
    phases: Path | None = None,
    seed: int = 0,
    threads: int = 0,
    progress: Progress = None,
    source: Source | None = None,
    folder: Path | None = None,
) -> list[str]:
    """Writes the pictures; returns a line about each.

    Parameters
    ----------
    film
        GIF of the first poses at four times their speed.
    phases
        Fig. 7 of the first pose that is reached, PNG, SVG or PDF.
    """
    need_robot(rig, ("--film", film), ("--phases", phases))
    campaign = _campaign(
        plan, rig, seed=seed, threads=threads, progress=progress, source=source, folder=folder
    )
    said = []
    if phases is not None:
        from ecm.rig.arm.figure import figure_7

        sortie, stop = _first_reached(campaign)
        figure_7(sortie, stop, campaign.plant.length_m, phases)
        reason = sortie.outcomes[0].reason
        said.append(
            f"{phases}: the phases of the first pose that the arm reaches"
            if not reason
            else f"{phases}: the phases of the first pose, which the arm does not reach: {reason}"
        )
    if film is not None:
        from ecm.rig.arm.film import film as write

        body = plan.meta.mechanism or {}
        radius = float(body.get("radius_m", _RADIUS_M))
        stops = [tour.stops[0] for tour in campaign.tours[:FILMED]]
        frames = write(campaign.job, stops, film, radius, progress)
        said.append(f"{film}: {len(stops)} poses, {frames} frames")
    return said


def pose_on_its_way(
    plan: Table,
    rig: RigSettings,
    *,
    seed: int = 0,
    threads: int = 0,
    source: Source | None = None,
    folder: Path | None = None,
) -> tuple[dict[str, F], list[list[Any]], str]:
    """Fig. 7 in numbers: the first pose of a plan that is reached, from home and back.

    Where none of the first poses is reached it is the very first, as far as the arm came.

    Returns
    -------
    arrays
        `time_s` (n,), `way` (n, 6) and `goal` (6,) less the rest pose, m and rad.
    phases
        Name, begin and end in s.
    reason
        Why the pose was not reached; empty where it was.
    """
    campaign = _campaign(
        plan, rig, seed=seed, threads=threads, progress=None, source=source, folder=folder
    )
    sortie, stop = _first_reached(campaign)
    time_s, way = whole_way(sortie)
    rest = np.array([campaign.plant.length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
    phases = [[*phase] for phase in (*sortie.outcomes[0].phases, *sortie.home.phases)]
    known = np.isfinite(way).all(axis=1)  # until it diverged, where it did
    arrays = {"time_s": time_s[known], "way": way[known] - rest, "goal": stop.goal - rest}
    return arrays, phases, sortie.outcomes[0].reason


def _first_reached(campaign: RobotCampaign) -> tuple[Sortie, Stop]:
    """The first pose that is reached; where none of the first `_TRIED` is, the first."""
    machine = campaign.job.machine()
    first: tuple[Sortie, Stop] | None = None
    for tour in campaign.tours[:_TRIED]:
        stop = tour.stops[0]
        sortie = machine.sortie([stop])
        if not sortie.outcomes[0].reason:
            return sortie, stop
        first = first or (sortie, stop)
    if first is None:
        raise InputError("the plan has no pose that the arm could show")
    return first


def _campaign(
    plan: Table,
    rig: RigSettings,
    *,
    seed: int,
    threads: int,
    progress: Progress,
    source: Source | None,
    folder: Path | None,
) -> RobotCampaign:
    kept = cache_directory() if folder is None else folder
    need_arm(kept)
    return RobotCampaign(
        plan,
        rig,
        fem_source(plan, threads) if source is None else source,
        seed=seed,
        folder=kept,
        library_folder=kept,
        progress=progress,
    )
