"""The page of the command line, from the parsers themselves."""

from __future__ import annotations

from typing import Any

from ecm.cli.app import COMMANDS, load_command

_HEAD = """# Commands

Each command of `ecm` with its arguments and options, as its parser knows them. `--help` after a
command prints the same. A command ends with an [exit code](errors.md): 0 done, 1 the computation
failed, 2 bad input, 130 interrupted.

All commands accept `--seed N` (the same seed gives the same bytes) and `--threads N` (0: all
cores; the number does not change a result), also where the tables below leave them out because
they change nothing.

## Completion by the shell

```sh
ecm --install-completion
```

once, then a new shell: the tab key completes commands, options and names of files, as in `ecm fi`,
tab, `fit`. It knows bash, zsh, fish and PowerShell, and adds a line to the start-up file of the
shell from which it is called. To see what it would install, or to write it elsewhere:
`ecm --show-completion`. An environment that is only there when it is active completes while it is.
"""


def page() -> str:
    """Return the page of all commands."""
    parts = [_HEAD]
    for name, command in COMMANDS.items():
        parts += _command(f"ecm {name}", load_command(name), command.line, 2)
    return "\n".join(parts) + "\n"


def _command(name: str, command: Any, line: str, level: int) -> list[str]:
    parts = [f"\n{'#' * level} {name}\n"]
    children = getattr(command, "commands", None)
    if children:
        parts.append(f"{line}\n")
        for child_name, child in children.items():
            parts += _command(f"{name} {child_name}", child, "", level + 1)
        return parts
    shown = [p for p in command.params if not getattr(p, "hidden", False) and p.name != "help"]
    arguments = [p for p in shown if p.param_type_name == "argument"]
    usage = " ".join([name, *(_argument(p) for p in arguments), "[OPTIONS]"])
    parts += [*_help(command.help or line), f"```text\n{usage}\n```\n"]
    parts += ["| argument or option | meaning | default |", "|---|---|---|"]
    for p in shown:
        parts.append(f"| {_names(p)} | {_cell(p.help or '')} | {_default(p)} |")
    return parts


def _help(text: str) -> list[str]:
    """Paragraphs of a help; indented lines stay as they are."""
    paragraphs = [part.strip("\n") for part in text.replace("\b", "").split("\n\n")]
    return [
        f"```text\n{part}\n```\n" if part.startswith("  ") else f"{part}\n"
        for part in paragraphs
        if part
    ]


def _argument(parameter: Any) -> str:
    name = parameter.metavar or parameter.name.upper()
    return str(name) if parameter.required else f"[{name}]"


def _names(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return f"`{_cell(_argument(parameter))}`"
    names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
    word = "" if parameter.is_bool_flag else (parameter.metavar or _choices(parameter))
    return f"{names} {_cell(word)}".rstrip()


def _choices(parameter: Any) -> str:
    return "|".join(
        getattr(choice, "value", choice) for choice in getattr(parameter.type, "choices", ())
    )


def _default(parameter: Any) -> str:
    if parameter.required:
        return "required"
    value = parameter.default
    value = getattr(value, "value", value)
    if value is None or value is False or callable(value) or value in ("", (), []):
        return ""
    return f"`{value}`" if value is not True else "on"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
