"""Pictures of a campaign: the film of its first poses, and Fig. 7 of one of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ecm.errors import InputError
from ecm.rig.elastic import Progress, Source
from ecm.rig.run import fem_source
from ecm.rig.settings import RigSettings
from ecm.robot.campaign import RobotCampaign
from ecm.stages import cache_directory

if TYPE_CHECKING:
    from ecm.table import Table

FILMED = 3
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
        Fig. 7 of the first pose, PNG, SVG or PDF.
    """
    need_robot(rig, ("--film", film), ("--phases", phases))
    kept = cache_directory() if folder is None else folder
    campaign = RobotCampaign(
        plan,
        rig,
        fem_source(plan, threads) if source is None else source,
        seed=seed,
        folder=kept,
        library_folder=kept,
        progress=progress,
    )
    stops = [tour.stops[0] for tour in campaign.tours[:FILMED]]
    said = []
    if phases is not None:
        from ecm.robot.figure import figure_7

        sortie = campaign.job.machine().sortie(stops[:1])
        figure_7(sortie, stops[0], campaign.plant.length_m, phases)
        said.append(f"{phases}: the phases of the first pose")
    if film is not None:
        from ecm.robot.film import film as write

        body = plan.meta.mechanism or {}
        radius = float(body.get("radius_m", _RADIUS_M))
        frames = write(campaign.job, stops, film, radius, progress)
        said.append(f"{film}: {len(stops)} poses, {frames} frames")
    return said
