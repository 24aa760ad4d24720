"""What each effect of the catalogue needs of a table, and what it says where that is not there."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from ecm.diagnosis import diagnose
from ecm.effects import Effect, all_effects, effects_of, get_effect
from ecm.effects.contact import Debonding
from ecm.effects.friction import Hysteresis
from ecm.io.columns import JOINT_SIGNS, JOINTS, POSE, VELOCITY, WRENCH
from ecm.io.table import Table
from support.campaigns import campaign, model
from support.full_table import full_table

NEEDS: dict[str, tuple[str, ...]] = {
    "stress_relaxation": ("dwell",),
    "viscous_damping": (VELOCITY[0],),
    "hysteresis": ("path",),
    "mullins_softening": ("time_s",),
    "permanent_set": ("time_s", "kind"),
    "temperature_modulus": ("temperature_degC",),
    "thermal_expansion": ("temperature_degC",),
    "ageing": ("time_s",),
    "pretension": ("free_length_m",),
    "platform_slip": ("time_s",),
    "own_weight": ("gravity_m_s2",),
    "payload": ("gravity_m_s2",),
    "tendon_friction": ("tendon1_N", "approach"),
    "inertia": ("raw.parquet",),
    "fts_drift": ("time_s",),
    "fts_thermal_drift": ("warmth",),
    "fts_saturation": ("fts_range",),
    "fts_hysteresis": ("time_s",),
    "fts_quantisation": ("fts_resolution",),
    "marker_motion": ("time_s",),
    "time_skew": ("raw.parquet",),
    "led_occlusion": ("leds_visible",),
    "robot_compliance": (JOINTS[3],),
    "backlash": (JOINTS[3], JOINT_SIGNS[6]),
    "joint_offset": (JOINTS[3],),
    "heteroscedastic_noise": ("pose_id",),
    "pose_noise": ("pose_id",),
}
"""Columns and keys under "needs" of the catalogue; the other effects need poses and wrenches."""
SAID = {
    VELOCITY[0]: "v_",
    "kind": "home",
    "tendon1_N": "tendon1_N",
    "pose_id": "repeats",
    "warmth": "sensor_temperature_degC",
    "path": "approach, or time_s",
    "dwell": "dwell_s",
}
"""What the record names in place of the column."""


def table_for(id: str) -> Table:
    """Everything, as a table of the kind that the effect is tested with."""
    table = full_table()
    if id not in ("inertia", "time_skew"):
        table = table.with_meta(replace(table.meta, file=replace(table.meta.file, kind="static")))
    if id == "led_occlusion":
        seen = np.random.default_rng(6).integers(4, 9, len(table)).astype(float)
        table = table.with_columns({"leds_visible": seen})
    return table


def without(table: Table, name: str) -> Table:
    """The table as if that had not been recorded."""
    meta = table.meta
    if name == "free_length_m":
        kept = {k: v for k, v in meta.mechanism.items() if k != name}
        return table.with_meta(replace(meta, mechanism=kept))
    if name == "gravity_m_s2":
        return table.with_meta(replace(meta, scene=replace(meta.scene, gravity_m_s2=(0.0,) * 3)))
    if name in ("fts_range", "fts_resolution"):
        return table.with_meta(replace(meta, instrument=replace(meta.instrument, **{name: None})))
    if name == "raw.parquet":
        return table.with_meta(replace(meta, file=replace(meta.file, kind="static")))
    several = {
        "path": ("approach", "time_s"),
        "dwell": ("dwell_s", "time_s"),
        "warmth": ("temperature_degC", "sensor_temperature_degC"),
        "tendon1_N": tuple(column for column in table.columns if column.startswith("tendon")),
    }
    return table.drop(*several.get(name, (name,)))


@pytest.mark.parametrize(("id", "name"), [(id, name) for id in NEEDS for name in NEEDS[id]])
def test_what_was_not_recorded_makes_an_effect_untestable_by_name(id: str, name: str) -> None:
    effect, table = get_effect(id), table_for(id)
    assert effect.missing(table) is None
    lacking = effect.missing(without(table, name))
    assert lacking is not None
    assert SAID.get(name, name) in lacking.record


@pytest.mark.parametrize("effect", all_effects(), ids=lambda effect: effect.id)
def test_poses_and_wrenches_are_enough_for_all_others(effect: Effect) -> None:
    bare = table_for("").select(np.arange(20))
    bare = bare.drop(*(name for name in bare.columns if name not in (*POSE, *WRENCH)))
    bare = without(without(bare, "free_length_m"), "gravity_m_s2")
    bare = without(without(bare, "fts_range"), "fts_resolution")
    assert (effect.missing(bare) is not None) == (effect.id in NEEDS)


def test_the_sensor_may_follow_the_only_temperature_that_is_known() -> None:
    table, effect = table_for(""), get_effect("fts_thermal_drift")
    fitted = effect.variants(table)
    other = table.drop("sensor_temperature_degC")
    assert effect.missing(other) is None
    assert {form.shape["follows"] for form in effect.variants(other)} == {"temperature_degC"}
    # What was fitted to the sensor's own temperature does not take another one.
    assert all(form.missing(other) is not None for form in fitted)


def test_without_time_no_effect_of_path_reads_the_order_of_rows() -> None:
    """A table in another order has the same answer, and says what to record."""
    table = campaign("hysteresis", 1.0, 4).drop("time_s")
    order = np.random.default_rng(0).permutation(len(table))
    found = [diagnose(model(), rows) for rows in (table, table.select(order))]
    for diagnosis in found:
        listed = {item.id: item.record for item in diagnosis.not_testable}
        assert listed["fts_hysteresis"] == "time_s"
        assert "hysteresis" in diagnosis.answer[0]
    assert found[0].answer == found[1].answer
    assert all("yield_m" not in form.shape for form in Hysteresis().variants(table))
    kept = Hysteresis("middle", 1e-3).missing(table)
    assert kept is not None
    assert kept.absent


def test_a_bond_that_opens_in_tension_needs_no_time_and_one_that_tore_does() -> None:
    table = campaign().drop("time_s")
    assert Debonding().missing(table) is None
    assert {form.shape["opens"] for form in Debonding().variants(table)} >= {"tension", "hinge"}
    assert all(form.shape["opens"] != "torn" for form in Debonding().variants(table))
    torn = Debonding("torn", 100.0).missing(table)
    assert torn is not None
    assert torn.record == "time_s"


@pytest.mark.parametrize("columns", [("x_m", "fx_N"), ("x_m", "theta_z_rad", "fx_N", "tau_z_Nm")])
def test_effects_of_few_columns_go_from_process_to_process_with_their_needs(
    columns: tuple[str, ...],
) -> None:
    table = full_table()
    some = table.drop(*(name for name in (*POSE, *WRENCH) if name not in columns))
    for effect in effects_of(some):
        copied = pickle.loads(pickle.dumps(effect))
        assert copied.id == effect.id
        assert copied.missing(some) == effect.missing(some)


@pytest.mark.parametrize("id", ["robot_compliance", "joint_offset", "backlash"])
def test_an_arm_of_six_joints_is_not_asked_for_a_seventh(id: str) -> None:
    lacking = get_effect(id).missing(full_table().drop(JOINTS[6]))
    assert lacking is not None
    assert "an arm of six joints" in lacking.reason
    assert JOINTS[6] not in lacking.record
    none = get_effect(id).missing(full_table().drop(*JOINTS))
    assert none is not None
    assert JOINTS[6] in none.record
