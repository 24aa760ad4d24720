"""`ecm identify`, `ecm design`, `ecm campaign` and `ecm app`."""

from __future__ import annotations

import os
import time
import webbrowser
from pathlib import Path
from typing import Any

from ecm.cli.models import open_model
from ecm.cli.options.rig import (
    AppArguments,
    CampaignArguments,
    DesignArguments,
    IdentifyArguments,
    Search,
)
from ecm.cli.session import Session, check_output_directory, check_plan
from ecm.designs.settings import list_or_region, row_list
from ecm.effects import Effect, get_effect, load_installed
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.cache import write_atomically
from ecm.io.table import Table
from ecm.report.blocks import text_of
from ecm.rig import CampaignOptions, campaign_minutes, run_campaign, run_campaigns
from ecm.rig.arm.run import robot_path
from ecm.rig.arm.summary import summary_lines
from ecm.rig.elastic import Progress
from ecm.rig.readings import keep_data
from ecm.workflow.app.serve import serve as serve_session
from ecm.workflow.config import read_config, read_rig, with_rig
from ecm.workflow.design import design as design_plan
from ecm.workflow.identify import identify as identify_mechanism


def identify(options: IdentifyArguments, session: Session) -> None:
    """Run `ecm identify`."""
    out = options.out
    check_output_directory(out)
    session.on_interrupt(f"finished stages are kept in {out}. The same command goes on there.")
    config = read_config(options.config)
    if options.rig is not None:
        config = with_rig(config, options.rig)
    summary = identify_mechanism(
        config, out, seed=session.seed, threads=session.threads, console=session
    )
    session.write_json(summary)
    if session.report is not None:
        write_atomically(session.report, (out / "report.html").read_bytes())


def design(options: DesignArguments, session: Session) -> None:
    """Run `ecm design`."""
    session.check_output(options.out)
    effects = _effects(options.effects)
    rig = None if options.rig is None else read_rig(options.rig)
    table = session.read([options.candidates], need="predict")
    check_plan(options.out, table)
    planned = design_plan(
        table,
        options.n,
        preset=None if options.preset is None else options.preset.value,
        base=None if options.base is None else open_model(options.base, session, table),
        rig=rig,
        effects=effects,
        how_many=options.how_many,
        console=session,
        **_search(options, session, table),
    )
    planned.plan.write(options.out)
    session.write_json(planned.to_dict())
    report = planned.report()
    session.write_report(report)
    session.print("\n\n".join(text_of(part.blocks) for part in report.sections[:-1]))
    time = "" if planned.minutes is None else f", about {planned.minutes:.0f} minutes on the rig"
    session.print(f"{options.out}: {len(planned.plan)} rows{time}")


def _search(options: DesignArguments, session: Session, table: Table) -> dict[str, Any]:
    """The options of the search for the rows."""
    names = ("model", "share", "metres_per_radian", "replicates", "ridge", "starts", "iterations")
    include = options.include
    return {name: getattr(options, name) for name in names} | {
        "criterion": options.criterion,
        "method": "paper" if options.search is Search.paper else "search",
        "time_limit_s": options.time_limit,
        "include": [] if include is None else row_list("--include", include, len(table)),
        "exclude": _excluded(options.exclude, table),
        "measured": _measured(options.augment, table, session),
        "seed": session.seed,
        "threads": session.threads,
    }


def _effects(text: str | None) -> tuple[Effect, ...]:
    if text is None:
        return ()
    load_installed()
    return tuple(get_effect(id.strip()) for id in dict.fromkeys(text.split(",")))


def _excluded(texts: list[str] | None, table: Table) -> list[int]:
    """Rows of lists and regions, and those that are no poses: home checks, unloaded readings."""
    rows = set()
    if table.has("kind"):
        rows = {i for i, kind in enumerate(table.text("kind")) if kind not in ("", "pose")}
    for text in texts or []:
        rows |= set(list_or_region("--exclude", text, table).tolist())
    return sorted(rows)


def _measured(path: Path | None, table: Table, session: Session) -> F | None:
    if path is None:
        return None
    return session.read([path], need="predict").measured().matrix(table.pose_columns)


def campaign(options: CampaignArguments, session: Session) -> None:
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


def serve(options: AppArguments, session: Session) -> None:
    """Run `ecm app`."""
    check_output_directory(options.folder)
    session.on_interrupt(f"ecm app --session {options.folder} goes on with the session.")

    def ready(address: str) -> None:
        session.print(f"{address}\nCtrl-C ends the server; the session stays in {options.folder}.")
        if options.browser:
            webbrowser.open(address)

    serve_session(
        options.folder,
        options.data or (),
        model=options.model,
        port=options.port,
        demo=options.demo,
        ready=ready,
    )
