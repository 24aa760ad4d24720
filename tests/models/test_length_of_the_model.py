"""The length that a model knows is that of data which do not tell it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ecm.comparison import compare
from ecm.diagnosis import diagnose
from ecm.io.table import Table, read_table
from ecm.models import Model, fit_model
from support.campaigns import campaign
from support.neck import Command
from support.stand_in import L


def silent(hidden: str = "anisotropy") -> Table:
    """Data with the instrument's figures and no word about the mechanism."""
    told = campaign(hidden, 1.0, 4)
    return told.with_meta(replace(told.meta, mechanism={}))


@pytest.fixture(scope="module")
def energy() -> Model:
    return fit_model(campaign("anisotropy", 1.0, 4), "energy4")


@pytest.mark.parametrize("name", ["energy4", "linear"])
def test_names_are_against_the_energy_of_that_length(name: str) -> None:
    """Catches the polynomial, which swallows most effects, where the length is known after all."""
    told = campaign("anisotropy", 1.0, 4)
    model = fit_model(told, name)
    found = diagnose(model, silent())
    assert found.base.kind == "energy"
    assert found.answer == diagnose(model, told).answer
    assert found.detection_limits["own_weight"].size > 0.0


def test_the_energy_stands_among_the_references(energy: Model) -> None:
    found = compare(energy, silent()).references
    assert found is not None
    assert found == compare(energy, campaign("anisotropy", 1.0, 4)).references


def test_the_next_campaign_goes_home_to_the_rest_pose(tmp_path: Path, ecm_command: Command) -> None:
    silent("face_tilt").write(tmp_path / "d.csv")
    fit_model(campaign("face_tilt", 1.0, 4), "energy4").save(tmp_path / "m.json")
    ecm_command(
        "diagnose", tmp_path / "m.json", tmp_path / "d.csv", "--next", tmp_path / "p.csv"
    ).good()
    plan = read_table(tmp_path / "p.csv")
    assert plan.meta.length_m == L
    assert set(plan.column("x_m")[plan.text("kind") == "home"]) == {L}
