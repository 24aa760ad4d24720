"""`ecm import`: a log of any kind as a measurement table."""

from __future__ import annotations

from pathlib import Path

from ecm.cli.options.import_log import Options
from ecm.cli.session import Session
from ecm.errors import InputError, Remedy
from ecm.io.row_errors import BadRows
from ecm.logs import import_log as import_any
from ecm.logs.importing import read_log
from ecm.logs.page import write_import


def import_log(options: Options, session: Session) -> None:
    """Run `ecm import`."""
    beside = None if options.out is None else options.out.with_suffix(".toml")
    if beside is not None and beside.exists() and not _is_ours(beside):
        raise InputError(
            f"{beside} is already there and is not overwritten. Choose another name with --out, or "
            "give it with --meta to copy what it says."
        )
    session.check_output(options.out, beside)
    topics = options.topics or []
    try:
        with session.working(f"reading {options.log}") as tell:
            imported = import_any(
                read_log(options.log, topics, tell).without(options.ignore or []),
                columns=_pairs(options.columns or []),
                rotation=options.rotation,
                units=[word for word in options.units.split(",") if word.strip()],
                axis=options.axis,
                group=options.group,
                meta=options.meta,
                leave_out=options.leave_out,
            )
    except BadRows as error:
        error.remedy = Remedy(error.remedy.words, "AGAIN --leave-out")
        raise
    session.print(str(imported))
    for warning in imported.table.warnings:
        session.warn(warning)
    session.write_json(imported.to_dict())
    if session.report is not None:
        write_import(session.report, imported)
    if options.out is None:
        session.print("\nNothing was written; --out table.csv writes the table.")
    else:
        with session.working(f"writing {options.out}") as tell:
            imported.write(options.out, progress=tell)
        session.print(f"\n{options.out} and {beside}: next ecm check {options.out}")


def _is_ours(path: Path) -> bool:
    """Whether a description was written by an earlier import."""
    return "\n[import]\n" in "\n" + path.read_text(encoding="utf-8", errors="replace")


def _pairs(words: list[str]) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for word in words:
        name, sign, column = word.partition("=")
        if not sign or not name or not column:
            raise InputError(f"--map {word}: expected NAME=COLUMN or NAME=COLUMN:UNIT")
        if name in pairs:
            raise InputError(f"--map {name} is given twice: '{pairs[name]}' and '{column}'")
        pairs[name] = column
    return pairs
