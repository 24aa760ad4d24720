"""docs/tutorial.md runs as it stands, and ends with the right answer for other secrets too.

So does docs/own_effect.md, whose effect the commands know once it is an installed package's; so
does the part of docs/designs.md that measures its candidates by two protocols.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ecm.models import PhysicsMap
from support.jobs import copy_cases
from support.neck import ROOT
from support.pages import Block, blocks, follow, run, run_apart, run_here

PAGE = ROOT / "docs" / "tutorial.md"
OWN = ROOT / "docs" / "own_effect.md"
DESIGNS = ROOT / "docs" / "designs.md"
SEED = "--seed 4 "
OTHERS = (21, 22, 23)
"""Taken as they come; what they hide is not looked at."""


def run_again(block: Block, folder: Path, where: str) -> str:
    """Run a block of a page that is also run as it stands: plain commands in this process."""
    return (run_apart if "if [" in block.text else run_here)(block, folder, where)


def run_python_apart(block: Block, folder: Path, where: str) -> str:
    """Run commands in this process, but Python, which may register effects, in one of its own."""
    return (run_apart if block.language == "python" else run_here)(block, folder, where)


def measured(folder: Path, seed: int | None = None) -> str:
    """What the page's last block prints after all but the plan, with that seed instead."""
    page = blocks(PAGE)[2:]
    if seed is None:
        return follow(page, PAGE.name, folder) or ""
    page = [replace(b, text=b.text.replace(SEED, f"--seed {seed} ")) for b in page]
    return follow(page, PAGE.name, folder, run_again) or ""


@pytest.fixture(scope="module")
def planned(
    tmp_path_factory: pytest.TempPathFactory, quick_job: Path, neck_physics: PhysicsMap
) -> Path:
    """The folder after section 1; its `ecm simulate` goes on from the cases of the quick job."""
    folder = tmp_path_factory.mktemp("tutorial")
    copy_cases(quick_job, folder / "candidates.parts")
    follow(blocks(PAGE)[:2], PAGE.name, folder)
    return folder


def test_the_page_ends_with_the_right_answer(planned: Path, tmp_path: Path) -> None:
    folder = tmp_path / "page"
    shutil.copytree(planned, folder)
    assert any(SEED in block.text for block in blocks(PAGE))
    assert "the answer is right" in measured(folder)
    assert (folder / "compare.html").stat().st_size < 10e6
    assert (folder / "found.html").stat().st_size < 10e6


def test_so_it_does_for_secrets_that_nobody_chose(planned: Path, tmp_path: Path) -> None:
    right = 0
    for seed in OTHERS:
        folder = tmp_path / str(seed)
        shutil.copytree(planned, folder)
        right += "the answer is right" in measured(folder, seed)
    assert right >= 2


def test_an_effect_of_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick_job: Path, neck_physics: PhysicsMap
) -> None:
    copy_cases(quick_job, tmp_path / "candidates.parts")
    follow(blocks(OWN), OWN.name, tmp_path, run_python_apart)
    ask = ["ecm", "predict", "better.json", "measured.csv", "--out", "predicted.csv"]
    with pytest.raises(AssertionError, match="unknown effect 'hose'"):
        run(tmp_path, *ask)
    # What pip writes beside an installed package of that pyproject.toml.
    table = (tmp_path / "pyproject.toml").read_text().split('."ecm.effects"]')[1]
    offered = re.findall(r'^(\w+) = "(\S+)"$', table, re.MULTILINE)
    installed = tmp_path / "our_rig-1.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: our-rig\nVersion: 1\n")
    lines = [f"{name} = {where}" for name, where in offered]
    (installed / "entry_points.txt").write_text("\n".join(["[ecm.effects]", *lines, ""]))
    paths = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    run(tmp_path, *ask)
    assert "hose under pressure" in run(tmp_path, "ecm", "effects", "hose")


def test_what_the_paper_s_protocol_cannot_test_a_diagnosable_plan_names(
    planned: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "page"
    shutil.copytree(planned, folder)
    follow(blocks(DESIGNS), DESIGNS.name, folder, run_again)

    def said(name: str) -> tuple[dict[str, Any], set[str]]:
        found = json.loads((folder / name).read_text(encoding="utf-8"))
        return found, {item["id"] for item in found["not_testable"]}

    history = {"hysteresis", "stress_relaxation"}
    paper, lacking = said("paper.json")
    assert history <= lacking
    assert paper["verdict"] == "unknown", paper["sentence"]
    diagnosable, lacking = said("diagnosable.json")
    assert not history & lacking
    assert any("hysteresis" in members for members in diagnosable["answer"]), diagnosable[
        "sentence"
    ]
    assert diagnosable["held_out"]["after"] < 1.15 < diagnosable["held_out"]["before"]


def test_the_next_experiment_is_measured_and_tells_a_class_apart(
    planned: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "next"
    shutil.copytree(planned, folder)
    commands = """
ecm new rig
ecm campaign plan.csv --rig rig.toml --hide face_tilt=1 --seed 1 --out first.csv
ecm diagnose neck.toml first.csv --json first.json --next next.csv
ecm campaign next.csv --rig rig.toml --hide first.csv --seed 2 --out second.csv
ecm diagnose neck.toml first.csv second.csv --json joint.json
"""
    run_here(Block("sh", "", commands.strip(), 0), folder, "the next experiment")
    first, joint = (
        json.loads((folder / name).read_text(encoding="utf-8"))
        for name in ("first.json", "joint.json")
    )
    assert first["verdict"] == "ambiguous"
    assert len(first["answer"][0]) > 1
    assert "face_tilt" in first["answer"][0]
    assert joint["answer"] == [["face_tilt"]], joint["sentence"]
    # What is hidden in the first is hidden in the second, and neither says it.
    for name in ("first", "second"):
        for ending in ("csv", "toml"):
            assert "face_tilt" not in (folder / f"{name}.{ending}").read_text(encoding="utf-8")
