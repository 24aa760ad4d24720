"""A command is a function of `ecm.cli`: its options are its signature and its docstring.

    def rows(session: Session, data: list[Path], *, most: Count = 10, **options: Any) -> None:
        '''Count the rows of tables.

        Parameters
        ----------
        most : N
            Rows to count at most.
        '''
        session.print(f"{min(most, len(session.read(data)))} rows")

What stands before `*` is an argument, the rest are options. The first paragraphs of the docstring
are the help. After the colon stands the word for the value, and before it the name of the option
where it is another one: `topics : --topic NAME`. `COMMANDS` of `ecm.cli.app` names the function.

What a public function states is not stated again: `passed` of the registry names the options that
go there as they are. Type, default and help come from there, and the command gets them by name or
among `options`. The options that all commands have are those of `Session`. All of it is read from
the source, so that help loads no engine.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, get_args, get_origin

import typer

Natural = Annotated[int, 0]
Count = Annotated[int, 1]
"""Whole numbers and the smallest of them."""

_SHARED = {
    "data": ("DATA...", "Tables; several become runs of one."),
    "model": ("MODEL", "Model file, or TOML with [mechanism] or [expression]."),
    "out": ("FILE", "The file to write."),
}
"""Words of the help for the files of many commands."""

_PACKAGE = Path(__file__).parents[1]
NO_NAMES: Mapping[str, str] = {}
typed: tuple[str, ...] = ()
"""The words after `ecm` of the command at work, for a remedy that repeats it."""


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command of the registry."""

    line: str
    """What it does, for `ecm --help`."""
    group: str = "Your data"
    """The title that it stands below there."""
    work: str
    """Its function, below `ecm.cli`."""
    of: str = ""
    """The public function that it calls, below `ecm`, and the class of its settings."""
    passed: str = ""
    """Parameters of these that are options as they are."""
    common: str = ""
    """Options of `Session`: tables (--meta, --skip-bad-rows), report, and seed and threads where
    they change anything. All commands take the last two; else the help hides them."""
    hide: str = ""
    """More options that the help leaves out, so that it is one screen."""


def new_application(*, old_names: Mapping[str, str] = NO_NAMES, **options: Any) -> typer.Typer:
    """Return a typer application with plain help and errors, which takes old names of options."""
    settings: dict[str, Any] = {"help_option_names": ["--help", "-h"], "max_content_width": 80}
    settings["token_normalize_func"] = lambda name: old_names.get(name, name)
    return typer.Typer(
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings=settings,
        **({"add_completion": False} | options),
    )


def parsed(command: Command) -> Callable[..., None]:
    """Return the function of all options of a command, as typer wants it."""
    text, own, words = _stated(f"cli.{command.work}")
    _, of_all, _ = _stated("cli.session.Session")
    public = {name: at for of in command.of.split() for name, at in _stated(of)[1].items()}
    for name in command.passed.split():
        text_there = public[name].text.partition(". ")[0].rstrip(".") + "."
        stated: dict[str, Any] = {"word": "", "text": text_there, "is_argument": False}
        own[name] = replace(public[name], **(stated | words.get(name, {})))
    absent = {"self"} | (set() if "report" in command.common else {"report"})
    absent |= set() if "tables" in command.common else {"meta", "skip_bad_rows"}
    hidden = {*command.hide.split(), *({"seed", "threads"} - set(command.common.split()))}
    del own["session"]
    shared = [option for name, option in of_all.items() if name not in absent]
    if "leave_out" in own:  # it records for good what the common one leaves out once
        hidden.add("skip_bad_rows")
        shared = [replace(o, word="") if o.name == "skip_bad_rows" else o for o in shared]

    def run(**values: Any) -> None:
        common = {option.name: values.pop(option.name) for option in shared}
        _function("session.run_command")(_function(command.work), values, common)

    run.__name__, run.__doc__ = command.work, text
    run.__annotations__ = {}  # the signature holds them, evaluated
    run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [option.of_typer(hidden=option.name in hidden) for option in (*own.values(), *shared)]
    )
    return run


def _function(name: str) -> Any:
    """A function below `ecm.cli`; its file is loaded now."""
    module, _, name = name.rpartition(".")
    return getattr(import_module(f"ecm.cli.{module}"), name)


@dataclass(frozen=True)
class _Option:
    """A parameter as the source of its function states it."""

    name: str
    annotation: ast.expr | None
    default: ast.expr | None
    is_argument: bool
    word: str = ""
    text: str = ""

    def of_typer(self, *, hidden: bool) -> inspect.Parameter:
        """As typer wants it."""
        word, text = (self.word, self.text) if self.text else _SHARED.get(self.name, ("", ""))
        default, kind, limits = _value(self.default), _value(self.annotation), []
        if get_origin(kind) is UnionType:  # of one name or several: an option is repeated
            kind = next((one for one in get_args(kind) if get_origin(one) is list), kind)
        if get_origin(kind) is Annotated:
            kind, *limits = get_args(kind)
        if get_origin(kind) is list and default == ():
            default = []
        names = [name for name in word.split() if name.startswith("--")]
        metavar = word.removeprefix(" ".join(names)).strip() or None
        made = (typer.Argument if self.is_argument else typer.Option)(
            *(names if names or self.is_argument else [f"--{self.name.replace('_', '-')}"]),
            metavar=metavar,
            help=text,
            hidden=hidden,
            show_default=default not in ([], "") and self.name != "threads",
            **dict(zip(("min", "max"), limits, strict=False)),
        )
        return inspect.Parameter(
            self.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=default,
            annotation=Annotated[kind, made],
        )


def _stated(function: str) -> tuple[str, dict[str, _Option], dict[str, dict[str, Any]]]:
    """The first paragraphs, the parameters and their words of a function that is not loaded."""
    module, _, name = function.rpartition(".")
    path = _PACKAGE.joinpath(*module.split(".")).with_suffix(".py")
    body = ast.parse(path.read_bytes()).body
    found: Any = next(node for node in body if getattr(node, "name", None) == name)
    text, _, section = (ast.get_docstring(found) or "").partition("\n\nParameters\n----------\n")
    words: dict[str, dict[str, Any]] = {}
    for item in re.split(r"\n(?=\S)", section.partition("\n\n")[0]):
        head, _, meaning = item.partition("\n")
        names, _, word = head.partition(" : ")
        found_words = {"word": word, "text": " ".join(meaning.split())}
        words |= dict.fromkeys(names.split(", "), found_words)
    of = next((node.args for node in ast.walk(found) if isinstance(node, ast.FunctionDef)), None)
    stated: list[tuple[str, Any, Any, bool]]
    if of is None:  # a class of settings: what `setting` is given, and the text below it
        stated = []
        for node, below in pairwise(found.body):
            match node, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(ast.Constant(str(meaning))):
                    default = getattr(node.value, "args", [node.value])[0]
                    stated.append((name, node.annotation, default, False))
                    words[name] = {"word": "", "text": " ".join(meaning.split())}
    else:
        defaults = [*[None] * (len(of.args) - len(of.defaults)), *of.defaults, *of.kw_defaults]
        stated = [
            (argument.arg, argument.annotation, default, argument in of.args)
            for argument, default in zip((*of.args, *of.kwonlyargs), defaults, strict=True)
        ]
    return text, {item[0]: _Option(*item, **words.get(item[0], {})) for item in stated}, words


class _Types(dict[str, Any]):
    """The types of options by name; any other type is given as a word."""

    def __missing__(self, name: str) -> type:
        return str


_TYPES = _Types(vars(builtins) | {"Natural": Natural, "Count": Count})
_TYPES |= {"Annotated": Annotated, "Literal": Literal, "Path": Path, "Sequence": list}


def _value(node: ast.expr | None) -> Any:
    """The value of an annotation or of a default; of none what says so in a signature."""
    return inspect.Parameter.empty if node is None else eval(ast.unparse(node), {}, _TYPES)
