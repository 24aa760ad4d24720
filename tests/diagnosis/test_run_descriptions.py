"""[run.N]: what was different in a run reaches the effects that it concerns, or is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import special

from ecm.diagnosis import diagnose, find_missing
from ecm.diagnosis.preparation import OtherValues, prepare
from ecm.diagnosis.search import seen_in_repeats
from ecm.diagnosis.verdict import Decision
from ecm.effects import Rows, get_effect
from ecm.effects.load import needs_gravity
from ecm.errors import InputError
from ecm.io.columns import POSE
from ecm.io.description import Instrument, Meta, Scene, read_meta
from ecm.io.table import Table, as_table, read_table
from ecm.models import Model, fit_model
from ecm.models.joint_fit import FittedEffect
from ecm.regression.slow_noise import SlowPart
from support.campaigns import INSTRUMENT, physics, with_change, with_effect, workspace_poses
from support.neck import columns_of
from support.stand_in import L, wrench

HALF = 6


def rows_of(meta: Meta, **more: Any) -> Rows:
    """The same six poses in run 0 and in run 1."""
    poses = np.tile(workspace_poses(HALF, 5), (2, 1))
    columns: dict[str, Any] = dict(zip(POSE, poses.T.copy(), strict=True))
    columns |= {"run": np.repeat([0.0, 1.0], HALF), **more}
    return Rows(Table(columns, meta, "two runs"), physics())


def halves(id: str, meta: Meta, **more: Any) -> tuple[Any, Any]:
    """Columns of an effect in either run."""
    rows, effect = rows_of(meta, **more), get_effect(id)
    found = np.asarray(effect.jacobian(rows, np.zeros(len(effect.parameters))))
    assert np.abs(found[:HALF]).max() > 0.0
    return found[:HALF], found[HALF:]


def test_what_is_said_of_run_0_holds_in_a_table_without_runs() -> None:
    """A cable that was said to be off was named: nothing read what was said of the only run."""
    off = {0: {"cable_attached": False}}
    columns = {name: one for name, one in rows_of(Meta()).table.columns.items() if name != "run"}
    single = Rows(Table(columns, Meta(runs=off), "one run"), physics())
    assert (single.of_run("cable_attached", 1.0) == 0.0).all()


def test_what_is_said_of_a_run_that_no_row_has_is_not_lost_without_a_word(tmp_path: Path) -> None:
    """A second table counts its own runs: [run.1] beside it was taken for the joined one's."""
    path = tmp_path / "second.csv"
    path.write_text("time_s,theta_z_rad,tau_z_Nm\n0,0.0,0.0\n1,0.1,0.2\n2,0.2,0.4\n")
    path.with_suffix(".toml").write_text("[run.1]\npayload_mass_kg = 0.0\n")
    said = [one for one in read_table(path).warnings if "[run.1]" in one]
    assert said == [
        f"{path}: no row belongs to [run.1], so what it says is not used; this table has [run.0]. "
        "Runs are counted in each table by itself"
    ]


@pytest.mark.parametrize("id", ["payload", "own_weight"])
def test_a_rig_turned_over_turns_the_weight_over(id: str) -> None:
    """Catches the gravity of the first campaign taken for all that are joined to it."""
    upright, turned = halves(id, Meta(runs={1: {"gravity_m_s2": [9.81, 0.0, 0.0]}}))
    np.testing.assert_allclose(turned, -upright, rtol=1e-12, atol=1e-12)
    weightless, heavy = Scene((0.0, 0.0, 0.0)), {1: {"gravity_m_s2": [0.0, 0.0, -9.81]}}
    assert needs_gravity(rows_of(Meta(scene=weightless)).table) is not None
    assert needs_gravity(rows_of(Meta(scene=weightless, runs=heavy)).table) is None


def test_a_dead_weight_pulls_along_the_gravity_of_its_run() -> None:
    meta = Meta(runs={1: {"gravity_m_s2": [0.0, 0.0, -9.81], "payload_mass_kg": 2.0}})
    rows = rows_of(meta, kind=np.repeat(np.array(["pose", "unloaded"], dtype=object), HALF))
    np.testing.assert_allclose(rows.sensor_load[HALF:, :3], np.tile([0.0, 0.0, 19.62], (HALF, 1)))


@pytest.mark.parametrize(
    ("scene", "runs", "ratio"),
    [
        (0.1, {1: 0.2}, 2.0),
        (None, {0: 0.1, 1: 0.2}, 2.0),
        (0.4, {1: 0.1}, 0.25),
        (0.4, {1: 0.0}, 0.0),
        (None, {1: 0.0}, 0.0),
        (None, {1: 0.3}, 1.0),
        (0.0, {}, 1.0),
    ],
)
def test_a_run_with_more_payload_weighs_as_much_more(
    scene: float | None, runs: dict[int, float], ratio: float
) -> None:
    """Catches a mass of which only zero or not is seen."""
    told = {run: {"payload_mass_kg": mass} for run, mass in runs.items()}
    first, second = halves("payload", Meta(scene=Scene(payload_mass_kg=scene), runs=told))
    np.testing.assert_allclose(second, ratio * first, rtol=1e-12)


def test_the_mass_of_the_scene_is_the_unit_of_the_payload() -> None:
    own, _ = halves("payload", Meta())
    told = Meta(scene=Scene(payload_mass_kg=0.4), runs={1: {"payload_mass_kg": 0.1}})
    np.testing.assert_array_equal(halves("payload", told)[0], own)


def test_a_dead_weight_is_no_payload() -> None:
    """Nor the unit of one: run 1 reads the free sensor alone."""
    kind = np.repeat(np.array(["pose", "unloaded"], dtype=object), HALF)
    own, _ = halves("payload", Meta(), kind=kind)
    told, free = halves("payload", Meta(runs={1: {"payload_mass_kg": 2.0}}), kind=kind)
    np.testing.assert_array_equal(told, own)
    assert not free.any()


def test_a_run_zeroed_with_the_payload_on_reads_nothing_of_it_at_rest() -> None:
    meta = Meta(runs={1: {"zeroed_with_payload": True}})
    free, with_payload = halves("payload", meta)
    everywhere = Meta(instrument=Instrument(zeroed_with_payload=True))
    np.testing.assert_array_equal(with_payload, halves("payload", everywhere)[1])
    np.testing.assert_array_equal(free, halves("payload", Meta())[0])


def test_slack_tendons_have_no_friction() -> None:
    more = {
        "tendon1_N": np.full(2 * HALF, 3.0),
        "approach": np.full(2 * HALF, "initial", dtype=object),
        "pose_id": np.tile(np.arange(HALF) * 1.0, 2),
    }
    taut, slack = halves("tendon_friction", Meta(runs={1: {"tendons_slack": True}}), **more)
    assert not slack.any()
    np.testing.assert_array_equal(taut, halves("tendon_friction", Meta(), **more)[0])


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("turned_end_for_end = true", "diagnose the table of that run alone"),
        ("temperature_degC = 25.0", "a column of the table"),
        ("free_length_m = 0.1", "[mechanism]"),
        ("gravity_m_s2 = [0, -9.81]", "has 2 entries: expected 3"),
        ("gravity_m_s2 = [0, 0, -9810]", "expected a norm of about 9.81"),
        ("payload_mass_kg = 'none'", "expected a number"),
        ("payload_mass_kg = -1", "expected at least 0"),
    ],
)
def test_what_no_effect_would_see_is_refused(line: str, expected: str, tmp_path: Path) -> None:
    """Catches a key that is taken and then forgotten, and a value that fails later."""
    path = tmp_path / "d.toml"
    path.write_text(f"[run.1]\n{line}\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_meta(path)
    assert "[run.1]" in str(caught.value)
    assert expected in str(caught.value)


def test_a_campaign_of_another_gravity_keeps_it_when_joined(tmp_path: Path) -> None:
    for name, gravity in (("up", (-9.81, 0.0, 0.0)), ("down", (9.81, 0.0, 0.0))):
        poses = workspace_poses(HALF, 5)
        columns: dict[str, Any] = dict(zip(POSE, poses.T.copy(), strict=True))
        columns["time_s"] = 10.0 * np.arange(HALF)
        Table(columns, Meta(scene=Scene(gravity)), name).write(tmp_path / f"{name}.csv")
    rows = Rows(read_table([tmp_path / "up.csv", tmp_path / "down.csv"]), physics())
    assert rows.gravity_m_s2[:, 0].tolist() == [-9.81] * HALF + [9.81] * HALF


@cache
def zero_in_place_of_a_payload() -> tuple[Model, Table, Table]:
    """A model to which the wrong name was added, the rows of its fit, and these with later ones.

    The payload is taken off in the later rows.
    """
    poses, noise = workspace_poses(90, 5), np.random.default_rng([5, 1]).standard_normal((90, 6))
    read, late = wrench(poses) + noise * np.repeat([0.3, 0.01], 3), np.arange(90) >= 60
    columns: dict[str, Any] = columns_of(poses, read) | {"run": late.astype(float)}
    lying = Meta(
        mechanism={"length_m": L},
        instrument=INSTRUMENT,
        scene=Scene(gravity_m_s2=(0.0, -9.81, 0.0)),
        runs={1: {"payload_mass_kg": 0.0}},
    )
    table = as_table(columns, meta=lying)
    table = with_effect(table, "payload", [0.5, 0.01, 0.0, 0.0])
    before = table.select(np.flatnonzero(~late))
    given = fit_model(before, "energy4", force=True).add("fts_offset").fit(before)
    return given, before, table


def test_a_wrong_name_that_was_added_is_taken_back_by_the_experiment_that_was_asked_for() -> None:
    """A wrong zero stood for a payload; held as it was it hid it, also after it was taken off."""
    given, _, table = zero_in_place_of_a_payload()
    found = diagnose(given, table)
    assert {id for members in found.answer for id in members} >= {"payload", "fts_offset"}
    assert "a change of what the model holds of it" in found.summary().missing
    assert found.addition is not None
    assert found.addition.remedy is not None
    assert "--remove fts_offset --add payload" in found.addition.remedy.command
    assert "Add it: payload in place of fts_offset" in found.report().text()
    changes = {one["id"]: one.get("change") for one in found.to_dict()["effects"]}
    assert changes["fts_offset"] is True
    assert changes["payload"] is None
    mass = next(item for item in found.effects if item.id == "payload").values[0]
    assert mass == pytest.approx(0.5, abs=0.02)


def test_other_values_alone_ask_for_a_fit_to_the_new_rows_that_keeps_the_base() -> None:
    """Fitted to all rows it would be the mean of two zeros, and anew lose what the others said."""
    given, before, _ = zero_in_place_of_a_payload()
    zero = np.array([1.5, -1.0, 0.8, 0.03, -0.04, 0.05])
    right = given.remove("fts_offset").add("payload").fit(before)
    held = right.add("fts_offset").fit(before)
    found = diagnose(held, with_effect(before, "fts_offset", zero))
    assert found.answer == (("fts_offset",),)
    assert found.effects[0].values == pytest.approx(zero, abs=0.3)
    assert found.to_dict()["effects"][0]["change"] is True
    assert found.summary().add.endswith('ecm.refit(model, table, freeze="base")')


def changes_offered(given: Model, table: Table) -> list[str]:
    return [one.id for one in prepare(given, table).effects if isinstance(one, OtherValues)]


def test_no_change_of_an_effect_is_offered_that_is_frozen_or_may_be_of_these_rows() -> None:
    given, before, table = zero_in_place_of_a_payload()
    assert changes_offered(given, table) == ["fts_offset"]
    assert changes_offered(given, before) == []
    assert changes_offered(given.freeze("fts_offset"), table) == []
    assert changes_offered(replace(given, training={}), table) == []


def test_a_part_of_the_rows_of_the_fit_does_no_harm() -> None:
    """A change of what the model holds may be tried on it, and is nothing."""
    given, before, _ = zero_in_place_of_a_payload()
    right = given.remove("fts_offset").add("payload").fit(before)
    for rows in (20, 40):
        part = before.select(np.arange(rows))
        assert changes_offered(right, part) == ["payload"]
        assert find_missing(right, part).verdict == "none"


def test_a_change_lacks_what_its_effect_lacks_and_imitates_nothing() -> None:
    before = zero_in_place_of_a_payload()[1]
    held = [
        FittedEffect.unfitted(get_effect(id)) for id in ("temperature_modulus", "permanent_set")
    ]
    hidden = before.with_columns({"time_s": 10.0 * np.arange(len(before))})
    for item, table in zip(held, (before, hidden), strict=True):
        own, change = item.effect.missing(table), OtherValues(item).missing(table)
        assert own is not None
        assert change == replace(own, imitates=False, forms=())


@cache
def friction_beside_a_payload(friction: float) -> Decision:
    """What two visits to each of fifty poses say to a model that holds a large payload."""
    places = np.random.default_rng(3).permutation(np.repeat(np.arange(50), 2))
    poses, noise = workspace_poses(50, 5)[places], np.random.default_rng([5, 1])
    read = wrench(poses) + noise.standard_normal((100, 6)) * np.repeat([0.3, 0.01], 3)
    columns: dict[str, Any] = columns_of(poses, read) | {
        "pose_id": places.astype(float),
        "time_s": 20.0 * np.arange(100),
    }
    lying = Scene(gravity_m_s2=(0.0, -9.81, 0.0))
    stated = Meta(mechanism={"length_m": L}, instrument=INSTRUMENT, scene=lying)
    table = with_effect(as_table(columns, meta=stated), "payload", [1.0, 0.02, 0.0, 0.0])
    # It swings a little with the pose, which no form of a payload does.
    swing = np.sin(9.0 * poses[:, 5]) * np.cos(300.0 * poses[:, 1])
    table = with_change(table, np.outer(1.2 * swing, np.eye(6)[1]))
    sizes = [one.scale for one in get_effect("hysteresis").parameters]
    table = with_effect(table, "hysteresis", friction * np.array(sizes))
    given = fit_model(table, "energy4", force=True).add("payload").fit(table)
    return find_missing(given, table)


@pytest.mark.parametrize(("friction", "answer"), [(1.0, (("hysteresis",),)), (0.0, ())])
def test_friction_that_shows_between_visits_is_no_other_form_of_a_large_payload(
    friction: float, answer: tuple[tuple[str, ...], ...]
) -> None:
    """It explained less than a thirtieth of what the payload does, and no row could name it."""
    assert friction_beside_a_payload(friction).answer == answer


def test_a_set_between_visits_is_the_best_of_all_such_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two effects are chosen among many more pairs; rows of a slow noise are no visits any more."""
    problem = friction_beside_a_payload(1.0).problem
    one = next(c for c in problem.candidates if c.id == "hysteresis")
    other = next(c for c in problem.candidates if c.effect.kind == "time" and c.id != one.id)
    assert seen_in_repeats(problem, [one])
    slow = replace(problem, noise=replace(problem.noise, slow=SlowPart((10.0,), (0.5,))))
    assert not seen_in_repeats(slow, [one])
    chance = 0.5 * problem.settings.level / len(problem.candidates)
    monkeypatch.setattr(special, "chdtrc", lambda dof, squares: chance)
    assert seen_in_repeats(problem, [one])
    assert not seen_in_repeats(problem, [one, other])
