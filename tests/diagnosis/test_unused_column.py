"""Columns of the user's own that act: each is an effect by itself, in tables of any columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.diagnosis.procedure import find_missing
from ecm.effects import effect, effects_of, unregister, with_shape
from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH
from ecm.models import load_model
from ecm.models.export.files import export_files
from support.models import spring_body
from support.neck import Command

LENGTH_M = 0.1
META = {
    "mechanism": {"length_m": LENGTH_M},
    "instrument": {"force_sd_N": 0.05, "torque_sd_Nm": 0.005,
                   "pose_position_sd_m": 1e-9, "pose_rotation_sd_rad": 1e-9},
}  # fmt: skip


def six_by_six(acts: str, rows: int = 240) -> ecm.Table:
    """An arc of springs with two columns of one's own, of which `valve` acts."""
    random = np.random.default_rng(5)
    time = 2.0 * np.arange(rows)
    poses = random.uniform(-1.0, 1.0, (rows, 6)) * [1e-4, 4e-3, 4e-3, 0.05, 0.05, 0.05]
    valve = np.repeat(random.uniform(0.0, 4.0, rows // 12), 12)
    idle = np.repeat(random.uniform(0.0, 1.0, rows // 6), 6)
    poses[:, 1:3] += 0.5 * LENGTH_M * np.column_stack([poses[:, 5], -poses[:, 4]])
    poses[:, 0] += LENGTH_M
    at = poses.copy()
    if acts == "shifts":
        at[:, 1] -= 2e-4 * valve
    wrenches = spring_body().predict(at)
    if acts == "adds":
        wrenches[:, 2] += 0.2 * valve
    elif acts == "scales":
        wrenches *= 1.0 + 0.05 * valve[:, None]
    elif acts == "adds with a lag":
        late = valve.copy()
        for i in range(1, rows):
            late[i] = valve[i] + (late[i - 1] - valve[i]) * np.exp(-2.0 / 15.0)
        wrenches[:, 2] += 0.2 * late
    wrenches += random.standard_normal((rows, 6)) * np.repeat([0.05, 0.005], 3)
    names = (*POSE, *WRENCH, "time_s", "valve", "idle")
    return ecm.as_table(
        dict(zip(names, (*poses.T, *wrenches.T, time, valve, idle), strict=True)), meta=META
    )


@pytest.mark.parametrize("acts", ["adds", "scales", "shifts", "adds with a lag"])
def test_an_own_column_of_six_by_six_is_named_with_how_it_acts(acts: str, tmp_path: Path) -> None:
    table = six_by_six(acts)
    plain = ecm.fit(table, "cubic")
    found = find_missing(plain, table)
    assert found.answer == (("unused_column:valve",),)
    better = ecm.refit(plain, table, add=["unused_column:valve"])
    shape = better.effects[0].effect.shape
    assert (shape["column"], shape["acts"]) == ("valve", acts.split(maxsplit=1)[0])
    if "lag" in acts:
        np.testing.assert_allclose(float(shape["lag_s"]), 15.0, rtol=0.15)
    else:
        assert "lag_s" not in shape
    better.save(tmp_path / "model.json")
    loaded = load_model(tmp_path / "model.json")
    np.testing.assert_array_equal(loaded.predict(table), better.predict(table))
    assert ecm.compare(loaded, table).whitened_rms < 1.05
    fixed = loaded.at({"valve": 2.5})
    there = table.with_columns({"valve": np.full(len(table), 2.5)})
    np.testing.assert_allclose(fixed.predict(table.poses), better.predict(there), atol=1e-9)
    exported = export_files(fixed, "c")
    assert "unused_column:valve at valve = 2.5" in exported.notes[0]
    assert not exported.lost
    assert exported.folding < 0.3


def test_an_export_at_one_value_of_a_column_is_the_way_out(
    tmp_path: Path, ecm_command: Command
) -> None:
    table, model, out = six_by_six("scales"), tmp_path / "valve.json", tmp_path / "code"
    better = ecm.refit(ecm.fit(table, "energy4"), table, add=["unused_column:valve"])
    better.save(model)
    refused = ecm_command("export", model, "--to", "opensim", "--out", out).refused()
    command = refused.err.strip().splitlines()[-1].split()
    low, high = better.conditions["valve"]
    assert command[:2] == ["ecm", "export"]
    assert command[-2:] == ["--at", f"valve={0.5 * (low + high):.6g}"]
    assert "unused_column:valve at valve" in ecm_command(*command[1:]).good().out
    for words, told in (
        ("valve=99", f"measured from {low:.6g} to"),
        ("idle=1", "columns that are followed so: valve"),
        ("valve", "expected COLUMN=VALUE"),
    ):
        again = ecm_command("export", model, "--to", "c", "--out", out, "--at", words)
        assert told in again.refused().err
    with pytest.raises(InputError, match="save the model that follows its columns"):
        better.at({"valve": 2.0}).save(model)


def test_a_column_that_sets_the_damping_is_named_beside_the_damper() -> None:
    """The current of a magnetorheological mount: it acts with the velocity, and alone nowhere."""
    random, time = np.random.default_rng(4), 0.002 * np.arange(1500)
    x = 0.004 * np.sin(12.6 * time) + 0.0015 * np.sin(29.8 * time)
    current = np.repeat(random.choice([0.0, 0.5, 1.0, 1.5, 2.0], 15), 100)
    force = 9e4 * x + (500.0 + 900.0 * current) * np.gradient(x, time)
    columns = {"time_s": time, "x_m": x, "fx_N": force + 2.0 * random.standard_normal(len(time))}
    instrument = {"force_sd_N": 2.0, "pose_position_sd_m": 1e-9}
    table = ecm.as_table(columns | {"current": current}, meta={"instrument": instrument})
    spring = ecm.fit(table, "linear")
    found = find_missing(spring, table)
    current_named, damper = sorted(found.answer)
    assert current_named == ("unused_column:current",)
    assert "viscous_damping" in damper  # a branch that relaxes within a sample is none other
    model = ecm.refit(spring, table, add=["viscous_damping", "unused_column:current"])
    assert ecm.compare(model, table).whitened_rms < 1.1
    np.testing.assert_allclose(model.effects[1].values, 900.0, rtol=0.02)
    # At one current it is a damper, no function of the pose: nothing that an export folds in.
    assert model.followed == {}


def test_where_no_own_column_acts_none_is_named() -> None:
    table = six_by_six("nothing")
    assert find_missing(ecm.fit(table, "cubic"), table).verdict == "none"
    assert {"unused_column:valve", "unused_column:idle"} <= set(ecm.check(table).testable)


def test_two_columns_that_act_are_both_named() -> None:
    random, n = np.random.default_rng(2), 200
    angle = 0.3 * np.sin(0.13 * np.arange(n)) + 0.1 * np.sin(0.62 * np.arange(n))
    slider = np.repeat(random.uniform(-0.5, 0.5, 20), 10)
    clamp = np.repeat(random.uniform(0.0, 1.0, 25), 8)
    idle = np.repeat(random.uniform(0.0, 1.0, 40), 5)
    torque = 4.0 * angle * (1.0 + 0.3 * clamp) + 0.3 * slider + 0.01 * random.standard_normal(n)
    columns = {"theta_z_rad": angle, "tau_z_Nm": torque, "time_s": 2.0 * np.arange(n)}
    table = ecm.as_table(
        columns | {"slider": slider, "clamp": clamp, "idle": idle},
        meta={"instrument": {"torque_sd_Nm": 0.01, "pose_rotation_sd_rad": 1e-9}},
    )
    found = find_missing(ecm.fit(table, "linear"), table)
    assert sorted(found.answer) == [("unused_column:clamp",), ("unused_column:slider",)]
    both = ecm.refit(
        ecm.fit(table, "linear"), table, add=["unused_column:clamp", "unused_column:slider"]
    )
    assert ecm.compare(both, table).whitened_rms < 1.1
    assert [item.id for item in both.remove("unused_column:clamp").effects] == [
        "unused_column:slider"
    ]


def test_a_column_that_an_effect_of_ones_own_uses_is_not_unused() -> None:
    table = six_by_six("adds")

    @effect("valve_force", physics="The valve pushes.", parameters={"z": "N"}, needs=("valve",))
    def pushes(rows):  # type: ignore[no-untyped-def]
        return np.eye(6)[2] * rows.table.column("valve")[:, None]

    try:
        ids = {item.id for item in effects_of(table)}
        assert "unused_column:idle" in ids
        assert "unused_column:valve" not in ids
        assert find_missing(ecm.fit(table, "cubic"), table).answer == (("valve_force",),)
    finally:
        unregister("valve_force")


def test_a_model_file_from_before_columns_had_effects_of_their_own_is_read() -> None:
    old = {"column": "valve", "zero": 2.0, "acts": "scales", "outputs": "fx_N"}
    assert with_shape("unused_column", old).id == "unused_column:valve"


def piston() -> ecm.Table:
    """A cubic spring and three pressures that add to it, of 220, 84 and 35 times the noise."""
    random, rows = np.random.default_rng(9), 200
    x = 0.01 * np.sin(np.linspace(0.0, 20.0, rows)) * random.uniform(0.5, 1.0, rows)
    pressures = {
        "supply_1_Pa": 2e5 * (1.5 + np.sin(np.linspace(0.0, 7.0, rows) + 1.0)),
        "supply_2_Pa": 1e5 * random.choice([0.2, 0.5, 1.0, 1.4], rows),
        "supply_3_Pa": 5e4 * (1.0 + np.cos(np.linspace(0.0, 31.0, rows))),
    }
    force = 900.0 * x + 2e6 * x**3 + 0.05 * random.standard_normal(rows)
    for value, slope in zip(pressures.values(), (-1.2e-4, 0.8e-4, -0.5e-4), strict=True):
        force += slope * value
    columns = {"time_s": 2.0 * np.arange(rows), "x_m": x, "fx_N": force} | pressures
    return ecm.as_table(
        columns, meta={"instrument": {"force_sd_N": 0.05, "pose_position_sd_m": 1e-6}}
    )


def test_three_pressures_are_named_at_once_and_beside_one_that_the_model_has() -> None:
    """The straight line that is chosen beside so large loads is no base once these are named."""
    table, ids = piston(), [f"unused_column:supply_{k}_Pa" for k in (1, 2, 3)]
    model = ecm.fit_model(table, "cubic")
    found = ecm.diagnose(model, table)
    assert {members[0] for members in found.answer} == set(ids), found.sentence()
    assert found.addition is not None
    assert found.addition.after is not None
    assert found.addition.after < 1.3
    with_one = ecm.refit(model, table, add=ids[:1])
    named = ecm.diagnose(with_one, table).answer
    assert {members[0] for members in named} == set(ids[1:])


def swelling_pad() -> ecm.Table:
    """A pad of foam, 9 by 5 columns, pressed and tilted, that swells with the air's humidity."""
    random, rows = np.random.default_rng(0), 45
    z, humidity = -random.uniform(0.4e-3, 4.5e-3, rows), random.uniform(25.0, 65.0, rows)
    tilt = random.uniform(-0.06, 0.06, (rows, 2))
    places = np.meshgrid(np.linspace(-0.02, 0.02, 9), np.linspace(-0.03, 0.03, 5))
    y, x = (place.ravel() for place in places)
    strain = -(z[:, None] + tilt[:, :1] * y - tilt[:, 1:] * x) / 0.015
    strain += 1.2e-3 * (humidity[:, None] - 45.0)
    load, sd = -3.2 * (strain + 9.0 * strain**3), (0.04, 6e-4, 6e-4)
    wrench = np.column_stack([load.sum(axis=1), load @ y, -load @ x])
    names = "z_m", "theta_x_rad", "theta_y_rad", "fz_N", "tau_x_Nm", "tau_y_Nm", "humidity"
    columns = z, *tilt.T, *(wrench + random.normal(0.0, sd, (rows, 3))).T, humidity
    noise = {"pose_position_sd_m": 6e-6, "pose_rotation_sd_rad": 2e-4}
    noise |= {"force_sd_N": sd[0], "torque_sd_Nm": sd[1]}
    return ecm.as_table(dict(zip(names, columns, strict=True)), meta={"instrument": noise})


def test_an_effect_is_added_to_the_degree_that_it_hid() -> None:
    """The swelling hides the cubic terms: added to the quadratic it left many times the noise."""
    table = swelling_pad()
    model = ecm.fit(table, "quadratic")
    found = ecm.diagnose(model, table)
    assert found.answer == (("unused_column:humidity",),)
    assert found.addition is not None
    assert found.addition.remedy is not None
    command = "ecm fit DATA --model poly:3 --add unused_column:humidity --out OUT"
    assert found.addition.remedy.command == command
    said = found.report().text()
    assert "fit poly:3 with unused_column:humidity, which errs" in said
    better = ecm.fit(table, "poly:3").add("unused_column:humidity").fit(table)
    plain = ecm.refit(model, table, add="unused_column:humidity")
    assert better.training["over_noise"] < 0.3 * plain.training["over_noise"]


def test_a_weak_column_has_a_name_once_a_strong_effect_is_in_the_model() -> None:
    """What the form of friction leaves follows no humidity: it was "another form of hysteresis"."""
    random, time = np.random.default_rng(1), 5.0 * np.arange(240)
    x = 3.0 * np.sin(time / 23.9 + 1.0) + 0.6 * np.sin(time / 7.48)
    turn = 2.5 * np.sin(time / 15.4 + 1.0)
    humid = 45.0 + 12.0 * np.sin(time / 420.0) + random.normal(0.0, 0.2, 240)
    way, rub, most = np.column_stack([x, turn]), np.zeros((240, 2)), np.array([1.2, 8.0])
    for i in range(1, 240):
        rub[i] = np.clip(rub[i - 1] + 2.0 * most * (way[i] - way[i - 1]), -most, most)
    elastic = np.column_stack(
        [9.0 * x + 0.12 * x**3 + 1.1 * turn, 40.0 * turn + 1.5 * turn**3 + 63.0 * x]
    )
    load = elastic * (1.0 - 0.0012 * (humid - 45.0))[:, None] + rub
    load += random.normal(size=(240, 2)) * [0.15, 0.8]
    columns = {"time_s": time, "x_m": 1e-3 * x, "theta_z_rad": np.deg2rad(turn), "humidity": humid}
    columns |= {"fx_N": load[:, 0], "tau_z_Nm": 1e-3 * load[:, 1]}
    noise = {"force_sd_N": 0.15, "torque_sd_Nm": 8e-4}
    noise |= {"pose_position_sd_m": 1e-6, "pose_rotation_sd_rad": 3.5e-5}
    table = ecm.as_table(columns, meta={"instrument": noise})
    rubs = ecm.refit(ecm.fit(table, "cubic"), table, add="hysteresis")
    found = find_missing(rubs, table)
    assert found.answer == (("unused_column:humidity",),)
