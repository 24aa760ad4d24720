"""`ecm campaign` with the arm: visits into the journal one by one, then table and record.

`NAME.robot.json` beside the table holds, pose by pose, goal, pose after the impedance phase and
after the position phase as the arm's own encoders give them, times of the phases, and reasons.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecm.io.cache import write_json
from ecm.rig.arm.campaign import RobotCampaign
from ecm.rig.arm.feed_forward import need_library
from ecm.rig.arm.record import HEADER, Line
from ecm.rig.arm.scene import mujoco
from ecm.rig.arm.summary import document
from ecm.rig.elastic import Progress, Source
from ecm.rig.hidden.spec import Hidden
from ecm.rig.journal import Journal
from ecm.rig.settings import RigSettings

if TYPE_CHECKING:
    from ecm.io.table import Table

MOST_PROCESSES = 8


def robot_path(data: Path) -> Path:
    """Where the record of the arm lies beside a table."""
    return data.with_suffix(".robot.json")


def need_arm(folder: Path) -> None:
    """MissingExtra or ComputationError now, not after the work, where the arm cannot be driven.

    Parameters
    ----------
    folder
        Where compiled controllers are kept; with one there a C compiler is not asked for.
    """
    mujoco()
    need_library(folder)


def run_robot(
    plan: Table,
    rig: RigSettings,
    out: Path | None,
    *,
    hide: Sequence[Hidden],
    seed: int,
    progress: Progress,
    resume: bool,
    source: Source,
    folder: Path,
    threads: int = 0,
) -> tuple[RobotCampaign, Table, Journal | None]:
    """All visits, read and in a table; the journal, where there is one, is still there."""
    need_arm(folder)
    campaign = RobotCampaign(
        plan,
        rig,
        source,
        hide=hide,
        seed=seed,
        folder=folder,
        library_folder=folder,
        progress=progress,
    )
    processes = _processes(rig, threads)
    total = len(campaign.planned.visits)
    if out is None:
        for line in campaign.lines((), processes):
            _tell(progress, line, total)
        return campaign, campaign.finished(), None
    path = out.with_name(out.stem + ".journal.csv")
    journal = Journal(path, campaign.key(source), HEADER, resume=resume)
    done = [Line.parse(text, str(path)) for text in journal.lines]
    while done and done[-1].fault:  # the readings that stopped the campaign are taken again
        done.pop()
    del journal.lines[len(done) :]
    with journal:
        for line in campaign.lines(done, processes):
            journal.append(line.text())
            _tell(progress, line, total)
    return campaign, campaign.finished(), journal


def write_record(campaign: RobotCampaign, out: Path) -> dict[str, Any]:
    """The record of the arm beside the table."""
    record = document(campaign)
    write_json(robot_path(out), record)
    return record


def _tell(progress: Progress, line: Line, total: int) -> None:
    if progress is not None:
        progress(line.visit + 1, total, "measuring")


def _processes(rig: RigSettings, threads: int) -> int:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    wanted = rig.arm.processes or threads or min(cores or 1, MOST_PROCESSES)
    return max(1, wanted)
