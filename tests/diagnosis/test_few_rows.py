"""Twenty to sixty poses in any order, each once, of a body of which the length alone is stated.

Laws are written here, by other formulas than those of the catalogue where it has one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from ecm.diagnosis import diagnose, find_missing, other_bases
from ecm.diagnosis.left_over import residual_after
from ecm.diagnosis.problem import Projection, assemble
from ecm.diagnosis.search import delta_chi2, held_out_squares, held_out_t, rank
from ecm.diagnosis.verdict import WEIGHTS
from ecm.effects import (
    Effect,
    LinearEffect,
    Parameter,
    Rows,
    effect,
    effects_of,
    get_effect,
    unregister,
)
from ecm.effects.protocol import guesses_torques
from ecm.io.arrays import F, rest_of
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import FileMeta, Instrument, Meta
from ecm.io.se3 import rotation
from ecm.io.table import Table, as_table
from ecm.models import Model, fit, fit_model
from ecm.models.energy import Symmetry
from ecm.models.fit import choose_base
from ecm.models.joint_fit import base_columns, joint_fit
from ecm.models.maps import EnergyTerms, PolynomialMap, StiffnessMap
from ecm.models.polynomial import PolynomialModel
from ecm.regression.noise import Noise
from support.campaigns import INSTRUMENT, NOISE, campaign, model, workspace_poses
from support.neck import columns_of
from support.stand_in import L, wrench

FORCES = WRENCH[:3]


def rows(poses: F, measured: F, seed: int, names: tuple[str, ...] = WRENCH, **more: F) -> Table:
    """The table of a user who knows the length, with times at rest and noise."""
    random = np.random.default_rng(seed)
    read = measured + NOISE * random.standard_normal(measured.shape)
    rest = np.exp(random.uniform(np.log(1.5), np.log(45.0), len(poses)))
    columns = dict(zip(POSE, poses.T, strict=True))
    columns |= {name: read[:, WRENCH.index(name)] for name in names}
    columns |= {"dwell_s": rest, "time_s": np.cumsum(rest + 6.0)} | more
    figures = {name: getattr(INSTRUMENT, name) for name in INSTRUMENT.__dataclass_fields__}
    return as_table(columns, meta={"mechanism": {"length_m": L}, "instrument": figures})


def linear(table: Table) -> object:
    return fit_model(table, "linear", force=True)


def answer(table: Table) -> set[str]:
    return {id for members in diagnose(linear(table), table).answer for id in members}


def test_a_form_that_the_base_takes_in_is_what_others_look_like_beside_forms_that_show() -> None:
    """A mass in all rows of three forces: the base has it, and one from a moment on is testable."""
    poses = workspace_poses(60, 3)
    table = rows(poses, wrench(poses), 8, FORCES)
    base = choose_base(fit_model(table, "energy4"), table)
    problem = assemble(base, table, effects_of(table))
    assert [one.effect.shape for one in problem.imitators if one.id == "payload"] == [{}]
    assert "payload" in problem.ids
    weighed = diagnose(
        linear(table := rows(poses, wrench(poses) - [6.0, 0, 0, 0, 0, 0], 8, FORCES)), table
    )
    assert any("payload" in members for members in weighed.answer)


def nearest_first(poses: F) -> F:
    """Poses as a hand takes them, each near the one before."""
    left, order = list(range(1, len(poses))), [0]
    scale = poses.std(axis=0)
    while left:
        away = (((poses[left] - poses[order[-1]]) / scale) ** 2).sum(axis=1)
        order.append(left.pop(int(np.argmin(away))))
    return poses[order]


@pytest.mark.parametrize("seed", [1, 2])
def test_an_offset_of_a_sensor_of_three_axes_is_found(seed: int) -> None:
    """It was the constant term of the model, which no energy has."""
    poses = workspace_poses(50, seed)
    zero = rotation(poses[:, 3:]) @ np.array([0.6, -0.9, 0.7])
    measured = wrench(poses) + np.hstack([zero, np.zeros_like(zero)])
    assert "fts_offset" in answer(rows(poses, measured, seed, FORCES))


def test_nothing_hidden_in_three_forces_is_nothing() -> None:
    poses = workspace_poses(50, 3)
    table = rows(poses, wrench(poses), 3, FORCES)
    assert diagnose(linear(table), table).verdict == "none"


def test_an_effect_whose_forces_follow_from_torques_needs_them() -> None:
    """A base that tilts by the torque: its forces are a guess where only forces are measured."""
    poses = workspace_poses(50, 4)
    table = rows(poses, wrench(poses), 4, FORCES)
    why = {one.id: one for one in diagnose(linear(table), table).not_testable}
    assert "torques" in why["base_compliance"].reason
    assert "tau_x_Nm" in why["base_compliance"].record
    assert "fts_offset" not in why


def test_poses_of_a_log_that_are_made_quiet_tell_nothing_of_torques() -> None:
    """Springs between the columns of one axis follow from the poses alone, quiet or not."""
    time = np.arange(120.0) * 0.1
    poses = 0.01 * np.sin(np.outer(time, 1.0 + 0.3 * np.arange(6)))
    poses = poses + np.random.default_rng(5).normal(0.0, 1e-4, poses.shape)
    columns = dict(zip(POSE, poses.T, strict=True)) | {"time_s": time}
    columns |= dict(zip(FORCES, 100.0 * poses[:, :3].T, strict=True))
    table = as_table(columns, meta={"file": {"kind": "continuous"}})
    model = linear(table)
    assert isinstance(model, Model)
    friction = next(one for one in effects_of(table) if one.id == "hysteresis").variants(table)[0]
    for quiet in (False, True):
        assert not guesses_torques(friction, Rows(table, model.base, quiet=quiet))


def test_what_an_earlier_pose_left_is_known_of_dwell_times_without_a_column_approach() -> None:
    """A branch of 150 s: of a short rest before it much is left at the next pose."""
    poses = workspace_poses(80, 9)
    static, rest = wrench(poses), np.random.default_rng(9).choice([5.0, 20.0, 60.0, 300.0], 80)
    left, before, read = np.zeros(6), np.zeros(6), []
    for now, dwell in zip(static, rest, strict=True):
        left, before = (left + now - before) * np.exp(-dwell / 150.0), now
        read.append(now + 0.2 * left)
    times = {"dwell_s": rest, "time_s": np.cumsum(rest + 6.0)}
    assert answer(rows(poses, np.array(read), 9, **times)) == {"stress_relaxation"}


def test_friction_between_poses_in_any_order_is_testable() -> None:
    poses = workspace_poses(40, 6)
    table = rows(poses, wrench(poses), 6)
    assert get_effect("hysteresis").missing(table) is None
    straight = table.with_columns({"approach": np.full(len(table), "initial")})
    lacking = get_effect("hysteresis").missing(straight)
    assert lacking is not None
    assert lacking.reason == "one approach direction"


class Term(LinearEffect):
    """One term of an energy of degree 5."""

    id = "term"
    parameters = (Parameter("size", "1", 1.0),)

    def columns(self, rows: Rows) -> F:
        further = EnergyTerms(L, 5).regressor(rows.poses, rows.base.model.scale)
        return np.asarray(further[:, :, -1:])


def test_terms_of_the_next_degree_are_the_base_s_own_error_as_large_as_the_noise() -> None:
    """An effect along them explains half of what it would beside a base that never errs."""
    poses = workspace_poses(60, 8)
    base = EnergyTerms(L, 4).fit(poses, wrench(poses))
    term = EnergyTerms(L, 5).regressor(poses, base.model.scale)[:, :, -1]
    more = term / np.sqrt(((term / NOISE) ** 2).mean())
    table = rows(poses, base.predict(poses) + 3.0 * more, 8)
    problem = assemble(base, table, [Term()])
    (item,) = problem.candidates
    known = problem.flat(problem.coefficient_block)
    column, y = (
        problem.flat(problem.design[:, :, item.columns])[:, 0],
        problem.flat(problem.response),
    )
    column, y = rest_of(known, column), rest_of(known, y)
    alone = float(column @ y) ** 2 / float(column @ column) / problem.scale
    assert alone > 10.0
    assert 0.4 * alone < delta_chi2(problem, (item,)) < 0.6 * alone


def test_an_effect_is_held_out_beside_the_base_of_all_rows() -> None:
    """A base of 65 terms must reach far beyond the 24 poses of a hand in each fold."""
    poses = nearest_first(workspace_poses(24, 5))
    table = rows(poses, wrench(poses), 5)
    lost = np.exp(-((table.column("dwell_s") / 8.0) ** 0.45))[:, None] * wrench(poses)
    relaxed = table.with_columns(
        {name: table.column(name) + 0.08 * lost[:, j] for j, name in enumerate(WRENCH)}
    )
    base = EnergyTerms(L, 6).fit(poses, relaxed.wrenches)
    problem = assemble(base, relaxed, [get_effect("stress_relaxation")])
    found = rank(problem)[0]
    assert found.drop > 300.0  # the best shape, hidden where the base may take in nine tenths
    assert held_out_t(problem, (), found.candidate) > 2.0
    # With the base held out as well it errs more than any effect explains.
    assert held_out_squares(problem, (found.candidate,), "time").sum() > 100.0 * found.drop


class Steep(Effect):
    """sinh(v) N along x: the first step of a fit goes ten times too far."""

    id = "steep"
    parameters = (Parameter("v", "1", 1.0),)

    def correction(self, rows: Rows, values: F) -> F:
        pushed = np.zeros((len(rows), len(rows.base.outputs)))
        pushed[:, 0] = np.sinh(values[0])
        return pushed


def test_what_is_clear_in_few_rows_wins_the_draws_beside_a_base_of_many_terms() -> None:
    """24 poses, 2 % from the humidity; of fewer rows a draw cannot hold an energy of degree 6."""
    poses = workspace_poses(24, 1)
    humidity = np.random.default_rng(51).uniform(30.0, 70.0, 24)
    scale = 1.0 + 0.02 * (humidity[:, None] - 50.0) / 20.0
    table = rows(poses, scale * wrench(poses), 1, humidity=humidity)
    found = diagnose(linear(table), table)
    assert found.answer == (("unused_column:humidity",),)
    assert found.checks[0].chosen_share > 0.95


def test_a_step_that_leaves_more_is_taken_in_part() -> None:
    poses = workspace_poses(20, 9)
    base = EnergyTerms(L, 4).fit(poses, wrench(poses))
    table = rows(poses, base.predict(poses) + np.array([50.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 9)
    fit = joint_fit(base, (Steep(),), table, Noise(source="assumed"), freeze_base=True)
    assert fit.converged
    assert fit.effects[0].values[0] == pytest.approx(np.arcsinh(50.0), abs=0.01)


@pytest.mark.parametrize("columns", [3, 6])
def test_an_effect_of_ones_own_gives_three_forces_or_all_six(columns: int) -> None:
    """The draft that a diagnosis writes for three forces has three columns."""
    poses = workspace_poses(50, 10)
    wind = np.sin(np.arange(50.0))
    measured = wrench(poses)
    measured[:, 1] += 2.0 * wind
    table = rows(poses, measured, 10, FORCES, wind_m_s=wind)

    @effect("gale", physics="A wind pushes.", parameters={"push": "N"}, needs=("wind_m_s",))
    def gale(rows: Rows) -> F:
        pushed = np.zeros((len(rows), columns))
        pushed[:, 1] = rows.table.column("wind_m_s")
        return pushed

    try:
        assert "gale" in answer(table)
    finally:
        unregister("gale")


@pytest.mark.parametrize("seed", [1, 5])
def test_rows_that_one_effect_touches_are_no_outliers(seed: int) -> None:
    """A soft block is met by a third of the poses; the catalogue has more columns than readings."""
    poses = workspace_poses(40, seed)
    depth = np.maximum(0.0, poses[:, 4] - np.quantile(poses[:, 4], 0.65)) ** 1.5
    measured = wrench(poses)
    measured[:, 4] += 7.0 * NOISE[4] * depth / np.sqrt((depth**2).mean())
    table = rows(poses, measured, seed)
    found = find_missing(linear(table), table)
    assert found.answer == (("contact_stop",),)
    assert found.problem.weights[depth > 0.0].min() > 0.5


@pytest.mark.parametrize("seed", [2, 4])
def test_it_is_not_none_where_something_explains_most(seed: int) -> None:
    """A modulus that no silicone has, 12 % per K, has no name, but its driver is seen."""
    poses = nearest_first(workspace_poses(24, seed))
    time_s = 60.0 * np.arange(1.0, 25.0)
    warm = 0.8 * (time_s / time_s[-1]) ** 0.7 + 0.3 * np.sin(time_s / 300.0)
    measured = wrench(poses) * (1.0 + 0.12 * (warm - warm.mean()))[:, None]
    table = rows(poses, measured, seed, temperature_degC=21.0 + warm)
    found = find_missing(linear(table), table)
    assert found.verdict == "family"
    assert found.family is not None
    assert found.family.driver == "the temperature of the body"


@pytest.mark.parametrize("seed", [641, 652, 838])
def test_noise_that_chance_brings_past_the_gate_is_none(seed: int) -> None:
    """Of 700 tables with nothing hidden seven fail the gate's test; no process is as likely."""
    poses = workspace_poses(60, seed)
    table = rows(poses, wrench(poses), seed)
    found = find_missing(linear(table), table)
    assert found.gate.rejected
    assert found.left.remains
    assert found.verdict == "none"


def lost_by_wear(table: Table) -> Table:
    """The same, softer by up to 0.3 below the largest tilt and twist so far."""
    bend = np.linalg.norm(table.poses[:, 3:], axis=1)
    largest = np.maximum.accumulate(bend)
    lost = 0.3 * ((largest - bend) / largest.max())[:, None] * wrench(table.poses)
    return table.with_columns({c: table.column(c) - lost[:, j] for j, c in enumerate(WRENCH)})


@pytest.mark.parametrize("seed", [7, 8])
def test_wear_of_rows_that_show_no_memory_is_that_or_a_law_of_the_strain(seed: int) -> None:
    """The largest pose came among the first: a body that stiffens would do the same to the rest."""
    poses = workspace_poses(19, seed)
    table = lost_by_wear(rows(poses, wrench(poses), seed))
    assert find_missing(linear(table), table).answer == (
        ("mullins_softening", "strain_stiffening"),
    )


def test_a_degree_that_takes_in_an_effect_is_too_many() -> None:
    """Of 17 rows degree 6 leaves nothing, and errs 260 times the noise where no row was."""
    poses = workspace_poses(17, 2)
    table = rows(poses, wrench(poses), 2)
    lost = np.exp(-((table.column("dwell_s") / 8.0) ** 0.45))[:, None] * wrench(poses)
    table = table.with_columns(
        {name: table.column(name) + 0.06 * lost[:, j] for j, name in enumerate(WRENCH)}
    )
    found = find_missing(linear(table), table)
    assert found.answer == (("stress_relaxation",),)
    assert found.problem.base.name == "energy5"


def test_degrees_that_take_in_an_effect_along_a_path_are_left_out_one_by_one() -> None:
    """Degrees 6 and 5 leave nothing of a relaxation on one path, and err by far beside it."""
    random, way = np.random.default_rng(2), 2.0 * np.pi * np.arange(170) / 170
    poses = 0.01 * np.sin(np.outer(way, [4.1, 2.7, 6.3]) + random.uniform(0.0, 6.0, 3))
    law = 400.0 * poses + 3e6 * poses * (poses**2).sum(axis=1, keepdims=True)
    lasting = np.exp(-1.5 / 8.0)
    moved = 0.3 * np.sqrt(lasting) * np.diff(law, axis=0, prepend=law[:1])
    for row in range(1, 170):
        moved[row] += lasting * moved[row - 1]
    read = law + moved + random.normal(0.0, 0.01, law.shape)
    seen = poses + random.normal(0.0, 3e-6, poses.shape)
    columns = dict(zip((*POSE[:3], *FORCES), np.hstack([seen, read]).T, strict=True))
    stated = {"force_sd_N": 0.01, "pose_position_sd_m": 3e-6}
    table = as_table(columns | {"time_s": 1.5 * np.arange(170.0)}, meta={"instrument": stated})
    model = fit_model(table, "poly:6", force=True)
    assert choose_base(model, table).name == "poly:6"
    found = diagnose(model, table)
    assert "stress_relaxation" in found.answer[0]
    assert found.addition is not None
    assert found.addition.base == "poly:4"
    assert found.addition.remedy is not None
    assert found.addition.remedy.command.startswith("ecm fit DATA --model poly:4 --add")


@pytest.mark.parametrize("understated", [1.0, 2.0])
def test_a_noise_that_is_stated_too_small_asks_for_no_fewer_degrees(
    understated: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Held-out rows err by 1.5 times what is left: fewer degrees would have names by chance."""
    poses = nearest_first(workspace_poses(50, 1))
    table = rows(poses, wrench(poses), 1, FORCES)
    force_N, torque_Nm = 0.3 / understated, 0.01 / understated
    stated = replace(INSTRUMENT, force_sd_N=force_N, torque_sd_Nm=torque_Nm)
    table = replace(table, meta=replace(table.meta, instrument=stated))
    monkeypatch.setattr(other_bases, "fewer_degrees", lambda base, table, by: pytest.fail(by))
    assert find_missing(linear(table), table).verdict == "none"


@pytest.mark.parametrize(("ripple_N", "asked"), [(0.5, False), (5.0, True)])
def test_no_other_form_is_asked_to_err_less_than_the_noise(
    ripple_N: float, asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is no more than noise asks for no other energy."""
    poses = workspace_poses(80, 3)
    table = rows(poses, wrench(poses), 3)
    ripple = ripple_N * np.sign(np.sin(0.7 * np.arange(80)))
    table = table.with_columns({"fy_N": table.column("fy_N") + ripple})
    tried: list[str] = []

    def energy_with(symmetry: Symmetry, table: Table) -> StiffnessMap:
        tried.append(symmetry)
        return fit.energy_with(symmetry, table)

    monkeypatch.setattr(other_bases, "energy_with", energy_with)
    found = find_missing(linear(table), table)
    assert found.verdict in (("family", "unknown") if asked else ("none",))
    assert bool(tried) is asked


def planar(poses: F, read: F, random: np.random.Generator, degrees: F) -> Table:
    """A planar table with the noise that is stated."""
    read = read + [0.05, 0.05, 0.001] * random.standard_normal(read.shape)
    names = ("x_m", "y_m", "theta_z_rad", "fx_N", "fy_N", "tau_z_Nm", "temperature_degC")
    sensor = {"force_sd_N": 0.05, "torque_sd_Nm": 0.001}
    exact = {"pose_position_sd_m": 1e-9, "pose_rotation_sd_rad": 1e-9}
    columns = dict(zip(names, np.column_stack([poses, read, degrees]).T, strict=True))
    return as_table(columns, meta={"instrument": sensor | exact})


LINE = np.array([[9000.0, 0.0, 0.0], [0.0, 700.0, -14.0], [0.0, -14.0, 0.5]])
"""A planar stiffness."""


def test_one_strong_term_of_a_higher_degree_is_no_kink() -> None:
    """A line is chosen for 44 rows of three axes, one of which follows the cube of its way."""
    random = np.random.default_rng(2)
    poses = random.uniform(-1.0, 1.0, (44, 3)) * [0.002, 0.006, 0.2]
    read = poses @ LINE
    read[:, 1] += 1e6 * poses[:, 1] ** 3
    table = planar(poses, read, random, np.full(44, 22.0))
    assert choose_base(fit_model(table, "linear"), table).name == "poly:1"
    assert find_missing(fit_model(table, "linear"), table).verdict == "none"


@pytest.mark.parametrize("seed", [1, 3])
def test_one_strong_term_of_a_higher_degree_is_no_kink_beside_an_effect(seed: int) -> None:
    """A cube beside squares of three axes, of a body that the room softens."""
    random = np.random.default_rng(seed)
    share = random.uniform(-1.0, 1.0, (50, 3))
    x, y, turn = share.T
    poses, degrees = share * [0.002, 0.006, 0.2], 22.0 + 4.0 * np.sin(np.arange(50.0))
    read = poses @ LINE
    read[:, 0] += 2.0 * y**2 - y * turn + turn**2
    read[:, 1] += 1.5 * x * y - 0.7 * x * turn + y**3
    read[:, 2] += 0.03 * x * turn - 0.02 * x * y
    read *= np.exp(-0.01 * (degrees - 22.0))[:, None]
    table = planar(poses, read, random, degrees)
    assert find_missing(fit_model(table, "linear"), table).answer == (("temperature_modulus",),)


def test_a_degree_of_nearly_as_many_coefficients_as_readings_hides_nothing() -> None:
    """A pad of foam that is pressed flat at some places: a quartic has 105 for 135 readings."""
    random = np.random.default_rng(1)
    z, tilt = -random.uniform(0.4e-3, 4.5e-3, 45), random.uniform(-0.06, 0.06, (45, 2))
    places = np.meshgrid(np.linspace(-0.02, 0.02, 16), np.linspace(-0.03, 0.03, 24))
    y, x = (place.ravel() for place in places)
    strain = -(z[:, None] + tilt[:, :1] * y - tilt[:, 1:] * x) / 0.015
    load = -0.375 * (strain + 9.0 * strain**3 + 50.0 * np.maximum(strain - 0.3, 0.0))
    read = np.column_stack([load.sum(axis=1), load @ y, -load @ x])
    read += random.normal(0.0, (0.04, 6e-4, 6e-4), (45, 3))
    names = "z_m", "theta_x_rad", "theta_y_rad", "fz_N", "tau_x_Nm", "tau_y_Nm"
    noise = {"pose_position_sd_m": 6e-6, "pose_rotation_sd_rad": 2e-4}
    noise |= {"force_sd_N": 0.04, "torque_sd_Nm": 6e-4}
    columns = dict(zip(names, np.column_stack([z, tilt, read]).T, strict=True))
    table = as_table(columns, meta={"instrument": noise})
    found = find_missing(fit_model(table, "cubic", force=True), table)
    assert found.verdict == "unknown"
    assert found.problem.base.name == "poly:3"


def test_what_a_richer_base_leaves_is_what_a_fit_of_it_leaves() -> None:
    """The columns of the plainer base are rounding there, and take nothing off."""
    random = np.random.default_rng(0)
    x = random.uniform(-0.01, 0.01, (60, 3))
    force = 400.0 * x + 3e6 * x**3 + 0.05 * random.standard_normal((60, 3))
    names = "x_m", "y_m", "z_m", "fx_N", "fy_N", "fz_N"
    table = as_table(dict(zip(names, np.column_stack([x, force]).T, strict=True)))
    problem = assemble(fit.fit_base(table, PolynomialModel(1)), table, ())
    richer = fit.fit_base(table, PolynomialModel(3))
    block = problem.whitener @ base_columns(problem.rows, richer)
    projection = Projection.of(block, np.sqrt(problem.weights))
    left = problem.squares_of(residual_after(problem, (), projection))
    fitted = problem.squares_of(problem.fit_with((), richer).whitened)
    assert left == pytest.approx(fitted, rel=1e-6)


def test_a_name_that_is_less_likely_than_not_is_not_said(monkeypatch: pytest.MonkeyPatch) -> None:
    table = campaign("payload", 1.0, 4)
    assert find_missing(model(), table).answer == (("payload",),)
    monkeypatch.setitem(WEIGHTS, "named", (-1.0, 0.0, 0.0, 0.0))
    found = find_missing(model(), table)
    assert (found.verdict, found.answer) == ("unknown", ())


def test_a_wild_base_makes_no_noise_of_an_error() -> None:
    """Of a log of three forces: beside the noise of its own stiffness a quartic errs nothing."""
    random, time = np.random.default_rng(5), 0.05 * np.arange(600.0)
    turns = np.outer(time, [0.31, 0.43, 0.57, 0.37, 0.29, 0.47])
    poses = np.sin(2.0 * np.pi * turns + np.arange(6.0)) * ([3e-3] * 3 + [0.03] * 3)
    force = poses[:, :3] * [2e4, 1e4, 1e4] + poses[:, 3:] @ np.eye(3)[[0, 2, 1]] * [0, 300, -300]
    force[:, 1] += 1e6 * poses[:, 1] ** 2
    slid = 0.0
    for row, step in enumerate(np.diff(poses[:, 1], prepend=poses[0, 1])):
        slid = float(np.clip(slid + step, -3e-4, 3e-4))
        force[row, 1] += 1.5 * slid / 3e-4
    force += 0.1 * random.standard_normal(force.shape)
    names, shifted = (*POSE, *WRENCH[:3]), poses + np.eye(6)[0] * L
    columns = dict(zip(names, np.hstack([shifted, force]).T, strict=True))
    exact = Instrument(
        force_sd_N=0.1, torque_sd_Nm=0.004, pose_position_sd_m=1e-6, pose_rotation_sd_rad=1e-5
    )
    meta = Meta(file=FileMeta(kind="continuous"), instrument=exact)
    table = as_table(columns | {"time_s": time}, meta=meta)
    found = diagnose(fit_model(table, "quadratic"), table)
    assert found.answer == (("hysteresis",),)
    assert np.abs(found.effects[0].values).max() == pytest.approx(1.5, rel=0.1)


@pytest.mark.parametrize("along_one_way", [True, False])
def test_a_degree_whose_terms_the_rows_cannot_tell_apart_is_no_other_base(
    along_one_way: bool,
) -> None:
    """One slow way through six coordinates: of 5000 rows each fit of degree 5 took a minute."""
    random = np.random.default_rng(2)
    span = np.repeat([4e-3, 0.1], 3)
    s = np.linspace(0.0, 1.0, 300)[:, None]
    poses = random.uniform(-1.0, 1.0, (300, 6))
    if along_one_way:
        turns = random.uniform(0.5, 6.0, (4, 6)) * s[:, None] + random.uniform(0.0, 1.0, (4, 6))
        poses = np.sin(2.0 * np.pi * turns).sum(axis=1) / 2.0 + 1e-3 * poses
    loads = (poses + 0.1 * poses**3) * np.repeat([10.0, 0.3], 3)
    loads += random.normal(0.0, 1.0, loads.shape) * np.repeat([0.05, 2e-3], 3)
    table = as_table(columns_of(span * poses, loads))
    problem = find_missing(fit_model(table, "linear"), table).problem
    degree = cast(PolynomialMap, problem.base).model.degree
    assert (other_bases._polynomial(problem.table, degree + 1) is None) is along_one_way
