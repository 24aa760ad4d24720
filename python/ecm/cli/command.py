"""The parser of a command: its options and the common ones; loads no engine.

The options of a command are a dataclass in `options`, whose fields are typer options and whose
docstring is the help. The work is a function of them and of a session. It stands below them where
it needs only the names of `ecm`, which are loaded when they are used:

    @dataclass(frozen=True, kw_only=True)
    class Options:
        '''Count the rows of tables.'''

        data: Data

    def rows(options: Options, session: Session) -> None:
        session.print(f"{len(session.read(options.data))} rows")

    rows = command(rows, Options, tables=True)

Longer work is a function of another file of `ecm.cli`, which is loaded when the options are parsed:
`check = command("tables.check", CheckArguments, tables=True)`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import MISSING, fields
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import typer

Data = Annotated[
    list[Path],
    typer.Argument(metavar="DATA...", help="Tables; several become runs of one."),
]
Out = Annotated[Path, typer.Option("--out", metavar="FILE", help="The file to write.")]
ModelFile = Annotated[
    str,
    typer.Argument(metavar="MODEL", help="Model file, or TOML with [mechanism] or [expression]."),
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


def command(
    work: str | Callable[..., None],
    options: type,
    *,
    tables: bool = False,
    report: bool = False,
    seed: bool = False,
    threads: bool = False,
    hide: Sequence[str] = (),
) -> Callable[..., None]:
    """Return a command as typer wants it: a function of all options.

    Parameters
    ----------
    work
        The function that does the work; or `FILE.NAME`, the function NAME of the file `FILE.py`,
        which is loaded when the command is called.
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
    module, _, function = work.partition(".") if isinstance(work, str) else ("", "", work.__name__)

    def run(**values: Any) -> None:
        from ecm.cli.session import run_command  # noqa: PLC0415 - help loads no engine

        shared = {name: values.pop(name) for name in common}
        if isinstance(work, str):
            found = getattr(import_module(f"ecm.cli.{module}"), function)
        else:
            found = work
        run_command(found, options(**values), shared)

    run.__name__, run.__doc__ = function, options.__doc__
    run.__annotations__ = {}  # the signature holds them, evaluated
    run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        _own_parameters(options)
        + [
            _parameter(name, _hidden(annotation) if name in hidden else annotation, default)
            for name, (annotation, default) in common.items()
        ]
    )
    return run


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
