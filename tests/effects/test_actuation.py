"""Effects of actuators: tendons, the side a pressure comes from, columns that are exchanged."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ecm
from ecm.effects import get_effect
from ecm.effects.actuation import PressureGain, PressureHysteresis, RegulatorLag, TendonStretch
from ecm.effects.registry import effects_of_actuators
from ecm.effects.relaxation import over_visits
from ecm.errors import InputError
from ecm.io.arrays import F, rms
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models import Model
from ecm.models.actuated import ActuatedMap, ActuatedModel, ActuatedTerms, exchanged
from ecm.models.joint_fit import FittedEffect, joint_fit
from ecm.regression.noise import declared_noise
from ecm.regression.rows import Rows
from support.driven import (
    ARM,
    NOISE,
    PRESSURES,
    TENSIONS,
    VOLUMES,
    arm_model,
    arm_table,
    measured,
    tendon_table,
)
from support.neck import Command


@pytest.fixture(scope="module")
def pulled() -> Table:
    return tendon_table()


@pytest.fixture(scope="module")
def pulled_model(pulled: Table) -> Model:
    return ecm.fit_model(pulled, "actuated4")


def bend(table: Table) -> F:
    """(N, 1) turn of the platform's axis, rad."""
    return np.linalg.norm(table.poses[:, 4:], axis=1)[:, None]


def test_tendon_friction_is_named_by_its_growth_with_the_bend(
    pulled: Table, pulled_model: Model
) -> None:
    plant = ecm.fit_model(pulled, "actuated5")
    tensions = pulled.matrix(TENSIONS)
    acting = tensions.copy()
    acting[:, 1] *= np.exp(-0.4 * bend(pulled)[:, 0])
    found = ecm.diagnose(pulled_model, measured(pulled, plant, acting))
    assert [item.id for item in found.effects] == ["capstan_friction"]
    assert found.effects[0].effect.shape["actuator"] == "tension_2_N"
    assert found.effects[0].values[0] == pytest.approx(0.4, rel=0.2)


def test_a_base_is_fitted_with_what_an_effect_adds_through_it(
    pulled: Table, pulled_model: Model
) -> None:
    """Friction that stays leaves linear least squares of the base: the first step ends them."""
    rubs = FittedEffect(get_effect("capstan_friction"), np.array([2.0]), np.zeros(1), frozen=True)
    noise = declared_noise(ecm.as_table(pulled, meta={**ARM, "instrument": NOISE}))
    fit = joint_fit(pulled_model.base, (rubs,), pulled, noise)
    assert fit.converged
    assert rms(fit.whitened) < 1.0


@pytest.mark.parametrize("kind", ["pressure", "tension"])
def test_what_is_warm_is_the_wall_and_not_what_drives_it(kind: str) -> None:
    """A body of s times the modulus has the wrench s h(p, a / s): the part of the inputs stays."""
    table = arm_table() if kind == "pressure" else tendon_table()
    plant = ecm.fit_model(table, "actuated5")
    warm = 3.0 * np.random.default_rng(5).standard_normal(len(table))
    wall = 1.0 - 0.02 * warm[:, None]
    inputs = table.matrix(PRESSURES if kind == "pressure" else TENSIONS)
    softened = wall * plant.predict(table.matrix(POSE), inputs / wall)
    columns = dict(table.columns) | dict(zip(WRENCH, softened.T, strict=True))
    columns["temperature_degC"] = 23.0 + warm
    rows = ecm.as_table(columns, meta={**ARM, "instrument": NOISE})
    model = ecm.refit(ecm.fit_model(rows, "actuated4"), rows, add="temperature_modulus")
    assert model.effects[0].values[0] == pytest.approx(0.02, rel=0.05)
    left = np.abs(model.readings(rows) - softened).max(axis=0)
    assert (left < 0.05 * softened.std(axis=0)).all()


@pytest.mark.parametrize("frame", ["", "middle"])
def test_what_relaxes_is_the_wall_and_not_what_drives_it(frame: str) -> None:
    """At a pose that stays, nothing relaxes of inputs that push a body in proportion to them."""
    terms = ActuatedTerms(0.1, ("pressure",), degree=3, order=1)
    scales, none = np.ones(terms.count()), np.zeros(len(terms.pure()))
    base = ActuatedMap(terms, np.ones(2), np.ones(1), scales, none, ("pressure_1_Pa",))
    columns = {name: np.full(24, 0.1 * j) for j, name in enumerate((*POSE, *WRENCH), 1)}
    columns |= {"pressure_1_Pa": np.random.default_rng(2).uniform(0.0, 5.0, 24)}
    # What relaxes of the move to the first pose, of which no approach is known, has decayed.
    columns |= {"time_s": 30.0 * np.arange(24), "dwell_s": np.tile([2.0, 20.0], 12)}
    columns["dwell_s"][0] = 1e3
    rows = Rows(ecm.as_table(columns, meta=ARM), base)
    assert np.ptp(rows.wrench, axis=0).max() > 1.0
    assert np.abs(over_visits(rows, 10.0, frame)[1:]).max() < 1e-9


def test_a_winch_that_stands_still_stretches_the_tendon(pulled: Table, pulled_model: Model) -> None:
    plant = ecm.fit_model(pulled, "actuated5")
    tensions = pulled.matrix(TENSIONS)
    shortening = plant.actuated.amounts(np.hstack([pulled.matrix(POSE), tensions]))
    acting = tensions - 600.0 * shortening * [0.0, 0.0, 1.0]
    found = ecm.diagnose(pulled_model, measured(pulled, plant, acting))
    assert "tendon_stretch" in found.answer[0]
    effect = next(item for item in found.effects if item.id == "tendon_stretch")
    assert effect.effect.shape["actuator"] == "tension_3_N"
    assert effect.values[0] == pytest.approx(600.0, rel=0.25)


def test_friction_turns_over_where_the_tendon_was_let_out(
    pulled: Table, pulled_model: Model
) -> None:
    rows = pulled.select(np.array([0, 1, 0, 1]))
    columns = {"pose_id": np.array([0.0, 1.0, 0.0, 1.0])}
    columns |= {"approach": np.array(["initial", "initial", "1", "0"], dtype=object)}
    both = Rows(rows.with_columns(columns), pulled_model.base)
    change = get_effect("capstan_friction").change(both, rows.matrix(TENSIONS))  # type: ignore[attr-defined]
    own = rows.matrix(TENSIONS)
    let_out = np.vstack([np.zeros((2, 3), bool), own[:1] < own[1:2], own[1:2] < own[:1]])
    np.testing.assert_allclose(change, np.where(let_out, 1.0, -1.0) * own * bend(rows))


def test_a_pressure_from_the_rest_pose_came_from_below() -> None:
    """With the column approach the row before in time is not where it came from."""
    table = arm_table().select(np.arange(3)).drop("volume_1_m3", "volume_2_m3", "volume_3_m3")
    columns = {"pose_id": np.arange(3.0), "time_s": 60.0 * np.arange(3.0)}
    columns |= {"approach": np.array(["initial", "initial", "1"], dtype=object)}
    rows = Rows(table.with_columns(columns), arm_model().base)
    inputs = table.matrix(PRESSURES)
    change = get_effect("pressure_hysteresis").change(rows, inputs)  # type: ignore[attr-defined]
    expected = -np.sign(inputs - np.vstack([np.zeros((2, 3)), inputs[1]]))
    np.testing.assert_array_equal(change, expected)


def test_a_wall_that_slips_turns_over_along_its_reach() -> None:
    """From no pressure up to 3 reaches, half a reach back, and all the way down again."""
    reach, table = 2000.0, arm_table().select(np.arange(3)).drop("volume_1_m3")
    pressures = dict.fromkeys(PRESSURES, np.array([3.0, 2.5, 0.0]) * reach)
    columns = {"pose_id": np.arange(3.0), "time_s": 60.0 * np.arange(3.0)} | pressures
    columns |= {"approach": np.array(["initial", "0", "1"], dtype=object)}
    rows = Rows(table.with_columns(columns), arm_model().base)
    wall = PressureHysteresis(reach_Pa=reach)
    change = wall.change(rows, rows.table.matrix(PRESSURES))
    np.testing.assert_allclose(change, np.array([[-1.0], [-0.5], [1.0]]) * np.ones(3))


def test_what_is_left_of_all_changes_is_to_come() -> None:
    """A valve of first order, read soon after each of three changes."""
    tau, step, table = 2.0, 1.0, arm_table().select(np.arange(3)).drop("volume_1_m3")
    pressures = np.array([4.0, 8.0, 2.0]) * 1e3
    columns = {"time_s": step * np.arange(3.0)} | dict.fromkeys(PRESSURES, pressures)
    rows = Rows(table.with_columns(columns), arm_model().base)
    lag = RegulatorLag(tau_s=tau)
    change = lag.change(rows, rows.table.matrix(PRESSURES))[:, 0]
    acts = [4e3]
    for pressure in pressures[1:]:
        acts.append(pressure + (acts[-1] - pressure) * np.exp(-step / tau))
    np.testing.assert_allclose(change, acts - pressures)
    assert lag.way(rows, np.ones(1)) == "all alike"
    words = RegulatorLag(PRESSURES[1]).way(rows, -np.ones(1))
    assert words == f"in {PRESSURES[1]}; the gauge lags behind the pressure that acts"


@pytest.mark.parametrize("of", [PressureGain, PressureHysteresis, RegulatorLag, TendonStretch])
def test_what_one_actuator_does_is_fitted_to_that_one(of: type[Any]) -> None:
    """As `ecm diagnose` adds what it named: the shape is known, and its actuator with it."""
    table = tendon_table() if of is TendonStretch else arm_table()
    each = [*table.actuation_columns]
    assert {one.shape["actuator"] for one in of().variants(table)} == {"all", *each}
    assert {one.shape["actuator"] for one in of(each[1]).variants(table)} == {each[1]}


def test_effects_of_one_kind_leave_the_other_alone(pulled: Table, pulled_model: Model) -> None:
    names = {effect.id for effect in effects_of_actuators()}
    assert {"capstan_friction", "tendon_stretch"} <= names
    for effect in effects_of_actuators():
        lacks = effect.missing(pulled)
        assert (lacks is None) == (effect.id in ("capstan_friction", "tendon_stretch")), effect.id
    gain = get_effect("pressure_gain").columns(Rows(pulled, pulled_model.base))  # type: ignore[attr-defined]
    assert not gain.any()


def test_a_tendon_that_would_push_has_the_wrong_sign(pulled: Table) -> None:
    name = pulled.actuation_columns[1]
    pushing = pulled.with_columns({name: -pulled[name]})
    for symmetry in ("alike", "general"):
        assert exchanged(pulled, ActuatedModel(symmetry=symmetry)) is None
        wrong = exchanged(pushing, ActuatedModel(symmetry=symmetry))
        assert wrong is not None
        assert wrong.mend == (f'{name} = {{ column = "{name}", scale = -1.0 }}',)
    with pytest.raises(InputError, match=f"the sign of {name} looks reversed: a tendon only pull"):
        ecm.fit(pushing, "actuated3")


def test_exchanged_chambers_are_refused_with_the_entry_that_mends_them(
    tmp_path: Path, ecm_command: Command
) -> None:
    table = arm_table().drop("volume_1_m3", "volume_2_m3", "volume_3_m3").select(np.arange(60))
    assert exchanged(table, ActuatedModel()) is None
    one, two = PRESSURES[:2]
    swapped = table.with_columns({one: table[two], two: table[one]})
    assert "chambers or tendons swapped" in " ".join(ecm.check(swapped).warnings)
    with pytest.raises(InputError, match=f"{one} and {two} look exchanged"):
        ecm.fit_model(swapped, "actuated4")
    assert ecm.fit_model(swapped, "actuated4", force=True).name == "actuated4"
    assert exchanged(swapped, ActuatedModel(symmetry="general")) is None
    # What is printed, typed.
    path, out = tmp_path / "s.csv", tmp_path / "s.json"
    replace(swapped, meta=table.meta).write(path)
    refused = ecm_command("fit", path, "--model", "actuated4", "--out", out).refused()
    lines = refused.err.splitlines()
    begin = next(i for i, line in enumerate(lines) if line.strip() == "[columns]")
    entries = [line.strip() for line in lines[begin : begin + 3]]
    toml = path.with_suffix(".toml")
    toml.write_text(toml.read_text() + "\n".join(entries) + "\n")
    ecm_command("fit", path, "--model", "actuated4", "--out", out).good()


def test_diagnose_names_exchanged_chambers_with_a_command_that_mends_them(
    tmp_path: Path, ecm_command: Command
) -> None:
    """Of a model that was fitted before, and of one that was forced onto the exchanged columns."""
    table, one, two = arm_table().drop(*VOLUMES), *PRESSURES[:2]
    noisy = measured(table, arm_model(), table.matrix(PRESSURES))
    path, model, forced = (tmp_path / name for name in ("s.csv", "arm.json", "forced.json"))
    swapped = noisy.with_columns({one: noisy[two], two: noisy[one]}).select(np.arange(60))
    swapped.write(path)
    ecm.fit_model(noisy.select(np.arange(40, 100)), "actuated4").save(model)
    ecm.fit_model(ecm.read_table(path), "actuated4", force=True).save(forced)
    for given in (model, forced):
        done = ecm_command("diagnose", given, path, "--json", tmp_path / "found.json")
        missing, add, after = done.out.splitlines()[:3]
        said = f"MISSING: no effect, the table looks misread: {one} and {two} look exchanged"
        assert missing.startswith(said)
        assert add == f"ADD IT:  ecm check {path} --mend"
        mend = "mend the table or its description, fit the model again, and diagnose it"
        assert after == f"NEXT:    {mend}"
        found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
        assert (found["verdict"], found["answer"]) == ("unknown", [])
    assert f"{one} and {two} look exchanged" in ecm_command("check", path).err
    # What is printed, typed; the rest of the description stays.
    before = path.with_suffix(".toml").read_text()
    mended = ecm_command(*add.split()[3:])
    assert (mended.code, "[columns] has" in mended.out) == (0, True)
    assert before.strip() in path.with_suffix(".toml").read_text()
    assert "exchanged" not in mended.err
    again = ecm_command("diagnose", model, path).out
    assert again.startswith("MISSING: nothing that these data could show")
    done = ecm_command("fit", path, "--model", "actuated4", "--out", tmp_path / "s.json").good()
    assert "nothing that an entry" in ecm_command("check", path, "--mend").out


def test_a_model_without_symmetry_takes_its_columns_in_any_order() -> None:
    table = arm_table().drop(*VOLUMES)
    one, two = PRESSURES[:2]
    swapped = table.with_columns({one: table[two], two: table[one]})
    model = ecm.fit_model(swapped, ActuatedModel(degree=3, order=1, symmetry="general"))
    found = ecm.diagnose(model, swapped, effects="pressure_gain")
    assert "exchanged" not in found.summary().missing
