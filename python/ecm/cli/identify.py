"""`ecm identify`: the paper's three steps and the loop after them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import Session, command
from ecm.cli.outputs import check_output_directory
from ecm.io.cache import write_atomically
from ecm.workflow.config import read_config, with_rig
from ecm.workflow.identify import identify as identify_mechanism


@dataclass(frozen=True, kw_only=True)
class Options:
    """Arguments of the command."""

    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", help="TOML file; see `ecm new config`.")
    ]
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the results.")]
    rig: Annotated[
        Path | None,
        typer.Option("--rig", metavar="RIG.toml", help="Measure on this rig, not CONFIG's."),
    ] = None


@command(Options, report=True, seed=True, threads=True)
def identify(options: Options, session: Session) -> None:
    """Simulate, select, measure, identify; then find the effect that was hidden."""
    out = options.out
    check_output_directory(out)
    session.on_interrupt(f"finished stages are kept in {out}. The same command goes on there.")
    config = read_config(options.config)
    if options.rig is not None:
        config = with_rig(config, options.rig)
    summary = identify_mechanism(
        config, out, seed=session.seed, threads=session.threads, console=session
    )
    session.write_json(summary)
    if session.report is not None:
        write_atomically(session.report, (out / "report.html").read_bytes())
