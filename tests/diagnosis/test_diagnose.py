"""Diagnosis on the simulated rig: one seed of each effect, nothing hidden, and the traps.

The plant is a closed form, the effects are the plant's own physics: no formula of the library.
The benchmark with FEM is benches/blind.py.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from ecm import refit
from ecm.comparison import compare
from ecm.diagnosis import diagnose, find_missing
from ecm.diagnosis.family import Family
from ecm.diagnosis.problem import assemble
from ecm.diagnosis.search import rank
from ecm.diagnosis.verdict import WEIGHTS, probability
from ecm.effects import Rows, all_effects, get_effect
from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument
from ecm.io.table import Table
from ecm.models import fit_model
from ecm.models.fit import choose_base
from ecm.rig import CampaignOptions, RigSettings, run_campaign
from support.acceptance import acceptance_check
from support.campaigns import (
    campaign,
    diagnosis_of,
    found_in,
    lists_of_the_interface,
    model,
    physics,
    plan,
    with_change,
    with_effect,
)
from support.stand_in import L, StandIn

EIGHT = (
    "fts_offset",
    "fts_drift",
    "payload",
    "base_compliance",
    "tip_frame_misalignment",
    "hysteresis",
    "temperature_modulus",
    "anisotropy",
)


@pytest.mark.parametrize("hidden", EIGHT)
def test_each_effect_at_the_size_of_the_noise_is_named(hidden: str) -> None:
    diagnosis = diagnosis_of(hidden, 1.0, 4)
    assert found_in(diagnosis, hidden), diagnosis.sentence()
    assert diagnosis.verdict in ("named", "ambiguous")
    assert diagnosis.held_out.before > 1.2
    assert diagnosis.held_out.after < 1.10
    assert diagnosis.ranking[0].id in diagnosis.answer[0]
    if len(diagnosis.answer[0]) > 1:
        assert diagnosis.verdict == "ambiguous"


@pytest.mark.parametrize("hidden", ["payload", "hysteresis", "temperature_modulus"])
def test_a_strong_effect_does_not_bring_a_second_name(hidden: str) -> None:
    """At three times the noise the leftover of an imperfect form is itself above the noise."""
    found = find_missing(model(), campaign(hidden, 3.0, 4))
    assert found_in(found, hidden), found.answer


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_nothing_hidden_is_none(seed: int) -> None:
    diagnosis = diagnosis_of("", 1.0, seed)
    assert diagnosis.verdict == "none"
    assert diagnosis.answer == ()
    assert diagnosis.effects == ()
    assert diagnosis.gate.p > 0.001
    assert diagnosis.upper_bound < 0.3
    limits = diagnosis.detection_limits
    # Sizes of the catalogue's prototype at 0.3 of the noise, give or take the other protocol.
    assert 0.002 < limits["temperature_modulus"].size * 1.5 < 0.05
    assert limits["payload"].unit in ("kg", "kg m")


def test_a_stiffer_material_is_no_effect() -> None:
    """An effect exactly along E belongs to the base."""
    table = campaign("", 1.0, 4)
    stiffer = table.with_columns({name: 1.05 * table.column(name) for name in WRENCH})
    assert find_missing(model(), stiffer).verdict == "none"


def test_two_effects_are_both_named() -> None:
    table = campaign("payload", 1.0, 4)
    diagnosis = diagnose(model(), with_effect(table, "temperature_modulus", [0.02]))
    assert {members[0] for members in diagnosis.answer} == {"payload", "temperature_modulus"}
    assert diagnosis.held_out.after < 1.1


def test_a_second_effect_explains_more_than_the_form_of_the_first_may_leave() -> None:
    """Beside a payload 8 % of all that is explained have a name, 5 % are left without a word."""
    table = campaign("payload", 1.0, 4)
    for beta, second in ((0.0034, {"temperature_modulus"}), (0.0026, set())):
        found = find_missing(model(), with_effect(table, "temperature_modulus", [beta]))
        assert {members[0] for members in found.answer} == {"payload"} | second


def test_an_unlikely_further_effect_is_no_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left by the form of the first effect looks like a small second one."""
    table = with_effect(campaign("payload", 1.0, 4), "temperature_modulus", [0.004])
    both = find_missing(model(), table)
    assert {members[0] for members in both.answer} == {"payload", "temperature_modulus"}
    monkeypatch.setitem(WEIGHTS, "named", (3.0, 0.0, 2.0, 0.0))
    one = find_missing(model(), table)
    assert one.answer == (("payload",),)
    assert probability(both) < 0.5 < probability(one)


def test_two_unlikely_effects_that_explain_what_follows_one_driver_are_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One of them leaves too much to be a name; the driver alone would tell no form."""
    hidden = with_effect(campaign("temperature_modulus", 1.0, 4), "thermal_expansion", [6e-4])
    monkeypatch.setitem(WEIGHTS, "named", (3.0, 0.0, 2.0, 0.0))
    found = find_missing(model(), hidden)
    assert {members[0] for members in found.answer} == {"temperature_modulus", "thermal_expansion"}
    assert probability(replace(found, fewer_tried=False)) < 0.5
    family = replace(found, fewer_tried=False, family=Family("", 1, (), "", (), "", 0))
    assert probability(found) == probability(family)


def test_structure_without_a_name_is_unknown() -> None:
    """A force that follows the product of two coordinates is nothing in the library."""
    table = campaign("", 1.0, 4)
    y, z = table.column("y_m"), table.column("z_m")
    strange = 2.0 * y * z / (y.std() * z.std())
    diagnosis = diagnose(model(), table.with_columns({"fy_N": table.column("fy_N") + strange}))
    assert diagnosis.verdict == "unknown", diagnosis.sentence()
    assert diagnosis.answer == ()
    assert diagnosis.unknown is not None
    assert {"y_m", "z_m"} <= set(diagnosis.unknown.variables)
    assert diagnosis.unknown.nearest.share < 0.6
    report = json.loads(json.dumps(diagnosis.to_dict(), allow_nan=False))
    lists_of_the_interface(report)
    unknown = report["unknown"]
    assert set(unknown) == {"variables", "words", "nearest", "skeleton", "misread"}
    assert unknown["misread"] is False
    assert all(isinstance(name, str) for name in unknown["variables"])
    assert isinstance(unknown["words"], str)
    assert set(unknown["nearest"]) == {"id", "share"}
    assert get_effect(unknown["nearest"]["id"])
    # The product of two coordinates is a function of the pose: the ceiling takes it.
    assert report["rmse"]["ceiling"]["fy_N"] < 0.5 * report["rmse"]["before"]["fy_N"]


def test_an_effect_taken_out_of_the_library_is_not_replaced_by_a_wrong_name() -> None:
    others = [id for id in EIGHT if id != "hysteresis"]
    found = find_missing(model(), campaign("hysteresis", 1.0, 4), effects=others)
    assert found.verdict != "named", found.answer


def test_the_papers_protocol_cannot_test_hysteresis_and_relaxation() -> None:
    """One approach, one dwell: said so, with what to record."""
    table = campaign("", 1.0, 4).measured()
    keep = table.text("approach") == "initial"
    dwell = np.full(int(keep.sum()), 2.0)
    single = table.select(np.flatnonzero(keep)).with_columns({"dwell_s": dwell})
    listed = {item.id: item for item in diagnose(model(), single).not_testable}
    assert listed["hysteresis"].reason == "one approach direction"
    assert "approach" in listed["hysteresis"].record
    assert "dwell_s" in listed["stress_relaxation"].record


def test_without_time_no_effect_of_time_is_named() -> None:
    table = campaign("fts_drift", 1.0, 4).drop("time_s")
    diagnosis = diagnose(model(), table)
    assert "fts_drift" in {item.id for item in diagnosis.not_testable}
    assert all("fts_drift" not in members for members in diagnosis.answer)


def test_outliers_do_not_become_an_effect() -> None:
    table = campaign("", 1.0, 5)
    random = np.random.default_rng(0)
    rows = random.choice(np.flatnonzero(table.text("kind") == "pose"), 4, replace=False)
    wrenches = table.wrenches.copy()
    wrenches[rows] += random.choice([-1.0, 1.0], (4, 6)) * [12.0, 5.0, 5.0, 0.2, 0.2, 0.2]
    bad = table.with_columns({name: wrenches[:, j] for j, name in enumerate(WRENCH)})
    diagnosis = diagnose(model(), bad)
    assert diagnosis.verdict == "none", diagnosis.sentence()
    assert set(diagnosis.outliers) >= set(rows.tolist())


def test_the_symmetric_energy_names_what_it_cannot_swallow() -> None:
    """Without a body the base is the energy model: it absorbs the length, not the drift."""
    table = campaign("fts_drift", 1.0, 4)
    diagnosis = diagnose(fit_model(table, "cubic"), table)
    assert diagnosis.base.kind == "energy"
    assert found_in(diagnosis, "fts_drift"), diagnosis.sentence()
    # A drift is no function of the pose: no cubic takes the whole of it.
    assert diagnosis.held_out.ceiling > 1.1 * diagnosis.held_out.after
    absorbed = {item.id: item.reason for item in diagnosis.not_testable}
    assert "the base absorbs it" in absorbed["length_error"]


def test_the_refitted_model_is_complete() -> None:
    table = campaign("payload", 1.0, 4)
    better = model().add("payload").fit(table)
    assert find_missing(better, table).verdict == "none"


def test_the_report_is_that_of_the_interface() -> None:
    diagnosis = diagnosis_of("payload", 1.0, 4)
    report = json.loads(json.dumps(diagnosis.to_dict(), allow_nan=False))
    assert report["schema"] == 1
    assert report["seed"] == 0
    assert report["base"]["kind"] == "physics"
    assert report["noise"]["source"] == "repeats"
    assert report["gate"]["p"] < 1e-6
    assert report["answer"] == [["payload"]]
    effect = report["effects"][0]
    assert effect["id"] == "payload"
    assert effect["parameters"]["mass"]["unit"] == "kg"
    assert effect["parameters"]["mass"]["sd"] > 0.0
    row = report["ranking"][0]
    assert {"id", "p", "delta_bic", "size", "sd", "unit", "expected_fall"} <= set(row)
    assert set(report["rmse"]["before"]) == set(WRENCH)
    assert report["rmse"]["after"]["fx_N"] < report["rmse"]["before"]["fx_N"]
    assert set(report["rmse"]) == {"before", "after", "floor", "ceiling"}
    assert set(report["held_out"]) == {"before", "after", "ceiling"}
    assert report["signature"]["constant_in_base"] > 0.3
    lists_of_the_interface(report)
    # A constant force in base axes and its lever: a cubic of the pose takes it down to the noise.
    for name, ceiling in report["rmse"]["ceiling"].items():
        assert ceiling == pytest.approx(report["rmse"]["floor"][name], rel=0.25)
    assert report["rmse"]["ceiling"]["fx_N"] < 0.8 * report["rmse"]["before"]["fx_N"]
    assert report["unknown"] is None


@pytest.mark.parametrize("source", ["declared", "assumed", "repeats"])
def test_the_verdict_says_where_its_noise_comes_from(source: str) -> None:
    table = campaign("payload", 1.0, 4)
    if source != "repeats":
        table = table.select(np.unique(table.column("pose_id"), return_index=True)[1]).measured()
    if source == "assumed":
        table = table.with_meta(replace(table.meta, instrument=Instrument()))
    found = diagnosis_of("payload", 1.0, 4) if source == "repeats" else diagnose(model(), table)
    assert found.noise.source == source
    said = found.sentence()
    assert ("as declared, not measured" in said) is (source == "declared")
    assert ("The noise is assumed: give repeats" in said) is (source == "assumed")
    assert any("the noise is assumed" in text for text in found.warnings) is (source == "assumed")


def test_the_same_seed_gives_the_same_report_and_another_the_same_verdict() -> None:
    table = campaign("base_compliance", 1.0, 4)
    first = diagnosis_of("base_compliance", 1.0, 4)
    assert first.to_dict() == diagnose(model(), table, seed=0).to_dict()
    another = diagnose(model(), table, seed=1)
    assert another.to_dict()["seed"] == 1
    for other in (another, *(find_missing(model(), table, seed=seed) for seed in (2, 3))):
        assert (other.verdict, other.answer) == (first.verdict, first.answer)


def test_row_order_does_not_matter() -> None:
    table = campaign("payload", 1.0, 4)
    order = np.random.default_rng(0).permutation(len(table))
    first, second = diagnosis_of("payload", 1.0, 4), diagnose(model(), table.select(order))
    assert first.answer == second.answer
    assert second.held_out.before == pytest.approx(first.held_out.before, rel=5e-3)


def sorted_by_size(table: Table) -> Table:
    """Poses in the order of their size, so that size grows with time."""
    measured = table.measured()
    deflection = (measured.poses - [L, 0, 0, 0, 0, 0]) * [1, 1, 1, L, L, L]
    order = np.argsort(np.abs(deflection).sum(axis=1))
    return measured.select(order).with_columns({"time_s": np.sort(measured.column("time_s"))})


def test_trap_size_that_grows_with_time() -> None:
    table = sorted_by_size(campaign("", 1.0, 4))
    assert find_missing(model(), table).verdict == "none"
    conservative = find_missing(model(), with_effect(table, "anisotropy", [0.01, 0.007]))
    assert found_in(conservative, "anisotropy"), conservative.answer


def of_one_dwell(table: Table, dwell_s: float) -> Table:
    """Its checks, and the poses that were read after this dwell."""
    return table.select((table.column("dwell_s") == dwell_s) | (table.text("kind") != "pose"))


@pytest.mark.parametrize("dwell_s", [2.0, 8.0, 30.0])
def test_trap_constant_dwell_names_nothing_and_says_what_to_record(dwell_s: float) -> None:
    diagnosis = diagnose(model(), of_one_dwell(campaign("stress_relaxation", 1.0, 4), dwell_s))
    listed = {item.id: item for item in diagnosis.not_testable}
    assert "dwell_s" in listed["stress_relaxation"].record
    assert diagnosis.verdict == "none", diagnosis.sentence()


def test_trap_constant_dwell_hides_relaxation_in_the_modulus() -> None:
    """All dwells together name it; each dwell alone has a modulus of its own."""
    table = campaign("stress_relaxation", 1.0, 4)
    assert find_missing(model(), table).answer == (("stress_relaxation",),)
    fitted = [model().fit(of_one_dwell(table, dwell_s)).base for dwell_s in (2.0, 8.0, 30.0)]
    short, middle, long = (float(base.coefficients[0]) for base in fitted)
    assert short > 1.005 * middle > 1.01 * long


def test_trap_a_wrong_sign_is_no_soft_material() -> None:
    table = campaign("", 1.0, 4)
    turned = table.with_columns({name: -table.column(name) for name in WRENCH})
    diagnosis = diagnose(model(), turned)
    assert diagnosis.verdict == "unknown"
    assert "a sign is likely wrong" in diagnosis.sentence()
    one = diagnose(model(), table.with_columns({"fz_N": -table.column("fz_N")}))
    assert (one.verdict, one.unknown is not None) == ("unknown", True)
    assert one.unknown.words.startswith("the sign of fz looks reversed")  # type: ignore[union-attr]


def test_trap_a_frame_turned_the_wrong_way_is_not_named() -> None:
    """Readings brought to base axes with R' for R, and rotations of the other sign."""
    table = campaign("", 1.0, 4)
    rotation = Rows(table, physics()).rotation
    twice = np.swapaxes(rotation @ rotation, 1, 2)
    wrong = np.concatenate(
        [np.einsum("nij,nj->ni", twice, table.wrenches[:, k : k + 3]) for k in (0, 3)], axis=1
    )
    askew = table.with_columns({name: wrong[:, j] for j, name in enumerate(WRENCH)})
    mirrored = table.with_columns({name: -table.column(name) for name in POSE[3:]})
    for bad in (askew, mirrored):
        found = find_missing(model(), bad)
        assert found.verdict == "unknown", found.answer
        assert found.answer == ()


def test_a_clamp_that_pushes_is_not_named() -> None:
    """Values far outside their bounds are no explanation; a hair outside is the form's misfit."""
    table = campaign("", 1.0, 4)
    stiffening = with_effect(table, "base_compliance", [-2e-3, 0.0, 0.0])
    answer = find_missing(model(), stiffening).answer
    assert all("base_compliance" not in members for members in answer)
    slight = with_effect(table, "base_compliance", [2e-3, 5e-7, -2e-7])
    diagnosis = diagnose(model(), slight)
    assert found_in(diagnosis, "base_compliance"), diagnosis.sentence()
    axial = dict(zip(("bending", "lateral", "axial"), diagnosis.effects[0].values, strict=True))
    assert axial["axial"] >= -1e-11


def test_trap_copied_rows_and_one_bad_pose() -> None:
    table = campaign("", 1.0, 4).measured()
    copied = table.select(np.concatenate([np.arange(len(table)), np.arange(40)]))
    diagnosis = diagnose(model(), copied)
    assert diagnosis.verdict == "none"
    assert any("40 rows repeat" in text for text in diagnosis.warnings)
    poses = table.poses.copy()
    poses[17] += [3e-3, 3e-3, 0.0, 0.05, 0.0, 0.0]
    bad = table.with_columns({name: poses[:, j] for j, name in enumerate(POSE)})
    diagnosis = diagnose(model(), bad)
    assert diagnosis.verdict == "none"
    assert diagnosis.outliers == (17,)
    # Both reports name the same row of the file, counted from 1.
    assert diagnosis.to_dict()["outliers"] == [18]
    assert compare(model(), bad).to_dict()["where"]["worst_rows"][0]["row"] == 18


@pytest.mark.parametrize("held", ["", "fts_offset"])
def test_every_effect_of_the_catalogue_is_accounted_for(held: str) -> None:
    """Catches an effect of the noise, or one of the model's own, of which nothing is said."""
    table = campaign("", 1.0, 4)
    found = diagnose(model().add(held).fit(table), table) if held else diagnosis_of("", 1.0, 4)
    report = found.to_dict()
    ranked = {item["id"] for item in report["ranking"]}
    not_testable = {item["id"] for item in report["not_testable"]}
    of_noise = set(report["noise"]["tested"])
    assert of_noise >= {"outliers", "pose_noise", "heteroscedastic_noise"}
    assert ranked | not_testable | of_noise == {effect.id for effect in all_effects()}
    assert not of_noise & (ranked | not_testable)
    assert not held or held in not_testable


def test_too_few_rows_are_refused() -> None:
    table = campaign("", 1.0, 4).measured().select(np.arange(5))
    with pytest.raises(InputError, match="at least 8"):
        diagnose(model(), table)


def test_a_table_of_other_columns_is_diagnosed_as_far_as_it_goes() -> None:
    """One displacement, one force, temperature: the proportional effects can still be tested."""
    random = np.random.default_rng(3)
    x = random.uniform(-1e-3, 1e-3, 200)
    temperature = 20.0 + 8.0 * random.uniform(-1.0, 1.0, 200)
    force = 1e4 * x * (1.0 - 0.01 * (temperature - 20.0)) + 0.05 * random.standard_normal(200)
    columns = {"x_m": x, "fx_N": force, "temperature_degC": temperature}
    meta = campaign("", 1.0, 4).meta
    table = Table(columns, type(meta)(), "spring")
    diagnosis = diagnose(fit_model(table, "linear"), table)
    assert diagnosis.base.kind == "polynomial"
    assert found_in(diagnosis, "temperature_modulus"), diagnosis.sentence()
    beta = diagnosis.effects[0].values[0]
    assert beta == pytest.approx(0.01, rel=0.05)
    assert "payload" in {item.id for item in diagnosis.not_testable}
    assert diagnosis.rmse.ceiling == {}


def test_trap_a_sensor_zeroed_with_the_payload_on() -> None:
    """What is left turns with the platform: (R R_z' - I) m g, found with its mass."""
    settings = RigSettings()
    settings = replace(
        settings,
        instrument=replace(settings.instrument, zeroed_with_payload=True),
        plant=replace(settings.plant, payload_mass_kg=0.8),
    )
    table = run_campaign(
        plan(), settings, None, hide="", seed=7, options=CampaignOptions(source=StandIn())
    )
    assert table.meta.instrument.zeroed_with_payload
    diagnosis = diagnose(model(), table)
    assert diagnosis.answer == (("payload",),), diagnosis.sentence()
    assert diagnosis.effects[0].values[0] == pytest.approx(0.8, abs=0.05)


def test_an_error_far_beyond_the_noise_is_no_name() -> None:
    """A residual that repeats and that no column follows leaves every name in doubt."""
    table = campaign("fts_offset", 20.0, 4)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], int(table.column("pose_id").max()) + 2)
    own = signs[table.column("pose_id").astype(int)]
    scrambled = table.with_columns({"tau_x_Nm": own * table.column("tau_x_Nm")})
    found = find_missing(model(), scrambled)
    assert found.verdict == "unknown"
    assert found.answer == ()


def test_the_evidence_for_an_effect_that_is_not_there_can_be_written() -> None:
    """What fails the checks goes into the report as well: plain numbers and truths."""
    problem = assemble(
        choose_base(model(), campaign(seed=3)), campaign(seed=3), all_effects(), None
    )
    weakest = rank(problem)[-1].candidate
    found = acceptance_check(problem, [weakest], weakest, [weakest.id], 0)
    assert not found.accepted
    assert json.loads(json.dumps(asdict(found)))["held_out_fall"] < 1.0


@pytest.mark.parametrize("effect", ["temperature_modulus", "hysteresis"])
@pytest.mark.parametrize("strength", [2.0, 4.0])
def test_what_an_added_effect_leaves_of_its_form_is_no_further_cause(
    effect: str, strength: float
) -> None:
    table = campaign(effect, strength, 8)
    better = refit(model(), table, add=effect)
    found = find_missing(better, table)
    assert (found.verdict, found.answer) == ("none", ())


def test_a_second_cause_is_found_after_the_first_was_added() -> None:
    change = campaign("payload", 1.0, 8).wrenches - campaign("", 1.0, 8).wrenches
    both = with_change(campaign("temperature_modulus", 2.0, 8), change)
    better = refit(model(), both, add="temperature_modulus")
    assert find_missing(better, both).answer == (("payload",),)
