"""The command line: a registry of commands, each loaded from its file only when it is called."""

from __future__ import annotations

from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from ecm._native import __version__
from ecm.cli.application import new_application

COMMANDS = {
    "identify": "Simulate, select, measure, identify: mesh to report.",
    "simulate": "Wrenches to poses by FEM.",
    "fit": "A model of measured or simulated pairs.",
    "predict": "A model's wrench and stiffness at given poses.",
    "design": "The poses worth measuring, as a plan.",
    "campaign": "A simulated rig measures a plan.",
    "import": "A log of any kind as a table.",
    "check": "Columns, units, what will be testable.",
    "compare": "Noise floor, excess error, where.",
    "diagnose": "Which effect is missing.",
    "refit": "Add or remove an effect and fit again.",
    "reveal": "Open a sealed truth and score an answer.",
    "effects": "The physical effects that can be named.",
    "material": "A material from tests.",
    "export": "A model as C or Rust for a controller.",
    "app": "The whole loop in a browser.",
    "new": "A config, rig or data file to begin from.",
}
"""Every command with its line of `ecm --help`."""

_OF_BODIES_AND_RIGS = {
    "identify", "simulate", "design", "campaign", "reveal", "material", "app", "new"
}  # fmt: skip
"""Commands with their options in `options/rig.py`; the others have them in `options/tables.py`."""

MOVED = {
    "head": "is an example of the repository now: in a copy of "
    "https://github.com/ecm-stiffness/ecm type `python examples/head --out DIR` (docs/head.md)",
}
"""Commands of earlier versions, and where their work is done now."""

_FUNCTIONS = {"import": "import_log", "app": "serve"}
"""The function of a command whose name is taken."""


def function_of(name: str) -> str:
    """Return the name of a command's function, here and in `ecm`."""
    return _FUNCTIONS.get(name, name)


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

    def format_options(self, ctx: Any, formatter: Any) -> None:
        # One line, so that all commands fit on one screen.
        formatter.write("Options: --version, --help (also of each command)\n")
        self.format_commands(ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and args[0] in MOVED:
            from ecm.errors import InputError  # noqa: PLC0415 - help loads no engine

            raise InputError(f"ecm {args[0]} {MOVED[args[0]]}")
        if args and args[0] not in COMMANDS:  # the parser suggests names of this mapping
            self.commands: Any = dict.fromkeys(COMMANDS)
        return super().resolve_command(ctx, args)


def load_command(name: str) -> Any:
    """Return the parser of one command, or of a group of commands (a typer application)."""
    file = "rig" if name in _OF_BODIES_AND_RIGS else "tables"
    function = getattr(import_module(f"ecm.cli.options.{file}"), function_of(name))
    if not isinstance(function, typer.Typer):
        single = new_application()
        single.command(name)(function)
        function = single
    return get_command(function)


_HELP = "Stiffness of continuum mechanisms: from a mesh to a model and its effects."
app = new_application(name="ecm", cls=_Commands, help=_HELP, no_args_is_help=True)


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
