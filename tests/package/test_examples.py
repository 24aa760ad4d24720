"""Every `>>>` example of the package runs and prints what it says; every public name has one."""

from __future__ import annotations

import ast
import doctest
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from support.neck import ROOT

PACKAGE = ROOT / "python" / "ecm"
NO_EXAMPLE = {"ecm.__version__", "ecm.EcmError"}
"""Names that nobody calls: a text, and the class from which the three errors derive."""

PENDING: set[str] = set()
"""Public names that still lack an example. The list may only become shorter."""


def docstrings(path: Path) -> Iterator[tuple[str, int, str]]:
    """Name, first line and text of every docstring of a file that holds an example."""

    def walk(node: ast.AST, name: str) -> Iterator[tuple[str, int, str]]:
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            text = ast.get_docstring(node, clean=False) or ""
            if ">>>" in text:
                yield name, node.body[0].lineno, text
        # Expressions are most of the nodes, and none has a docstring.
        for child in (one for one in ast.iter_child_nodes(node) if not isinstance(one, ast.expr)):
            own = getattr(child, "name", None)
            yield from walk(child, f"{name}.{own}" if isinstance(own, str) else name)

    yield from walk(ast.parse(path.read_text(encoding="utf-8")), module_name(path))


def module_name(path: Path) -> str:
    """Dotted name of a file of the package."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


EXAMPLES = {
    name: (path, line, text)
    for path in sorted(PACKAGE.rglob("*.py"))
    for name, line, text in docstrings(path)
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_prints_what_it_says(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path, line, text = EXAMPLES[name]
    variables = dict(vars(import_module(module_name(path))))
    example = doctest.DocTestParser().get_doctest(text, variables, name, str(path), line - 1)
    printed: list[str] = []
    result = doctest.DocTestRunner(verbose=False).run(example, out=printed.append)
    assert result.attempted > 0
    assert not result.failed, "".join(printed)


def public_names() -> dict[str, str]:
    """Public names, as a user writes them, with the place where they are defined.

    Names of `ecm` and of each room's `__init__`; constants and modules are left out, and a name
    that both offer is asked for once.
    """
    homes: dict[str, str] = {}
    rooms = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))
    for owner in ("ecm", *(f"ecm.{room}" for room in rooms)):
        module = import_module(owner)
        for name in getattr(module, "__all__", ()):
            thing = getattr(module, name)
            if callable(thing) and str(getattr(thing, "__module__", "")).startswith("ecm."):
                home = f"{thing.__module__}.{thing.__qualname__}"
                if home not in homes.values():
                    homes[f"{owner}.{name}"] = home
    return homes


def without_example() -> set[str]:
    """Public names for which neither the docstring nor one of a method shows an example."""
    return {
        name
        for name, home in public_names().items()
        if not any(shown == home or shown.startswith(f"{home}.") for shown in EXAMPLES)
    } - NO_EXAMPLE


def test_every_public_name_has_an_example() -> None:
    assert len(public_names()) > 80
    assert without_example() == PENDING
