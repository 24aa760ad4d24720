"""The kinds of effects that were missed, one set of each: `benches/blind_kinds.py` has more."""

from __future__ import annotations

from pathlib import Path

from blind_kinds import outcome, sets
from blind_parts.miss_kinds import UNSAID
from blind_parts.other_sets import OtherSet, given_model, table_of
from ecm.diagnosis import Diagnosis, diagnose


def diagnosed(name: str, number: int, folder: Path) -> tuple[Diagnosis, str]:
    """The answer to one set of a kind, and what it counts as."""
    case = next(one for one in sets(12, 3) if one.name == name and one.index % 1000 == number)
    table, mechanism = table_of(case, folder)
    found = diagnose(given_model(table, mechanism), table)
    answer = [list(members) for members in found.answer]
    return found, outcome({"set": case.to_dict(), "verdict": found.verdict, "answer": answer})


def test_a_set_without_home_rows_comes_with_what_it_looks_like(solids: Path) -> None:
    found, counts_as = diagnosed("permanent set", 8, solids)
    assert counts_as == "right", found.sentence()
    ((*members,),) = found.answer
    assert {"marker_motion", "permanent_set"} <= set(members)
    pairs = {pair for step in found.next_experiment for pair in step.separates}
    assert "marker_motion or permanent_set" in pairs
    listed = {item.id: item.record for item in found.not_testable}
    assert listed["permanent_set"] == "home pose after every sample"


def test_friction_is_named_by_the_order_of_rows_where_no_approach_is_said(solids: Path) -> None:
    found, counts_as = diagnosed(UNSAID, 0, solids)
    assert counts_as == "right", found.sentence()
    assert any("row before in time" in line for line in found.warnings)


def test_a_trace_of_the_load_before_is_no_friction(solids: Path) -> None:
    """Friction by the order of rows explains a part of it, and the load before far more."""
    case = OtherSet(
        seed=2, index=2, kind="foreign", name="memory", body="soft", strength=3.0, rows=90,
        repeats=0, declared=False,
    )  # fmt: skip
    table, mechanism = table_of(case, solids)
    found = diagnose(given_model(table, mechanism), table)
    assert found.verdict == "unknown", found.sentence()
    assert found.unknown is not None
    assert "of the reading before" in found.unknown.words


def test_a_small_effect_of_time_is_named_beside_a_larger_one_of_the_pose(solids: Path) -> None:
    found, counts_as = diagnosed("small beside larger", 2, solids)
    assert counts_as == "right", found.sentence()
    small = next(members for members in found.answer if "temperature_modulus" in members)
    # What looks like a part of the larger effect is no rival of the smaller one.
    assert "permanent_set" not in small


def test_what_grows_softer_in_tension_is_not_called_stiffening_alone(solids: Path) -> None:
    found, counts_as = diagnosed("softer in tension", 0, solids)
    assert counts_as == "right", found.sentence()
    assert "strain_stiffening (softer in tension than in compression; or " in found.sentence()
    assert found.to_dict()["directions"] == {
        "strain_stiffening": "softer in tension than in compression"
    }
