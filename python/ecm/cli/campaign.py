"""`ecm campaign`: a simulated rig measures a plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import Json, Out, Quiet, Seed, Threads, keep_note, load, output, save_json


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("campaign", short_help="A simulated rig measures a plan.")(campaign)


def campaign(
    *,
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="What `ecm design` writes.")],
    rig: Annotated[Path, typer.Option("--rig", metavar="RIG.toml", help="`ecm new rig`.")],
    out: Out,
    hide: Annotated[
        str | None,
        typer.Option(
            "--hide",
            metavar="EFFECT=S",
            help="Hide an effect of strength S; random; none; FIRST.csv: what is hidden there.",
        ),
    ] = None,
    rigs: Annotated[
        int,
        typer.Option("--rigs", min=0, metavar="N", help="On N rigs of their own seeds: OUT-0000 …"),
    ] = 0,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler that deals the rigs."),
    ] = None,
    film: Annotated[
        Path | None, typer.Option("--film", metavar="FILE.gif", help="The arm at the first poses.")
    ] = None,
    phases: Annotated[
        Path | None,
        typer.Option("--phases", metavar="FILE.png", help="The arm's phases at the first pose."),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace a table that stands there.")
    ] = False,
    json: Json = None,
    seed: Seed = 0,
    threads: Threads = 0,
    quiet: Quiet = False,
) -> None:
    """Drive the simulated rig through a plan and write what it measures."""
    from ecm.rig import campaign_minutes, run_campaign, run_campaigns
    from ecm.rig.journal import keep_data
    from ecm.workflow.config import read_rig

    with Console(quiet=quiet) as console:
        output(out, json, film, phases)
        if not rigs and scheduler is None:
            keep_data(out, overwrite=overwrite)  # before the plan is read
        settings = read_rig(rig)
        if film is not None or phases is not None:
            from ecm.rig.arm.pictures import require_robot

            require_robot(settings, ("--film", film), ("--phases", phases))
        table = load([plan], console, need="predict")
        console.say(f"{len(table)} visits, about {campaign_minutes(table, settings):.0f} minutes")
        if rigs or scheduler is not None:
            paths = run_campaigns(
                table, settings, out, rigs=max(1, rigs), hide=hide, seed=seed, threads=threads,
                scheduler=scheduler, progress=console.bar("campaign"), overwrite=overwrite,
            )  # fmt: skip
            save_json(json, {"schema": 1, "seed": seed, "data": [str(path) for path in paths]})
            console.say(f"{paths[0]} … {paths[-1].name}: {len(paths)} rigs")
            return
        keep_note("Readings so far are kept: the same command goes on there.")
        data = run_campaign(
            table, settings, out, hide=hide, seed=seed, threads=threads,
            progress=console.bar("campaign"), resume=True, overwrite=overwrite,
        )  # fmt: skip
        for warning in data.warnings:
            console.warn(warning)
        save_json(json, {"schema": 1, "seed": seed, "rows": len(data), "data": str(out)})
        console.say(f"{out}: {len(data)} rows")
        if settings.rig.mode == "robot":
            from ecm.rig.arm.pictures import PictureSource, write_pictures
            from ecm.rig.arm.run import robot_path
            from ecm.rig.arm.summary import summary_lines

            for line in summary_lines(robot_path(out)):
                console.say(line)
            if film is not None or phases is not None:
                for line in write_pictures(
                    PictureSource(table, settings, seed, threads),
                    film=film, phases=phases, progress=console.bar("pictures"),
                ):  # fmt: skip
                    console.say(line)
