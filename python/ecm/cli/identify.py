"""`ecm identify`: the paper's three steps and the loop after them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import (
    Json,
    Quiet,
    Report,
    Seed,
    Threads,
    keep_note,
    need_report,
    output,
    output_directory,
    save_json,
)

if TYPE_CHECKING:
    from ecm.workflow.identify import Console as JobConsole


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("identify", short_help="Simulate, select, measure, identify: mesh to report.")(
        identify
    )


def identify(
    *,
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="TOML; `ecm new config`.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="For the results.")],
    rig: Annotated[
        Path | None,
        typer.Option("--rig", metavar="RIG.toml", help="Measure on this rig, not CONFIG's."),
    ] = None,
    json: Json = None,
    report: Report = None,
    seed: Seed = 0,
    threads: Threads = 0,
    quiet: Quiet = False,
) -> None:
    """Simulate, select, measure, identify; then find the effect that was hidden."""
    from ecm.io.cache import write_atomically
    from ecm.workflow.config import read_config, with_rig
    from ecm.workflow.identify import identify as run

    with Console(quiet=quiet) as console:
        output(json, report)
        output_directory(out)
        need_report(report)
        keep_note(f"Finished stages are kept in {out}: the same command goes on there.")
        settings = read_config(config)
        if rig is not None:
            settings = with_rig(settings, rig)
        summary = run(settings, out, seed=seed, threads=threads, console=_shown(console))
        save_json(json, summary)
        if report is not None:
            write_atomically(report, (out / "report.html").read_bytes())


def _shown(console: Console) -> JobConsole:
    """The command's lines and bars, as the job wants them."""
    from ecm.workflow.identify import Console as Base

    class Shown(Base):
        """Draws."""

        def say(self, text: str = "") -> None:
            """A line."""
            console.say(text)

        def bar(self, title: str) -> Callable[..., None] | None:
            """A bar for the work that comes next."""
            return console.bar(title)

    return Shown()
