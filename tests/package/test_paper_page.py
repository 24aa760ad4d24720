"""docs/paper_tables.py rewrites every marked part of docs/paper.md, and nothing else."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from support.neck import ROOT

PART = re.compile(r"<!-- (?!end)([a-z ]+) -->\n.*?<!-- end -->", re.DOTALL)


def test_the_tables_of_a_job_replace_those_of_the_page(quick_job: Path, tmp_path: Path) -> None:
    page = tmp_path / "paper.md"
    before = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    page.write_text(before, encoding="utf-8")
    tables = runpy.run_path(str(ROOT / "docs" / "paper_tables.py"))
    tables["main"](quick_job, page)
    after = page.read_text(encoding="utf-8")
    assert PART.findall(after) == ["simulation", "table two", "table three", "models", "rest"]
    assert PART.sub("", after) == PART.sub("", before)
    assert "wrenches drawn" in after
    assert after != before

    page.write_text("# A page without marks\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="no part"):
        tables["main"](quick_job, page)
