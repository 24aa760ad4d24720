"""Errors of the package. Each message says where, what was found, what was expected, what to do.

All derive from `EcmError`. An outcome such as a solver that did not converge is a status in the
result, not an error.
"""

from __future__ import annotations

import json
import re
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ecm._native import DesignError, EcmError, FemError, ModelError

__all__ = [
    "ComputationError",
    "DesignError",
    "EcmError",
    "FemError",
    "InputError",
    "MissingExtra",
    "ModelError",
    "Refusal",
    "Remedy",
    "document_of",
    "exit_code",
    "remedy_of",
    "shortened",
    "shown",
    "visible",
]


_MOST_QUOTED = 80
"""Letters of a file's own text that a message quotes."""
_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)


@dataclass(frozen=True)
class Remedy:
    """The way out of a refusal: what to do, and the command that does it.

    Parameters
    ----------
    words
        What to do, as the begin of a sentence that a command may end.
    command
        A command line of `ecm`; empty where no command helps. DATA, MODEL and OUT stand for the
        files of the command that was refused, AGAIN for this command as it was typed. Where no
        command filled them in, it is shown as the call in Python that does the same.

    Examples
    --------
    >>> remedy = Remedy("fit the stated body", "ecm fit DATA --model physics --out OUT")
    >>> print(remedy.filled({"DATA": "neck.csv", "OUT": "neck2.json"}))
    Fit the stated body:
      ecm fit neck.csv --model physics --out neck2.json
    >>> print(remedy)
    Fit the stated body:
      better = ecm.fit(table, "physics")
    """

    words: str
    command: str = ""
    force: bool = False
    """Whether --force does all the same what was refused."""

    def filled(self, files: Mapping[str, str]) -> Remedy:
        """The remedy with the names of files in place of DATA, MODEL and so on."""
        names = "|".join(map(re.escape, files))
        if not names:
            return self
        command = re.sub(rf"\b({names})\b", lambda found: files[found[1]], self.command)
        return replace(self, command=command)

    def to_dict(self) -> dict[str, Any]:
        """For JSON: `words`, `command` and `force`."""
        return {"words": self.words, "command": self.command, "force": self.force}

    def __str__(self) -> str:
        """The words, and the command on a line of its own."""
        words = self.words[:1].upper() + self.words[1:]
        return f"{words}:\n  {self.shown}" if self.command else f"{words}."

    @property
    def shown(self) -> str:
        """The command; as calls in Python where it still stands without its files."""
        if not {"DATA", "MODEL"} & set(self.command.split()):
            return self.command
        parts = (shlex.split(part) for part in self.command.split(" && ") if part != "AGAIN")
        return "; ".join(_call(*words[1:]) for words in parts)


_IN_PYTHON = {"DATA": "table", "MODEL": "model"}
"""What a file is called in Python."""
_CALLS = {
    "import": "table = ecm.import_log(log).table",
    "check": "print(ecm.check(table))",
    "check --leave-out": "table = ecm.as_table(table, skip_bad_rows=True)",
    "export": "ecm.export({})",
    "fit": "better = ecm.fit({})",
    "refit": "better = ecm.refit({})",
}
"""The call of each command that a remedy names."""


def _call(verb: str, *words: str) -> str:
    """The call in Python of `ecm VERB WORDS`."""
    given: dict[str, list[str]] = {"": []}
    option = ""
    for word in words:
        if word.startswith("--"):
            option = word[2:]
            given.setdefault(option, [])
        else:
            given[option].append(_IN_PYTHON.get(word) or json.dumps(word))
            option = ""
    if "data" in given:
        given[""][0] += f".measured_at({given.pop('data')[0]})"
    if verb == "export":
        given["to"] += given["out"]
    added = given.pop("add", []) if verb == "fit" else []
    values = [value for key in ("", "to", "model") for value in given.pop(key, [])]
    values += [f"{key}={_value(words)}" for key, words in given.items() if key != "out"]
    verb = "check --leave-out" if "leave-out" in given else verb
    call = _CALLS[verb].format(", ".join(values))
    before, _, made = call.partition(" = ")
    return f"{before} = ecm.refit({made}, table, add={_value(added)})" if added else call


def _value(words: list[str]) -> str:
    """The value of an option in Python: one, several, or True of a flag."""
    return f"[{', '.join(words)}]" if len(words) > 1 else "".join(words) or "True"


class Refusal(EcmError):
    """An error of this package that may know its way out.

    Examples
    --------
    >>> Refusal("no length", remedy=Remedy("state it in the TOML")).message
    'no length'
    """

    def __init__(self, message: object = "", *, remedy: Remedy | None = None) -> None:
        super().__init__(message)
        self.message = str(message)
        """What was found and what was expected, without the way out."""
        self.remedy = remedy

    def __reduce__(self) -> tuple[Any, ...]:
        """From a process of its own it comes as it was, whatever its class is made from."""
        return type(self).__new__, (type(self), *self.args), self.__dict__

    def __str__(self) -> str:
        """The message, and the way out below it."""
        return self.message if self.remedy is None else f"{self.message}\n{self.remedy}"


class InputError(Refusal):
    """Wrong input: a value, a file, an option. The command line ends with exit code 2.

    Parameters
    ----------
    message
        Where, what was found, what was expected.
    remedy
        The way out, where there is one that can be named.

    Examples
    --------
    >>> from ecm.io.mechanism import Mechanism
    >>> try:
    ...     Mechanism(poisson_ratio=0.6)
    ... except InputError as error:
    ...     print(error)
    poisson_ratio = 0.6: expected a number from 0 to 0.5 (0.49 for rubber)
    >>> print(InputError("no length", remedy=Remedy("state it in the TOML")))
    no length
    State it in the TOML.
    """


class ComputationError(Refusal):
    """A failed computation (no convergence, full disk). The command line ends with exit code 1.

    Parameters
    ----------
    message
        Where, and what was found.
    remedy
        The way out, where there is one that can be named.

    Examples
    --------
    >>> exit_code(ComputationError("no pose of the workspace is stable"))
    1
    """


class MissingExtra(InputError):
    """An optional dependency that is not installed.

    Parameters
    ----------
    package
        Name of the missing package.
    extra
        Extra of this package that installs it.
    purpose
        What needs it.

    Examples
    --------
    >>> missing = MissingExtra("pyarrow", "data", "Reading a.parquet")
    >>> print(missing.message)
    Reading a.parquet needs the package pyarrow, which is not installed (extra data)
    >>> missing.remedy.command.partition(" -m ")[2]
    "pip install 'pandas>=2.2' 'pyarrow>=15'"
    """

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs the package {package}, which is not installed (extra {extra})",
            remedy=Remedy("install what it needs", _installs(extra)),
        )


def _installs(extra: str) -> str:
    """The command that installs the packages of an extra, into the Python that runs.

    By their names, it works from a checkout, from a wheel and from an index alike.
    """
    from importlib.metadata import PackageNotFoundError, requires  # noqa: PLC0415 - takes long

    try:
        stated = requires("ecm-stiffness") or []
    except PackageNotFoundError:  # run from its folder
        stated = []
    pairs = (line.partition(";") for line in stated)
    of_extra = re.compile(rf"\bextra == ['\"]{re.escape(extra)}['\"]")
    found = [package.strip() for package, _, when in pairs if of_extra.search(when)]
    packages = found or [f"ecm-stiffness[{extra}]"]
    return shlex.join([sys.executable or "python", "-m", "pip", "install", *packages])


def shown(value: object) -> str:
    """A value of a file as messages quote it, text in quotes; see `shortened`.

    Examples
    --------
    >>> print(shown("fx_N"), shown(2.5), shown([None] * 2))
    'fx_N' 2.5 [None, None]
    """
    return f"'{shortened(value)}'" if isinstance(value, str) else shortened(repr(value))


def shortened(text: str) -> str:
    """A cell, a name or a message of others, of which only the begin is shown where it is long.

    Parameters
    ----------
    text
        The text; up to 80 letters stay, in one line.

    Examples
    --------
    >>> shortened("fx_N")
    'fx_N'
    >>> print(shortened("x" * 50_000))
    xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx... (50000 letters)
    """
    text = text.replace("\n", "\\n").replace("\t", "\\t")
    if len(text) <= _MOST_QUOTED:
        return text
    return f"{text[: _MOST_QUOTED - 20]}... ({len(text)} letters)"


def visible(text: str) -> str:
    """Text with its control characters written out: a terminal obeys none that a file holds.

    Escape sequences colour or hide lines, a carriage return overwrites them, and the marks of
    writing directions turn them round. Line ends and tabs stay.

    Parameters
    ----------
    text
        What will be printed.

    Examples
    --------
    >>> print(visible("fx\x1b[2J_N"))
    fx\\x1b[2J_N
    """
    return _UNSEEN.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def exit_code(error: EcmError) -> int:
    """Return the exit code of the command line: 1 for a failed computation, 2 for wrong input."""
    return 1 if isinstance(error, ComputationError) else 2


def document_of(error: EcmError) -> dict[str, Any]:
    """Return what JSON says of an error: the message, the exit code and the way out.

    Examples
    --------
    >>> document_of(InputError("no length"))
    {'message': 'no length', 'exit_code': 2, 'remedy': None}
    """
    remedy = remedy_of(error)
    return {
        "message": error.message if isinstance(error, Refusal) else str(error),
        "exit_code": exit_code(error),
        "remedy": None if remedy is None else remedy.to_dict(),
    }


def remedy_of(error: BaseException) -> Remedy | None:
    """Return the way out that an error names; None where it names none.

    Examples
    --------
    >>> remedy_of(InputError("no model", remedy=Remedy("fit one", "ecm fit DATA --out OUT"))).words
    'fit one'
    """
    found = getattr(error, "remedy", None)
    return found if isinstance(found, Remedy) else None
