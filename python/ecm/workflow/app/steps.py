"""Each step of the loop as the command line of `ecm` that does the same, in the session folder."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from ecm.effects import get_effect, load_installed
from ecm.errors import InputError, Remedy
from ecm.io.cache import write_atomically

PLAN, RIG = "plan.csv", "rig.toml"
DEMO_FILES = (PLAN, "plan.toml", RIG)
_FILES = Path(__file__).parent / "demo"


def write_demo(folder: Path) -> None:
    """Write plan and rig into a session folder; the campaign is a step.

    Raises
    ------
    InputError
        Where the folder has other files of these names.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as name:
    ...     write_demo(Path(name))
    ...     sorted(path.name for path in Path(name).iterdir())
    ['plan.csv', 'plan.toml', 'rig.toml']
    """
    files = {folder / name: (_FILES / name).read_bytes() for name in DEMO_FILES}
    for path, content in files.items():
        if path.exists() and path.read_bytes() != content:
            raise InputError(
                f"{path} is there already, and not that of the demo: name another folder with "
                "--session"
            )
    for path, content in files.items():
        write_atomically(path, content)


_HIDDEN = ("random=5", "8")
"""What the demo hides and its seed: five times the noise, so that it is seen in every picture."""


@dataclass(frozen=True)
class Files:
    """The files that a step works on: those that count now."""

    data: list[str]
    model: str | None = None
    answer: str | None = None
    """The last diagnosis of these data, of whichever model."""
    next_plan: str | None = None
    dropped: list[str] = field(default_factory=list)
    """The files that were dropped last, together: tables, or logs to import."""
    described: frozenset[str] = frozenset()
    """Those of them with a description beside them."""
    sealed: str | None = None
    """Table of a simulated campaign whose truth is sealed."""
    simulated: bool = False
    """The rig that measured it is described in the session."""
    skip_bad_rows: bool = False
    """These tables were checked without their bad rows: so is every later step."""


@dataclass(frozen=True)
class Command:
    """Arguments of `ecm`, and the files that they write."""

    argv: list[str]
    outputs: list[str]


Request = Mapping[str, Any]


_ANY, _WORDS, _TARGET = r"(?s).*", r"[A-Za-z0-9 ,/^*.-]{0,80}", "c|rust|mujoco"
_NUMBER = r"\d{0,6}\.?\d{0,9}(e-?\d)?"
_MODEL = r"[A-Za-z][A-Za-z0-9:+_-]{0,60}"
_EXPECTED = {
    _ANY: "a text",
    _WORDS: "letters, digits, commas and spaces",
    _TARGET: "c, rust or mujoco",
    _NUMBER: "a number above 0",
    _MODEL: "the name of a model, as energy6 or cubic",
}
_OPTIONS: dict[str, dict[str, str | list[str] | None]] = {
    "import": {
        **{"map": [_ANY], "ignore": [_ANY], "group": _ANY},
        **{"rotation": _WORDS, "units": _WORDS, "axis": _WORDS, "leave_out": None},
    },
    "fit": {"model": _MODEL, "add": [_ANY], "curve": None, "force": None},
    "refit": {"add": [_ANY], "remove": [_ANY], "freeze": [_ANY], "force": None},
    "export": {"to": _TARGET, "mass": _NUMBER, "inertia": _NUMBER, "at": _ANY, "force": None},
    "check": {"skip_bad_rows": None},
}
"""What a request may say of the options of its command: one text of a form, several, or a flag."""


def command_of(verb: str, request: Request, files: Files, number: int) -> Command:
    """Return the command of a step.

    Raises
    ------
    InputError
        For an unknown verb, a value out of its choices, or where an earlier step is needed first.
    """
    if verb not in _COMMANDS:
        raise InputError(f"no step {verb!r}; there are {', '.join(_COMMANDS)}")
    return _COMMANDS[verb](request, files, number)


def _options(verb: str, request: Request) -> list[str]:
    """The options of a command that a request names."""
    argv = []
    for name, form in _OPTIONS[verb].items():
        option, given = f"--{name.replace('_', '-')}", request.get(name) or ""
        if form is None:
            argv += [option] if given else []
            continue
        pattern, several = (form[0], given or []) if isinstance(form, list) else (form, [given])
        if not isinstance(several, list):
            raise InputError(f"{name}: expected a list of names")
        for text in several:
            if not isinstance(text, str) or not re.fullmatch(pattern, text):
                raise InputError(f"{name} {text!r}: expected {_EXPECTED[pattern]}")
            argv += [option, text] if text else []
    return argv


def request_of(command: str, files: Files) -> dict[str, Any] | None:
    """Return the request of the step that a remedy's command is; None where there is none.

    Parameters
    ----------
    command
        A command line, as a refusal names it. What it writes goes to files of the step's own.
    files
        The files that count now: a command of other files is no step.

    Examples
    --------
    >>> files = Files(data=["a.csv"], model="model-2.json")
    >>> request_of("ecm fit a.csv --model physics --out b.json", files)
    {'verb': 'fit', 'model': 'physics'}
    >>> request_of("ecm fit b.csv --model physics --out b.json", files) is None
    True
    """
    with suppress(ValueError, InputError):  # a quote without its end; what no step may say
        return _request(*shlex.split(command), files=files)
    return None


def way_out(remedy: Mapping[str, Any], files: Files) -> dict[str, Any]:
    """Return a remedy with the request of the step that does it, where one does."""
    return {**remedy, "request": request_of(remedy["command"], files)}


def _request(program: str = "", verb: str = "", *words: str, files: Files) -> dict[str, Any] | None:
    request: dict[str, Any] = {"verb": verb}
    known = _OPTIONS.get(verb, {})
    given, rest = [], iter(words)
    for word in rest:
        name = word.removeprefix("--").replace("-", "_")
        if (verb, name) == ("check", "leave_out"):  # which would change a file of the user's
            name = "skip_bad_rows"
        if word in _OWN:
            next(rest, "")
        elif not word.startswith("--") or name not in known:
            given.append(word)
        elif known[name] is None:
            request[name] = True
        elif isinstance(known[name], list):
            request.setdefault(name, []).append(next(rest, ""))
        else:
            request[name] = next(rest, "")
    if verb == "import" and given and given[0] in files.dropped[1:]:
        request["log"] = given[0]
    expected = {
        "import": given[:1] if given and given[0] in files.dropped else None,
        "check": files.data,
        "fit": files.data,
        "compare": [files.model, *files.data],
        "diagnose": [files.model, *files.data],
        "refit": [files.model, *files.data],
        "export": [files.model],
    }
    if program != "ecm" or given != expected.get(verb):
        return None
    command_of(verb, request, files, 0)
    return request


_OWN = ("--out", "--name", "--json", "--report", "--next", "--meta")
"""Options whose files and names are chosen by the step itself."""


def _check(request: Request, files: Files, n: int) -> Command:
    files = replace(files, skip_bad_rows=files.skip_bad_rows or bool(request.get("skip_bad_rows")))
    return Command(["check", *_data(files), "--json", f"check-{n}.json"], [f"check-{n}.json"])


def _import(request: Request, files: Files, n: int) -> Command:
    if not files.dropped:
        raise InputError("no file yet: drop a log or a table")
    log = request.get("log", files.dropped[0])
    if log not in files.dropped:
        raise InputError(f"log {log!r}: expected one of {', '.join(files.dropped)}")
    out, report = f"data-{n}.csv", f"import-{n}.json"
    meta = ["--meta", str(Path(log).with_suffix(".toml"))] if log in files.described else []
    argv = ["import", log, "--out", out, "--json", report, *meta, *_options("import", request)]
    return Command(argv, [out, f"data-{n}.toml", report])


def _fit(request: Request, files: Files, n: int) -> Command:
    model, report = f"model-{n}.json", f"fit-{n}.json"
    argv = ["fit", *_data(files), *_known_effects(_options("fit", request))]
    return Command([*argv, "--out", model, "--json", report], [model, report])


def _compare(_request: Request, files: Files, n: int) -> Command:
    outputs = [f"compare-{n}.json", f"compare-{n}.html"]
    argv = ["compare", _model(files), *_data(files), "--json", outputs[0], "--report", outputs[1]]
    return Command(argv, outputs)


def _diagnose(_request: Request, files: Files, n: int) -> Command:
    found, page, plan = f"found-{n}.json", f"found-{n}.html", f"next-{n}.csv"
    argv = ["diagnose", _model(files), *_data(files)]
    argv += ["--json", found, "--report", page, "--next", plan]
    return Command(argv, [found, page, plan, f"next-{n}.toml"])


def _refit(request: Request, files: Files, n: int) -> Command:
    model, report = f"model-{n}.json", f"refit-{n}.json"
    argv = ["refit", _model(files), *_data(files), *_known_effects(_options("refit", request))]
    return Command([*argv, "--out", model, "--json", report], [model, report])


def _known_effects(options: list[str]) -> list[str]:
    """Options as they are, where each effect in them is one: no other name is for a command."""
    load_installed()
    for option, name in pairwise(options):
        if option in ("--add", "--remove", "--freeze") and (option, name) != ("--freeze", "base"):
            get_effect(name)
    return options


def _example(request: Request, _files: Files, n: int) -> Command:
    """A table to begin with, or the neck on a simulated rig with an effect hidden."""
    name = request.get("name")
    if name == "neck":
        return _on_the_rig(PLAN, *_HIDDEN, n)
    if name not in ("1", "3", "6"):
        raise InputError(f"example {name!r}: expected neck, 1, 3 or 6 (degrees of freedom)")
    table = f"data-{n}.csv"
    return Command(["new", "data", "--dof", name, "--out", table], [table, f"data-{n}.toml"])


def _campaign(_request: Request, files: Files, n: int) -> Command:
    """The next plan of the diagnosis, on the same simulated rig."""
    if files.sealed is None or not files.simulated:
        raise InputError("no simulated rig in this session: measure the plan on your own rig")
    if files.next_plan is None:
        raise InputError("no next plan: diagnose first; not every experiment can be driven")
    return _on_the_rig(files.next_plan, files.sealed, str(100 + n), n)


def _on_the_rig(plan: str, hidden: str, seed: str, n: int) -> Command:
    table = f"data-{n}.csv"
    argv = ["campaign", plan, "--rig", RIG, "--hide", hidden, "--seed", seed, "--out", table]
    return Command(argv, [table, f"data-{n}.toml", f"data-{n}.truth.json"])


def _export(request: Request, files: Files, n: int) -> Command:
    folder, report = f"export-{n}", f"export-{n}.json"
    argv = ["export", _model(files), *_options("export", {"to": "c", **request})]
    return Command([*argv, "--out", folder, "--json", report], [report, folder])


def _reveal(_request: Request, files: Files, n: int) -> Command:
    if files.sealed is None:
        raise InputError("no sealed truth in this session: only a simulated campaign has one")
    truth = f"truth-{n}.json"
    answer = ["--answer", files.answer] if files.answer else []
    return Command(["reveal", files.sealed, *answer, "--json", truth], [truth])


_COMMANDS: dict[str, Callable[[Request, Files, int], Command]] = {
    "example": _example,
    "import": _import,
    "check": _check,
    "fit": _fit,
    "compare": _compare,
    "diagnose": _diagnose,
    "refit": _refit,
    "campaign": _campaign,
    "export": _export,
    "reveal": _reveal,
}


def _data(files: Files) -> list[str]:
    if not files.data:
        raise InputError("no table yet: drop one, or begin with the demo")
    return [*files.data, *(["--skip-bad-rows"] if files.skip_bad_rows else [])]


def _model(files: Files) -> str:
    if files.model is None:
        raise InputError(
            "no model yet", remedy=Remedy("fit one", "ecm fit DATA --model choose --out OUT")
        )
    return files.model
