"""The proposed experiment: chance of the right name before and after, and what it is worth."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np

from ecm.designs import Design, diagnosable_plan, paper_plan
from ecm.diagnosis import diagnose
from ecm.effects import Rows, get_effect
from ecm.io.description import Meta
from ecm.io.table import Table
from ecm.rig import CampaignOptions, RigSettings, run_campaign
from support.campaigns import (
    campaign,
    diagnosis_of,
    lists_of_the_interface,
    model,
    physics,
    plan,
    with_change,
    workspace_poses,
)
from support.stand_in import L, StandIn


def warming() -> Table:
    """A campaign with nothing hidden, over which it grows warmer by 4 K."""
    table = campaign("", 1.0, 4)
    time = table.column("time_s")
    warm = 22.0 + 4.0 * (time - time.min()) / np.ptp(time)
    warm += 0.05 * np.random.default_rng(0).standard_normal(len(warm))
    return table.with_columns({"temperature_degC": warm})


def test_warm_and_cold_poses_separate_temperature_from_age() -> None:
    """Both grow with time; after the proposed warm-up one of them is sure."""
    table = warming()
    change = get_effect("temperature_modulus").correction(Rows(table, physics()), np.array([6e-3]))
    found = diagnose(model(), with_change(table, change))
    assert found.verdict == "ambiguous"
    assert set(found.answer[0]) == {"ageing", "temperature_modulus"}
    lists_of_the_interface(json.loads(json.dumps(found.to_dict(), allow_nan=False)))
    warm_up = next(item for item in found.next_experiment if "warm and cold" in item.action)
    # An hour of heating and what the rig needs for 20 visits.
    assert warm_up.minutes == 80
    assert 0.4 < warm_up.p_correct_before < 0.95
    assert warm_up.p_correct > 0.95
    assert warm_up.p_correct > warm_up.p_correct_before
    for first, later in pairwise(found.next_experiment):
        # Nothing that is surer and shorter stands behind.
        assert first.p_correct >= later.p_correct or first.minutes <= later.minutes


def test_two_classes_are_told_apart_in_one_session() -> None:
    """A length beside a modulus: the calliper is for one class, a campaign for the other."""
    table = warming()
    rows = Rows(table, physics())
    change = get_effect("temperature_modulus").correction(rows, np.array([1.2e-2]))
    change = change + get_effect("length_error").correction(rows, np.array([1.5e-4]))
    found = diagnose(model(), with_change(table, change))
    assert sum(len(members) > 1 for members in found.answer) == 2, found.answer
    session = found.next_experiment[0]
    parts = session.action.split(" + ")
    assert len(parts) > 1
    assert "calliper" in parts
    assert session.minutes <= 180
    singles = [item for item in found.next_experiment if " + " not in item.action]
    assert session.p_correct > max(item.p_correct for item in singles) + 0.1
    assert session.p_correct_before < 0.5


def test_nothing_to_separate_proposes_nothing() -> None:
    assert diagnosis_of("temperature_modulus", 1.0, 4).next_experiment == ()


def candidates() -> tuple[Table, Design]:
    poses = workspace_poses(100, 3)
    columns = {
        name: poses[:, j]
        for j, name in enumerate(("x_m", "y_m", "z_m", "theta_x_rad", "theta_y_rad", "theta_z_rad"))
    }
    table = Table(columns, Meta(mechanism={"length_m": L}), "candidates")
    return table, Design(np.arange(100), "maximin", 0.0, 0.0, 1.0, "converged")


def test_the_papers_protocol_cannot_test_what_the_diagnosable_one_can() -> None:
    """One approach and one dwell: said so; the preset makes both testable."""
    both = {"hysteresis", "stress_relaxation"}
    table = run_campaign(
        paper_plan(*candidates(), seed=0), RigSettings(), None,
        hide="hysteresis=1.0", seed=5, options=CampaignOptions(source=StandIn()),
    )  # fmt: skip
    found = diagnose(model(), table)
    listed = {item.id: item.record for item in found.not_testable}
    assert both <= set(listed), found.sentence()
    assert all(listed[id] for id in both)
    # A clean name would be wrong: the truth is among what was left out.
    assert found.verdict != "named", found.sentence()
    assert diagnosable_plan(*candidates(), 290, seed=0).text("approach").tolist() == (
        plan().text("approach").tolist()
    )
    for hidden in (*both, "ageing"):
        found = diagnosis_of(hidden, 1.0, 4)
        assert not both & {item.id for item in found.not_testable}
        assert found.answer == ((hidden,),), found.sentence()
