"""The pages of columns and effects, and the help of the page, are what scripts write."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from ecm.effects import effects_for, get_effect
from ecm.io.columns import POSE_OFFSETS, STANDARD, is_standard
from ecm.io.table import read_table
from support.neck import ROOT, Command

DOCS = ROOT / "docs"
WRITER, EFFECTS, WORDS = (
    runpy.run_path(str(DOCS / f"{name}.py")) for name in ("columns", "effects_pages", "page_words")
)
WRITTEN = {
    DOCS / "columns.md": WRITER["page"],
    WORDS["WORDS"]: WORDS["page"],
    **{DOCS / "effects" / name: page for name, page in EFFECTS["pages"]().items()},
}
"""What writes each page of the scripts of docs/, by the file that is in the repository."""


def test_every_standard_column_is_in_the_guide_once() -> None:
    names = [name for guide in WRITER["COLUMN_GUIDE"] for name in guide.names]
    numbered = ["tendon1_N", "pressure_1_Pa", "volume_1_m3", "tension_1_N", "length_1_m"]
    assert sorted(names) == sorted([*STANDARD, *POSE_OFFSETS, *numbered])
    assert all(is_standard(name) for name in names)


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.name)
def test_a_page_is_the_one_that_the_code_writes(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == WRITTEN[path](), "see docs/: columns.py and others"


def test_every_effect_has_a_picture_or_its_page_says_why_not() -> None:
    effects = [(g, e) for g in EFFECTS["GROUPS"] for e in EFFECTS["family"](g)[1]]
    none = [(group, effect.id) for group, effect in effects if EFFECTS["drawn"](effect) is None]
    assert none == [("noise", "outliers")]
    page = WRITTEN[DOCS / "effects" / "noise.md"]()
    assert page.count("No picture: it leaves no curve.") == 1
    assert all((DOCS / "effects" / f"{group}.png").exists() for group, _ in effects)


@pytest.mark.parametrize("path", [EFFECTS[name] for name in ("NECK", "HINGE", "ARM")])
def test_a_docstring_says_what_each_parameter_of_each_form_is(path: Path) -> None:
    table = EFFECTS["rows_of"](path).table
    forms = [
        form
        for effect in effects_for(table.columns)
        if effect.missing(table) is None
        for form in effect.variants(table)
    ]
    said = [EFFECTS["meaning"](form, one.name) for form in forms for one in form.parameters]
    assert len(said) > 10
    with pytest.raises(KeyError, match="does not say what nothing is"):
        EFFECTS["meaning"](get_effect("payload"), "nothing")


@pytest.mark.parametrize(("dof", "columns"), [("1", 2), ("3", 6), ("6", 12)])
def test_a_template_of_each_size_is_checked_and_fitted(
    dof: str, columns: int, tmp_path: Path, ecm_command: Command
) -> None:
    ecm_command("new", "data", "--dof", dof, "--out", tmp_path / "d.csv").good()
    table = read_table(tmp_path / "d.csv")
    assert len((*table.pose_columns, *table.wrench_columns)) == columns
    ecm_command("fit", tmp_path / "d.csv", "--model", "linear", "--out", tmp_path / "m.json").good()
