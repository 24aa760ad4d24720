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

if TYPE_CHECKING:
    from ecm.compare import FTest
    from ecm.compare.references import References


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
    from ecm.check import excitation_sentences, never_excited
    from ecm.cli.models import open_model
    from ecm.cli.reports import write_comparison
    from ecm.compare import compare as run

    with Console(quiet=quiet) as console:
        output(json, report)
        load_effects()
        need_report(report)
        table = load(data, console, meta=meta, skip_bad_rows=skip_bad_rows, need="fit")
        found = run(open_model(model, console), table, seed=seed)
        save_json(
            json,
            {
                **found.to_dict(),
                "never_excited": list(never_excited(table)),
                "warnings": [*found.warnings, *table.warnings],
            },
        )
        if report is not None:
            write_comparison(report, found)
        rows = [("component", "rmse", "bias", "noise floor", "excess", "90 % interval", "F",
                 "unit")]  # fmt: skip
        silent = never_excited(table)
        for item in found.components:
            if item.name in silent:
                continue
            interval = f"{item.excess_low:.3g} .. {item.excess_high:.3g}"
            unit = item.name.rsplit("_", 1)[1].replace("Nm", "N m")
            rows.append(
                (item.name, f"{item.rmse:.3g}", f"{item.bias:.3g}", f"{item.floor:.3g}",
                 f"{item.excess:.3g}", interval, _ratio(item.lack_of_fit), unit)
            )  # fmt: skip
        console.say(columns(rows))
        console.say()
        console.say(found.sentence())
        if found.lack_of_fit is not None:
            console.say(_lack_of_fit(found.lack_of_fit))
        if found.references is not None:
            console.say(_side_by_side(found.references))
        for warning in found.warnings:
            console.warn(warning)
        for sentence in excitation_sentences(silent):
            console.say(sentence)


def _ratio(found: FTest | None) -> str:
    return "" if found is None else f"{found.F:.3g}"


def _lack_of_fit(found: FTest) -> str:
    return (
        f"Lack of fit over all components: F = {found.F:.6g} with {found.dof:.4g} and "
        f"{found.dof_error:.4g} degrees of freedom, p = {found.p:.2g}."
    )


def _side_by_side(found: References) -> str:
    levels = (
        ("physics base", found.physics),
        ("symmetric energy", found.energy),
        ("ceiling", found.ceiling),
        ("noise", found.floor),
    )
    shown = ", ".join(f"{name} {value:.2f}" for name, value in levels if value is not None)
    return f"Held-out error over noise: {shown}. {found.sentence()}"
