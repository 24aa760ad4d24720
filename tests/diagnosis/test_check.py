"""`ecm check`: what a table can and cannot tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ecm.comparison import compare
from ecm.diagnosis import diagnose
from ecm.effects import all_effects
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.sanity import never_excited
from ecm.io.table import as_table
from ecm.models import fit_model
from ecm.models.check import check
from support.neck import LENGTH_M, neck_columns

FULL = Meta(mechanism={"length_m": LENGTH_M})


def test_every_effect_is_testable_or_has_a_reason_and_a_remedy() -> None:
    found = check(as_table(neck_columns(), meta=FULL))
    named = {*found.testable, *(one.id for one in found.not_testable)}
    assert named == {effect.id for effect in all_effects()}
    assert all(one.reason and one.record for one in found.not_testable)


def test_check_and_diagnose_test_the_same_of_a_table_of_few_columns() -> None:
    """A pose that was held, and one of its inputs, which effects of all six poses need as well."""
    rng, t = np.random.default_rng(0), np.arange(300.0)
    x, tension = 1e-3 * np.sin(0.2 * t), 5.0 + 3.0 * np.sin(0.03 * t)
    force = 900.0 * x + 0.02 * tension + 0.01 * rng.standard_normal(len(t))
    held = np.full(len(t), 0.25)
    columns = {"time_s": t, "x_m": x, "z_m": held, "fx_N": force, "tension_1_N": tension}
    table = as_table(columns)
    checked, told = check(table), diagnose(fit_model(table, "cubic"), table)
    assert set(checked.testable) == {one.id for one in told.ranking}
    lacking = {one.id for one in checked.not_testable}
    assert lacking == {one.id for one in told.not_testable}
    assert {"regulator_lag", "capstan_friction"} < lacking


def test_a_column_makes_its_effect_testable() -> None:
    columns = neck_columns()
    reasons = {one.id: one.reason for one in check(as_table(columns, meta=FULL)).not_testable}
    assert reasons["temperature_modulus"] == "no column temperature_degC"
    assert "fts_drift" in reasons
    columns["temperature_degC"] = 20.0 + 5.0 * np.sin(np.arange(60.0))
    columns["time_s"] = 30.0 * np.arange(60.0)
    testable = check(as_table(columns, meta=FULL)).testable
    assert "temperature_modulus" in testable
    assert "fts_drift" in testable


def test_a_constant_temperature_does_not_test_it() -> None:
    columns = neck_columns() | {"temperature_degC": np.full(60, 21.0)}
    assert "temperature_modulus" not in check(as_table(columns, meta=FULL)).testable


def test_what_is_never_excited_is_said() -> None:
    columns = neck_columns()
    columns["tau_z_Nm"] = np.zeros(60)
    table = as_table(columns, meta=FULL)
    assert never_excited(table) == ("tau_z_Nm",)
    found = check(table)
    assert "The z torque (tau_z_Nm) is never excited" in " ".join(found.sentences())
    assert found.zero_columns == ("tau_z_Nm",)
    dead = table.with_columns(dict.fromkeys(WRENCH, np.zeros(len(table))))
    said = "the wrench is exactly 0 in every row, and the poses vary: is the sensor dead"
    assert said in " ".join(check(dead).warnings)
    driven = dead.with_columns({"pressure_1_Pa": np.arange(len(table), dtype=float)})
    assert said not in " ".join(check(driven).warnings)
    # Of a known length the forces are enough for what does not follow from the torque.
    assert {"payload", "contact_stop"} <= set(found.testable)
    assert set(check(as_table(columns)).testable) == {"kink", "dead_zone", "higher_degree"}


def test_home_rows_do_not_count_as_excitation() -> None:
    columns = neck_columns(10) | {"kind": np.array(["pose"] * 8 + ["home"] * 2, dtype=object)}
    columns["fx_N"] = np.array([3.0] * 8 + [0.0, 0.1])
    assert never_excited(as_table(columns)) == ("fx_N",)


ONE_FIGURE = {"force_sd_N": 0.3}
ALL_FIGURES = {
    "pose_position_sd_m": 4e-5, "pose_rotation_sd_rad": 4e-4, **ONE_FIGURE, "torque_sd_Nm": 0.01,
}  # fmt: skip
FULL_COLUMNS = (*POSE, *WRENCH)
ONE_OF_EACH = ("x_m", "fx_N")


@pytest.mark.parametrize(
    ("columns", "figures", "contrasts", "source"),
    [
        (FULL_COLUMNS, {}, 0, "assumed"),
        (FULL_COLUMNS, ONE_FIGURE, 0, "assumed"),
        (FULL_COLUMNS, ALL_FIGURES, 0, "declared"),
        (FULL_COLUMNS, dict.fromkeys(ALL_FIGURES, 0.0), 0, "assumed"),
        (FULL_COLUMNS, {}, 1, "assumed"),
        (FULL_COLUMNS, ALL_FIGURES, 1, "declared"),
        (FULL_COLUMNS, ALL_FIGURES, 19, "declared"),
        (FULL_COLUMNS, {}, 20, "repeats"),
        (FULL_COLUMNS, ALL_FIGURES, 20, "repeats"),
        (ONE_OF_EACH, ONE_FIGURE, 0, "assumed"),
        (ONE_OF_EACH, ONE_FIGURE | {"pose_position_sd_m": 4e-5}, 0, "declared"),
        (ONE_OF_EACH, ALL_FIGURES, 7, "declared"),
        (ONE_OF_EACH, {}, 8, "repeats"),
    ],
)
def test_check_and_compare_agree_on_where_the_noise_comes_from(
    columns: tuple[str, ...], figures: dict[str, float], contrasts: int, source: str
) -> None:
    """Figures are declared when all that concern the columns are; repeats count from 20 (or 8)."""
    data = neck_columns()
    ids = np.arange(60.0)
    ids[: contrasts + 1] = 0.0
    meta = Meta(mechanism={"length_m": LENGTH_M}, instrument=Instrument(**figures))  # type: ignore[arg-type]
    table = as_table({name: data[name] for name in columns} | {"pose_id": ids}, meta=meta)
    found = check(table)
    assert found.noise == source
    name = "energy4" if len(columns) == 12 else "linear"
    model = replace(fit_model(table, name), noise=None)
    assert compare(model, table).noise.source == source
    assert found.repeated_poses == (contrasts > 0)
    few = "repeats of 1 pose are too few"
    assert (few in " ".join(found.sentences())) == (contrasts > 0 and source != "repeats")


def test_units_and_spans_of_the_columns() -> None:
    more = {"humidity": np.full(60, 40.0), "pressure_1_Pa": np.linspace(0.0, 1e4, 60)}
    found = check(as_table(neck_columns() | more))
    columns = {column.name: column for column in found.columns}
    assert columns["pressure_1_Pa"].unit == "Pa"
    assert columns["tau_x_Nm"].unit == "N m"
    assert columns["theta_x_rad"].unit == "rad"
    assert columns["x_m"].role == "pose"
    assert columns["humidity"].role == "covariate"
    assert columns["humidity"].constant
    document = found.to_dict()
    assert document["rows"] == 60
    assert {"name", "unit", "role", "min", "max"} <= set(document["columns"][0])
