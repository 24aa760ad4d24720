"""`ecm import`, `ecm check` and `ecm new`: tables, and files to begin from."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

from ecm.cli.session import Session, import_options, refuse_models, way_in
from ecm.effects import load_installed
from ecm.errors import InputError, Remedy
from ecm.io.cache import write_atomically
from ecm.io.csv import BadRows
from ecm.io.description import with_columns
from ecm.io.interrupts import uninterrupted
from ecm.io.sanity import record_leave_out
from ecm.io.templates import NEXT_STEP, data_template, description_template, template
from ecm.logs import import_log as import_any
from ecm.logs.importing import answered, import_report, read_log
from ecm.logs.names import Question
from ecm.models.actuated import misread
from ecm.models.check import check as check_table


def import_log(
    session: Session,
    log: Path,
    *,
    out: Path | None = None,
    columns: Sequence[str] = (),
    units: str = "",
    topics: Sequence[str] = (),
    ignore: Sequence[str] = (),
    meta: Path | None = None,
    **options: Any,
) -> None:
    """Make a table of a log: text, Parquet, MAT, HDF5, NPZ, ROS 2 bag or MCAP (docs/import.md).

    Parameters
    ----------
    log : LOG
        The log.
    out : FILE
        Table; else only shown.
    columns : --map A=B[:UNIT]
        Column A is B (-B: negated); repeat it.
    rotation : WORD
        wxyz, xyzw, rotvec, ZYX or xyz.
    units : LIST
        Where unstated: SI, or mm,deg,N,N mm.
    axis : x|y|z
        Axis of names without one.
    topics : --topic NAME
        A topic of a bag; repeat it.
    ignore : COLUMN
        Not used; repeat it.
    group : NAME
        Column that tells experiments apart.
    meta : FILE
        TOML with mechanism, frames, instrument.
    leave_out
        Leave unreadable rows and copies out; record them.
    """
    refuse_models([log])
    beside = None if out is None else out.with_suffix(".toml")
    if beside is not None and beside.exists() and not _is_ours(beside):
        raise InputError(
            f"{beside} is already there and is not overwritten. Choose another name with --out, or "
            "give it with --meta to copy what it says."
        )
    session.check_output(out, beside)
    said = {**options, "columns": _pairs(columns), "units": units.split(","), "meta": meta}
    read: Any = log
    try:
        with session.working(f"reading {log}") as tell:
            read = read_log(log, topics, tell).without(ignore)
            imported = import_any(read, **said)
    except BadRows as error:
        error.remedy = Remedy(error.remedy.words, "AGAIN --leave-out")
        raise
    except Question as error:
        found = answered(read, said)
        if found is not None and not (topics and "topics" in found[0].options):
            again = shlex.join(import_options(found[0].options))
            error.remedy = Remedy(f"for example, {found[0].words}", f"AGAIN {again}")
        raise
    session.print(str(imported))
    session.warn(*imported.table.warnings)
    session.write_json(imported.to_dict())
    if session.report is not None:
        session.write_report(import_report(imported))
    if out is None:
        session.print("\nNothing was written; --out table.csv writes the table.")
    else:
        with session.working(f"writing {out}") as tell:
            imported.write(out, progress=tell)
        session.print(f"\n{out} and {beside}: next ecm check {out}")


def _is_ours(path: Path) -> bool:
    """Whether a description was written by an earlier import."""
    return "\n[import]\n" in "\n" + path.read_text(encoding="utf-8", errors="replace")


def _pairs(words: Sequence[str]) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for word in words:
        name, sign, column = word.partition("=")
        if not sign or not name or not column:
            raise InputError(f"--map {word}: expected NAME=COLUMN or NAME=COLUMN:UNIT")
        if name in pairs:
            raise InputError(f"--map {name} is given twice: '{pairs[name]}' and '{column}'")
        pairs[name] = column
    return pairs


def check(
    session: Session, data: list[Path], *, leave_out: bool = False, mend: bool = False
) -> None:
    """Check columns and units; say what was never excited and which effects can be tested.

    Parameters
    ----------
    leave_out
        Record what is no measurement in NAME.toml.
    mend
        Record in NAME.toml which columns are exchanged or negated.
    """
    if leave_out:
        _leave_out(data, session)
    if mend:
        _mend(data, session)
    table = session.read(data)
    load_installed()
    with session.working(f"checking {len(table)} rows") as tell:
        result = check_table(table, progress=tell)
    session.write_json(result.to_dict())
    report = result.report()
    session.show(report)
    session.write_report(report)
    session.warn(*result.warnings[len(table.warnings) :], wrong=True)
    if not (table.pose_columns or table.wrench_columns):  # names that no reader of tables doubts
        for way in filter(None, (way_in(path, session.meta) for path in data)):
            session.note(str(way))
    if result.misread is not None and result.misread.mend:
        session.note("--mend puts under [columns] into the TOML beside the table:")
        for entry in result.misread.mend:
            session.note(f"    {entry}")


def _described(data: list[Path], session: Session, what: str) -> Iterator[tuple[Path, Path]]:
    """Each table with the description that is about to be written."""
    if session.meta is not None and len(data) > 1:
        raise InputError(f"{what} per table: give one table with --meta")
    for path in data:
        description = session.meta or path.with_suffix(".toml")
        session.check_output(description)
        yield path, description


def _mend(data: list[Path], session: Session) -> None:
    """Record the exchanged and negated columns of each table in its description."""
    for path, description in _described(data, session, "--mend records columns"):
        wrong = misread(session.read([path]))
        if wrong is None or not wrong.mend:
            session.print(f"{path}: nothing that an entry of [columns] mends")
            continue
        text = description.read_text(encoding="utf-8") if description.is_file() else ""
        write_atomically(description, with_columns(text, wrong.mend))
        session.print(f"{description}: [columns] has {', '.join(wrong.columns)}: {wrong.what}")


def _leave_out(data: list[Path], session: Session) -> None:
    """Record the rows of each table that are no measurements, in its description."""
    for path, description in _described(data, session, "--leave-out records rows"):
        found = record_leave_out(path, description)
        said = f"{description}: [leave_out] has {', '.join(found)}"
        session.print(said if found else f"{path}: nothing to leave out")


def new(
    session: Session,
    what: Literal["config", "arm", "rig", "bench", "data"],
    *,
    out: Path | None = None,
    dof: Literal["1", "3", "6"] = "6",
) -> None:
    """Write a commented file to begin from: config.toml, arm.toml, rig.toml, bench.toml, data.csv.

    Parameters
    ----------
    what : config|arm|rig|bench|data
        Which file: the paper's neck, a driven arm, the simulated rig, a real one, or a table.
    out : FILE
        Instead of the usual name.
    dof : 1|3|6
        Columns of data: one angle, three, or all.
    """
    usual = "data.csv" if what == "data" else f"{what}.toml"
    path = out or Path(usual)
    files = {path: data_template(int(dof)) if what == "data" else template(usual)}
    if what == "data":
        if path.suffix == ".toml":
            raise InputError(f"{path}: expected the name of the table, e.g. {path.stem}.csv")
        files[path.with_suffix(".toml")] = description_template(int(dof))
    session.check_output(*files)
    there = [target for target in files if target.exists()]
    # A kill between the two files of a pair leaves one as it was written: the other is added.
    half = len(there) < len(files) and all(t.read_bytes() == files[t].encode() for t in there)
    if there and not half:
        raise InputError(
            f"{there[0]} is already there and is not overwritten. Choose another name with "
            "--out FILE."
        )
    with uninterrupted():
        for target, text in files.items():
            write_atomically(target, text)
    for target in files:
        session.print(f"wrote {target}")
    session.write_result(files=[str(target) for target in files])
    session.print(NEXT_STEP[what].format(path=path))
