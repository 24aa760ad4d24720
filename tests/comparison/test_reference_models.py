"""Four references side by side point to the family of what is hidden."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.comparison import compare
from ecm.comparison.reference_models import ReferenceModels
from support.campaigns import campaign, model
from support.chain import neck
from support.neck import LENGTH_M, Command, columns_of

DESCRIBED = {
    "mechanism": {"length_m": LENGTH_M},
    "instrument": {
        "force_sd_N": 0.3,
        "torque_sd_Nm": 0.01,
        "pose_position_sd_m": 1e-6,
        "pose_rotation_sd_rad": 1e-6,
    },
}


@pytest.mark.parametrize(
    ("hidden", "family"),
    [
        ("length_error", "symmetric"),
        ("base_compliance", "symmetric"),
        ("anisotropy", "asymmetric"),
        ("temperature_modulus", "other"),
        ("stress_relaxation", "other"),
    ],
)
def test_the_family_of_a_hidden_effect(hidden: str, family: str) -> None:
    found = compare(model(), campaign(hidden, 2.0, 1)).references
    assert found is not None
    shares = found.shares()
    assert max(shares, key=shares.__getitem__) == family
    assert shares[family] > 0.6
    assert sum(shares.values()) == pytest.approx(1.0)


def test_nothing_hidden_points_nowhere() -> None:
    found = compare(model(), campaign("", 1.0, 1)).references
    assert found is not None
    for level in (found.physics, found.energy, found.ceiling):
        assert level == pytest.approx(1.0, abs=0.06)
    assert found.shares() == {}
    assert "noise" in found.sentence()


@pytest.mark.parametrize("rows", [30, 60])
def test_of_few_rows_without_a_cause_nothing_points_anywhere(rows: int) -> None:
    """The ceiling was of the residual of fitted rows: all of the excess was "asymmetric"."""
    for seed in range(3):
        random = np.random.default_rng(seed)
        poses = random.uniform(-1.0, 1.0, (rows, 6)) * [0.002, 0.01, 0.01, 0.3, 0.3, 0.3]
        poses[:, 0] += LENGTH_M
        noise = np.repeat([0.3, 0.01], 3) * random.normal(size=(rows, 6))
        table = ecm.Table(columns_of(poses, model().base.predict(poses) + noise), DESCRIBED)
        found = compare(ecm.fit(table, "energy4"), table).references
        assert found is not None
        assert found.energy is not None
        assert found.ceiling == pytest.approx(found.energy, rel=0.03)
        assert found.sentence() == "What is left is noise: no family of effects stands out."


def test_shares_are_those_of_the_squares() -> None:
    found = ReferenceModels(physics=3.0, energy=2.0, ceiling=1.5)
    assert found.shares() == pytest.approx(
        {"symmetric": 5.0 / 8.0, "asymmetric": 1.75 / 8.0, "other": 1.25 / 8.0}
    )
    assert "62% of the excess points to elasticity or geometry" in found.sentence()
    # A model that errs far less than each of them lacks nothing that they could tell.
    outdone = ReferenceModels(physics=30.0, energy=20.0, ceiling=15.0, own=6.0)
    assert outdone.shares() == {}
    assert "errs far more than the model" in outdone.sentence()
    assert replace(outdone, own=8.0).shares()["symmetric"] > 0.5
    # Without structure, as of few rows, an error of six times the noise is no noise.
    assert "errs far more than the model" in replace(outdone, missing=False).sentence()
    alike = ReferenceModels(physics=9.0, energy=9.0, ceiling=9.0, missing=False, own=8.0)
    assert alike.sentence() == "No family of effects stands out."
    # A ceiling that is no better than the energy has nothing of its own.
    assert ReferenceModels(physics=3.0, energy=1.0, ceiling=1.2).shares()["asymmetric"] == 0.0


def test_no_fem_runs_for_a_reference_and_the_command_that_shows_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ecm_command: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ECM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("ecm.models.physics.map.build_family", no_fem)
    neck(tmp_path)
    description = Path("data-1.toml").read_text(encoding="utf-8")
    assert description.count("radius_m = 0.033") == 1
    wider = description.replace("radius_m = 0.033", "radius_m = 0.0317")
    Path("data-1.toml").write_text(wider, encoding="utf-8")
    assert ecm_command("fit", "data-1.csv", "--model", "linear", "--out", "m.json").code == 0
    done = ecm_command("compare", "m.json", "data-1.csv", "--json", "c.json", "--report", "c.html")
    assert done.code == 0, done.err
    asked = done.out.partition("The physics base is left out: ")[2].splitlines()
    assert "up to ten minutes" in asked[0]
    command = "ecm fit data-1.csv --model physics --out physics.json && ecm"
    assert any(line.startswith(command) for line in asked)
    references = json.loads(Path("c.json").read_text(encoding="utf-8"))["references"]
    assert references["fem_needed"]
    assert references["physics"] is None
    assert "The physics base is left out" in Path("c.html").read_text(encoding="utf-8")


def no_fem(*_: object, **__: object) -> None:
    raise AssertionError("an FEM runs that nobody asked for")


def test_a_fem_that_is_there_is_shown_at_once() -> None:
    found = compare(model(), campaign("payload", 1.0, 0)).references
    assert found is not None
    assert not found.fem_needed


def test_a_report_draws_no_floor_where_the_noise_is_only_assumed(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    x = np.linspace(-0.01, 0.01, 40)
    table = ecm.as_table({"x_m": x, "fx_N": 2e3 * x + 3e7 * x**3 + random.normal(0.0, 0.1, 40)})
    result = compare(ecm.fit(table, "linear"), table)
    assert result.noise.is_assumed
    result.report().write(tmp_path / "c.html")
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    assert "% of the spread" in page
    for claim in ("noise floor", "over its noise", "times its noise", "90 % interval"):
        assert claim not in page
    declared = ecm.as_table(
        dict(table.columns), meta={"instrument": {"force_sd_N": 0.1, "pose_position_sd_m": 1e-6}}
    )
    compare(ecm.fit(declared, "linear"), declared).report().write(tmp_path / "d.html")
    assert "Error of each component over its noise floor" in (tmp_path / "d.html").read_text(
        encoding="utf-8"
    )
