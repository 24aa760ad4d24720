"""`ecm check`: columns, units, what will be testable."""

from __future__ import annotations

from pathlib import Path

from ecm.cli.options.check import Options
from ecm.cli.session import Session
from ecm.cli.text import columns
from ecm.diagnosis.check import Check, lines_by_reason
from ecm.diagnosis.check import check as check_table
from ecm.diagnosis.suspect_rows import record_leave_out
from ecm.effects import load_installed
from ecm.errors import InputError


def check(options: Options, session: Session) -> None:
    """Run `ecm check`."""
    if options.leave_out:
        _leave_out(options.data, session)
    table = session.read(options.data)
    load_installed()
    with session.working(f"checking {len(table)} rows") as tell:
        result = check_table(table, progress=tell)
    session.write_json(result.to_dict())
    _print(result, session)
    wrong = result.misread
    for warning in result.warnings[len(table.warnings) :]:
        session.warn(warning, wrong=wrong is not None and warning == wrong.sentence())
    if wrong is not None and wrong.mend:
        session.note("To mend it, put under [columns] into the TOML beside the table:")
        for entry in wrong.mend:
            session.note(f"    {entry}")


def _leave_out(data: list[Path], session: Session) -> None:
    """Record the rows of each table that are no measurements, in its description."""
    if session.meta is not None and len(data) > 1:
        raise InputError("--leave-out records rows per table: give one table with --meta")
    for path in data:
        description = session.meta or path.with_suffix(".toml")
        session.check_output(description)
        found = record_leave_out(path, description)
        session.print(
            f"{description}: [leave_out] has {', '.join(found)}"
            if found
            else f"{path}: nothing to leave out"
        )


def _print(result: Check, session: Session) -> None:
    rows = [("column", "unit", "from", "to", "distinct", "what")]
    for column in result.columns:
        ends = ("", "")
        if column.minimum is not None and column.maximum is not None:
            ends = (f"{column.minimum:.4g}", f"{column.maximum:.4g}")
        what = column.role + (", constant" if column.constant else "")
        if column.unknown:
            what += f", {column.unknown} unknown"
        rows.append((column.name, column.unit, *ends, str(column.distinct), what))
    session.print(columns(rows))
    session.print()
    for sentence in result.sentences():
        session.print(sentence)
    testable = ", ".join(result.testable) or "none"
    session.print(f"\nTestable effects ({len(result.testable)}): {testable}")
    if result.not_testable:
        session.print("Not testable with these columns:")
        for line in lines_by_reason(result.not_testable):
            session.print(line)
