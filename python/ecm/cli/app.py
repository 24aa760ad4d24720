"""The command line: a registry of commands, each loaded from its file only when it is called."""

from __future__ import annotations

from itertools import groupby
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from ecm._native import __version__
from ecm.cli.command import Command, new_application, parsed

PLAN, RIG = "Plan and measure", "Simulated rig"
COMMANDS = {
    "import": Command(
        line="A log of any kind as a table.",
        work="tables.import_log", of="logs.importing.import_log",
        passed="rotation axis group leave_out", common="report",
    ),
    "check": Command(
        line="Columns, units, what will be testable.", work="tables.check", common="tables report",
    ),
    "fit": Command(
        line="A model of measured or simulated pairs.",
        work="models.fit", of="models.estimator.fit_model", passed="zero_at_home stable weights",
        common="tables report seed",
    ),
    "predict": Command(
        line="A model's wrench and stiffness at given poses.",
        work="models.predict", of="models.prediction.predict", passed="leverage",
        common="tables report",
    ),
    "compare": Command(
        line="Noise floor, excess error, where.",
        work="models.compare", common="tables report seed",
    ),
    "diagnose": Command(
        line="Which effect is missing.", work="diagnose.diagnose", common="tables report seed",
    ),
    "refit": Command(
        line="Add or remove an effect and fit again.",
        work="models.refit", of="models.refit.refit", passed="add remove freeze",
        common="tables report",
    ),
    "effects": Command(
        line="The physical effects that can be named.", work="diagnose.effects", common="report",
    ),
    "export": Command(
        line="A model as C or Rust for a controller.",
        work="models.export", of="models.export.files.export", passed="name precision force",
        common="tables report", hide="meta skip_bad_rows dt",
    ),
    "app": Command(
        line="The whole loop in a browser.",
        work="jobs.serve", of="workflow.app.server.serve", passed="model port demo",
        common="report",
    ),
    "simulate": Command(
        line="Wrenches to poses by FEM.", group=PLAN,
        work="jobs.simulate", of="fem.simulate.simulate", passed="scheduler",
        common="report seed threads",
    ),
    "design": Command(
        line="The poses worth measuring, as a plan.", group=PLAN,
        work="jobs.design", of="workflow.design.design designs.regressors.DesignSettings",
        passed="criterion how_many share metres_per_radian replicates ridge starts iterations "
        "time_limit_s",
        common="tables report seed",
        hide="share metres_per_radian replicates ridge search starts time_limit_s "
        "meta skip_bad_rows quiet seed",
    ),
    "material": Command(
        line="A material from tests.", group=PLAN,
        work="jobs.material", of="fem.material_fit.fit_material", passed="model use poisson_ratio",
        common="report",
    ),
    "new": Command(line="A config, rig or data file to begin from.", group=PLAN, work="tables.new"),
    "measure": Command(
        line="A real rig measures a plan, row by row.", group=PLAN,
        work="jobs.measure", common="report",
    ),
    "campaign": Command(
        line="A simulated rig measures a plan.", group=RIG,
        work="jobs.campaign", of="rig.run.run_campaign", passed="overwrite",
        common="report seed threads",
    ),
    "identify": Command(
        line="Simulate, select, measure, identify: mesh to report.", group=RIG,
        work="jobs.identify", common="report seed threads",
    ),
    "reveal": Command(
        line="Open a sealed truth and score an answer.", group=RIG, work="jobs.reveal",
        common="report",
    ),
}  # fmt: skip
"""Every command, with its line of `ecm --help`."""
MOVED = {
    "head": "is an example of the repository now: in a copy of "
    "https://github.com/ecm-stiffness/ecm type `python examples/head --out DIR` (docs/head.md)",
}
"""Commands of earlier versions, and where their work is done now."""


OLD_NAMES = {"skip-bad-rows": "leave-out"}
"""Names of options of earlier versions, which are still taken; `check` has both."""


class _Commands(TyperGroup):
    """The commands of the registry; the help of the group loads none of them."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in COMMANDS and cmd_name not in self.commands:
            self.commands[cmd_name] = load_command(cmd_name)
        return self.commands.get(cmd_name)

    def get_help_option(self, ctx: Any) -> Any:
        option = super().get_help_option(ctx)
        if option is not None:
            option.default = False  # typer loads a library to convert what is no bool
        return option

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        formatter.write(f"  {self.help}\n")

    def format_options(self, ctx: Any, formatter: Any) -> None:
        # One line, so that all commands fit on one screen.
        formatter.write("Options: --version, --install-completion, --help (also of commands)\n")
        self.format_commands(ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for title, names in groupby(COMMANDS, lambda name: COMMANDS[name].group):
            lines = "".join(f"  {name:<8}  {COMMANDS[name].line}\n" for name in names)
            formatter.write(f"{title}:\n{lines}")

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and args[0] in MOVED:
            from ecm.errors import InputError  # noqa: PLC0415 - help loads no engine

            raise InputError(f"ecm {args[0]} {MOVED[args[0]]}")
        if args and args[0] not in COMMANDS:  # the parser suggests names of this mapping
            self.commands: Any = dict.fromkeys(COMMANDS)
        return super().resolve_command(ctx, args)


def load_command(name: str) -> Any:
    """Return the parser of one command; of `material` a group with its one command."""
    command = COMMANDS[name]
    made = new_application(old_names={} if name == "check" else OLD_NAMES)
    grouped = name == "material"
    made.command("fit" if grouped else name, short_help=command.line)(parsed(command))
    if grouped:
        made.callback(no_args_is_help=True, help="Materials from tests.")(lambda: None)
    return get_command(made)


_HELP = "Stiffness of continuum mechanisms: from a mesh to a model and its effects."
app = new_application(
    name="ecm", cls=_Commands, help=_HELP, no_args_is_help=True, add_completion=True
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"ecm {__version__}")
        raise typer.Exit


@app.callback(help=_HELP)
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Options of the program itself."""
