"""The tutorials, guides and explanations run as they stand, and print what they say."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from support.neck import ROOT
from support.pages import blocks, follow, run_here

PAGES = sorted(
    page
    for part in ("tutorials", "howto", "explain")
    for page in (ROOT / "docs" / part).glob("*.md")
    if any(block.language in ("python", "sh") for block in blocks(page))
)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_runs_and_prints_what_it_says(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    follow(blocks(page), page.name, tmp_path, run_here)
