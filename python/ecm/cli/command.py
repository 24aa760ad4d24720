"""What all commands share: their common options, reading tables, writing JSON.

A command is a function of its own options, a dataclass whose fields are typer options, and of a
session, which holds the common ones:

    @dataclass(frozen=True, kw_only=True)
    class Options:
        data: Data

    @command(Options, tables=True)
    def check(options: Options, session: Session) -> None:
        '''Check the columns of a table.'''
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_type_hints

import typer

from ecm.cli import interrupt
from ecm.cli.console import Console
from ecm.cli.outputs import Outputs
from ecm.io.cache import write_json
from ecm.io.table import Need, Table, read_table
from ecm.report.page import require_report

T = TypeVar("T")

Data = Annotated[
    list[Path],
    typer.Argument(metavar="DATA...", help="Tables; several become runs of one."),
]
Out = Annotated[Path, typer.Option("--out", metavar="FILE", help="The file to write.")]
ModelFile = Annotated[
    str, typer.Argument(metavar="MODEL", help="Model file, or TOML with [mechanism].")
]

_COMMON: dict[str, tuple[Any, Any]] = {
    "meta": (
        Annotated[
            Path | None,
            typer.Option("--meta", metavar="FILE", help="Description, if not NAME.toml."),
        ],
        None,
    ),
    "skip_bad_rows": (
        Annotated[bool, typer.Option("--skip-bad-rows", help="Leave bad rows out; record them.")],
        False,
    ),
    "json": (
        Annotated[
            Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON.")
        ],
        None,
    ),
    "report": (
        Annotated[
            Path | None, typer.Option("--report", metavar="FILE", help="Write an HTML report.")
        ],
        None,
    ),
    "seed": (
        Annotated[
            int,
            typer.Option("--seed", metavar="N", min=0, help="Seed of the random generator."),
        ],
        0,
    ),
    "threads": (
        Annotated[
            int,
            typer.Option(
                "--threads", metavar="N", min=0, help="Threads; 0: all cores.", show_default=False
            ),
        ],
        0,
    ),
    "quiet": (Annotated[bool, typer.Option("--quiet", help="Print only errors.")], False),
}
"""The common options with their defaults, in the order of the help."""


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
        self.json, self.report = json, report
        self.seed, self.threads = seed, threads
        self._outputs = Outputs()

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
        table = read_table(list(paths), meta=self.meta, skip_bad_rows=self.skip_bad_rows, need=need)
        for warning in table.warnings:
            self.warn(warning)
        return table

    def write_json(self, document: Any) -> None:
        """Write the file of --json, where it is asked for."""
        if self.json is not None:
            write_json(self.json, document)


def command(
    options: type[T],
    *,
    tables: bool = False,
    report: bool = False,
    seed: bool = False,
    threads: bool = False,
    hide: Sequence[str] = (),
) -> Callable[[Callable[[T, Session], None]], Callable[..., None]]:
    """Make a command of a function (options, session).

    Parameters
    ----------
    options
        Dataclass of the command's own arguments and options.
    tables
        The command reads measurement tables: --meta and --skip-bad-rows.
    report
        The command has a page: --report.
    seed, threads
        Whether they change anything. Every command accepts them; else the help hides them.
    hide
        Common options that the help hides, so that it fits on one screen.
    """
    absent = {"report"} if not report else set()
    absent |= {"meta", "skip_bad_rows"} if not tables else set()
    common = {name: option for name, option in _COMMON.items() if name not in absent}
    hidden = {*hide, *(() if seed else ("seed",)), *(() if threads else ("threads",))}
    parameters = _own_parameters(options) + [
        _parameter(name, _hidden(annotation) if name in hidden else annotation, default)
        for name, (annotation, default) in common.items()
    ]

    def decorate(function: Callable[[T, Session], None]) -> Callable[..., None]:
        def run(**values: Any) -> None:
            session = Session(**{name: values.pop(name) for name in common})
            with session:
                session.check_output(session.json, session.report)
                if session.report is not None:
                    require_report()
                function(options(**values), session)

        run.__name__, run.__doc__ = function.__name__, function.__doc__
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {}  # the signature holds them, evaluated
        return run

    return decorate


def _own_parameters(options: type) -> list[inspect.Parameter]:
    hints = get_type_hints(options, include_extras=True)
    return [
        _parameter(
            item.name,
            hints[item.name],
            inspect.Parameter.empty if item.default is MISSING else item.default,
        )
        for item in fields(options)
    ]


def _parameter(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
    )


def _hidden(annotation: Any) -> Any:
    kind, option = get_args(annotation)
    option = copy(option)
    option.hidden = True
    return Annotated[kind, option]
