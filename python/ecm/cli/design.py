"""`ecm design`: the poses worth measuring, as a plan."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ecm.cli.models import open_model
from ecm.cli.options.design import Options, Search
from ecm.cli.outputs import check_plan
from ecm.cli.session import Session
from ecm.designs import Size
from ecm.designs.rows import list_or_region, row_list
from ecm.effects import Effect, get_effect, load_installed
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.workflow.config import read_rig
from ecm.workflow.design import design as design_plan
from ecm.workflow.report_design import write_design


def design(options: Options, session: Session) -> None:
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
