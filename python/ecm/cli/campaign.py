"""`ecm campaign`: a simulated rig measures a plan."""

from __future__ import annotations

import os
import time
from typing import Any

from ecm.cli.options.campaign import Options
from ecm.cli.session import Session
from ecm.io.table import Table
from ecm.rig import CampaignOptions, RigSettings, campaign_minutes, run_campaign, run_campaigns
from ecm.rig.arm.pictures import PictureSource, require_robot, write_pictures
from ecm.rig.arm.run import robot_path
from ecm.rig.arm.summary import summary_lines
from ecm.rig.elastic import Progress
from ecm.rig.journal import keep_data
from ecm.workflow.config import read_rig


def campaign(options: Options, session: Session) -> None:
    """Run `ecm campaign`."""
    many = bool(options.rigs) or options.scheduler is not None
    session.check_output(options.out, options.film, options.phases)
    if not many:
        keep_data(options.out, overwrite=options.overwrite)  # before the plan is read
    rig = read_rig(options.rig)
    if options.film is not None or options.phases is not None:
        require_robot(rig, ("--film", options.film), ("--phases", options.phases))
    plan = session.read([options.plan], need="predict")
    session.print(f"{len(plan)} visits, about {campaign_minutes(plan, rig):.0f} minutes")
    common: dict[str, Any] = {
        "hide": options.hide,
        "overwrite": options.overwrite,
        "progress": paced(session.progress("campaign")),
    }
    if many:
        paths = run_campaigns(
            plan,
            rig,
            options.out,
            seeds=range(session.seed, session.seed + max(1, options.rigs)),
            options=CampaignOptions(threads=session.threads, scheduler=options.scheduler),
            **common,
        )
        document = {"schema": 1, "seed": session.seed, "data": [str(path) for path in paths]}
        session.write_json(document)
        session.print(f"{paths[0]} … {paths[-1].name}: {len(paths)} rigs")
        return
    session.on_interrupt("finished readings are kept. The same command goes on there.")
    data = run_campaign(
        plan,
        rig,
        options.out,
        seed=session.seed,
        options=CampaignOptions(threads=session.threads),
        **common,
    )
    rest = "Run the same command with --overwrite for the rest."
    session.on_interrupt(f"complete: {options.out}. {rest}")
    for warning in data.warnings:
        session.warn(warning)
    session.write_json(
        {"schema": 1, "seed": session.seed, "rows": len(data), "data": str(options.out)}
    )
    session.print(f"{options.out}: {len(data)} rows")
    if rig.rig.mode == "robot":
        for line in _arm_lines(options, session, plan, rig):
            session.print(line)


def paced(progress: Progress) -> Progress:
    """Let each reading take at least ECM_READING_S seconds: a person can watch them come."""
    try:
        pause_s = float(os.environ["ECM_READING_S"])
    except (KeyError, ValueError):
        return progress
    if progress is None:
        return None
    say = progress

    def slower(done: int, total: int, what: str) -> None:
        say(done, total, what)
        if what == "measuring":
            time.sleep(max(0.0, pause_s))

    return slower


def _arm_lines(options: Options, session: Session, plan: Table, rig: RigSettings) -> list[str]:
    """What the arm did, and the pictures of it that were asked for."""
    lines = summary_lines(robot_path(options.out))
    if options.film is not None or options.phases is not None:
        lines += write_pictures(
            PictureSource(plan, rig, session.seed, session.threads),
            film=options.film,
            phases=options.phases,
            progress=session.progress("pictures"),
        )
    return lines
