"""Stress that still decays when a pose is read, in a table without dwell times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from ecm.diagnosis import Diagnosis, diagnose
from ecm.io.arrays import F
from ecm.io.description import FileMeta, Instrument, Meta
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from ecm.models.refit import refit
from support.neck import columns_of
from support.tapered_body import META, NOISE, random_poses, tapered

STEP_S = 5.0
LAWS: dict[str, Callable[[F], F]] = {
    "exponential": lambda age_s: 0.15 * np.exp(-age_s / 12.0),
    "power": lambda age_s: 0.2 * (1.0 + age_s / 2.0) ** -0.6,
}


def found(law: str, seed: int = 1, rows: int = 150) -> Diagnosis:
    """Each step of the load leaves a share that decays by the law; read half a step later."""
    random = np.random.default_rng([seed, 7])
    poses = random_poses(random, rows)
    elastic = tapered(poses)
    wrench = elastic.copy()
    if law:
        steps = np.diff(elastic, axis=0, prepend=np.zeros((1, 6)))
        age = STEP_S * (np.subtract.outer(np.arange(rows), np.arange(rows)) + 0.5)
        wrench += np.where(age > 0.0, LAWS[law](np.maximum(age, 0.0)), 0.0) @ steps
    wrench += random.normal(size=wrench.shape) * NOISE
    columns = columns_of(poses, wrench) | {"time_s": STEP_S * np.arange(rows)}
    table = as_table(columns, meta=META)
    return diagnose(fit_model(table, "energy4-revolution"), table)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_exponential_one_is_a_relaxation(seed: int) -> None:
    said = found("exponential", seed)
    assert said.answer == (("stress_relaxation",),), said.sentence()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_another_law_is_that_or_its_family(seed: int) -> None:
    said = found("power", seed)
    if said.family is None:
        assert said.answer == (("stress_relaxation",),), said.sentence()
    else:
        assert "the poses before" in said.family.driver, said.sentence()


def test_without_memory_there_is_none() -> None:
    assert found("").verdict == "none"


@pytest.mark.parametrize("seed", [1, 2])
def test_a_thick_body_takes_the_temperature_on_later(seed: int) -> None:
    """Its modulus follows the room after ten minutes: by what is recorded, not by time alone."""
    random = np.random.default_rng([seed, 11])
    poses, time = random_poses(random, 150), 30.0 * np.arange(150)
    room = 22.0 + 3.0 * np.sin(time / 900.0) + 1.5 * np.sin(time / 300.0 + 1.0)
    body = np.full(150, room[0])
    for i in range(1, 150):
        body[i] = body[i - 1] + (room[i] - body[i - 1]) * (1.0 - np.exp(-30.0 / 600.0))
    wrench = tapered(poses) * (1.0 - 0.012 * (body - 22.0))[:, None]
    wrench += random.normal(size=wrench.shape) * NOISE
    recorded = {"time_s": time, "temperature_degC": room}
    table = as_table(columns_of(poses, wrench) | recorded, meta=META)
    said = diagnose(fit_model(table, "energy4-revolution"), table)
    assert said.family is not None, said.sentence()
    assert "the temperature of the body" in said.family.driver, said.sentence()


def test_two_time_constants_beside_dwell_times_are_one_relaxation() -> None:
    """One alone left five times the noise, which with it in the model had no name."""
    random = np.random.default_rng(11)
    poses = random_poses(random, 100)
    elastic = tapered(poses)
    dwell = random.choice([5.0, 15.0, 40.0, 120.0, 300.0], 100)
    moved = np.cumsum(dwell + 20.0) - dwell
    held = np.subtract.outer(moved + dwell, moved)
    steps = np.diff(elastic, axis=0, prepend=np.zeros((1, 6)))
    wrench = elastic + random.normal(size=elastic.shape) * NOISE
    for tau_s, share in ((20.0, 0.12), (600.0, 0.08)):
        ramp = -np.expm1(-20.0 / tau_s) * tau_s / 20.0
        decayed = np.exp(-np.maximum(held, 0.0) / tau_s)
        wrench += share * ramp * np.where(held > 0.0, decayed, 0.0) @ steps
    columns = columns_of(poses, wrench) | {"time_s": moved + dwell, "dwell_s": dwell}
    table = as_table(columns, meta=META)
    plain = fit_model(table, "energy4-revolution")
    said, better = diagnose(plain, table), refit(plain, table, add="stress_relaxation")
    assert said.answer == (("stress_relaxation",),), said.sentence()
    shapes = said.effects[0].effect.shape, better.effects[0].effect.shape
    for shape in shapes:  # refit takes the form that diagnose names
        assert (shape["tau_s"], shape["second_tau_s"]) == pytest.approx((20.0, 600.0), rel=0.25)
    assert said.held_out.after < 0.4 * said.held_out.before, said.held_out


def rubber(friction_N: float, softening: float) -> Table:
    """A log of a spring with two relaxations, friction of its guide, and a first loading that is
    stiffer."""
    random = np.random.default_rng(1)
    time = 0.05 * np.arange(2400)
    size = np.interp(time, [0.0, 40.0, 80.0, 120.0], [1.2, 2.0, 2.0, 1.0])
    x = size * (2.0 / np.pi) * np.arcsin(np.sin(0.9 * time + 0.004 * time**2))
    rates = np.diff(x, prepend=x[0])
    load = 120.0 * x + 6.0 * x**3
    for share, tau in ((25.0, 0.6), (18.0, 8.0)):
        load += lfilter([share], [1.0, -np.exp(-0.05 / tau)], rates)
    most = np.maximum.accumulate(np.abs(load))
    load *= 1.0 - softening * np.tanh((most - np.abs(load)) / 120.0)
    load += friction_N * np.tanh(rates / 1e-3) + random.normal(0.0, 1.5, len(time))
    columns = {"time_s": time, "x_m": 1e-3 * x, "fx_N": load}
    rig = Instrument(pose_position_sd_m=1e-7, force_sd_N=1.5)
    return as_table(columns, meta=Meta(file=FileMeta(kind="continuous"), instrument=rig))


def test_friction_that_hides_in_two_relaxations_is_found_beside_them() -> None:
    """The relaxation took in what it could of it: nothing was named at 5.8 times the noise."""
    table = rubber(14.0, 0.0)
    model = refit(fit_model(table, "poly:3"), table, add="stress_relaxation")
    assert model.history[-1].held_out > 2.0
    said = diagnose(model, table)
    assert said.answer == (("hysteresis",),), said.sentence()
    assert said.addition is not None
    assert said.addition.after is not None
    assert said.addition.after < 1.15
    again = diagnose(refit(model, table, add="hysteresis"), table)
    assert not again.answer, again.sentence()


def test_an_effect_more_takes_no_shape_from_the_others() -> None:
    """The shapes of all were chosen anew beside a bad one of the new effect, and were worse."""
    table = rubber(10.0, 0.25)
    model = fit_model(table, "poly:3").add("mullins_softening", "stress_relaxation").fit(table)
    more = model.add("hysteresis").fit(table)
    assert more.history[-1].held_out < 0.95 * model.history[-1].held_out


@pytest.mark.parametrize("hidden", ["jump", ""])
def test_an_effect_that_takes_all_beside_that_of_the_model_is_another_cause(hidden: str) -> None:
    """It had no name while it explained little of what the relaxation does."""
    random = np.random.default_rng(1)
    time = 0.1 * np.arange(960)
    stroke = np.where(time < 48.0, time / 16.0, time / 3.0)
    x = 2.3 * (2.0 / np.pi) * np.arcsin(np.sin(2.0 * np.pi * stroke))
    rates = np.diff(x, prepend=x[0])
    load = 120.0 * x + 6.0 * x**3 + lfilter([60.0], [1.0, -np.exp(-0.1 / 3.0)], rates)
    load += 9.0 * (time > 67.0) * (hidden == "jump")
    columns = {"time_s": time, "x_m": 1e-3 * x, "fx_N": load + random.normal(0.0, 1.5, 960)}
    rig = Instrument(pose_position_sd_m=1e-7, force_sd_N=1.5)
    table = as_table(columns, meta=Meta(file=FileMeta(kind="continuous"), instrument=rig))
    model = refit(fit_model(table, "poly:3"), table, add="stress_relaxation")
    said = diagnose(model, table)
    assert said.answer == ((("jump",),) if hidden == "jump" else ()), said.sentence()
