"""`ecm design`: the poses worth measuring, as a plan."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from ecm.cli.command import Out, Session, command
from ecm.cli.models import open_model
from ecm.cli.outputs import check_plan
from ecm.designs import CRITERIA, Size
from ecm.designs.rows import list_or_region, row_list
from ecm.effects import Effect, get_effect, load_installed
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.workflow.config import read_rig
from ecm.workflow.design import design as design_plan
from ecm.workflow.report_design import write_design


class Preset(str, Enum):
    """Protocols of a plan."""

    paper = "paper"
    diagnosable = "diagnosable"


class Search(str, Enum):
    """How to look for the design."""

    best = "best"
    paper = "paper"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Arguments of the command."""

    candidates: Annotated[Path, typer.Argument(metavar="CANDIDATES", help="Table of poses.")]
    n: Annotated[int, typer.Option("--n", metavar="N", min=1, help="Poses to choose.")]
    out: Out
    criterion: Annotated[
        str, typer.Option("--criterion", metavar="NAME", help=f"{', '.join(CRITERIA)}.")
    ] = "d"
    model: Annotated[
        str | None,
        typer.Option("--model", metavar="NAME", help="cubic, poly:D, energyD, physics."),
    ] = None
    preset: Annotated[
        Preset | None,
        typer.Option("--preset", metavar="NAME", help="paper or diagnosable; else rows alone."),
    ] = None
    effects: Annotated[
        str | None, typer.Option("--effects", metavar="IDS", help="Effects to tell apart: ID,ID.")
    ] = None
    include: Annotated[
        str | None, typer.Option("--include", metavar="ROWS", help="Rows to take, e.g. 1,5-9.")
    ] = None
    exclude: Annotated[
        list[str] | None,
        typer.Option("--exclude", metavar="ROWS|REGION", help="E.g. 7 or x_m<0.09&y_m>0."),
    ] = None
    augment: Annotated[
        Path | None, typer.Option("--augment", metavar="FILE", help="Poses already measured.")
    ] = None
    base: Annotated[
        str | None,
        typer.Option("--base", metavar="MODEL", help="Nominal model: rows count by their noise."),
    ] = None
    rig: Annotated[
        Path | None, typer.Option("--rig", metavar="RIG", help="Rig file: its noise and times.")
    ] = None
    share: Annotated[float, typer.Option("--share", min=0.0, max=1.0, hidden=True)] = 0.5
    metres_per_radian: Annotated[float | None, typer.Option("--metres-per-radian", hidden=True)] = (
        None
    )
    how_many: Annotated[
        bool, typer.Option("--how-many", help="Also the expected error for each n up to N.")
    ] = False
    replicates: Annotated[bool, typer.Option("--replicates", hidden=True)] = False
    ridge: Annotated[float, typer.Option("--ridge", hidden=True)] = 0.0
    search: Annotated[Search, typer.Option("--search", hidden=True)] = Search.best
    starts: Annotated[int, typer.Option("--starts", min=1, hidden=True)] = 10
    iterations: Annotated[int, typer.Option("--iterations", min=0, hidden=True)] = 0
    time_limit: Annotated[float, typer.Option("--time-limit", min=0.0, hidden=True)] = 0.0


@command(Options, tables=True, report=True, seed=True, hide=("meta", "skip_bad_rows", "quiet"))
def design(options: Options, session: Session) -> None:
    """Choose the poses worth measuring (all options: docs/designs.md)."""
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
    if session.report is not None:
        write_design(session.report, planned)
    if planned.sizes:
        _print_sizes(planned.sizes, session)
    for sentence in planned.sentences():
        session.print(sentence)
    time = "" if planned.minutes is None else f", about {planned.minutes:.0f} minutes on the rig"
    session.print(f"{options.out}: {len(planned.plan)} rows{time}")


def _search(options: Options, session: Session, table: Table) -> dict[str, Any]:
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


def _print_sizes(sizes: tuple[Size, ...], session: Session) -> None:
    """Print n against expected error, with its knee."""
    session.print("     n   error of h   of K (in units of one reading's noise)")
    for size in sizes:
        mark = "  <- knee" if size.knee else ""
        session.print(f"{size.n:6d} {size.wrench_error:11.3f} {size.stiffness_error:6.3f}{mark}")
