"""`ecm campaign` with the arm: each visit goes into the journal, then table and record are written.

`NAME.robot.json` beside the table has for each pose: goal, pose after the impedance phase and after
the position phase by the arm's own encoders, times of the phases, and the reason if it was skipped.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ecm.io.cache import write_json
from ecm.io.parallel import own_cores
from ecm.rig.arm.campaign import RobotCampaign
from ecm.rig.arm.mechanism import require_library
from ecm.rig.arm.scene import mujoco
from ecm.rig.arm.sorties import HEADER, SortieStore, VisitRecord
from ecm.rig.arm.summary import campaign_record
from ecm.rig.elastic import Progress, Source
from ecm.rig.readings import Journal, journal_path

if TYPE_CHECKING:
    from ecm.io.table import Table

_MOST_PROCESSES = 8


def robot_path(data: Path) -> Path:
    """Return the path of the arm's record beside a table."""
    return data.with_suffix(".robot.json")


def require_arm(folder: Path) -> None:
    """Raise MissingExtra or ComputationError before the work if the arm cannot be simulated.

    If `folder` has a compiled controller, no C compiler is needed.
    """
    mujoco()
    require_library(folder)


def run_robot(
    campaign: RobotCampaign,
    source: Source,
    out: Path | None,
    *,
    progress: Progress,
    resume: bool,
    threads: int = 0,
) -> tuple[Table, Journal | None]:
    """Carry out all visits; return the table, and the journal if `out` names a file."""
    processes = _processes(campaign.settings.arm.processes, threads)
    total = len(campaign.planned.visits)

    def report(record: VisitRecord) -> None:
        if progress is not None:
            progress(record.visit + 1, total, "measuring")

    if out is None:
        for record in campaign.lines((), processes):
            report(record)
        return campaign.finished(), None
    path = journal_path(out)
    journal = Journal(path, campaign.key(source), HEADER, resume=resume)
    done = [VisitRecord.parse(text, str(path)) for text in journal.lines]
    while done and done[-1].fault:  # readings that stopped the campaign are taken again
        done.pop()
    del journal.lines[len(done) :]
    with journal:
        for record in campaign.lines(done, processes, sortie_store(campaign, out)):
            journal.append(record.text())
            report(record)
    return campaign.finished(), journal


def sortie_store(campaign: RobotCampaign, out: Path) -> SortieStore:
    """Return what is stored beside the journal, in `NAME.journal.parts`."""
    return SortieStore(journal_path(out).with_suffix(".parts"), campaign.identity)


def write_record(campaign: RobotCampaign, out: Path) -> None:
    """Write the record of the arm beside the table."""
    write_json(robot_path(out), campaign_record(campaign))


def _processes(setting: int, threads: int) -> int:
    return setting or threads or min(own_cores(), _MOST_PROCESSES)
