"""Files, frames and dicts become a Table in public functions; nothing below knows another kind."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ecm
from ecm.errors import InputError
from ecm.io.table import TableLike, as_table, takes_table
from support.neck import ROOT

PACKAGE = ROOT / "python" / "ecm"
READER = PACKAGE / "io" / "table.py"
PUBLIC = {name for name in dir(ecm) if not name.startswith("_")}
# What a public class has of its bases is public, too.
PUBLIC |= {base.__name__ for name in PUBLIC for base in getattr(getattr(ecm, name), "__mro__", ())}


def functions(tree: ast.AST, holder: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    """The functions of a file, with `Holder.` before those of a class."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            yield f"{holder}{node.name}", node
        elif isinstance(node, ast.ClassDef):
            yield from functions(node, f"{node.name}.")


def names_in(node: ast.AST | None) -> set[str]:
    return set() if node is None else {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}


def arguments(function: ast.FunctionDef) -> list[ast.arg]:
    return [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]


def inner_functions_of_any_kind(sources: dict[str, str]) -> list[str]:
    """Functions that take any kind of table, or make one of it, and are not public."""
    found = []
    for where, source in sources.items():
        for name, function in functions(ast.parse(source)):
            public = name.split(".")[0] in PUBLIC and not name.split(".")[-1].startswith("_")
            takes = any("TableLike" in names_in(own.annotation) for own in arguments(function))
            if (takes or "as_table" in names_in(function)) and not public:
                found.append(f"{where}: {name}")
    return found


def sources() -> dict[str, str]:
    return {
        str(path.relative_to(PACKAGE)): path.read_text(encoding="utf-8")
        for path in sorted(PACKAGE.rglob("*.py"))
        if path != READER
    }


# No tables of measurements: predictions given as a model, and poses whose columns have names.
ALSO_MADE = {"models/fit.py: as_model", "models/evaluation.py: rows_of_poses"}


def test_only_public_functions_take_what_is_no_table() -> None:
    inner = set(inner_functions_of_any_kind(sources()))
    assert {name for name in inner if not name.startswith("workflow/")} == ALSO_MADE


def test_an_inner_function_that_takes_any_table_is_seen() -> None:
    taken = "def inner(table: TableLike) -> None: ...\n"
    made = "class Model:\n    def _rows(self, data):\n        return as_table(data)\n"
    assert inner_functions_of_any_kind({"a.py": taken, "b.py": made}) == [
        "a.py: inner", "b.py: Model._rows"
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["fit_model", "refit", "predict", "compare", "diagnose", "check"])
def test_public_functions_read_at_the_door(name: str) -> None:
    function = getattr(ecm, name)
    path = Path(inspect.getsourcefile(inspect.unwrap(function)) or "")
    own = dict(functions(ast.parse(path.read_text(encoding="utf-8"))))[function.__name__]
    decorators = {word for node in own.decorator_list for word in names_in(node)}
    assert "takes_table" in decorators
    assert "as_table" not in names_in(own)


def test_the_door_gives_a_table_and_keeps_the_signature(tmp_path: Path) -> None:
    @takes_table("fit")
    def count(table: TableLike, times: int = 1, *, meta: object = None) -> int:
        assert isinstance(table, ecm.Table)
        return times * len(table)

    assert str(inspect.signature(count)).startswith("(table: 'TableLike', times: 'int' = 1")
    columns = {"y_m": [0.0, 0.01], "fy_N": [0.0, 30.0]}
    path = tmp_path / "data.csv"
    ecm.Table(columns).write(path)
    assert count(columns) == count(path) == count(table=ecm.Table(columns)) == 2
    assert count(columns, 3) == 6
    with pytest.raises(InputError, match="times = 'two': expected a whole number"):
        count(columns, "two")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="times = the class int itself: expected a whole number"):
        count(columns, int)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no wrench column"):
        count({"y_m": [0.0]})
    with pytest.raises(TypeError, match="table"):
        count()  # type: ignore[call-arg]


def test_a_table_passes_the_door_once(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[object] = []

    def reading(data: object, **given: Any) -> ecm.Table:
        read.append(data)
        return as_table(data, **given)

    monkeypatch.setattr("ecm.io.table.as_table", reading)
    table = {"x_m": [0.0, 1e-3, 2e-3, 3e-3], "fx_N": [0.0, 9.0, 21.0, 30.0]}
    ecm.compare(ecm.fit_model(table, "linear"), table)
    assert sum(not isinstance(one, ecm.Table) for one in read) == 2


@pytest.mark.parametrize("function", [ecm.refit, ecm.predict, ecm.export])
def test_a_path_in_place_of_a_model_is_told_how_it_is_opened(function: Any) -> None:
    rest = {"to": "c", "directory": "build"} if function is ecm.export else {"table": {"x_m": [0]}}
    with pytest.raises(InputError, match=r"expected a Model, as ecm\.load_model opens one"):
        function("model.json", **rest)


def test_a_path_may_begin_at_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In Python no shell puts the home folder in: a folder of the name ~ was made."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    y = np.linspace(-0.01, 0.01, 9)
    table = as_table({"y_m": y, "fy_N": 3000.0 * y})
    table.write("~/table.csv")
    model = ecm.fit("~/table.csv", "linear")
    model.save("~/model.json")
    ecm.export(model, "c", "~/code")
    assert ecm.load_model("~/model.json").name == model.name
    made = {path.name for path in tmp_path.iterdir()}
    assert made == {"code", "model.json", "table.csv"}
