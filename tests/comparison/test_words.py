"""What a comparison says of a log: loops and dampers, neighbours that err alike, noise alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import ecm
from ecm.io.arrays import F
from ecm.io.table import Table
from support.neck import columns_of

NOISE_NM = 0.02


def log(hidden: Callable[[F, F], F], seed: int = 0) -> Table:
    """Four cycles of a cubic spring at 50 Hz with a torque beside it."""
    random = np.random.default_rng(seed)
    time = 0.02 * np.arange(1500.0)
    angle = 0.4 * np.sin(0.9 * time) * (0.7 + 0.3 * np.sin(0.23 * time))
    torque = 3.0 * angle + 2.0 * angle**3 + hidden(time, angle)
    columns = {
        "time_s": time,
        "theta_z_rad": angle + 1e-5 * random.standard_normal(len(time)),
        "tau_z_Nm": torque + NOISE_NM * random.standard_normal(len(time)),
    }
    meta = {
        "file": {"kind": "continuous"},
        "instrument": {"torque_sd_Nm": NOISE_NM, "pose_rotation_sd_rad": 1e-5},
    }
    return ecm.Table(columns, meta)


def said(table: Table) -> ecm.Comparison:
    return ecm.compare(ecm.fit(table, "cubic"), table)


@pytest.mark.parametrize("seed", range(3))
def test_of_noise_alone_nothing_is_said(seed: int) -> None:
    found = said(log(lambda time, angle: 0.0 * time, seed))
    assert not found.missing
    assert found.neighbours_alike is None
    assert "too small" not in found.sentence()
    assert "too few" not in found.sentence()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["air", "glue"])
def test_what_follows_the_motion_is_structure(kind: str, seed: int) -> None:
    """Air that is pressed out, and glue that pulls on the way back alone: no smooth function."""

    def hidden(time: F, angle: F) -> F:
        rate = np.gradient(angle, time)
        if kind == "air":
            return np.asarray(0.12 * rate * np.abs(rate) / (1.0 - angle) ** 3)
        return np.asarray(-0.06 * np.exp(-(((angle - 0.1) / 0.05) ** 2)) * (rate < 0.0))

    found = said(log(hidden, seed))
    assert found.missing
    assert "nothing in it follows" not in found.sentence()


@pytest.mark.parametrize("seed", range(3))
def test_a_ripple_in_time_is_no_noise_that_was_stated_too_small(seed: int) -> None:
    found = said(log(lambda time, angle: 0.05 * np.sin(2.0 * np.pi * 2.37 * time), seed))
    assert found.neighbours_alike is not None
    assert found.neighbours_alike > 0.5
    assert "neighbouring rows err alike" in found.sentence()
    assert "too small" not in found.sentence()


def test_noise_that_was_stated_too_small_is_called_so() -> None:
    random = np.random.default_rng(5)
    found = said(log(lambda time, angle: 0.03 * random.standard_normal(len(time))))
    assert found.neighbours_alike is None
    assert "that noise is too small, or these rows are too few" in found.sentence()


def test_an_error_of_few_rows_is_no_noise_that_was_stated_too_small() -> None:
    """A stop that four rows touch: all others err as the noise does."""
    found = said(log(lambda time, angle: 9.0 * np.isin(np.arange(1500), [200, 617, 930, 1311])))
    assert found.whitened_rms > 10.0
    assert "too small" not in found.sentence()
    assert "--report lists the worst" in found.sentence()


def test_noise_that_is_not_known_has_no_floor() -> None:
    x = np.linspace(-1.0, 1.0, 30)
    table = ecm.Table({"x_m": x, "fx_N": 3.0 * x + 0.4 * np.sin(40.0 * x)})
    text = str(said(table))
    assert "noise floor" not in text
    assert "RMSE, % of the spread" in text
    # Of a large table, too, it is the spread of all rows that both the sentence and the table give.
    found = ecm.compare(ecm.fit(table, "linear"), table, most_rows=12)
    assert found.rows_used is not None
    share = 100.0 * found.components[0].rmse / table["fx_N"].std()
    assert f" {share:.3g} % of its spread" in found.sentence()
    assert found.shares_of_spread[0] == pytest.approx(share)


def test_noise_that_is_only_assumed_is_no_floor() -> None:
    """All six poses and wrenches, no repeats and no figures: the noise of a common rig weighs."""
    random = np.random.default_rng(0)
    at = random.uniform(-1.0, 1.0, (40, 6)) * [4e-3, 8e-3, 8e-3, 0.2, 0.2, 0.2]
    wrench = at * [2e4, 3e3, 3e3, 4.0, 14.0, 14.0] + 0.002 * random.standard_normal((40, 6))
    table = ecm.Table(columns_of(at, wrench))
    model = ecm.fit(table, "linear")
    compared, found = ecm.compare(model, table), ecm.diagnose(model, table, effects=[])
    assert compared.noise.is_assumed
    assert not compared.noise.is_residual
    for text in (str(compared), found.model.sentence()):
        assert "floor" not in text
        assert "times the noise" not in text
        assert "% of" in text
    for document in (compared.to_dict(), found.to_dict()):
        assert document["noise"]["is_assumed"] is True


@pytest.mark.parametrize("seed", range(3))
def test_what_follows_the_last_change_of_a_pressure_is_structure(seed: int) -> None:
    """Beside 40 coefficients and all smooth functions, few rows said that nothing follows."""
    random = np.random.default_rng(seed)
    x, pressure = 1e-3 * random.uniform(-5.0, 5.0, 70), 1e5 * random.uniform(0.0, 1.0, 70)
    rose = np.sign(np.diff(pressure, prepend=pressure[0]))
    force = 900.0 * x + 2e7 * x**3 - 2e-5 * pressure * (1.0 + 20.0 * x)
    columns = {"time_s": 20.0 * np.arange(70), "x_m": x, "pressure_1_Pa": pressure}
    meta = {"instrument": {"force_sd_N": 0.02, "pose_position_sd_m": 1e-6}}
    noise = 0.02 * random.standard_normal(70)
    for lacks in (0.0, 0.04):
        table = ecm.Table({**columns, "fx_N": force + noise + lacks * rose}, meta)
        assert ecm.compare(ecm.fit(table, "cubic"), table).missing == (lacks > 0.0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("lacks", ["nothing", "friction", "a stop"])
def test_friction_and_a_stop_at_few_visits_of_three_forces_are_structure(
    lacks: str, seed: int
) -> None:
    """Sixty coefficients beside all functions in three forces left nothing to say, at 1.5 to 2."""
    random = np.random.default_rng(seed)
    at = 4e-3 * random.uniform(-1.0, 1.0, (160, 3))
    force = 9.0 * at + 2e5 * at**3 + 6e-4 * random.standard_normal((160, 3))
    if lacks == "friction":  # a tip in its sheath
        force[:, 0] += 2e-3 * np.sign(np.diff(at[:, 0], prepend=0.0))
    if lacks == "a stop":
        force[:, 0] += 15.0 * np.maximum(at[:, 0] - 2.7e-3, 0.0)
    names = ("time_s", "x_m", "y_m", "z_m", "fx_N", "fy_N", "fz_N")
    columns = dict(zip(names, (3.0 * np.arange(160), *at.T, *force.T), strict=True))
    meta = {"instrument": {"force_sd_N": 6e-4, "pose_position_sd_m": 1e-6}}
    found = said(ecm.Table(columns, meta))
    assert found.missing == (lacks != "nothing")


def test_a_stop_beyond_a_polynomial_of_eight_degrees_is_structure() -> None:
    """Its error was said to be noise that is stated too small, while the diagnosis named it."""
    for height in (0.0, 15.0):
        table = log(lambda _, angle, height=height: height * np.maximum(angle - 0.29, 0.0))
        assert ecm.compare(ecm.fit(table, "poly:8"), table).missing == (height > 0.0)


def test_an_error_that_only_several_components_show_is_not_said_of_one() -> None:
    """Noise of the position moves force and torque together; what parts them is small beside it."""
    random, x = np.random.default_rng(2), np.linspace(-0.01, 0.01, 80)
    moved = 1e5 * (x + 1e-5 * random.standard_normal(80))
    parting = 0.3 * np.sin(800.0 * x) + 0.01 * random.standard_normal(80)
    columns = {"x_m": x, "fx_N": moved + parting, "tau_y_Nm": 0.02 * (moved - parting)}
    figures = {"pose_position_sd_m": 2e-5, "force_sd_N": 0.01, "torque_sd_Nm": 2e-4}
    found = said(ecm.Table(columns, {"instrument": figures}))
    assert max(one.excess for one in found.components) == 0.0
    assert found.whitened_rms > 2.0
    assert found.sentence().endswith("no component shows alone: their noise goes together.")


def test_rows_before_the_moment_of_an_effect_are_told() -> None:
    """A clock that begins anew is before the knock, and nothing told why the model erred."""
    time, random = 5.0 * np.arange(60.0), np.random.default_rng(2)
    x = random.uniform(-1e-3, 1e-3, 60)
    force = 2e4 * x + 4.0 * (time > 150.0) + random.normal(0.0, 0.1, 60)
    table = ecm.as_table({"time_s": time, "x_m": x, "fx_N": force})
    model = ecm.refit(ecm.fit_model(table, "linear"), table, add="jump")
    (effect,) = model.effects
    # Another table whose clock begins anew and goes on for as long has the jump in its middle.
    ways = ((0.0, 0.4, "all of these rows"), (0.0, 1.1, "28 of these rows"), (400.0, 0.4, ""))
    for begin, pace, told in ways:
        later = table.with_columns({"time_s": begin + pace * time})
        said = [text for text in ecm.compare(model, later).warnings if "acts after" in text]
        assert bool(said) == bool(told)
        assert all(f"jump acts after {effect.effect.acts_after_s:g} s" in one for one in said)
        assert all(told in one for one in said)
    assert not any("acts after" in text for text in ecm.compare(model, table).warnings)
