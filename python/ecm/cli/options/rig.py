"""The options of the commands on bodies, plans and rigs: what help and parsing need, no more."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import ecm
from ecm._native import criteria
from ecm.cli.application import new_application
from ecm.cli.command import Out, command

if TYPE_CHECKING:
    from ecm.cli.session import Session


class What(str, Enum):
    """Files that can be written."""

    config = "config"
    rig = "rig"
    data = "data"


class Dof(str, Enum):
    """Degrees of freedom of a table."""

    one = "1"
    three = "3"
    six = "6"


@dataclass(frozen=True, kw_only=True)
class NewArguments:
    """Write a commented file to begin from: config.toml, rig.toml, or data.csv with data.toml."""

    what: Annotated[What, typer.Argument(metavar="config|rig|data", help="Which file.")]
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Instead of the usual name.")
    ] = None
    dof: Annotated[
        Dof,
        typer.Option("--dof", metavar="1|3|6", help="Columns of data: one angle, three, or all."),
    ] = Dof.six


new = command("tables.new", NewArguments)


@dataclass(frozen=True, kw_only=True)
class SimulateArguments:
    """Simulate wrenches of the box by FEM and keep the poses of the admissible workspace."""

    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", help="TOML file; see `ecm new config`.")
    ]
    out: Out
    full_box: Annotated[
        bool, typer.Option("--full-box", help="Keep every stable pose of the wrench box.")
    ] = False
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler for the cases."),
    ] = None
    vtu: Annotated[
        Path | None,
        typer.Option("--vtu", metavar="DIR", help="Folder for ParaView files of the first poses."),
    ] = None


simulate = command("fem.simulate", SimulateArguments, seed=True, threads=True)


_FILE = "FILE"
_Tests = Annotated[list[Path] | None, typer.Option(metavar=_FILE, help="The same.")]


@dataclass(frozen=True, kw_only=True)
class MaterialArguments:
    """Fit a material to uniaxial, equibiaxial and pure-shear tests, with errors."""

    uniaxial: Annotated[
        list[Path] | None, typer.Option(metavar=_FILE, help="Stretch and nominal stress.")
    ] = None
    equibiaxial: _Tests = None
    pure_shear: _Tests = None
    model: Annotated[str, typer.Option(help="A material model by name (docs/fem.md), or auto.")] = (
        "auto"
    )
    terms: Annotated[int, typer.Option(min=1, max=4, help="Terms of ogden.")] = 2
    unit: Annotated[str, typer.Option(help="Pa, kPa, MPa; where no header names it.")] = ""
    order: Annotated[str, typer.Option(help="stretch-stress or stress-stretch.")] = ""
    use: Annotated[
        tuple[float, float], typer.Option(help="Stretches that the mechanism reaches.")
    ] = (0.5, 1.6)
    poisson_ratio: Annotated[float, typer.Option(help="These tests cannot show it.")] = 0.49
    out: Annotated[
        Path | None, typer.Option(metavar=_FILE, help="TOML with [mechanism.material].")
    ] = None


material = new_application(no_args_is_help=True, help="Materials from tests.")
material.command("fit", short_help="A material from tests.")(command("fem.fit", MaterialArguments))


@material.callback()
def _about() -> None:
    """Materials from tests."""


class Preset(str, Enum):
    """Protocols of a plan."""

    paper = "paper"
    diagnosable = "diagnosable"


class Search(str, Enum):
    """How to look for the design."""

    best = "best"
    paper = "paper"


@dataclass(frozen=True, kw_only=True)
class DesignArguments:
    """Choose the poses worth measuring (all options: docs/designs.md)."""

    candidates: Annotated[Path, typer.Argument(metavar="CANDIDATES", help="Table of poses.")]
    n: Annotated[int, typer.Option("--n", metavar="N", min=1, help="Poses to choose.")]
    out: Out
    criterion: Annotated[
        str,
        typer.Option("--criterion", metavar="NAME", help=f"{', '.join(c[0] for c in criteria())}."),
    ] = "d"
    model: Annotated[
        str | None,
        typer.Option("--model", metavar="NAME", help="cubic, poly:D, energyD, physics."),
    ] = None
    preset: Annotated[
        Preset | None,
        typer.Option("--preset", metavar="NAME", help="paper or diagnosable; else rows alone."),
    ] = None
    effects: Annotated[
        str | None, typer.Option("--effects", metavar="IDS", help="Effects to tell apart: ID,ID.")
    ] = None
    include: Annotated[
        str | None, typer.Option("--include", metavar="ROWS", help="Rows to take, e.g. 1,5-9.")
    ] = None
    exclude: Annotated[
        list[str] | None,
        typer.Option("--exclude", metavar="ROWS|REGION", help="E.g. 7 or x_m<0.09&y_m>0."),
    ] = None
    augment: Annotated[
        Path | None, typer.Option("--augment", metavar="FILE", help="Poses already measured.")
    ] = None
    base: Annotated[
        str | None,
        typer.Option("--base", metavar="MODEL", help="Nominal model: rows count by their noise."),
    ] = None
    rig: Annotated[
        Path | None, typer.Option("--rig", metavar="RIG", help="Rig file: its noise and times.")
    ] = None
    share: Annotated[float, typer.Option("--share", min=0.0, max=1.0, hidden=True)] = 0.5
    metres_per_radian: Annotated[float | None, typer.Option("--metres-per-radian", hidden=True)] = (
        None
    )
    how_many: Annotated[
        bool, typer.Option("--how-many", help="Also the expected error for each n up to N.")
    ] = False
    replicates: Annotated[bool, typer.Option("--replicates", hidden=True)] = False
    ridge: Annotated[float, typer.Option("--ridge", hidden=True)] = 0.0
    search: Annotated[Search, typer.Option("--search", hidden=True)] = Search.best
    starts: Annotated[int, typer.Option("--starts", min=1, hidden=True)] = 10
    iterations: Annotated[int, typer.Option("--iterations", min=0, hidden=True)] = 0
    time_limit: Annotated[float, typer.Option("--time-limit", min=0.0, hidden=True)] = 0.0


design = command(
    "jobs.design",
    DesignArguments,
    tables=True,
    report=True,
    seed=True,
    hide=("meta", "skip_bad_rows", "quiet"),
)


@dataclass(frozen=True, kw_only=True)
class CampaignArguments:
    """Drive the simulated rig through a plan and write what it measures."""

    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="Plan, as `ecm design` writes it.")]
    rig: Annotated[
        Path, typer.Option("--rig", metavar="RIG.toml", help="Rig file; see `ecm new rig`.")
    ]
    out: Out
    hide: Annotated[
        str | None,
        typer.Option(
            "--hide",
            metavar="EFFECT=S",
            help="Effect to hide, of strength S; or random, none, FIRST.csv (the same as there).",
        ),
    ] = None
    rigs: Annotated[
        int,
        typer.Option("--rigs", min=0, metavar="N", help="Measure on N rigs, each of its own seed."),
    ] = 0
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler for the rigs."),
    ] = None
    # They draw outside the package now; `ecm campaign` says where.
    film: Annotated[Path | None, typer.Option("--film", hidden=True)] = None
    phases: Annotated[Path | None, typer.Option("--phases", hidden=True)] = None
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace a table that is there already.")
    ] = False


campaign = command("jobs.campaign", CampaignArguments, seed=True, threads=True)


@dataclass(frozen=True, kw_only=True)
class IdentifyArguments:
    """Simulate, select, measure, identify; then find the effect that was hidden."""

    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", help="TOML file; see `ecm new config`.")
    ]
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the results.")]
    rig: Annotated[
        Path | None,
        typer.Option("--rig", metavar="RIG.toml", help="Measure on this rig, not CONFIG's."),
    ] = None


identify = command("jobs.identify", IdentifyArguments, report=True, seed=True, threads=True)


@dataclass(frozen=True, kw_only=True)
class RevealArguments:
    """Open the sealed NAME.truth.json and score an answer."""

    data: Annotated[Path, typer.Argument(metavar="DATA", help="Table of a simulated campaign.")]
    answer: Annotated[
        Path | None,
        typer.Option("--answer", metavar="FILE", help="JSON of diagnose, to be scored."),
    ] = None


def print_truth(options: RevealArguments, session: Session) -> None:
    """Run `ecm reveal`."""
    revealed = ecm.reveal(options.data, options.answer)
    session.write_json(revealed.to_dict())
    session.print(revealed.text())


reveal = command(print_truth, RevealArguments)


@dataclass(frozen=True, kw_only=True)
class AppArguments:
    """Go round the loop in a browser: data, model, where it fails, what is missing, add, next."""

    data: Annotated[
        list[Path] | None, typer.Argument(metavar="TABLE", help="Tables of a new session.")
    ] = None
    model: Annotated[
        str | None, typer.Option("--model", metavar="NAME", help="Model to fit at once.")
    ] = None
    port: Annotated[
        int, typer.Option("--port", metavar="P", min=0, max=65535, help="Port; 0: a free one.")
    ] = 0
    folder: Annotated[
        Path, typer.Option("--session", metavar="DIR", help="Folder of the session.")
    ] = Path("ecm-session")
    demo: Annotated[
        bool, typer.Option("--demo", help="Begin with the neck and a hidden effect.")
    ] = False
    browser: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in the browser.")
    ] = True


serve = command("jobs.serve", AppArguments)
