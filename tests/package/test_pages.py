"""README, tutorials, guides, explanations and notebooks run as they stand, with what they print."""

from __future__ import annotations

import re
import runpy
import shutil
from pathlib import Path

import pytest

from docsite.notebook_page import NOTEBOOKS
from docsite.notebook_page import page as notebook_page
from ecm.models import PhysicsMap
from support.jobs import copy_cases
from support.neck import ROOT
from support.pages import blocks, follow, run_here

PAGES = [
    ROOT / "docs" / "measure.md",
    *sorted(
        page
        for part in ("tutorials", "howto", "explain")
        for page in (ROOT / "docs" / part).glob("*.md")
        if any(block.language in ("python", "sh") for block in blocks(page))
    ),
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_runs_and_prints_what_it_says(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    follow(blocks(page), page.name, tmp_path, run_here)


def test_the_readme_runs_but_for_the_two_commands_of_make(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick_job: Path, neck_physics: PhysicsMap
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    copy_cases(quick_job, tmp_path / "simulated.parts")  # `ecm simulate` goes on from them
    found = [b for b in blocks(ROOT / "README.md") if "make demo" not in b.text]
    assert found
    follow(found, "README.md", tmp_path, run_here)


GIVEN = {
    "README.md": {"1.89", "3.10", "3.11", "7.3"},  # versions
    "choose_a_model.md": {"0.49"},
    "first_rig.md": {"0.118"},
    "noise.md": {"0.5"},
    "own_data.md": {"0.436"},
}
"""Numbers of the text that no block prints: they are given."""


def not_printed(text: str) -> set[str]:
    """Decimal numbers of a page that are no rounding, or percentage, of one in its blocks."""
    fence = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
    printed = [
        float(n) for n in re.findall(r"\d+(?:\.\d+)?(?:e-?\d+)?", "".join(fence.findall(text)))
    ]
    prose = re.sub(
        r"`[^`]*`|!\[[^]]*\]|\]\([^)]*\)|^(?:\||    ).*$", "", fence.sub("", text), flags=re.M
    )
    found = set(re.findall(r"(?<![\w.])\d+\.\d+(?![\w.]*\d)", prose))
    return {
        word for word in found
        if not any(round(n, len(word.split(".")[1])) == float(word) for k in printed
                   for n in (k, 100.0 * k))
    }  # fmt: skip


@pytest.mark.parametrize(
    "page",
    [
        page
        for page in (ROOT / "README.md", *PAGES)
        if page.parent.name in (ROOT.name, "tutorials", "howto")
        and any(block.language == "text" for block in blocks(page))
    ],
    ids=lambda page: page.stem,
)
def test_numbers_of_the_text_are_those_that_its_blocks_print(page: Path) -> None:
    assert not_printed(page.read_text(encoding="utf-8")) == GIVEN.get(page.name, set())


def test_a_number_of_the_text_that_nothing_prints_is_noticed() -> None:
    page = "```text\nerror 9.554 and 0.12\n```\nIt errs {} times the noise, 12.0 %.\n"
    assert not_printed(page.format("9.6")) == set()
    assert not_printed(page.format("9.7")) == {"9.7"}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    runpy.run_path(str(path))
    printed = capsys.readouterr().out
    # Its words stand on these figures.
    if path.stem == "three_stiffnesses":
        assert re.search(r"energy4 +work of one turn +-?0\.0000 mJ", printed)
        assert "energy4  skew part of H over H: 0e+00" in printed
    else:
        error = {
            n: float(e) for n, e in re.findall(r"(\w+) +held-out error: fy +([\d.]+)", printed)
        }
        assert error["energy5"] < error["energy4"] < 0.1 * error["linear"]
    assert "```python" in notebook_page(path)
