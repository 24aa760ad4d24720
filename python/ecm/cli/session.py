"""What all commands share at work: reading tables, writing JSON, checking what will be written."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ecm.cli import application, interrupt
from ecm.cli.console import Console
from ecm.cli.outputs import Outputs
from ecm.errors import EcmError, Refusal, Remedy, exit_code, remedy_of
from ecm.io.cache import write_json
from ecm.io.row_errors import BadRows
from ecm.io.table import Need, Table, read_table
from ecm.report.page import require_report

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
    """A command at work: its common options, and what it prints, reads and writes."""

    def __init__(
        self,
        *,
        meta: Path | None = None,
        skip_bad_rows: bool = False,
        json: Path | None = None,
        report: Path | None = None,
        seed: int = 0,
        threads: int = 0,
        quiet: bool = False,
    ) -> None:
        super().__init__(quiet=quiet)
        self.meta, self.skip_bad_rows = meta, skip_bad_rows
        self.json, self.report = _stream(json), _stream(report)
        self.seed, self.threads = seed, threads
        self._outputs = Outputs()

    def print(self, text: str = "") -> None:
        """Print a line of the result; on stderr where stdout gets --json or --report."""
        to_stdout = _STDOUT in (self.json, self.report)
        if to_stdout:
            self.note(text)
        else:
            super().print(text)

    def __enter__(self) -> Session:
        interrupt.describe(self._outputs.sentence)
        return self

    def check_output(self, *paths: Path | None) -> None:
        """Raise InputError where a file could not be written; None is left out.

        An interruption tells which of the files are written.
        """
        self._outputs.check(*paths)

    def read(self, paths: Sequence[Path], need: Need | None = None) -> Table:
        """Read the measurement table of the command and print its warnings."""
        try:
            with self.working("reading") as tell:
                table = read_table(
                    list(paths),
                    meta=self.meta,
                    skip_bad_rows=self.skip_bad_rows,
                    need=need,
                    progress=tell,
                )
        except BadRows as error:
            error.remedy = Remedy(error.remedy.words, "AGAIN --skip-bad-rows")
            raise
        for warning in brief(table.warnings, paths):
            self.warn(warning)
        return table

    def files_of(self, options: object) -> dict[str, str]:
        """The command itself and its files by the names that a remedy has for them."""
        files = {"AGAIN": shlex.join(["ecm", *application.typed])}
        for option, name in (("data", "DATA"), ("model", "MODEL"), ("out", "OUT")):
            given = getattr(options, option, None)
            if given is not None:
                parts = given if isinstance(given, list | tuple) else [given]
                files[name] = " ".join(shlex.quote(str(part)) for part in parts)
        if self.meta is not None and "DATA" in files:
            files["DATA"] += f" --meta {shlex.quote(str(self.meta))}"
        return files

    def write_json(self, document: Any) -> None:
        """Write the file of --json, where it is asked for."""
        if self.json is not None:
            write_json(self.json, document)


def run_command(
    work: Callable[[Any, Session], None], options: object, common: Mapping[str, Any]
) -> None:
    """Do the work of a command: a function of its options and of a session of the common ones."""
    with Session(**common) as session:
        session.check_output(session.json, session.report)
        if session.report is not None:
            require_report()
        try:
            work(options, session)
        except EcmError as error:
            if isinstance(error, Refusal) and error.remedy is not None:
                error.remedy = error.remedy.filled(session.files_of(options))
            # The refusal itself counts, not a disk that is full as well.
            with suppress(EcmError, OSError):
                session.write_json(refusal(error))
            raise


def refusal(error: EcmError) -> dict[str, Any]:
    """What --json gets in place of a result: the message, the exit code and the way out."""
    remedy = remedy_of(error)
    return {
        "schema": 1,
        "error": {
            "message": error.message if isinstance(error, Refusal) else str(error),
            "exit_code": exit_code(error),
            "remedy": None if remedy is None else remedy.to_dict(),
        },
    }
