"""`ecm compare`: noise floor, excess error, and where."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from ecm.cli.console import Console
from ecm.cli.options import (
    Data,
    HiddenThreads,
    Json,
    Meta,
    ModelFile,
    Quiet,
    Report,
    Seed,
    SkipBadRows,
    load,
    load_effects,
    need_report,
    output,
    save_json,
)
from ecm.cli.text import columns
from ecm.io.columns import unit_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ecm.comparison import Comparison
    from ecm.comparison.reference_models import ReferenceModels


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("compare", short_help="Noise floor, excess error, where.")(compare)


def compare(
    *,
    model: ModelFile,
    data: Data,
    meta: Meta = None,
    skip_bad_rows: SkipBadRows = False,
    json: Json = None,
    report: Report = None,
    seed: Seed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """A model against a table: RMSE, bias, noise floor and excess error per component."""
    from ecm.cli.models import open_model, prepare_physics
    from ecm.cli.reports import write_comparison
    from ecm.comparison import compare as run
    from ecm.diagnosis.check import excitation_sentences, never_excited

    with Console(quiet=quiet) as console:
        output(json, report)
        load_effects()
        need_report(report)
        table = load(data, console, meta=meta, skip_bad_rows=skip_bad_rows, need="fit")
        opened = open_model(model, console, table)
        if opened.base.kind != "physics":
            prepare_physics(table, console, threads)
        found = run(opened, table, seed=seed)
        warnings = [*found.warnings, *table.warnings]
        silent = never_excited(table)
        save_json(json, {**found.to_dict(), "never_excited": list(silent), "warnings": warnings})
        if report is not None:
            write_comparison(report, found, warnings)
        console.say(_errors(found, silent))
        console.say()
        if found.lack_of_fit is not None:
            console.say(_lack_of_fit(found, silent))
            console.say()
        console.say(found.sentence())
        if found.references is not None:
            console.say(_side_by_side(found.references))
        for warning in found.warnings:
            console.warn(warning)
        for sentence in excitation_sentences(silent):
            console.say(sentence)


def _errors(found: Comparison, silent: Sequence[str]) -> str:
    """Error, floor and excess of each component that was excited."""
    rows = [("component", "rmse", "bias", "noise floor", "excess", "90 % interval", "unit")]
    for item in found.components:
        if item.name in silent:
            continue
        interval = f"{item.excess_low:.3g} .. {item.excess_high:.3g}"
        unit = unit_of(item.name)
        rows.append(
            (item.name, f"{item.rmse:.3g}", f"{item.bias:.3g}", f"{item.floor:.3g}",
             f"{item.excess:.3g}", interval, unit)
        )  # fmt: skip
    return columns(rows)


def _lack_of_fit(found: Comparison, silent: Sequence[str]) -> str:
    """F of what the model leaves between repeated poses over what repeats of one pose leave."""
    tests = {"all": found.lack_of_fit} | {c.name: c.lack_of_fit for c in found.components}
    rows = [("lack of fit", "F", "dof", "of error", "p")]
    for name, test in tests.items():
        if test is not None and name not in silent:
            dof = f"{test.dof:.4g}", f"{test.dof_error:.4g}"
            rows.append((name, f"{test.F:.6g}", *dof, f"{test.p:.2g}"))
    return columns(rows)


def _side_by_side(found: ReferenceModels) -> str:
    shown = ", ".join(f"{name} {value:.2f}" for name, value in found.levels().items())
    return f"Held-out error over noise: {shown}. {found.sentence()}"
