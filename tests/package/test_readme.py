"""Every code block of README.md but the two commands of make runs, in order, in one folder."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from ecm.models import PhysicsMap
from support.jobs import copy_cases
from support.neck import ROOT
from support.pages import blocks, follow, run_here


def test_the_blocks_of_the_page_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick_job: Path, neck_physics: PhysicsMap
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    copy_cases(quick_job, tmp_path / "simulated.parts")  # `ecm simulate` goes on from them
    found = [b for b in blocks(ROOT / "README.md") if "make demo" not in b.text]
    assert found
    follow(found, "README.md", tmp_path, run_here)
