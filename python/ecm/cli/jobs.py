"""`ecm simulate`, `material`, `identify`, `design`, `campaign`, `measure` and `app`: long work."""

from __future__ import annotations

import json
import os
import shutil
import sys
import time
import webbrowser
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from ecm.bench import Bench
from ecm.bench import measure as measure_plan
from ecm.bench.run import envelope, pictured
from ecm.bench.until import certificate_path
from ecm.cli.command import Count, Natural
from ecm.cli.models import open_model
from ecm.cli.session import Session, check_not_read, check_output_directory, check_plan
from ecm.designs.regressors import list_or_region, row_list
from ecm.effects import Effect, get_effect, load_installed
from ecm.errors import InputError, Remedy
from ecm.fem.material_fit import fit_material, read_test
from ecm.fem.simulate import simulate as simulate_pairs
from ecm.fem.simulate import write_vtu
from ecm.io.arrays import F
from ecm.io.cache import write_atomically
from ecm.io.mechanism import RUBBER_PA
from ecm.io.settings import write_toml
from ecm.io.table import Table
from ecm.report.blocks import text_of
from ecm.rig import CampaignOptions, campaign_minutes, run_campaign, run_campaigns
from ecm.rig import reveal as reveal_truth
from ecm.rig.arm.trips import summary_lines
from ecm.rig.elastic import Progress
from ecm.rig.readings import keep_data, robot_path
from ecm.workflow.app.copying import report_of
from ecm.workflow.app.server import serve as serve_session
from ecm.workflow.app.session import Session as WrittenSession
from ecm.workflow.app.views import state_of
from ecm.workflow.config import read_config, read_rig, with_rig
from ecm.workflow.design import design as design_plan
from ecm.workflow.identify import identify as identify_mechanism


def identify(session: Session, config: Path, *, out: Path, rig: Path | None = None) -> None:
    """Simulate, select, measure, identify; then find the effect that was hidden.

    Parameters
    ----------
    config : CONFIG
        TOML file; see `ecm new config`.
    out : DIR
        Folder of the results.
    rig : RIG.toml
        Measure on this rig, not CONFIG's.
    """
    check_output_directory(out)
    session.on_interrupt(f"finished stages are kept in {out}. The same command goes on there.")
    job = read_config(config)
    if rig is not None:
        job = with_rig(job, rig)
    summary = identify_mechanism(
        job, out, seed=session.seed, threads=session.threads, console=session
    )
    session.write_json(summary)
    session.reported = True
    if session.report is not None:
        write_atomically(session.report, (out / "report.html").read_bytes())


def design(
    session: Session,
    candidates: Path,
    *,
    n: Count,
    out: Path,
    model: str | None = None,
    preset: Literal["paper", "diagnosable"] | None = None,
    effects: str | None = None,
    include: str | None = None,
    exclude: Sequence[str] = (),
    augment: Path | None = None,
    base: str | None = None,
    rig: Path | None = None,
    search: Literal["best", "paper"] = "best",
    **options: Any,
) -> None:
    """Choose the poses worth measuring (all options: docs/designs.md).

    Parameters
    ----------
    candidates : CANDIDATES
        Table of poses.
    n : N
        Poses to choose.
    criterion : NAME
        d, i, a, g, di, maximin.
    model : NAME
        cubic, poly:D, energyD, physics.
    preset : NAME
        paper (each pose once) or diagnosable (twice).
    effects : IDS
        Effects to tell apart: ID,ID.
    include : ROWS
        Rows to take, e.g. 1,5-9.
    exclude : ROWS|REGION
        E.g. 7 or x_m<0.09&y_m>0.
    augment : FILE
        Poses already measured.
    base : MODEL
        Nominal model: rows count by their noise.
    rig : RIG.toml
        Simulated rig (`ecm new rig`): noise and times.
    how_many
        Also the expected error for each n up to N.
    iterations : N
        Steps of the search; 0: all.
    time_limit_s : --time-limit S
        Seconds of the search; with a limit another run may give another design.
    """
    session.check_output(out)
    told_apart = _effects(effects)
    instruments = None if rig is None else read_rig(rig)
    table = session.read([candidates], need="predict")
    check_plan(out, table)
    planned = design_plan(
        table,
        n,
        preset=preset,
        base=None if base is None else open_model(base, session, table),
        rig=instruments,
        effects=told_apart,
        console=session,
        model=model,
        method="paper" if search == "paper" else "search",
        include=[] if include is None else row_list("--include", include, len(table)),
        exclude=_excluded(exclude, table),
        measured=_measured(augment, table, session),
        seed=session.seed,
        threads=session.threads,
        **options,
    )
    planned.plan.write(out)
    session.write_json(planned.to_dict())
    report = planned.report()
    session.write_report(report)
    session.print("\n\n".join(text_of(part.blocks) for part in report.sections[:-1]))
    time = "" if planned.minutes is None else f", about {planned.minutes:.0f} minutes on the rig"
    session.print(f"{out}: {len(planned.plan)} rows{time}")


def _effects(text: str | None) -> tuple[Effect, ...]:
    if text is None:
        return ()
    load_installed()
    return tuple(get_effect(id.strip()) for id in dict.fromkeys(text.split(",")))


def _excluded(texts: Sequence[str], table: Table) -> list[int]:
    """Rows of lists and regions, and those that are no poses: home checks, unloaded readings."""
    named = [list_or_region("--exclude", text, table) for text in texts]
    rows: list[int] = np.unique(np.concatenate([np.flatnonzero(~table.of_poses), *named])).tolist()
    return rows


def _measured(path: Path | None, table: Table, session: Session) -> F | None:
    if path is None:
        return None
    return session.read([path], need="predict").measured().matrix(table.pose_columns)


def campaign(
    session: Session,
    plan: Path,
    *,
    rig: Path,
    out: Path,
    hide: str | None = None,
    rigs: Natural = 0,
    scheduler: str | None = None,
    overwrite: bool,
) -> None:
    """Drive the simulated rig through a plan and write what it measures.

    Parameters
    ----------
    plan : PLAN
        Plan, as `ecm design` writes it.
    rig : RIG.toml
        Rig file; see `ecm new rig`.
    hide : EFFECT=S
        Effect to hide, of strength S; or random, none, FIRST.csv (the same as there).
    rigs : N
        Measure on N rigs, each of its own seed.
    scheduler : ADDRESS
        Dask scheduler for the rigs.
    overwrite
        Replace a table that is there already.
    """
    many = bool(rigs) or scheduler is not None
    session.check_output(out)
    if not many:
        keep_data(out, overwrite=overwrite)  # before the plan is read
    settings = read_rig(rig)
    visits = session.read([plan], need="predict")
    session.print(f"{len(visits)} visits, about {campaign_minutes(visits, settings):.0f} minutes")
    common: dict[str, Any] = {
        "hide": hide,
        "overwrite": overwrite,
        "options": CampaignOptions(threads=session.threads, scheduler=scheduler),
        "progress": paced(session.progress("campaign")),
    }
    if many:
        seeds = range(session.seed, session.seed + max(1, rigs))
        paths = run_campaigns(visits, settings, out, seeds=seeds, **common)
        session.write_result(seed=session.seed, data=[str(path) for path in paths])
        session.print(f"{paths[0]} … {paths[-1].name}: {len(paths)} rigs")
        return
    session.on_interrupt("finished readings are kept. The same command goes on there.")
    data = run_campaign(visits, settings, out, seed=session.seed, **common)
    rest = "Run the same command with --overwrite for the rest."
    session.on_interrupt(f"complete: {out}. {rest}")
    session.warn(*data.warnings)
    session.write_result(seed=session.seed, rows=len(data), data=str(out))
    session.print(f"{out}: {len(data)} rows")
    if settings.rig.mode == "robot":
        session.print(*summary_lines(robot_path(out)))


def measure(
    session: Session,
    plan: Path,
    *,
    rig: Path,
    out: Path,
    minutes: float | None = None,
    model: Path | None = None,
    until: str = "",
    fit: str = "",
    dry_run: bool = False,
    yes: bool = False,
    overwrite: bool = False,
) -> None:
    """Measure a plan on a real rig, row by row (docs/measure.md).

    Parameters
    ----------
    plan : PLAN
        Plan, as `ecm design` writes it.
    rig : BENCH.toml
        Limits, instruments and devices of the rig.
    out
        Table to write; NAME.journal.csv keeps each reading.
    minutes : N
        Begin no pose after N minutes; 0: write the table only.
    model : MODEL
        Say how far each row is from this model.
    until : GOAL
        Stop when it is enough: "0.3 mm" or "0.5 N" at fresh poses, or named.
    fit : NAME
        Model whose error counts, such as energy6; default: the best of degree 4 to 6.
    dry_run
        Say where the mover would go, and move nothing.
    yes
        Move without asking.
    overwrite
        Replace a table that is there already.
    """
    session.check_output(out)
    keep_data(out, overwrite=overwrite)
    bench = Bench.read(rig)
    visits = session.read([plan], need="predict")

    def agree(lines: list[str]) -> None:
        session.print(*lines)
        if not yes and not _agreed():
            remedy = Remedy(
                "look at numbers and picture, clear the rig's surroundings, and say --yes"
            )
            raise InputError("nobody has agreed to the moves above", remedy=remedy)
        session.on_interrupt("finished readings are kept. The same command goes on there.")
        session.print(f"ecm app --follow {out} shows the rows in a browser as they come")

    if dry_run:
        run, lines = envelope(visits, bench)
        session.print(*lines, pictured(run, out), "dry run: nothing was moved")
        return
    data = measure_plan(
        visits,
        bench,
        out,
        minutes=minutes,
        model=None if model is None else open_model(str(model), session, visits),
        until=until,
        fit=fit,
        seed=session.seed,
        agree=agree,
        overwrite=overwrite,
        say=session.warn,
        progress=paced(session.progress("measure")),
    )
    session.write_result(rows=len(data), data=str(out))
    session.print(f"{out}: {len(data)} rows")
    if until or fit:
        session.print(*json.loads(certificate_path(out).read_text(encoding="utf-8"))["words"])


def _agreed() -> bool:
    """Whether a person at the terminal says yes."""
    return sys.stdin.isatty() and input("Move? [y/N] ").strip().lower() in ("y", "yes")


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
        if what.startswith("measuring"):
            time.sleep(max(0.0, pause_s))

    return slower


def reveal(session: Session, data: Path, *, answer: Path | None = None) -> None:
    """Open the sealed NAME.truth.json and score an answer.

    Parameters
    ----------
    data : DATA
        Table of a simulated campaign.
    answer : FILE
        JSON of diagnose, to be scored.
    """
    revealed = reveal_truth(data, answer)
    session.write_json(revealed.to_dict())
    session.print(revealed.text())


def serve(
    session: Session,
    data: Sequence[Path] = (),
    *,
    folder: Path = Path("ecm-session"),
    follow: Path | None = None,
    browser: bool = True,
    **options: Any,
) -> None:
    """Go round the loop in a browser: data, model, where it fails, what is missing, add, next.

    Parameters
    ----------
    data : TABLE
        Tables of a new session.
    model : NAME
        Model to fit at once.
    port : P
        Port; 0: a free one.
    folder : --session DIR
        Folder of the session. --report and --json write it as it is, and nothing is served.
    follow : TABLE
        Show the rows of `ecm measure --out TABLE` as they come.
    demo
        Begin with the neck and a hidden effect.
    browser : --open/--no-open
        Open the page in the browser.
    """
    if session.report is not None or session.json is not None:
        if data or not (folder / "steps.jsonl").is_file():
            raise InputError(
                f"{folder}: --report and --json write a session that is there, without tables; "
                "begin one without them"
            )
        written = WrittenSession(folder)
        session.write_report(report_of(written))
        session.write_json(state_of(written))
        return
    check_output_directory(folder)
    session.on_interrupt(f"ecm app --session {folder} goes on with the session.")

    def ready(address: str) -> None:
        session.print(f"{address}\nCtrl-C ends the server; the session stays in {folder}.")
        if browser:
            webbrowser.open(address)

    serve_session(folder, data, follow=follow, ready=ready, **options)


_VTU = 10
"""Poses that --vtu draws."""


def simulate(
    session: Session,
    config: Path,
    *,
    out: Path,
    full_box: bool = False,
    vtu: Path | None = None,
    **options: Any,
) -> None:
    """Simulate wrenches of the box by FEM and keep the poses of the admissible workspace.

    Parameters
    ----------
    config : CONFIG
        TOML file; see `ecm new config`.
    full_box
        Keep every stable pose of the wrench box.
    scheduler : ADDRESS
        Dask scheduler for the cases.
    vtu : DIR
        Folder for ParaView files of the first poses.
    """
    check_not_read(out, config)
    session.check_output(out)
    if vtu is not None:
        check_output_directory(vtu)
    job = read_config(config)
    parts = out.with_suffix(".parts")
    session.on_interrupt(f"finished cases are kept in {parts}. The same command goes on there.")
    workspace, young = job.workspace, job.mechanism.young_modulus_Pa
    if young < RUBBER_PA[0]:
        session.warn(f"E = {young:.3g} Pa, and rubber has 1e4 or more: is it in Pa?")
    pairs = simulate_pairs(
        job.mechanism,
        job.simulate.n,
        replace(workspace, full_box=full_box or workspace.full_box),
        seed=session.seed,
        threads=session.threads,
        directory=parts,
        progress=session.progress(f"FEM poses{job.mechanism.size_words}"),
        **options,
    )
    pairs.table(str(out)).write(out)
    session.on_interrupt(f"complete: {out}. Run the same command again for the rest.")
    session.warn(*pairs.warnings)
    if vtu is not None:
        shown = pairs.wrenches[:_VTU]
        write_vtu(job.mechanism, shown, vtu)
        session.print(f"{vtu}: {len(shown)} deformed bodies with displacement and stress")
    shutil.rmtree(parts, ignore_errors=True)
    newton = {"kept": float(pairs.iterations.mean()), "all": pairs.newton_per_case}
    session.write_result(
        seed=session.seed, counts=pairs.counts, newton_per_case=newton, data=str(out)
    )
    session.print(", ".join(f"{name} {count}" for name, count in pairs.counts.items()))
    session.print(
        f"Newton iterations a case: {newton['kept']:.2f} of kept, {newton['all']:.2f} of all"
    )
    session.print(f"{out}: {len(pairs)} wrench-pose pairs")


def material(
    session: Session,
    *,
    uniaxial: Sequence[Path] = (),
    equibiaxial: Sequence[Path] = (),
    pure_shear: Sequence[Path] = (),
    terms: Annotated[int, 1, 4] = 2,
    unit: str = "",
    order: str = "",
    out: Path | None = None,
    use: tuple[float, float],
    **options: Any,
) -> None:
    """Fit a material to uniaxial, equibiaxial and pure-shear tests, with errors.

    Parameters
    ----------
    uniaxial : FILE
        Stretch and nominal stress.
    equibiaxial, pure_shear : FILE
        The same.
    model : NAME
        A material model by name (docs/fem.md), or auto.
    terms : N
        Terms of ogden.
    unit : UNIT
        Pa, kPa, MPa; where no header names it.
    order : WORD
        stretch-stress or stress-stretch.
    use : LEAST MOST
        Stretches that the mechanism reaches.
    poisson_ratio : NU
        These tests cannot show it.
    out : FILE
        TOML with [mechanism.material].
    """
    session.check_output(out)
    if not 0.0 < use[0] <= 1.0 <= use[1]:
        raise InputError(f"--use {use[0]} {use[1]}: expected stretches around 1")
    given = {"uniaxial": uniaxial, "equibiaxial": equibiaxial, "pure_shear": pure_shear}
    tests = [
        read_test(path, mode, unit=unit, order=order)
        for mode, paths in given.items()
        for path in paths
    ]
    with session.working("fitting the material") as tell:
        fitted = fit_material(tests, terms=terms, use=use, progress=tell, **options)
    session.warn(*fitted.warnings)
    session.print(*fitted.sentences())
    table = fitted.material.to_dict()
    if out is not None:
        write_atomically(out, "[mechanism.material]\n" + write_toml(table))
        session.print(f"{out}: copy [mechanism.material] into the TOML of the mechanism")
    session.write_result(
        material=table,
        young_modulus_Pa=fitted.material.young_modulus_Pa,
        sd=dict(zip(fitted.names, fitted.sd.tolist(), strict=True)),
        relative_rms=fitted.rms,
        aicc=fitted.aicc,
        covered_stretch=list(fitted.covered),
        warnings=list(fitted.warnings),
    )
