"""The pages of columns and of effects follow the code; the templates run."""

from __future__ import annotations

import re
import runpy
from collections.abc import Callable
from pathlib import Path

import pytest

from ecm.io.columns import STANDARD, is_standard
from ecm.io.table import read_table
from support.neck import ROOT, Done

WRITER = runpy.run_path(str(ROOT / "docs" / "columns.py"))
EFFECTS = runpy.run_path(str(ROOT / "docs" / "effects_pages.py"))["pages"]()


def test_every_standard_column_is_in_the_guide_once() -> None:
    names = [name for guide in WRITER["COLUMN_GUIDE"] for name in guide.names]
    numbered = ["tendon1_N", "pressure_1_Pa", "volume_1_m3", "tension_1_N", "length_1_m"]
    assert sorted(names) == sorted([*STANDARD, *numbered])
    assert all(is_standard(name) for name in names)


def test_the_page_is_the_one_that_the_code_writes() -> None:
    made = WRITER["page"]()
    page = (ROOT / "docs" / "columns.md").read_text(encoding="utf-8")
    assert page == made, "run: python docs/columns.py"


@pytest.mark.parametrize("name", EFFECTS)
def test_the_pages_of_effects_are_those_that_the_code_writes(name: str) -> None:
    page = ROOT / "docs" / "effects" / name
    assert page.read_text(encoding="utf-8") == EFFECTS[name], "run: python docs/effects_pages.py"


def test_the_page_cites_files_that_exist() -> None:
    page = (ROOT / "docs" / "columns.md").read_text(encoding="utf-8")
    cited = set(re.findall(r"docs/[a-z_]+\.md", page))
    assert cited
    assert all((ROOT / name).is_file() for name in cited)


@pytest.mark.parametrize(("dof", "columns"), [("1", 2), ("3", 6), ("6", 12)])
def test_a_template_of_each_size_is_checked_and_fitted(
    dof: str, columns: int, tmp_path: Path, ecm_command: Callable[..., Done]
) -> None:
    made = ecm_command("new", "data", "--dof", dof, "--out", tmp_path / "d.csv")
    assert made.code == 0, made.err
    table = read_table(tmp_path / "d.csv")
    assert len((*table.pose_columns, *table.wrench_columns)) == columns
    fitted = ecm_command(
        "fit", tmp_path / "d.csv", "--model", "linear", "--out", tmp_path / "m.json"
    )
    assert fitted.code == 0, fitted.err
