"""`ecm campaign`: a simulated rig measures a plan."""

from __future__ import annotations

import os
import time
from typing import Any

from ecm.cli.options.campaign import Options
from ecm.cli.session import Session
from ecm.errors import InputError
from ecm.rig import CampaignOptions, campaign_minutes, run_campaign, run_campaigns
from ecm.rig.arm.run import robot_path
from ecm.rig.arm.summary import summary_lines
from ecm.rig.elastic import Progress
from ecm.rig.journal import keep_data
from ecm.workflow.config import read_rig


def campaign(options: Options, session: Session) -> None:
    """Run `ecm campaign`."""
    many = bool(options.rigs) or options.scheduler is not None
    if options.film is not None or options.phases is not None:
        raise InputError(
            "--film, --phases: the pictures of the arm are drawn in a copy of "
            "https://github.com/ecm-stiffness/ecm now: python benches/arm_pictures.py "
            f"{options.plan} --rig {options.rig} --film film.gif --phases phases.png"
        )
    session.check_output(options.out)
    if not many:
        keep_data(options.out, overwrite=options.overwrite)  # before the plan is read
    rig = read_rig(options.rig)
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
        for line in summary_lines(robot_path(options.out)):
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
