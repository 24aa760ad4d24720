"""The pages that the code writes hold every command, option, key and public name."""

from __future__ import annotations

from importlib import import_module

import pytest

import ecm
from docsite import cli_page, errors_page, python_page, settings_page
from ecm.cli.app import COMMANDS, load_command
from ecm.io.mechanism import Mechanism
from ecm.rig.settings import Procedure


def rows(page: str) -> list[list[str]]:
    """Cells of every row of the tables of a page, without heads and rules."""
    lines = [line for line in page.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in line.replace("\\|", "/")[1:-1].split("|")] for line in lines]


def test_every_command_and_option_is_there_with_its_meaning() -> None:
    page = cli_page.page()
    assert [name for name in COMMANDS if f"\n## ecm {name}\n" not in page] == []
    assert all(meaning for _, meaning, _ in rows(page))
    weights = next(row for row in rows(page) if row[0].startswith("`--weights`"))
    assert weights[2] == "`auto`"
    assert "`config/arm/rig/bench/data`" in [row[0] for row in rows(page)]
    assert {option.name for option in load_command("fit").params} > {"model", "pcr"}


def test_every_key_is_there_with_its_meaning_and_range() -> None:
    found = rows(settings_page.page())
    assert [key for key, meaning, _, _ in found if not meaning] == []
    keys = {key.strip("`") for key, *_ in found}
    for cls in (Mechanism, Procedure):
        assert set(cls.__dataclass_fields__) <= keys
    assert ["`poisson_ratio`", "0.49 for rubber.", "from 0 to 0.5", "`0.49`"] in found


def test_every_error_is_there_with_its_exit_code() -> None:
    found = {row[0].strip("`"): row for row in rows(errors_page.page())}
    assert set(found) >= {"ComputationError", "EcmError", "InputError", "MissingExtra"}
    assert found["ComputationError"][2] == "1"
    assert found["MissingExtra"][1:3] == ["`InputError`", "2"]


def test_defaults_are_written_as_in_a_call() -> None:
    page = python_page.page("ecm.diagnosis")
    assert "held_out: str = 'blocks'," in page
    assert "settings: DiagnosisSettings = DiagnosisSettings()," in page
    assert "assemble: Callable[..., Problem] = assemble," in page
    assert " at 0x" not in "".join(python_page.page(room) for room in python_page.ROOMS)


def test_a_field_has_its_meaning_unless_the_docstring_says_it() -> None:
    found = {row[0]: row[1:] for row in rows(python_page.page("ecm.diagnosis"))}
    assert found["`least_bic`"] == ["Fall of BIC that a name needs.", "`6.0`"]
    page = python_page.page("ecm")
    described = page.split("\n## Mechanism\n")[1].split("\n## ")[0]
    assert "| `poisson_ratio` | 0.49 for rubber. | `0.49` |" in described
    compared = page.split("\n## Comparison\n")[1].split("\n## ")[0]
    assert "| `row` | (N,) rows in the table, from 0. |" in compared
    assert "| `indices` |" not in page.split("\n## Design\n")[1].split("\n## ")[0]


def test_what_a_class_has_of_a_base_that_no_page_names_is_shown() -> None:
    page = python_page.page("ecm.models")
    model = page.split("\n## Model\n")[1].split("\n## ")[0]
    assert "| `predict()` |" in model  # of EvaluatedModel
    assert "| `fit()` |" in model
    assert "| `fit_map()` |" in page.split("\n## Expression\n")[1].split("\n## ")[0]


def test_the_name_of_a_type_is_shown_as_what_it_stands_for() -> None:
    assert "Shape = dict[str, float | str]" in python_page.page("ecm.effects")


@pytest.mark.parametrize("room", python_page.ROOMS)
def test_every_public_name_is_there_with_its_docstring(room: str) -> None:
    page = python_page.page(room)
    assert [
        n
        for n in import_module(room).__all__
        if not n.startswith("_") and f"\n## {n}\n" not in page
    ] == []
    assert "\n---" not in page.replace("\n|---", "")
    if room == "ecm":
        assert ">>> from ecm" in page or ">>> import" in page
        assert f"## {ecm.fit_model.__name__}" in page
