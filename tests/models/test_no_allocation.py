"""h and K of a model that was opened from its file take no memory."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from support.exports import fitted
from support.neck import ROOT
from support.programs import cargo, ended

MANIFEST = """[package]
name = "allocations"
version = "0.0.0"
edition = "2024"

[[bin]]
name = "allocations"
path = "main.rs"

[workspace]

[dependencies]
ecm-poly = {{ path = "{crate}", default-features = false, features = ["alloc"] }}
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compiled once; what it depends on stays in `target`."""
    folder = tmp_path_factory.mktemp("allocations")
    crate = ROOT / "crates" / "ecm-poly"
    (folder / "Cargo.toml").write_text(MANIFEST.format(crate=crate.as_posix()), encoding="utf-8")
    shutil.copy(ROOT / "Cargo.lock", folder / "Cargo.lock")
    shutil.copy(Path(__file__).parent / "allocations" / "main.rs", folder / "main.rs")
    target = ROOT / "target" / "allocations"
    cargo(folder, target, "build", "--release")
    return target / "release" / "allocations"


def test_a_thousand_evaluations_allocate_nothing(program: Path, tmp_path: Path) -> None:
    files = [tmp_path / f"{name}.json" for name in ("energy6", "cubic")]
    for file in files:
        fitted(file.stem).save(file)
    counted = ended(program, *files)
    assert [line.split()[0] for line in counted.stdout.splitlines()] == ["0", "0"]
