"""docs/tutorial.md runs as it stands, and ends with the right answer for other secrets too."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from test_readme import ROOT, Block, blocks, run

PAGE = ROOT / "docs" / "tutorial.md"
SEED = "--seed 4 "
OTHERS = (21, 22, 23)
"""Taken as they come; what they hide is not looked at."""


def follow(page: list[Block], folder: Path, seed: int | None) -> str:
    """Run the blocks in a folder; what the last one prints."""
    import sys

    printed = ""
    for block in page:
        where = f"tutorial.md:{block.line}"
        if block.language == "toml":
            (folder / block.name).write_text(block.text, encoding="utf-8")
            continue
        text = block.text if seed is None else block.text.replace(SEED, f"--seed {seed} ")
        if block.language == "python":
            printed = run([sys.executable, "-c", text], folder, where)
        else:
            assert block.language == "sh", where
            printed = run(["bash", "-euc", text], folder, where)
    return printed


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder after section 1."""
    folder = tmp_path_factory.mktemp("tutorial")
    follow(blocks(PAGE)[:2], folder, None)
    return folder


def test_the_page_ends_with_the_right_answer(planned: Path, tmp_path: Path) -> None:
    folder = tmp_path / "page"
    shutil.copytree(planned, folder)
    assert any(SEED in block.text for block in blocks(PAGE))
    assert "the answer is right" in follow(blocks(PAGE)[2:], folder, None)
    assert (folder / "compare.html").stat().st_size < 10e6
    assert (folder / "found.html").stat().st_size < 10e6


def test_so_it_does_for_secrets_that_nobody_chose(planned: Path, tmp_path: Path) -> None:
    right = 0
    for seed in OTHERS:
        folder = tmp_path / str(seed)
        shutil.copytree(planned, folder)
        right += "the answer is right" in follow(blocks(PAGE)[2:], folder, seed)
    assert right >= 2
