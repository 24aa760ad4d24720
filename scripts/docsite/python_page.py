"""Pages of the Python interface, from the docstrings (whose examples `make test` runs)."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from importlib import import_module
from typing import Any, get_origin

from ecm.io.settings import meanings

ROOMS = (
    "ecm",
    "ecm.models",
    "ecm.effects",
    "ecm.comparison",
    "ecm.designs",
    "ecm.diagnosis",
    "ecm.rig",
    "ecm.report",
)
_TITLE = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)
_LISTS = ("Parameters", "Attributes", "Raises", "Returns", "Yields")


def name_of(room: str) -> str:
    """Name of the page of a part of the package."""
    return f"reference/python_{room.rpartition('.')[2]}.md"


def page(room: str) -> str:
    """Return the page of a part: each public name with its signature and docstring."""
    module = import_module(room)
    parts = [f"# {room}\n", _text(inspect.getdoc(module) or "")]
    for name in module.__all__:
        thing = getattr(module, name)
        if callable(thing) and get_origin(thing) is None:
            parts += [f"\n## {name}\n", *_entry(room, name, thing)]
        elif not name.startswith("_"):
            parts += [f"\n## {name}\n", f"```python\n{name} = {_short(thing)}\n```\n"]
    return "\n".join(parts) + "\n"


def _entry(room: str, name: str, thing: Any) -> Iterator[str]:
    kind = "class" if inspect.isclass(thing) else "def"
    home = f"{getattr(thing, '__module__', '')}.{getattr(thing, '__qualname__', '')}"
    yield f"```python\n{kind} {room}.{name}{_signature(thing)}\n```\n"
    if home != f"{room}.{name}" and room == "ecm" and home.rpartition(".")[2] != name:
        yield f"The same as `{home}`.\n"
    yield _docstring(inspect.getdoc(thing) or "")
    if inspect.isclass(thing):
        yield from _fields(thing)
        yield from _members(thing)


def _fields(cls: type) -> Iterator[str]:
    """What each field of a dataclass means, unless the docstring says it."""
    if not is_dataclass(cls) or "Parameters" in _TITLE.findall(inspect.getdoc(cls) or ""):
        return
    meaning = meanings(cls)
    found = [item for item in fields(cls) if item.init and meaning.get(item.name)]
    rows = [_row(f"`{item.name}`", meaning[item.name], _default(item)) for item in found]
    if rows:
        yield "\n".join(["| field | meaning | default |", "|---|---|---|", *rows, ""])


def _default(item: Field[Any]) -> str:
    return "" if item.default is MISSING else f"`{_value(item.default)}`"


def _members(cls: type) -> Iterator[str]:
    """Public methods and properties of a class, and of bases that no page names, a line each."""
    named = {name for room in ROOMS for name in import_module(room).__all__}
    bases = [kind for kind in cls.__mro__[1:] if kind.__module__.startswith("ecm.")]
    members = {**vars(cls)}
    for kind in bases:
        if kind.__name__ not in named:
            members = {**vars(kind), **members}
    rows = []
    for name, member in members.items():
        inner = member.__func__ if isinstance(member, (staticmethod, classmethod)) else member
        text = inspect.getdoc(inner)
        if name.startswith("_") or not text or not (callable(inner) or isinstance(inner, property)):
            continue
        call = "" if isinstance(inner, property) else "()"
        rows.append(_row(f"`{name}{call}`", " ".join(text.split("\n\n")[0].split())))
    if rows:
        yield "\n".join(["| member | meaning |", "|---|---|", *rows, ""])


def _row(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _signature(thing: Any) -> str:
    try:
        signature = inspect.signature(thing)
    except (TypeError, ValueError):
        return ""
    parameters = [_parameter(item) for item in signature.parameters.values()]
    returned = _word(signature.return_annotation)
    text = str(signature.replace(parameters=parameters, return_annotation=returned))
    if len(text) < 80:
        return text
    inside, _, returned = text[1:].rpartition(")")
    return "(\n" + "".join(f"    {part},\n" for part in _split(inside)) + f"){returned}"


class _Word:
    """Text that a signature shows as it is, without quotes."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text


def _word(annotation: Any) -> Any:
    return _Word(annotation.strip("'\"")) if isinstance(annotation, str) else annotation


def _parameter(item: inspect.Parameter) -> inspect.Parameter:
    default = item.default
    if default is not inspect.Parameter.empty:
        default = _Word(_value(default))
    return item.replace(annotation=_word(item.annotation), default=default)


def _value(default: Any) -> str:
    """A default as one would write it; a record of defaults is its class, a function its name."""
    if inspect.isroutine(default):
        return str(default.__name__)
    if is_dataclass(default) and not isinstance(default, type):
        return f"{type(default).__name__}({'' if default == type(default)() else '...'})"
    return repr(default).replace("<factory>", "...")


def _split(text: str) -> list[str]:
    """Arguments of a signature; commas inside brackets do not count."""
    parts, depth, begin = [], 0, 0
    for at, sign in enumerate(text):
        depth += (sign in "([{") - (sign in ")]}")
        if sign == "," and depth == 0:
            parts.append(text[begin:at].strip())
            begin = at + 1
    return [*parts, text[begin:].strip()]


def _docstring(text: str) -> str:
    """A NumPy-style docstring as Markdown."""
    pieces = _TITLE.split(text)
    parts = [_text(pieces[0])]
    for title, body in zip(pieces[1::2], pieces[2::2], strict=True):
        parts.append(f"**{title}**\n")
        if title == "Examples":
            parts.append(f"```python\n{body.strip()}\n```\n")
        else:
            parts.append(_listed(body) if title in _LISTS else _text(body))
    return "\n".join(parts)


def _listed(body: str) -> str:
    """`name` and its indented meaning, as a list."""
    items: list[list[str]] = []
    for line in body.strip().splitlines():
        if line[:1].strip():
            items.append([f"- `{line.strip()}`:"])
        elif items:
            items[-1].append(line.strip())
    return "\n".join(" ".join(word for word in item if word) for item in items) + "\n"


def _text(text: str) -> str:
    return text.strip() + "\n"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) < 200 else text[:200] + " ..."
