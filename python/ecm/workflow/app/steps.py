"""Each step of the loop as the command line of `ecm` that does the same, in the session folder."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
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
_MODEL = re.compile(r"[A-Za-z][A-Za-z0-9:+_-]{0,60}")
_WORDS = re.compile(r"[A-Za-z0-9 ,/^*.-]{0,80}")


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
    optional: tuple[str, ...] = ()
    """Outputs that the command may leave out."""


Request = Mapping[str, Any]


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
    with suppress(ValueError):  # a quote without its end
        return _request(*shlex.split(command), files=files)
    return None


def _request(program: str = "", verb: str = "", *words: str, files: Files) -> dict[str, Any] | None:
    request: dict[str, Any] = {"verb": verb}
    given, rest = [], iter(words)
    for word in rest:
        name = word.removeprefix("--").replace("-", "_")
        if word in _OWN:
            next(rest, "")
        elif word in _FLAGS:
            request[name] = True
        elif word in _VALUES:
            request[name] = next(rest, "")
        elif word in _LISTS:
            request.setdefault(name, []).append(next(rest, ""))
        else:
            given.append(word)
    if verb == "import" and given and given[0] in files.dropped[1:]:
        request["log"] = given[0]
    known = {
        "import": given[:1] if given and given[0] in files.dropped else None,
        "check": files.data,
        "fit": files.data,
        "compare": [files.model, *files.data],
        "diagnose": [files.model, *files.data],
        "refit": [files.model, *files.data],
        "export": [files.model],
    }
    if program != "ecm" or given != known.get(verb):
        return None
    try:
        command_of(verb, request, files, 0)
    except InputError:
        return None
    return request


_OWN = ("--out", "--json", "--report", "--next", "--meta")
"""Options whose files are chosen by the step itself."""
_FLAGS = ("--force", "--leave-out", "--skip-bad-rows", "--curve")
_VALUES = ("--model", "--to", "--rotation", "--units", "--axis", "--group")
_LISTS = ("--map", "--ignore", "--add", "--remove", "--freeze")
"""The options that a request may have, as `request_of` reads them."""


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
    argv = ["import", log, "--out", out, "--json", report]
    if log in files.described:
        argv += ["--meta", str(Path(log).with_suffix(".toml"))]
    for option in ("map", "ignore"):
        for name in _names(request, option):
            argv += [f"--{option}", name]
    for option in ("rotation", "units", "axis"):
        value = request.get(option) or ""
        if not isinstance(value, str) or not _WORDS.fullmatch(value):
            raise InputError(f"{option} {value!r}: expected letters, digits, commas and spaces")
        if value:
            argv += [f"--{option}", value]
    group = request.get("group") or ""
    if not isinstance(group, str):
        raise InputError("group: expected the name of a column")
    if group:
        argv += ["--group", group]
    if request.get("leave_out"):
        argv.append("--leave-out")
    return Command(argv, [out, f"data-{n}.toml", report])


def _fit(request: Request, files: Files, n: int) -> Command:
    name = request.get("model", "")
    if not isinstance(name, str) or not _MODEL.fullmatch(name):
        raise InputError(f"model {name!r}: expected the name of a model, as energy6 or cubic")
    model, report = f"model-{n}.json", f"fit-{n}.json"
    argv = ["fit", *_data(files), "--model", name, "--out", model, "--json", report]
    argv += [f"--{option}" for option in ("curve", "force") if request.get(option)]
    return Command(argv, [model, report])


def _compare(_request: Request, files: Files, n: int) -> Command:
    outputs = [f"compare-{n}.json", f"compare-{n}.html"]
    argv = ["compare", _model(files), *_data(files), "--json", outputs[0], "--report", outputs[1]]
    return Command(argv, outputs)


def _diagnose(_request: Request, files: Files, n: int) -> Command:
    found, page, plan = f"found-{n}.json", f"found-{n}.html", f"next-{n}.csv"
    argv = ["diagnose", _model(files), *_data(files)]
    argv += ["--json", found, "--report", page, "--next", plan]
    description = f"next-{n}.toml"
    return Command(argv, [found, page, plan, description], (plan, description))


def _refit(request: Request, files: Files, n: int) -> Command:
    model, report = f"model-{n}.json", f"refit-{n}.json"
    argv = ["refit", _model(files), *_data(files)]
    load_installed()
    for option in ("add", "remove", "freeze"):
        for name in _names(request, option):
            if not (option == "freeze" and name == "base"):
                get_effect(name)  # the only names that reach a command line
            argv += [f"--{option}", name]
    if request.get("force"):
        argv.append("--force")
    return Command([*argv, "--out", model, "--json", report], [model, report])


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
    language = request.get("to", "c")
    if language not in ("c", "rust", "mujoco"):
        raise InputError(f"language {language!r}: expected c, rust or mujoco")
    folder, report = f"export-{n}", f"export-{n}.json"
    argv = ["export", _model(files), "--to", language, "--out", folder, "--json", report]
    if request.get("force"):
        argv.append("--force")
    return Command(argv, [report, folder])


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


def _names(request: Request, option: str) -> list[str]:
    names = request.get(option, [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"{option}: expected a list of names")
    return names
