"""Options that several commands share, and what they do with files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from ecm.cli.console import Console
    from ecm.io.table import Need, Table

Json = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON.")
]
Report = Annotated[
    Path | None, typer.Option("--report", metavar="FILE", help="Write an HTML report.")
]
Seed = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Of every random number.")]
Threads = Annotated[
    int, typer.Option("--threads", metavar="N", min=0, help="0: all cores.", show_default=False)
]
HiddenSeed = Annotated[int, typer.Option("--seed", min=0, hidden=True)]
"""Every command takes it; here nothing is drawn."""
HiddenThreads = Annotated[int, typer.Option("--threads", min=0, hidden=True)]
"""Every command takes it; here nothing is long."""
Quiet = Annotated[bool, typer.Option("--quiet", help="Say only what is wrong.")]
Meta = Annotated[
    Path | None,
    typer.Option("--meta", metavar="FILE", help="Description, instead of NAME.toml beside it."),
]
SkipBadRows = Annotated[
    bool, typer.Option("--skip-bad-rows", help="Leave bad rows out and record them.")
]
Data = Annotated[
    list[Path], typer.Argument(metavar="DATA...", help="Tables; several are runs of one.")
]
Out = Annotated[Path, typer.Option("--out", metavar="FILE", help="The file to write.")]
ModelFile = Annotated[
    str, typer.Argument(metavar="MODEL", help="Model file, or TOML with [mechanism].")
]

_kept: list[str] = []


def keep_note(text: str) -> None:
    """Say this if the command is interrupted: what is kept and how to go on."""
    _kept[:] = [text]


def kept() -> str:
    """What an interrupted command leaves behind."""
    return _kept[0] if _kept else "Nothing was written."


def output(*paths: Path | None) -> None:
    """InputError now, not after the work, where a file could not be written."""
    from ecm.errors import InputError

    for path in paths:
        if path is None:
            continue
        if path.is_dir():
            raise InputError(f"{path}: found a directory, expected the name of a file to write")
        _writable(path, path.parent)


def output_plan(path: Path | None) -> None:
    """`output` of a plan: it replaces an older plan, nothing else, nor another's description."""
    from ecm.errors import InputError

    output(path)
    if path is None:
        return
    if path.is_file():
        with path.open(encoding="utf-8", errors="replace") as file:
            header = file.readline().strip()
        if header and "action" not in header.split(","):
            raise InputError(
                f"{path}: what stands there is no plan, and is not overwritten. Choose another "
                "name."
            )
        return
    beside = path.with_suffix(".toml")
    if beside.exists():
        raise InputError(
            f"{path}: beside it stands {beside}, which the plan's description would overwrite. "
            "Choose another name."
        )


def output_directory(path: Path) -> None:
    """InputError now where a directory could not be made or written into."""
    from ecm.errors import InputError

    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: found a file, expected a directory (or a new name)")
    _writable(path, path)


def _writable(path: Path, directory: Path) -> None:
    from ecm.errors import InputError

    nearest = directory.absolute()
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise InputError(f"{path}: {nearest} is a file, expected a directory. Check the path.")
    if not os.access(nearest, os.W_OK):
        raise InputError(f"{path}: no permission to write in {nearest}. Choose another place.")


def load(
    paths: Sequence[Path],
    console: Console,
    *,
    meta: Path | None = None,
    skip_bad_rows: bool = False,
    need: Need | None = None,
) -> Table:
    """The measurement table of a command, its warnings said."""
    from ecm.io.table import read_table

    table = read_table(list(paths), meta=meta, skip_bad_rows=skip_bad_rows, need=need)
    for warning in table.warnings:
        console.warn(warning)
    return table


def load_effects() -> None:
    """The effects that installed packages offer; InputError where one cannot be loaded."""
    from ecm.effects import load_installed
    from ecm.errors import EcmError, InputError

    try:
        load_installed()
    except EcmError:
        raise
    except Exception as error:
        raise InputError(
            f"an effect of an installed package (entry point ecm.effects) cannot be loaded: "
            f"{type(error).__name__}: {error}. Repair or remove that package."
        ) from None


def save_json(path: Path | None, document: Any) -> None:
    """The file of --json, where it was asked for."""
    if path is not None:
        from ecm.io.cache import write_json

        write_json(path, document)


def need_report(path: Path | None) -> None:
    """MissingExtra now where --report needs what is not installed."""
    if path is not None:
        from ecm.report.page import require_report

        require_report()
