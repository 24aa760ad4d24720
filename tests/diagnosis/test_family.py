"""Where no form of the catalogue fits but one driver explains what is left, the driver is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ecm
from ecm.diagnosis import diagnose
from ecm.diagnosis.family import find_family, posterior
from ecm.diagnosis.problem import assemble
from ecm.diagnosis.procedure import find_missing
from ecm.diagnosis.verdict import WEIGHTS
from ecm.effects import effects_of, unregister
from ecm.effects.experiments import get_experiment
from ecm.io.table import Table
from ecm.regression.rows import Rows
from support.campaigns import META, NOISE, campaign, model, workspace_poses
from support.neck import columns_of
from support.stand_in import wrench


def spring(**columns: np.ndarray) -> Table:
    """A linear spring on 160 rows at random positions, with more columns."""
    random = np.random.default_rng(3)
    x = random.uniform(-0.01, 0.01, 160)
    force = 400.0 * x + 0.05 * random.standard_normal(160) + columns.pop("more", 0.0)
    time_s = 30.0 * np.arange(160.0)
    return ecm.as_table({"time_s": time_s, "x_m": x, "fx_N": force, **columns})


def memory() -> Table:
    """Two springs at right angles; the force of one follows where the other was before."""
    x = spring().column("x_m")
    random = np.random.default_rng(4)
    y = random.uniform(-0.01, 0.01, 160)
    fy = 300.0 * y + 0.05 * random.standard_normal(160) + 60.0 * np.r_[x[:1], x[:-1]]
    return spring(y_m=y, fy_N=fy)


def test_a_log_of_few_columns_has_no_poses_to_go_to() -> None:
    table, said = memory(), []
    for kind in ("static", "continuous"):
        own = ecm.as_table(dict(table.columns), meta={"file": {"kind": kind}})
        problem = assemble(ecm.fit_model(own, "linear").base, own, ())
        found = find_family(problem, posterior(problem), ())
        assert found is not None
        said.append(found.experiment)
        assert get_experiment(found.experiment).id == "both_sides"
    assert "the same pose from" in said[0]
    assert "pose" not in said[1]


def test_the_driver_is_said_with_a_draft_that_explains_it() -> None:
    table = memory()
    model = ecm.fit_model(table, "linear")
    found = diagnose(model, table)
    assert found.verdict == "family"
    assert found.answer == ()
    assert found.family is not None
    assert found.family.driver == "the poses before"
    document = found.to_dict()
    assert document["unknown"]["skeleton"] == document["family"]["draft"]
    assert document["summary"]["missing"].startswith("a cause that follows the poses before")
    assert found.family.experiment in document["summary"]["next"]
    exec(compile(found.family.draft, "draft", "exec"), {})
    try:
        after = diagnose(model, table, effects=["my_effect"])
    finally:
        unregister("my_effect")
    assert after.answer == (("my_effect",),)
    assert after.held_out.after < 0.8 * after.held_out.before


@pytest.mark.parametrize("seed", range(5))
def test_of_noise_no_driver_is_sure(seed: int) -> None:
    random = np.random.default_rng(100 + seed)
    table = spring(humidity_percent=random.uniform(20.0, 60.0, 160))
    force = table.column("fx_N") + 0.1 * random.standard_normal(160)
    table = table.with_columns({"fx_N": force})
    base = ecm.fit_model(table, "linear").base
    found = posterior(assemble(base, table, effects_of(table, None)))
    assert {one.name for one in found.drivers} >= {"time", "humidity_percent", "the poses before"}
    assert max(*found.of_drivers, found.of_pose) < 0.9
    assert sum(found.of_drivers) + found.of_pose + found.of_nothing == pytest.approx(1.0)


def test_along_one_loading_curve_the_order_of_the_rows_is_no_driver() -> None:
    random = np.random.default_rng(6)
    x = np.linspace(0.0, 0.02, 60)
    force = 400.0 * x + 0.4 * np.sin(600.0 * x) + 0.02 * random.standard_normal(60)
    for columns in ({"x_m": x, "fx_N": force}, {"time_s": 9.0 * np.arange(60.0)}):
        table = ecm.as_table({"x_m": x, "fx_N": force, **columns})
        base = ecm.fit_model(table, "linear").base
        found = posterior(assemble(base, table, effects_of(table)))
        names = {driver.name for driver in found.drivers}
        assert not names & {"the order of the rows", "time"}
    mixed = random.permutation(60)
    table = ecm.as_table({"x_m": x[mixed], "fx_N": force[mixed]})
    found = posterior(assemble(base, table, effects_of(table)))
    assert "the order of the rows" in {driver.name for driver in found.drivers}


def test_more_evidence_is_more_sure_and_more_members_less() -> None:
    _, members, share, left = WEIGHTS["named"]
    assert share > 0.0 > max(members, left)
    weak, strong = spring(more=0.0), memory()
    sure = [
        diagnose(ecm.fit_model(t, "linear"), t).to_dict()["probability"] for t in (weak, strong)
    ]
    assert all(0.0 < p <= 1.0 for p in sure)


@pytest.mark.parametrize(
    ("period", "phase"), [(0.9, 0.3), (0.9, 0.6), (0.7, 3.8), (0.9, 3.8), (1.1, 5.0)]
)
def test_a_stiffness_that_follows_the_hour_is_not_a_bond_that_opens_nor_ageing_beside_it(
    period: float, phase: float
) -> None:
    """One wave in time passes every check of a name, or of two; one process of time is likelier."""
    table = campaign()
    time_s = table.column("time_s")
    factor = 1.0 + 0.005 * np.sin(2.0 * np.pi * time_s / (period * time_s.max()) + phase)
    names = table.wrench_columns
    found = find_missing(
        model(), table.with_columns({name: table.column(name) * factor for name in names})
    )
    assert found.answer == ()
    assert found.family is not None
    assert found.family.driver == "time"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_six_weak_parameters_are_weighed_as_a_process_of_so_many_columns(seed: int) -> None:
    """By a count of parameters a smooth process of the pose, of any size, explains far more."""
    found = find_missing(model(), campaign("tip_frame_misalignment", 0.3, seed))
    assert any("tip_frame_misalignment" in members for members in found.answer)


def test_an_effect_that_leaves_too_much_says_its_family() -> None:
    """Friction in a form of its own: no process of the way is as likely as the nearest effect."""
    found = find_missing(model(), campaign("hysteresis", 1.0))
    problem, accepted = found.problem, found.accepted
    chances = posterior(problem, accepted.effects)
    assert max(chances.of_drivers) < 0.1
    family = find_family(problem, chances, accepted.classes)
    assert family is not None
    assert family.driver == "the way to the pose"
    assert find_family(problem, chances, (*accepted.classes, ("face_tilt",))) is None


def test_the_weight_of_effects_that_two_drivers_explain_is_divided() -> None:
    found = find_missing(model(), warmed(SLOW, 0.0, 3, 0.01))
    chances = posterior(found.problem)
    weights = {"time": 0.2, "the temperature of the body": 0.15}
    chances = replace(
        chances,
        of_drivers=tuple(weights.get(one.name, 0.0) for one in chances.drivers),
        of_effects=0.65,
    )
    one_of_both = (("ageing", "temperature_modulus"),)
    family = find_family(found.problem, chances, one_of_both)
    assert family is not None
    assert family.driver == "time or the temperature of the body"
    family = find_family(found.problem, replace(chances, of_effects=0.75), (("ageing",),))
    assert family is not None
    assert family.driver == "time"


GROWTH = 2e-4
"""Share a kelvin."""
SWING = np.random.default_rng(9).uniform(16.0, 28.0, 90)
SLOW = 20.0 + 6.0 * np.sin(np.arange(90.0) / 18.0) + 0.15 * np.sin(7.0 * np.arange(90.0))
"""Warmer with the hours, but for a little: time explains nearly as much."""


def warmed(
    temperature: np.ndarray, growth: float, component: int = 0, factor: float = 0.0
) -> Table:
    """A body that grows with the warmth in all directions, and one component of its wrench."""
    poses = workspace_poses(len(temperature), 5)
    warmer = temperature - 22.0
    size = 1.0 + growth * warmer[:, None]
    read = wrench(np.hstack([poses[:, :3] / size, poses[:, 3:]])) * size ** np.repeat([2.0, 3.0], 3)
    read[:, component] *= 1.0 + factor * warmer
    read += NOISE * np.random.default_rng(8).standard_normal(poses.shape)
    return read_at(poses, read, temperature)


def read_at(poses: np.ndarray, read: np.ndarray, temperature: np.ndarray) -> Table:
    """Poses and wrenches in time, with the temperature of the room."""
    more = {"time_s": 20.0 * np.arange(len(poses)), "temperature_degC": temperature}
    return ecm.as_table(columns_of(poses, read) | more, meta=META)


@pytest.mark.parametrize("again", [0, 10])
@pytest.mark.parametrize("seed", [5, 6])
def test_wear_below_the_largest_energy_is_no_warm_room(seed: int, again: int) -> None:
    """A stiff direction adds more to the energy than to the deflection: the largest come apart."""
    poses = workspace_poses(50, seed)
    poses = np.vstack([poses, poses[:again]])
    read = wrench(poses)
    energy = np.abs((read * (poses - poses.mean(axis=0))).sum(axis=1))
    below = 1.0 - energy / np.maximum.accumulate(energy)
    read *= 1.0 - 0.05 * np.sqrt(below)[:, None]
    read += NOISE * np.random.default_rng(seed).standard_normal(read.shape)
    hours = np.arange(len(poses)) / 180.0
    table = read_at(poses, read, 20.0 + 7.2 * hours + 0.3 * np.sin(3600.0 * hours))
    found = posterior(find_missing(ecm.fit_model(table, "linear"), table).problem)
    chances = {one.name: p for one, p in zip(found.drivers, found.of_drivers, strict=True)}
    assert chances["the largest deflection so far"] > 0.9


def locking_joint(rows: int, seed: int, grows: bool) -> Table:
    """Three angles of a joint that locks up: no polynomial of few degrees holds its form."""
    random = np.random.default_rng(seed)
    time_s = 0.05 * np.arange(rows)
    if grows:
        q = random.uniform(-1.0, 1.0, (rows, 3)) * np.linspace(0.2, 1.0, rows)[:, None]
    else:
        turns = random.uniform(0.05, 0.15, 3) * time_s[:, None] + random.uniform(0.0, 1.0, 3)
        q = np.sin(2.0 * np.pi * turns) * np.linspace(0.2, 1.0, rows)[:, None]
    stiffness = np.array([[3.0, 0.5, 0.2], [0.5, 2.0, 0.3], [0.2, 0.3, 4.0]])
    torque = q @ stiffness / (1.0 - 0.18 * (q**2).sum(axis=1, keepdims=True)) + 0.4 * np.sinh(
        1.5 * q
    )
    noise = 0.003 * float(np.abs(torque).max())
    torque += noise * random.standard_normal(q.shape)
    columns = {f"theta_{axis}_rad": 0.3 * q[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"tau_{axis}_Nm": torque[:, i] for i, axis in enumerate("xyz")}
    columns |= {"time_s": (20.0 if grows else 1.0) * time_s}
    return ecm.as_table(
        columns,
        meta={
            "file": {"kind": "static" if grows else "continuous"},
            "instrument": {"pose_rotation_sd_rad": 1e-6, "torque_sd_Nm": noise},
        },
    )


@pytest.mark.parametrize("seed", [16, 17, 23, 29])
def test_a_body_that_locks_up_in_a_test_that_grows_does_not_remember_its_largest_load(
    seed: int,
) -> None:
    """The largest deflection so far is nearly the deflection itself there."""
    table = locking_joint(150, seed, grows=True)
    model = ecm.fit_model(table, "cubic")
    assert posterior(find_missing(model, table).problem).of_pose > 0.9
    found = diagnose(model, table)
    assert found.verdict == ("none" if seed == 16 else "unknown")
    if found.unknown is not None:
        assert "follows the pose alone, in a form that poly:3 lacks" in str(found)
        assert "fit a model of more terms" in str(found)


def test_a_log_that_a_polynomial_of_more_degrees_holds_lacks_nothing_else() -> None:
    table = locking_joint(2000, 0, grows=False)
    found = diagnose(ecm.fit_model(table, "cubic"), table)
    assert found.verdict == "none"
    assert found.to_dict()["model"]["base"] == "poly:5"


def test_growth_is_named_and_its_size_found() -> None:
    table = warmed(SWING, GROWTH)
    found = diagnose(ecm.fit_model(table, "energy4"), table)
    assert found.answer == (("thermal_expansion",),)
    ((_, alpha, sd),) = found.effects[0].listed
    assert abs(alpha - GROWTH) < 4.0 * sd
    assert sd < 0.05 * alpha


@pytest.mark.parametrize("seed", range(3))
def test_what_is_said_of_a_driver_is_all_that_follows_it(seed: int) -> None:
    """A stiffness that saturates with a current: beside its linear part a time was said, 0.04 N."""
    random = np.random.default_rng(seed)
    x = random.uniform(-3e-3, 3e-3, 120)
    coil = np.repeat(random.choice([0.0, 0.5, 1.0, 2.0, 3.0], 30), 4)
    force = 1.6e4 * x * (1.0 + 0.05 * np.tanh(coil / 0.9)) + 0.2 * random.standard_normal(120)
    columns = {"time_s": 10.0 * np.arange(120), "x_m": x, "fx_N": force, "coil_A": coil}
    meta = {"instrument": {"force_sd_N": 0.2, "pose_position_sd_m": 1e-6}}
    table = ecm.Table(columns, meta)
    found = diagnose(ecm.fit_model(table, "cubic"), table)
    assert found.verdict == "family"
    assert found.unknown is not None
    assert found.unknown.words.startswith("fx follows coil_A*x_m (+0.")
    assert found.unknown.variables == ("coil_A", "x_m")


@pytest.mark.parametrize("component", range(6))
def test_one_stiffness_that_follows_a_driver_is_no_name(component: int) -> None:
    """What acts on one component alone, as a torsion modulus does, has no effect: a family has."""
    table = warmed(SWING, 0.0, component, 0.01)
    found = diagnose(ecm.fit_model(table, "energy4"), table)
    assert found.family is not None
    assert found.family.driver == "the temperature of the body"


def test_a_known_effect_beyond_its_bound_is_said_with_the_size_that_it_would_need() -> None:
    """A thermometer in the room, a body that its own motor warms twelve times as much."""
    poses, warm = workspace_poses(90, 5), np.linspace(21.0, 22.0, 90) + 0.1 * np.sin(np.arange(90))
    read = wrench(poses) * (1.0 - 0.12 * (warm - 21.5))[:, None]
    read += NOISE * np.random.default_rng(8).standard_normal(poses.shape)
    table = read_at(poses, read, warm)
    found = diagnose(ecm.fit_model(table, "energy4"), table)
    assert found.verdict == "family"
    assert "temperature_modulus (beta = 0.12 1/K, beyond its bound 0.05)" in found.summary().missing


def test_what_the_form_of_the_models_own_effect_may_leave_is_said_with_what_would_show_it() -> None:
    """A body that softens much when warm, and a sensor that is not compensated, weak beside it."""
    poses = workspace_poses(120, 5)
    warm = 20.0 + 30.0 * np.sin(np.arange(120) / 11.0)
    read = wrench(poses) * np.exp(0.01 * (20.0 - warm))[:, None]
    read += NOISE * np.tile([0.2, -0.1], 3) * (warm - 20.0)[:, None]
    read += NOISE * np.random.default_rng(8).standard_normal(poses.shape)
    table = read_at(poses, read, warm)
    bare = ecm.fit_model(table, "energy4")
    held = diagnose(bare, table)
    assert held.answer[0][0] == "temperature_modulus"
    found = diagnose(ecm.refit(bare, table, add="temperature_modulus"), table)
    said = found.summary()
    assert "(fts_thermal_drift or another form of temperature_modulus)" in said.missing
    assert said.next.startswith("unloaded zero warm and cold")


def test_drivers_that_share_the_weight_are_said_together() -> None:
    table = warmed(SLOW, 0.0, 3, 0.01)
    found = diagnose(ecm.fit_model(table, "energy4"), table)
    assert found.verdict == "family"
    assert found.family is not None
    assert found.family.columns == ("temperature_degC", "time_s")
    assert found.unknown is not None
    assert found.unknown.variables[:2] == found.family.columns
    assert (
        "the temperature of the body or time (none fits all of it: temp" in found.summary().missing
    )
    assert "warm" in found.family.experiment


@pytest.mark.parametrize("component", range(6))
@pytest.mark.parametrize("factor", [0.003, 0.03])
def test_a_driver_is_not_taken_for_another_in_nearly_its_order(
    component: int, factor: float
) -> None:
    table = warmed(SLOW, 0.0, component, factor)
    family = diagnose(ecm.fit_model(table, "energy4"), table).family
    assert family is None or "temperature_degC" in family.columns


def test_a_draft_on_the_way_of_an_input_runs_with_a_model_of_the_pose_alone() -> None:
    """The base takes the pressure as a second input; the rows of the user's model do not."""
    random = np.random.default_rng(5)
    pressure = 1e4 * random.integers(0, 8, 160)
    table = spring(pressure_1_Pa=pressure, more=2e-4 * pressure)
    base = ecm.fit(table, "linear").base
    assert "pressure_1_Pa" in base.inputs
    driven = posterior(assemble(base, table, [])).drivers
    texts = [text for one in driven for text, _ in one.history.values()]
    assert any("pressure_1_Pa" in text for text in texts)
    rows = Rows(table, ecm.fit(table.drop("pressure_1_Pa"), "linear").base)
    for text in texts:
        assert eval(text, {"np": np, "rows": rows}).shape == (160,)


def test_friction_of_another_law_ends_in_a_model_that_a_controller_steps() -> None:
    """A family has no name; the nearest known form brings the error down, and can be exported."""
    poses, random = workspace_poses(60, 4), np.random.default_rng(2)
    poses = np.repeat(poses, 2, axis=0)[random.permutation(120)]
    limits = poses.std(axis=0) * 0.35
    hold = np.array([6.0, 2.0, 2.0, 0.05, 0.1, 0.1])
    stretch, rubs = np.zeros(6), np.zeros_like(poses)
    for i in range(1, len(poses)):
        # What sticks yields smoothly: no spring of the catalogue.
        for part in np.diff(np.linspace(poses[i - 1], poses[i], 20), axis=0):
            stretch += part * (1.0 - np.sign(part) * stretch / limits)
        rubs[i] = hold * stretch / limits
    noise = random.standard_normal(poses.shape) * np.repeat([0.3, 0.01], 3)
    columns = columns_of(poses, wrench(poses) + rubs + noise)
    columns["time_s"] = 20.0 * np.arange(120.0)
    table = ecm.as_table(columns, meta=META)
    given = ecm.fit(table, "energy4")
    found = diagnose(given, table)
    assert found.addition is not None, found.summary()
    assert found.addition.effects == ("hysteresis",)
    assert found.addition.after < 0.7 * found.addition.before
    if not found.answer:
        assert "the nearest known form" in found.summary().add
    better = ecm.refit(given, table, add="hysteresis")
    assert better.controller().effects.acting == ["hysteresis"]
    assert not any("mend the figures" in words for words in found.warnings)
