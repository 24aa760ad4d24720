"""`ecm check`: columns, units, what will be testable."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from ecm.cli.console import Console
from ecm.cli.options import (
    Data,
    HiddenSeed,
    HiddenThreads,
    Json,
    Meta,
    Quiet,
    SkipBadRows,
    load,
    load_effects,
    output,
    save_json,
)
from ecm.cli.text import columns

if TYPE_CHECKING:
    from ecm.diagnosis.check import Check


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("check", short_help="Columns, units, what will be testable.")(check)


def check(
    *,
    data: Data,
    meta: Meta = None,
    skip_bad_rows: SkipBadRows = False,
    json: Json = None,
    seed: HiddenSeed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """Columns, units, what was never excited, and which effects can be tested."""
    from ecm.diagnosis.check import check as check_table

    with Console(quiet=quiet) as console:
        output(json)
        table = load(data, console, meta=meta, skip_bad_rows=skip_bad_rows)
        load_effects()
        found = check_table(table)
        save_json(json, found.to_dict())
        _print(found, console)


def _print(found: Check, console: Console) -> None:
    rows = [("column", "unit", "from", "to", "distinct", "what")]
    for column in found.columns:
        ends = ("", "")
        if column.minimum is not None and column.maximum is not None:
            ends = (f"{column.minimum:.4g}", f"{column.maximum:.4g}")
        what = column.role + (", constant" if column.constant else "")
        if column.unknown:
            what += f", {column.unknown} unknown"
        rows.append((column.name, column.unit, *ends, str(column.distinct), what))
    console.say(columns(rows))
    console.say()
    for sentence in found.sentences():
        console.say(sentence)
    console.say()
    console.say(f"Testable effects ({len(found.testable)}): {', '.join(found.testable) or 'none'}")
    if found.not_testable:
        console.say("Not testable with these columns:")
        console.say(columns([(f"  {id}", why, f"-> {what}") for id, why, what in
                             found.not_testable], header=False))  # fmt: skip
