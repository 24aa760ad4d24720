"""`ecm design`: the poses worth measuring, as a plan."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ecm.cli.console import Console
from ecm.cli.options import (
    HiddenThreads,
    Json,
    Out,
    Report,
    Seed,
    load,
    load_effects,
    need_report,
    output,
    output_plan,
    save_json,
)

if TYPE_CHECKING:
    from ecm.designs import DesignSettings, NominalModel, Size
    from ecm.diagnosis.identifiability import Identifiability
    from ecm.effects import Effect
    from ecm.io.table import Table
    from ecm.regression.noise import Noise
    from ecm.rig import RigSettings


class Preset(str, Enum):
    """Protocols of a plan."""

    paper = "paper"
    diagnosable = "diagnosable"


class Search(str, Enum):
    """How to look for the design."""

    best = "best"
    paper = "paper"


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("design", short_help="The poses worth measuring, as a plan.")(design)


def design(
    *,
    candidates: Annotated[Path, typer.Argument(metavar="CANDIDATES", help="Table of poses.")],
    n: Annotated[int, typer.Option("--n", metavar="N", min=1, help="Poses to choose.")],
    out: Out,
    criterion: Annotated[
        str, typer.Option("--criterion", metavar="NAME", help="d, i, a, g, di, maximin.")
    ] = "d",
    model: Annotated[
        str | None,
        typer.Option("--model", metavar="NAME", help="cubic, poly:D, energyD, physics."),
    ] = None,
    preset: Annotated[
        Preset | None, typer.Option("--preset", help="Protocol; default: the rows alone.")
    ] = None,
    effects: Annotated[
        str | None, typer.Option("--effects", metavar="IDS", help="To be told apart: ID,ID.")
    ] = None,
    include: Annotated[
        str | None, typer.Option("--include", metavar="ROWS", help="Must be in, e.g. 1,5-9.")
    ] = None,
    exclude: Annotated[
        list[str] | None,
        typer.Option("--exclude", metavar="ROWS|REGION", help="E.g. 7 or x_m<0.09&y_m>0."),
    ] = None,
    augment: Annotated[
        Path | None, typer.Option("--augment", metavar="FILE", help="Poses already measured.")
    ] = None,
    base: Annotated[
        str | None,
        typer.Option("--base", metavar="MODEL", help="Nominal: weighs rows by their noise."),
    ] = None,
    rig: Annotated[
        Path | None, typer.Option("--rig", metavar="RIG", help="Noise, minutes of this rig file.")
    ] = None,
    share: Annotated[float, typer.Option("--share", min=0.0, max=1.0, hidden=True)] = 0.5,
    metres_per_radian: Annotated[
        float | None, typer.Option("--metres-per-radian", hidden=True)
    ] = None,
    how_many: Annotated[
        bool, typer.Option("--how-many", help="Also n against expected error, up to N.")
    ] = False,
    replicates: Annotated[bool, typer.Option("--replicates", hidden=True)] = False,
    ridge: Annotated[float, typer.Option("--ridge", hidden=True)] = 0.0,
    search: Annotated[Search, typer.Option("--search", hidden=True)] = Search.best,
    starts: Annotated[int, typer.Option("--starts", min=1, hidden=True)] = 10,
    iterations: Annotated[int, typer.Option("--iterations", min=0, hidden=True)] = 0,
    time_limit: Annotated[float, typer.Option("--time-limit", min=0.0, hidden=True)] = 0.0,
    meta: Annotated[Path | None, typer.Option("--meta", hidden=True)] = None,
    skip_bad_rows: Annotated[bool, typer.Option("--skip-bad-rows", hidden=True)] = False,
    json: Json = None,
    report: Report = None,
    seed: Seed = 0,
    threads: HiddenThreads = 0,
    quiet: Annotated[bool, typer.Option("--quiet", hidden=True)] = False,
) -> None:
    """Choose the poses worth measuring (all options: docs/designs.md)."""
    from ecm.designs import (
        DesignSettings,
        diagnosable_plan,
        optimal_design,
        paper_plan,
        plain_plan,
    )

    with Console(quiet=quiet) as console:
        output_plan(out)
        output(json, report)
        need_report(report)
        wanted = _effects(effects, preset)
        settings = _rig(rig)
        table = load([candidates], console, meta=meta, skip_bad_rows=skip_bad_rows, need="predict")
        # Free polynomials absorb the effects.
        name = model or ("cubic" if not effects else "energy4")
        nominal = _nominal(
            table,
            base=base,
            model=name,
            noise=_noise(settings),
            needed=bool(effects) or rig is not None,
            free=preset is Preset.diagnosable,
            threads=threads,
            console=console,
        )
        names = table.pose_columns
        poses = table.matrix(names)
        weighed = base is not None or rig is not None or name == "physics" or effects
        weights = nominal if weighed else None
        choice = DesignSettings(
            criterion=criterion,
            model=name,
            length_m=table.meta.length_m,
            effects=wanted if effects else (),
            ridge=ridge,
            share=share,
            metres_per_radian=metres_per_radian,
            columns=names,
            replicates=replicates,
            method="paper" if search is Search.paper else "search",
            starts=starts,
            iterations=iterations,
            time_limit_s=time_limit,
            seed=seed,
            threads=threads,
        )
        chosen = optimal_design(
            poses,
            n,
            choice,
            include=_included(include, table),
            exclude=_excluded(exclude, table),
            measured=_measured(augment, table, console),
            base=weights,
            progress=console.bar("design"),
        )
        if preset is Preset.diagnosable:
            plan = diagnosable_plan(table, chosen, seed=seed)
        elif preset is Preset.paper:
            plan = paper_plan(table, chosen, seed=seed)
        else:
            plan = plain_plan(table, chosen, seed=seed)
        plan.write(out)
        told = _told(plan, nominal, wanted, preset, settings)
        minutes = _minutes(plan, settings)
        sizes = _sizes(poses, n, choice, weights, console) if how_many else []
        save_json(
            json,
            {
                "schema": 1,
                "seed": seed,
                "criterion": chosen.criterion,
                "model": None if criterion == "maximin" else name,
                "n": len(chosen.indices),
                "rows": (chosen.indices + 1).tolist(),
                "value": chosen.value,
                "bound": chosen.bound,
                "efficiency": chosen.efficiency,
                "status": chosen.status,
                "reproducible": time_limit == 0.0,
                "minutes": minutes,
                "effects": [item.to_dict() for item in told],
                "how_many": [size.to_dict() for size in sizes],
            },
        )
        if report is not None:
            from ecm.cli.design_report import write_design

            write_design(report, table, chosen, told=told, sizes=sizes, minutes=minutes)
        console.say(chosen.sentence())
        if time_limit > 0.0:
            console.say("with a time limit another run may give another design")
        for item in told:
            console.say("  " + item.sentence())
        time = "" if minutes is None else f", about {minutes:.0f} minutes on the rig"
        console.say(f"{out}: {len(plan)} rows{time}")


def _rig(path: Path | None) -> RigSettings | None:
    from ecm.workflow.config import read_rig

    return None if path is None else read_rig(path)


def _noise(settings: RigSettings | None) -> Noise | None:
    from ecm.designs import rig_noise

    return None if settings is None else rig_noise(settings)


def _minutes(plan: Table, settings: RigSettings | None) -> float | None:
    """Robot minutes on this rig, or the default one; None where no length is known."""
    from ecm.io.columns import POSE
    from ecm.rig import RigSettings, campaign_minutes

    if plan.meta.length_m is None or plan.pose_columns != POSE:
        return None
    return campaign_minutes(plan, RigSettings() if settings is None else settings)


def _effects(text: str | None, preset: Preset | None) -> tuple[Effect, ...]:
    """The effects to be told apart: those named, or all of the catalogue."""
    from ecm.effects import all_effects, get_effect
    from ecm.errors import InputError

    if text is None:
        return all_effects() if preset is Preset.diagnosable else ()
    if preset is not Preset.diagnosable:
        raise InputError(
            "--effects: needs --preset diagnosable, whose protocol tells effects apart; add it"
        )
    load_effects()
    return tuple(get_effect(id.strip()) for id in dict.fromkeys(text.split(",")))


def _nominal(
    table: Table,
    *,
    base: str | None,
    model: str,
    noise: Noise | None,
    needed: bool,
    free: bool,
    threads: int,
    console: Console,
) -> NominalModel | None:
    """The nominal base where it is asked for; else where it costs nothing."""
    from ecm.cli.models import open_model
    from ecm.designs import nominal_model
    from ecm.errors import InputError
    from ecm.io.columns import WRENCH

    physics = model == "physics"
    if base is not None or needed or physics:
        return nominal_model(
            table,
            None if base is None else open_model(base, console, table),
            physics=physics,
            noise=noise,
            threads=threads,
            progress=console.bar("physics base") if physics else None,
        )
    if not free:
        return None
    try:
        if table.wrench_columns == WRENCH or table.meta.body() is not None:
            return nominal_model(table, threads=threads)
    except InputError:
        pass
    console.say(
        "which effects this plan can name is not known without a nominal stiffness; give --base "
        "MODEL, or a [mechanism] beside the candidates"
    )
    return None


def _included(text: str | None, table: Table) -> Sequence[int]:
    from ecm.designs.rows import row_list

    return [] if text is None else [int(row) for row in row_list("--include", text, len(table))]


def _excluded(texts: list[str] | None, table: Table) -> list[int]:
    """Rows of lists and regions, and those that are no poses: home checks, unloaded readings."""
    from ecm.designs.rows import list_or_region

    rows = set()
    if table.has("kind"):
        rows = {i for i, kind in enumerate(table.text("kind")) if kind not in ("", "pose")}
    for text in texts or []:
        rows |= set(list_or_region("--exclude", text, table).tolist())
    return sorted(rows)


def _measured(path: Path | None, table: Table, console: Console) -> Any:
    if path is None:
        return None
    done = load([path], console, need="predict").measured()
    return done.matrix(table.pose_columns)


def _told(
    plan: Table,
    nominal: NominalModel | None,
    effects: Sequence[Effect],
    preset: Preset | None,
    rig: RigSettings | None,
) -> list[Identifiability]:
    from ecm.diagnosis.identifiability import identifiability

    if preset is not Preset.diagnosable or nominal is None:
        return []
    return identifiability(plan, nominal, effects, rig=rig)


def _sizes(
    poses: Any, n: int, design: DesignSettings, base: NominalModel | None, console: Console
) -> list[Size]:
    """n against expected error up to N, printed with its knee."""
    from ecm.designs import DesignSettings, design_sizes

    settings = DesignSettings(
        criterion="d" if design.criterion == "maximin" else design.criterion,
        model=design.model,
        length_m=design.length_m,
        iterations=60,
        seed=design.seed,
        threads=design.threads,
    )
    bar = console.bar("how many")
    sizes = design_sizes(poses, (), settings, most=n, base=base, progress=bar)
    console.say("     n   error of h   of K (in units of one reading's noise)")
    for size in sizes:
        mark = "  <- knee" if size.knee else ""
        console.say(f"{size.n:6d} {size.wrench_error:11.3f} {size.stiffness_error:6.3f}{mark}")
    return sizes
