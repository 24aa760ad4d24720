"""What all commands share at work: reading tables, writing JSON, checking what will be written.

Files that are no table are refused with the way in: a log to import, a model in its place.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from ecm.cli import command, interrupt
from ecm.cli.command import Natural
from ecm.cli.console import Console
from ecm.cli.interrupt import NOTHING_WRITTEN
from ecm.errors import ComputationError, EcmError, InputError, Refusal, Remedy, document_of
from ecm.io.cache import is_device, write_json
from ecm.io.columns import POSE, WRENCH
from ecm.io.csv import LEAVE_OUT, BadRows
from ecm.io.settings import IMPORT
from ecm.io.table import Need, Table, check_description, read_table
from ecm.report.blocks import CodeBlock, Report, Section, require_report

_OF_MODELS = ("compare", "diagnose", "predict", "refit")
"""Commands that take a model, and then tables."""


def refuse_models(paths: Sequence[Path]) -> None:
    """Raise InputError where a model is given in place of a table, with the right order."""
    for path in filter(_is_model, paths):
        verb, *others = command.typed
        # The last word that is this path: an option before it may name the same file.
        place = len(others) - 1 - [Path(word) for word in reversed(others)].index(path)
        if verb in _OF_MODELS and not any(_is_model(Path(word)) for word in others[:place]):
            others.insert(0, others.pop(place))
            said = "give the model first"
        else:
            # Beside other tables the model is left out; alone a table stands in its place.
            others[place : place + 1] = ["data.csv"] if len(paths) == 1 else []
            said = "give a table in its place"
        remedy = Remedy(said, shlex.join(["ecm", verb, *others]))
        raise InputError(f"{path} is a model, expected a table of measurements", remedy=remedy)


def way_in(path: Path, meta: Path | None = None) -> Remedy | None:
    """Return the import that makes a table to fit of a log; None where nothing is known.

    Parameters
    ----------
    path
        The file, or the folder of a bag, that was given as a table.
    meta
        The description that was given with it; else that beside the file.
    """
    # To import these takes a sixth of the time in which a command starts.
    from ecm.logs.importing import answered, read_log  # noqa: PLC0415 - see above
    from ecm.logs.names import read_name  # noqa: PLC0415 - see above

    # Without its description the table would have no noise, no frames, no mechanism.
    beside = meta or path.with_suffix(".toml")
    described = [{"meta": str(beside)}] if beside.is_file() else []
    tried = [(given, whole) for given in (*described, {}) for whole in (True, False)]
    answers = ((given, answered(path, given, whole=whole)) for given, whole in tried)
    given, found = next((one for one in answers if one[1] is not None), ({}, None))
    if found is None:
        with suppress(EcmError, OSError, ValueError):
            columns = list(read_log(path, ()).log.columns)
            if columns and not any(read_name(name).may_be_measured for name in columns):
                some = ", ".join(f"'{name}'" for name in columns[:3]) + ", ..." * (len(columns) > 3)
                return Remedy(
                    f"a model needs a pose and a wrench in each row, and here is only {some}: "
                    "record both in the same rows, or bring them into the columns of one file"
                )
        return None
    answer, imported = found
    of = {"pose": imported.table.pose_columns, "wrench": imported.table.wrench_columns}
    lacking = " or a ".join(kind for kind in of if not of[kind])
    own = [imported.meta.origin[name] == name for names in of.values() for name in names]
    if lacking and any(own):
        return None  # a table already
    first = "import it, since it is a log of another program"
    last = ""
    if lacking:
        first = (
            f"no column may be a {lacking}, without which no model can be fitted: record it in the "
            "same rows"
        )
        last = "what there is becomes a table by"
    words = "; ".join(filter(None, (first, answer.words, last)))
    out = path.with_name(f"{path.stem}-table.csv")
    options = import_options({**given, **answer.options})
    typed = ["ecm", "import", str(path), *options, "--out", str(out)]
    return Remedy(words, shlex.join(typed))


def import_options(options: Mapping[str, Any]) -> list[str]:
    """Options of `import_log` as they are typed."""
    words = []
    for name, value in options.items():
        if isinstance(value, Mapping):
            words += [word for item in value.items() for word in ("--map", "=".join(item))]
        elif name == "topics":
            words += [word for topic in value for word in ("--topic", topic)]
        elif value is True:
            words.append(f"--{name.replace('_', '-')}")
        else:
            words += [f"--{name}", value if isinstance(value, str) else ",".join(value)]
    return words


def _is_table(path: Path) -> bool:
    """Whether the first line of a file names standard columns of a pose and of a wrench."""
    with suppress(OSError), path.open(encoding="utf-8-sig", errors="replace") as file:
        names = {name.strip() for name in file.readline().split(",")}
        return not names.isdisjoint(POSE) and not names.isdisjoint(WRENCH)
    return False


def _is_model(path: Path) -> bool:
    """Whether a file is a fitted model."""
    if path.suffix != ".json":
        return False
    with suppress(OSError, ValueError):
        document = json.loads(path.read_bytes())
        return isinstance(document, dict) and "training" in document
    return False


def _identity(path: Path) -> tuple[int, int] | None:
    """What changes when a file is written again; None where there is none."""
    with suppress(OSError):
        status = path.stat()
        return status.st_ino, status.st_mtime_ns
    return None


def check_plan(path: Path, table: Table) -> None:
    """Raise InputError where a plan for a table would replace another file than an older plan.

    A kill between the two files of a plan leaves the first one, its description: where that is the
    very one that would be written, nothing is lost.
    """
    description = table.meta.of_plan().beside(path).to_toml()
    beside = path.with_suffix(".toml")
    if path.is_file():
        with path.open(encoding="utf-8", errors="replace") as file:
            header = file.readline().strip()
        if header and "action" not in header.split(","):
            raise InputError(
                f"{path}: this file is no plan, and is not overwritten. Choose another name."
            )
    elif beside.exists() and beside.read_bytes() != description.encode():
        raise InputError(
            f"{path}: beside it is {beside}, which the plan's description would overwrite. "
            "Choose another name."
        )


def check_not_read(path: Path, source: Path) -> None:
    """Raise InputError where the description beside a table would replace a file that is read."""
    beside = path.with_suffix(".toml")
    if beside.exists() and source.exists() and beside.samefile(source):
        raise InputError(
            f"{path}: beside it is {source}, which the command reads, and which the table's "
            "description would overwrite. Choose another name."
        )


def check_output_directory(path: Path) -> None:
    """Raise InputError where a directory could not be made or written into."""
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: found a file, expected a directory (or a new name)")
    _check_writable(path, path)


def _check_writable(path: Path, directory: Path) -> None:
    whole = directory.absolute()
    nearest = next((place for place in (whole, *whole.parents) if place.exists()), whole)
    if not nearest.is_dir():
        raise InputError(f"{path}: {nearest} is a file, expected a directory. Check the path.")
    if not os.access(nearest, os.W_OK):
        raise InputError(f"{path}: no permission to write in {nearest}. Choose another place.")


def model_named_after(data: Any) -> Path:
    """Return the file of a model that nobody named: called like the first of its tables."""
    return Path(f"{Path(data[0]).stem}.json")


@contextmanager
def saved_by_force(path: Path) -> Iterator[None]:
    """Add to the refusal of a model that it was not saved, and how it would be."""
    try:
        yield
    except ComputationError as error:
        raise ComputationError(
            f"{path}: not saved, {error.message}. --force saves it all the same.",
            remedy=replace(
                error.remedy or Remedy("save it all the same", "AGAIN --force"), force=True
            ),
        ) from None


_STDOUT = Path("/dev/stdout")


def _stream(path: Path | None) -> Path | None:
    """Return the standard output for `-`."""
    return _STDOUT if path == Path("-") else path


def brief(warnings: Sequence[str], paths: Sequence[Path]) -> list[str]:
    """Warnings with the names of files in place of their paths; what several share is one line."""
    files: dict[str, list[str]] = {}
    for warning in warnings:
        path = next((p for p in paths if warning.startswith(f"{p}: ")), None)
        text = warning if path is None else warning.removeprefix(f"{path}: ")
        files.setdefault(text, []).extend([] if path is None else [path.name])
    lines = []
    for text, names in files.items():
        some = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
        lines.append(f"{some}: {text}" if names else text)
    return lines


class Session(Console):
    """A command at work: its common options, and what it prints, reads and writes.

    Parameters
    ----------
    meta : FILE
        Description, if not NAME.toml.
    skip_bad_rows : --leave-out
        Leave bad rows out; record them.
    json : FILE
        Write the result as JSON.
    report : FILE
        Write an HTML report.
    seed : N
        Seed of the random generator.
    threads : N
        Threads; 0: all cores.
    quiet
        Print only errors.
    """

    def __init__(
        self,
        *,
        meta: Path | None = None,
        skip_bad_rows: bool = False,
        json: Path | None = None,
        report: Path | None = None,
        seed: Natural = 0,
        threads: Natural = 0,
        quiet: bool = False,
    ) -> None:
        super().__init__(quiet=quiet)
        self.meta, self.skip_bad_rows = meta, skip_bad_rows
        self.json, self.report = _stream(json), _stream(report)
        self.seed, self.threads = seed, threads
        self.reported = False
        """Whether the page of --report is written."""
        self._said: list[str] = []
        self._before: dict[Path, tuple[int, int] | None] = {}
        """The files that are to be written, as they were."""

    def print(self, *lines: str) -> None:
        """Print lines of the result; on stderr where stdout gets --json or --report."""
        self._said += lines
        if _STDOUT not in (self.json, self.report):
            super().print(*lines)
        else:
            for text in lines:
                self.note(text)

    def write_report(self, report: Report) -> None:
        """Write the page of --report, where it is asked for."""
        self.reported = True
        if self.report is not None:
            with self.working("writing the report"):
                report.write(self.report)

    def report_said(self) -> None:
        """Write what was printed as the page of --report, where the command wrote none."""
        if not self.reported:
            words = CodeBlock(shlex.join(["ecm", *command.typed]), "\n".join(self._said))
            title = f"ecm {command.typed[0]}" if command.typed else "ecm"
            self.write_report(Report(title, "", [Section("Result", [words])]))

    def show(self, report: Report) -> None:
        """Print a report in lines of the terminal's width; into a file each line is whole."""
        width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
        self.print(report.text(width))

    def __enter__(self) -> Session:
        interrupt.describe(self.left_behind)
        return self

    def check_output(self, *paths: Path | None) -> None:
        """Raise InputError where a file could not be written; None is left out."""
        for path in paths:
            if path is None:
                continue
            if path.is_dir():
                raise InputError(f"{path}: found a directory, expected the name of a file to write")
            if is_device(path):
                if not os.access(path, os.W_OK):
                    raise InputError(f"{path}: no permission to write there")
                continue
            _check_writable(path, path.parent)
            if path.suffix == ".csv":
                check_description(path)
            self._before[path] = _identity(path)

    def left_behind(self) -> str:
        """Return which of these files an interrupted command has written, and how to go on."""
        written = [str(p) for p, before in self._before.items() if _identity(p) != before]
        if not written:
            return NOTHING_WRITTEN
        return f"complete: {', '.join(written)}. Run the same command again for the rest."

    def read(self, paths: Sequence[Path], need: Need | None = None) -> Table:
        """Read the measurement table of the command and print its warnings."""
        refuse_models(paths)
        try:
            with self.working("reading") as tell:
                table = read_table(
                    list(paths),
                    meta=self.meta,
                    skip_bad_rows=self.skip_bad_rows,
                    need=need,
                    progress=tell,
                )
        except InputError as error:
            is_known = error.remedy is not None and error.remedy.command != IMPORT
            if isinstance(error, BadRows):
                is_known = not error.most  # where most rows are bad, the file may be a log
            logs = (path for path in paths if not _is_table(path))
            if not is_known and (log := next(logs, None)):
                error.remedy = way_in(log, self.meta) or error.remedy
            raise
        self.warn(*brief(table.warnings, paths))
        return table

    def files_of(self, **options: object) -> dict[str, str]:
        """The command itself and its files by the names that a remedy has for them."""
        files = {"DATA": "data.csv", "MODEL": "model.json"}
        files["AGAIN"] = shlex.join(["ecm", *command.typed])
        for name in ("data", "model", "out"):
            given = options.get(name) or (name == "data" and options.get("plan"))
            if given:
                parts = given if isinstance(given, list | tuple) else [given]
                files[name.upper()] = " ".join(shlex.quote(str(part)) for part in parts)
        if options.get("data") and options.get("out", "") is None:
            files["OUT"] = shlex.quote(str(model_named_after(options["data"])))
        if self.meta is not None and options.get("data"):
            files["DATA"] += f" --meta {shlex.quote(str(self.meta))}"
        return files

    def write_json(self, document: Any) -> None:
        """Write the file of --json, where it is asked for."""
        if self.json is not None:
            write_json(self.json, document)

    def write_result(self, **fields: Any) -> None:
        """Write these fields there."""
        self.write_json({"schema": 1, **fields})


def run_command(
    work: Callable[..., None], options: Mapping[str, Any], common: Mapping[str, Any]
) -> None:
    """Do the work of a command: a function of a session of the common options, and of its own."""
    with Session(**common) as session:
        session.check_output(session.json, session.report)
        if session.report is not None:
            require_report()
        try:
            work(session, **options)
            session.report_said()
        except EcmError as error:
            if isinstance(error, Refusal) and error.remedy is not None:
                if error.remedy.command == LEAVE_OUT and "skip_bad_rows" in common:
                    error.remedy = Remedy(error.remedy.words, "AGAIN --leave-out")
                error.remedy = error.remedy.filled(session.files_of(**options))
            # The refusal itself counts, not a disk that is full as well.
            with suppress(EcmError, OSError):
                session.write_result(error=document_of(error))
            raise
