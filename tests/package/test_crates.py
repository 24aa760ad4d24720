"""Crates as they are published: licences, README, metadata; licences of what they depend on."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest

from ecm.io.settings import read_toml
from release.version import oldest_rust
from support.neck import ROOT
from support.programs import cargo, ended, need_program, need_rust_target

CRATES = sorted((ROOT / "crates").glob("ecm-*"))
PUBLISHED = [c for c in CRATES if c.name != "ecm-py"]
WINDOWS = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\.|$)")


@pytest.fixture(scope="module")
def packages() -> list[dict[str, Any]]:
    """What cargo knows of every package, dependencies included."""
    command = [need_program("cargo"), "metadata", "--format-version", "1", "--locked", "--offline"]
    done = ended(*command, cwd=ROOT)
    return list(json.loads(done.stdout)["packages"])


def allowed(expression: str, licences: set[str]) -> bool:
    """Whether an SPDX expression is met by these licences; AND binds closer than OR."""
    if "(" in expression:
        inner = re.search(r"\(([^()]*)\)", expression)
        assert inner is not None, expression
        met = "met" if allowed(inner.group(1), licences) else "not met"
        return allowed(expression.replace(inner.group(0), met), licences | {"met"})
    choices = re.split(r" OR | ?/ ?", expression)
    return any(all(part in licences for part in choice.split(" AND ")) for choice in choices)


def test_every_dependency_has_a_licence_of_deny_toml(packages: list[dict[str, Any]]) -> None:
    rules = read_toml(ROOT / "deny.toml")
    licences = set(rules["licenses"]["allow"])
    refused = {
        p["name"]: p["license"] for p in packages if not allowed(p["license"] or "", licences)
    }
    assert refused == {}
    assert not allowed("GPL-3.0", licences)
    assert not allowed("(MIT OR Apache-2.0) AND GPL-3.0", licences)


def test_every_dependency_comes_from_the_registry(packages: list[dict[str, Any]]) -> None:
    registry = "registry+https://github.com/rust-lang/crates.io-index"
    assert {p["source"] for p in packages} == {None, registry}


def test_no_dependency_needs_a_newer_compiler_than_is_promised(
    packages: list[dict[str, Any]],
) -> None:
    def parts(version: str) -> tuple[int, ...]:
        return tuple(int(part) for part in version.split("."))

    promised = parts(oldest_rust())
    newer = {
        p["name"]: p["rust_version"]
        for p in packages
        if parts(p["rust_version"] or "0") > (*promised, 99)
    }
    assert newer == {}


@pytest.mark.parametrize("crate", [c.name for c in PUBLISHED])
def test_an_archive_says_what_it_is(crate: str, packages: list[dict[str, Any]]) -> None:
    package = next(p for p in packages if p["name"] == crate)
    assert package["readme"] == "README.md"
    assert 3 <= len(package["keywords"]) <= 5
    assert ("no-std" in package["categories"]) == (crate in {"ecm-se3", "ecm-poly"})
    assert package["metadata"]["docs"]["rs"]
    assert package["rust_version"]
    folder = ROOT / "crates" / crate
    for text in ("LICENSE-MIT", "LICENSE-APACHE"):
        assert (folder / text).read_bytes() == (ROOT / text).read_bytes()
    assert "```rust\n" in (folder / "README.md").read_text(encoding="utf-8")
    assert 'include_str!("../README.md")' in (folder / "src/lib.rs").read_text(encoding="utf-8")


def test_the_bindings_are_not_published(packages: list[dict[str, Any]]) -> None:
    assert next(p for p in packages if p["name"] == "ecm-py")["publish"] == []


@pytest.mark.parametrize("crate", [c.name for c in PUBLISHED])
def test_an_archive_is_listed_without_a_warning(crate: str) -> None:
    command = [
        need_program("cargo"), "package", "--list", "--allow-dirty", "--offline", "-p", crate,
    ]  # fmt: skip
    done = ended(*command, cwd=ROOT)
    assert "warning" not in done.stderr
    names = done.stdout.split()
    assert {"README.md", "LICENSE-MIT", "LICENSE-APACHE"} <= set(names)
    assert [n for n in names if any(WINDOWS.match(part) for part in n.split("/"))] == []


def test_no_public_signature_has_a_type_of_faer() -> None:
    shown = re.compile(r"^\s*pub (fn [^{;]*|\w+: .*)\b(Mat|MatRef|MatMut|Col|Llt)<", re.M)
    assert shown.search("    pub u: Mat<f64>,")
    for crate in PUBLISHED:
        root = (crate / "src/lib.rs").read_text(encoding="utf-8")
        for module in re.findall(r"^pub (?:mod|use) (\w+)", root, re.M):
            for source in [*crate.glob(f"src/{module}.rs"), *crate.glob(f"src/{module}/**/*.rs")]:
                assert shown.search(source.read_text(encoding="utf-8")) is None, source


CLOSED = {
    "StiffnessKind": "three stiffnesses, by their definition",
    "Constraint": "a node is free, moves with the platform, or is held",
    "Precision": "float and double, the two types of exported code",
    "Outcome": "numbers of the exported C",
    "Parameter": "numbers of the exported C",
}
"""Public enums that another crate may match in full."""


def test_enums_that_may_grow_are_matched_with_a_rest() -> None:
    enum = re.compile(r"((?:^(?:#\[|//).*\n)*)^pub enum (\w+)", re.M)
    found: dict[str, bool] = {}
    for crate in PUBLISHED:
        for source in crate.glob("src/**/*.rs"):
            if "bin" not in source.parts:
                for head, name in enum.findall(source.read_text(encoding="utf-8")):
                    found[name] = "#[non_exhaustive]" in head
    assert len(found) > 20
    assert {name for name, grows in found.items() if not grows} == set(CLOSED)


@pytest.mark.parametrize("features", ["", "alloc"])
def test_ecm_poly_builds_for_a_cortex_m(features: str) -> None:
    need_rust_target("thumbv7em-none-eabihf")
    command = ["check", "--release", "--quiet", "-p", "ecm-poly", "--no-default-features"]
    command += ["--features", features, "--target", "thumbv7em-none-eabihf"]
    # Where the test of allocations has compiled what the crate's macros need.
    cargo(ROOT, ROOT / "target" / "allocations", *command, RUSTFLAGS="-D warnings")


def test_model_files_open_with_alloc_alone() -> None:
    # What these lines let in is compiled for a Cortex-M by the test above.
    root = (ROOT / "crates/ecm-poly/src/lib.rs").read_text(encoding="utf-8")
    for names in ("EnergyModel", "{PoseModel, PosePolynomial}", "{open_model, seal_model}"):
        line = rf'#\[cfg\(feature = "alloc"\)\]\npub use \w+::{re.escape(names)};'
        assert re.search(line, root), names


def test_figures_of_the_designs_stand_in_one_place() -> None:
    text = (ROOT / "crates/ecm-doe/README.md").read_text(encoding="utf-8")
    assert "docs/designs.md" in text
    assert re.search(r"\d ms|\d times|\.98\d", text) is None


def test_the_workflow_runs_what_the_makefile_has() -> None:
    workflow = (ROOT / ".github/workflows/crates.yml").read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"run: make (\w+)", workflow)
    assert targets == ["deny", "semver"]
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.M), target
    checked = re.search(r"\) semver-checks .*", makefile)
    assert checked is not None
    assert set(re.findall(r"-p (\S+)", checked.group())) == {crate.name for crate in PUBLISHED}
