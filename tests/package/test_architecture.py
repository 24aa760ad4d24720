"""The rooms and arrows of the code are those that ARCHITECTURE.md states, and none runs back.

Imports are read from the source, those inside functions and under `TYPE_CHECKING` as well.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import pytest

from support.neck import ROOT

PACKAGE = ROOT / "python" / "ecm"
NATIVE = "_native"
MOST_ROOMS, MOST_FLOORS = 15, 9
MOST_EXCEPTIONS = 29
Graph = Mapping[str, set[str]]


def python_modules() -> dict[str, Path]:
    """Dotted name below `ecm` of every file; a package by its folder's name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def python_imports(source: str, modules: Iterable[str]) -> set[str]:
    """Modules below `ecm` that a source imports, anywhere in it."""
    known = {*modules, NATIVE}
    found = set()
    for node in ast.walk(ast.parse(source)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            if name.split(".")[0] != "ecm":
                continue
            parts = name.split(".")[1:]
            while parts and ".".join(parts) not in known:
                parts.pop()
            found.add(".".join(parts) or "ecm")
    return found


@cache
def python_graph() -> Graph:
    """Every module with what it imports; the doors `ecm` and `python -m ecm` are no rooms."""
    modules = python_modules()
    graph = {
        name: python_imports(path.read_text(encoding="utf-8"), modules) - {name}
        for name, path in modules.items()
    }
    del graph[""], graph["__main__"]
    return graph


def rooms(graph: Graph) -> dict[str, set[str]]:
    """The same between rooms: the folders and files at the top of the package."""
    found: dict[str, set[str]] = {}
    for module, imported in graph.items():
        room = module.split(".")[0]
        own = found.setdefault(room, set())
        own |= {name.split(".")[0] for name in imported} - {room}
    return found


def circles(graph: Graph) -> list[list[str]]:
    """Groups of nodes that reach each other, by repeatedly taking away what nothing blocks."""
    left = {node: set(edges) & set(graph) for node, edges in graph.items()}
    while True:
        ends = {node for node, edges in left.items() if not edges}
        used = set().union(*left.values()) if left else set()
        ends |= set(left) - used
        if not ends:
            return [sorted(left)] if left else []
        left = {node: edges - ends for node, edges in left.items() if node not in ends}


def floors(graph: Graph) -> dict[str, int]:
    """Floor of each node: one above the highest that it imports."""
    found: dict[str, int] = {}

    def floor(node: str) -> int:
        if node not in found:
            found[node] = 1 + max(
                (floor(other) for other in graph[node] if other in graph), default=0
            )
        return found[node]

    for node in graph:
        floor(node)
    return found


def stated(heading: str) -> dict[str, set[str]]:
    """The arrows of the list under a heading of ARCHITECTURE.md: `room → room, room`."""
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    block = text.split(heading, 1)[1].split("```", 2)[1]
    found = {}
    for line in block.splitlines():
        if "→" in line:
            room, others = line.split("→")
            found[room.strip()] = {name.strip() for name in others.split(",") if name.strip()}
    return found


def rust_graph(crate: Path) -> dict[str, set[str]]:
    """Files of a crate with those that their `use` lines name; tests are left out."""
    source = crate / "src"
    files = {}
    for path in sorted(source.rglob("*.rs")):
        parts = path.relative_to(source).with_suffix("").parts
        name = parts[:-1] if parts[-1] in ("mod", "lib", "main") else parts
        files["::".join(name)] = path.read_text(encoding="utf-8")
    graph: dict[str, set[str]] = {}
    for name, text in files.items():
        body = text.split("#[cfg(test)]")[0]
        found = set()
        for used in re.findall(r"^\s*(?:pub(?:\(crate\))? )?use ([^;]+);", body, re.MULTILINE):
            for path in spread(used.replace("\n", " ")):
                parts = [part.strip() for part in path.split("::")]
                base = name.split("::") if name else []
                if parts[0] == "crate":
                    parts = parts[1:]
                elif parts[0] == "super":
                    while parts and parts[0] == "super":
                        parts, base = parts[1:], base[:-1]
                    parts = base + parts
                elif parts[0] == "self":
                    parts = base + parts[1:]
                else:
                    continue
                while parts and "::".join(parts) not in files:
                    parts.pop()
                target = "::".join(parts)
                # A module's file names its parts; what a part takes from it is a real arrow.
                if target and target != name and not target.startswith(f"{name}::"):
                    found.add(target)
        graph[name] = found
    return {name: edges for name, edges in graph.items() if name}


def spread(path: str) -> list[str]:
    """`a::{b, c::{d}}` as `a::b`, `a::c::d`."""
    match = re.match(r"(.*?)\{(.*)\}\s*$", path, re.DOTALL)
    if match is None:
        return [path.split(" as ", maxsplit=1)[0]]
    parts, depth, start = [], 0, 0
    inner = match.group(2)
    for i, sign in enumerate([*inner, ","]):
        depth += (sign == "{") - (sign == "}")
        if sign == "," and depth == 0:
            parts.append(inner[start:i].strip())
            start = i + 1
    return [found for part in parts if part for found in spread(match.group(1) + part)]


def test_the_python_rooms_and_their_arrows_are_those_of_the_page() -> None:
    known = stated("### Python")
    found = rooms(python_graph())
    assert set(found) == set(known)
    for room, imported in found.items():
        assert imported == known[room], f"{room}: ARCHITECTURE.md states other imports"


def test_the_house_is_small_and_no_arrow_runs_back() -> None:
    graph = python_graph()
    assert circles(graph) == []
    found = rooms(graph)
    assert circles(found) == []
    assert len(found) <= MOST_ROOMS
    assert max(floors(found).values()) <= MOST_FLOORS


@pytest.mark.parametrize("crate", sorted((ROOT / "crates").iterdir()), ids=lambda path: path.name)
def test_no_circle_in_a_crate(crate: Path) -> None:
    assert circles(rust_graph(crate)) == []


def test_the_crates_depend_on_those_of_the_page() -> None:
    known = stated("### Crates")
    for crate in sorted((ROOT / "crates").iterdir()):
        text = (crate / "Cargo.toml").read_text(encoding="utf-8")
        section = (
            text.split("[dependencies]", 1)[-1].split("\n[", 1)[0]
            if "[dependencies]" in text
            else ""
        )
        used = set(re.findall(r"^(ecm-\w+)", section, re.MULTILINE))
        assert used == known[crate.name], crate.name


@pytest.mark.parametrize(
    "source",
    [
        "from ecm.cli import tables",
        "def f():\n    from ecm.cli.tables import check",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import ecm.cli.tables",
    ],
)
def test_a_new_arrow_is_found_wherever_it_stands(source: str) -> None:
    modules = python_modules()
    graph = dict(python_graph())
    graph["io.table"] = graph["io.table"] | python_imports(source, modules)
    assert "cli" in rooms(graph)["io"]
    assert circles(graph)
    assert rooms(graph) != stated("### Python")


def test_exceptions_from_the_rules_are_few_and_say_why() -> None:
    """Late imports (PLC0415) and large functions (PLR09xx) are allowed where a line says why."""
    found = [
        (path.name, number, line)
        for folder in ("python", "tests", "benches", "scripts", "docs", "examples")
        for path in sorted((ROOT / folder).rglob("*.py"))
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if re.search(r"# noqa: PL", line)
    ]
    found = [place for place in found if place[0] != Path(__file__).name]
    assert len(found) <= MOST_EXCEPTIONS, found
    assert [place for place in found if not re.search(r"# noqa: PL\w+ - \w", place[2])] == []


def test_no_name_of_the_binding_is_renamed_at_its_import() -> None:
    """What the binding calls EnergyEvaluator is called so everywhere."""
    renamed = [
        (path.name, alias.name)
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module == "ecm._native"
        for alias in node.names
        if alias.asname is not None
    ]
    assert renamed == []


def test_no_docstring_and_no_help_begins_with_of() -> None:
    """A docstring says what its subject is, not only what it belongs to."""
    begins = re.compile(r'^\s*(?:"""|//[/!] )Of |(?:help|doc)="Of ', re.M)
    assert begins.search('    """Of a rod."""')
    assert begins.search("    /// Of a rod.")
    for folder in ("python", "benches", "scripts", "crates"):
        files = [p for p in (ROOT / folder).rglob("*.*") if p.suffix in (".py", ".rs")]
        assert files
        assert [p for p in files if begins.search(p.read_text(encoding="utf-8"))] == []
