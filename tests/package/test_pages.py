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


@pytest.mark.parametrize("name", ["models.md", "actuation.md"])
def test_python_of_a_page_with_parts_of_files_prints_what_it_says(
    name: str, tmp_path: Path
) -> None:
    page = ROOT / "docs" / name
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    found = [block for block in blocks(page) if block.language in ("python", "text")]
    assert [block.language for block in found].count("text") >= 1
    follow(found, page.name, tmp_path, run_here)


def test_the_readme_runs_but_for_the_two_commands_of_make(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick_job: Path, neck_physics: PhysicsMap
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    copy_cases(quick_job, tmp_path / "simulated.parts")  # `ecm simulate` goes on from them
    found = [b for b in blocks(ROOT / "README.md") if "make demo" not in b.text]
    assert found
    follow(found, "README.md", tmp_path, run_here)


OF_RECORDS = ("measure.md", "verdict.md")
"""Pages whose numbers are those of the benchmarks' records, beside a few that blocks print."""
GIVEN = {
    # Versions, times, a download.
    "README.md": {"1.89", "3.10", "3.11", "7.3", "18", "58", "60", "126"},
    "choose_a_model.md": {"0.49", "11"},
    "designs.md": {"100", "200"},
    "first_rig.md": {"0.118", "120"},
    "noise.md": {"0.5", "16"},
    "own_data.md": {"0.436"},
}
"""Numbers of the text that no block prints: they are given."""
UNIT = r"(?:N m|N mm|N/mm|N|mm|m|deg|degrees|rad|kPa|Pa|mJ|ms|s|min|h|Hz|kg|g|MB)\b|%"


def not_printed(text: str) -> set[str]:
    """Numbers of a page that are no rounding, or percentage, of one in its blocks.

    Of whole numbers those with a unit, in whatever thousandth of it, and those after "of".
    """
    fence = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
    printed = [
        float(n) for n in re.findall(r"\d+(?:\.\d+)?(?:e-?\d+)?", "".join(fence.findall(text)))
    ]
    prose = re.sub(
        r"`[^`]*`|!\[[^]]*\]|\]\([^)]*\)|^(?:\||    ).*$", "", fence.sub("", text), flags=re.M
    )
    decimal = re.findall(r"(?<![\w.])\d+\.\d+(?![\w.]*\d)", prose)
    whole = re.findall(rf"(?<![\w.,/])\d+(?= (?:{UNIT}))|(?<=\bof )\d+(?![\w.,]*\d)", prose)
    return {
        word for words, factors in ((decimal, (1.0, 100.0)), (whole, (1.0, 100.0, 1000.0)))
        for word in words
        if not any(round(factor * n, len(word.partition(".")[2])) == float(word)
                   for n in printed for factor in factors)
    }  # fmt: skip


@pytest.mark.parametrize(
    "page",
    [
        page
        for page in (ROOT / "README.md", ROOT / "docs" / "own_effect.md", *PAGES)
        if page.name not in OF_RECORDS and any(block.language == "text" for block in blocks(page))
    ],
    ids=lambda page: page.stem,
)
def test_numbers_of_the_text_are_those_that_its_blocks_print(page: Path) -> None:
    assert not_printed(page.read_text(encoding="utf-8")) == GIVEN.get(page.name, set())


def test_a_number_of_the_text_that_nothing_prints_is_noticed() -> None:
    page = "```text\nerror 9.554, 0.12 and 80 rows\n```\nIt errs {} times the noise, 12.0 %.\n"
    assert not_printed(page.format("9.6")) == set()
    assert not_printed(page.format("9.7")) == {"9.7"}
    for right, wrong in (("12 %", "13 %"), ("9554 N", "9555 N"), ("3 of 80", "3 of 81")):
        assert not_printed(page.format(right)) == set()
        assert len(not_printed(page.format(wrong))) == 1


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
