"""What commands write as JSON fits the published schemas; what does not fit is noticed."""

from __future__ import annotations

import json
import shutil
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from docsite.json_page import SCHEMAS, page
from ecm.errors import InputError, Remedy
from support.neck import ROOT, Command
from support.programs import need_packages

TABLE = "examples/neck_measured.csv"
TENSION = "stretch,stress_MPa\n1.0,0.0\n1.2,0.1112\n1.4,0.1958\n1.6,0.2661\n2.0,0.385\n"
LOG = "time [s],angle z [deg],torque z [N mm]\n0,0,0\n1,10,20\n2,20,40\n"
SETTINGS = """[mechanism]
builtin = "cylinder"
length_m = 0.1034
radius_m = 0.033
young_modulus_Pa = 650e3
poisson_ratio = 0.49

[simulate]
n = 2
n_test = 1
"""
PLAN = "x_m,y_m,z_m,theta_x_rad,theta_y_rad,theta_z_rad\n0.1034,0.01,0,0,0,0.1\n"
COMMANDS = {
    "check": f"check {TABLE}",
    "fit": f"fit {TABLE} --model energy4 --out model.json",
    "predict": f"predict model.json {TABLE} --out predicted.csv",
    "compare": f"compare model.json {TABLE}",
    "diagnose": f"diagnose model.json {TABLE}",
    "refit": f"refit model.json {TABLE} --add fts_gain --out better.json",
    "design": f"design {TABLE} --n 20 --model energy4 --iterations 5 --out plan.csv",
    "export": "export model.json --to c --out out",
    "effects": "effects",
    "import": "import log.csv --out log_table.csv",
    "simulate": "simulate neck.toml --out pairs.csv",
    "campaign": "campaign one_pose.csv --rig examples/rig.toml --out campaign.csv",
    "reveal": f"reveal {TABLE} --answer diagnose.json",
    "material": "material fit --uniaxial tension.csv --out material.toml",
}
"""A command of each layout, in an order in which each finds the files it needs."""


def problems(name: str, document: Any) -> list[str]:
    """Where a document does not fit its schema."""
    need_packages("jsonschema")
    from jsonschema import Draft202012Validator  # noqa: PLC0415 - may be missing

    schema = json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    found = Draft202012Validator(schema).iter_errors(document)
    return [f"{name}: {list(error.path)}: {error.message}" for error in found]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the example's table, a log and a test of a material."""
    need_packages("jsonschema")
    folder = tmp_path_factory.mktemp("schemas")
    shutil.copytree(ROOT / "examples", folder / "examples")
    (folder / "tension.csv").write_text(TENSION, encoding="utf-8")
    (folder / "log.csv").write_text(LOG, encoding="utf-8")
    (folder / "neck.toml").write_text(SETTINGS, encoding="utf-8")
    (folder / "one_pose.csv").write_text(PLAN, encoding="utf-8")
    shutil.copyfile(folder / "examples" / "neck_measured.toml", folder / "one_pose.toml")
    return folder


@pytest.mark.parametrize("name", COMMANDS)
def test_what_a_command_writes_fits_its_schema(
    name: str,
    folder: Path,
    request: pytest.FixtureRequest,
    ecm_command: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if name in ("compare", "diagnose"):
        request.getfixturevalue("neck_physics")  # else its FEM runs here
    monkeypatch.chdir(folder)
    ecm_command(*COMMANDS[name].split(), "--json", f"{name}.json").good()
    document = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    assert problems(name, document) == []
    if name in ("fit", "refit"):
        model = "model.json" if name == "fit" else "better.json"
        assert problems("model", json.loads((folder / model).read_text("utf-8"))) == []


def test_the_summary_of_a_job_fits_its_schema(quick_job: Path) -> None:
    summary = json.loads((quick_job / "summary.json").read_text(encoding="utf-8"))
    assert problems("identify", summary) == []


def test_what_a_refused_command_writes_fits_its_schema(
    tmp_path: Path, ecm_command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the way out, its DATA and OUT filled in, in the file as in the terminal."""
    need_packages("jsonschema")
    command = import_module("ecm.cli.models")

    def refuse(*_given: object, **_named: object) -> None:
        remedy = Remedy("fit the stated body", "ecm fit DATA --model physics --out OUT")
        raise InputError("no way", remedy=remedy)

    monkeypatch.setattr(command, "open_model", refuse)
    monkeypatch.chdir(ROOT)
    written = tmp_path / "refit.json"
    named = ("refit", "no.json", TABLE, "--add", "payload", "--out", "a b.json")
    done = ecm_command(*named, "--json", written)
    typed = f"ecm fit {TABLE} --model physics --out 'a b.json'"
    assert done.code == 2
    assert done.err.endswith(f"error: no way\nFit the stated body:\n  {typed}\n")
    document = json.loads(written.read_text(encoding="utf-8"))
    assert problems("refusal", document) == []
    assert document["error"]["remedy"]["command"] == typed


def test_what_does_not_fit_is_noticed(folder: Path) -> None:
    assert problems("predict", {"schema": 1, "rows": 3, "columns": ["fx_N"]}) == []
    assert problems("predict", {"schema": 2, "rows": "3", "columns": []}) != []
    assert any("'rows' is a required" in text for text in problems("predict", {"schema": 1}))


def test_every_layout_is_tried_and_shown() -> None:
    names = sorted(path.stem for path in SCHEMAS.glob("*.json"))
    assert names == sorted([*COMMANDS, "identify", "model", "refusal"])
    assert all(f"(../schemas/{name}.json)" in page() for name in names)
    assert "| `answer` | array |" in page()
    assert "| `ranking[].delta_bic` | number |" in page()
