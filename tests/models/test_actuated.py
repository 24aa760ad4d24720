"""Energies of pose and actuation, on FEM of an arm with three chambers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ecm
from ecm.effects import get_effect
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models import Model, PolynomialModel, actuated, fit
from ecm.models.actuated import ActuatedMap, ActuatedModel, ActuatedTerms, WallStiffness
from ecm.models.errors_in_variables import fit_with_pose_noise
from ecm.models.evaluation import pose_error
from ecm.models.maps import FittedMap
from ecm.models.selection import choose_model, default_candidates
from ecm.regression.rows import inputs_of
from ecm.workflow.config import read_config
from support.driven import ARM, NOISE, PRESSURES, VOLUMES, arm_table, measured
from support.models import reread
from support.neck import ROOT, Command, way_out

ARM_FILE = ROOT / "examples" / "soft_arm.toml"


@pytest.fixture(scope="module")
def table() -> Table:
    """100 rows by FEM; the first 60 are fitted."""
    return arm_table()


@pytest.fixture(scope="module")
def train(table: Table) -> Table:
    return table.select(np.arange(60))


@pytest.fixture(scope="module")
def fresh(table: Table) -> Table:
    return table.select(np.arange(60, 100))


@pytest.fixture(scope="module")
def other_mesh() -> Table:
    """60 rows by a finer mesh of the same arm."""
    table = ecm.read_table(ROOT / "examples" / "soft_arm_fine.csv")
    assert len(table) == 60
    return table


@pytest.fixture(scope="module")
def model(train: Table) -> Model:
    return ecm.fit_model(train, "actuated4")


@pytest.fixture(scope="module")
def plant(table: Table) -> Model:
    """An energy of another degree and order."""
    return ecm.fit_model(table, "actuated5:4")


def share_of_spread(model: Model, fresh: Table) -> F:
    """(6,) root of the mean square of the error on fresh rows, over their spread."""
    left = model.predict(fresh) - fresh.wrenches
    return np.asarray(np.sqrt((left**2).mean(axis=0)) / fresh.wrenches.std(axis=0))


@pytest.mark.parametrize(("ends", "most"), [(True, 1e-3), (False, 0.01)])
def test_the_parts_of_a_fit_begin_at_that_to_all_rows_and_end_as_if_they_did_not(
    table: Table, monkeypatch: pytest.MonkeyPatch, ends: bool, most: float
) -> None:
    """Also where poses run away, and the fit is that by the weights alone."""

    def runs_away(*arguments: Any, **options: Any) -> FittedMap:
        return replace(fit_with_pose_noise(*arguments, **options), converged=ends)

    monkeypatch.setattr(actuated, "fit_with_pose_noise", runs_away)
    fold = np.arange(len(table)) % 4
    of_pose = {"pose_position_sd_m": 2e-5, "pose_rotation_sd_rad": 2e-4}
    meta = {**ARM, "instrument": {**NOISE, **of_pose}}
    read = ecm.as_table(table.drop(*VOLUMES), meta=meta)
    found = ActuatedModel(3).maps_without(read, fold, None)
    assert found is not None
    for part, near in enumerate(found):
        plain = ActuatedModel(3).fit_map(read.select(fold != part), "auto")
        assert plain.converged == ends
        at = inputs_of(plain.base, read)
        apart = (near.predict(at) - plain.base.predict(at)) / read.wrenches.std(axis=0)
        assert np.sqrt((apart**2).mean()) < most


def test_sixty_rows_are_fitted_ten_times_better_than_by_a_polynomial(
    model: Model, train: Table, fresh: Table, other_mesh: Table
) -> None:
    every = ("linear", "quadratic", PolynomialModel(2, pcr="press"))
    polynomials = [ecm.fit_model(train, one) for one in every]
    assert all(polynomial.inputs == (*POSE, *PRESSURES) for polynomial in polynomials)
    for rows, most in ((fresh, 0.01), (other_mesh, 0.02)):
        ours = share_of_spread(model, rows).max()
        assert ours < most
        best = min(share_of_spread(polynomial, rows).max() for polynomial in polynomials)
        assert best > 10.0 * ours
    # On the other mesh most of what is left is by how much the two meshes differ.
    rows, body = other_mesh.select(np.arange(12)), read_config(ARM_FILE).mechanism
    own = body.fem().solve_poses(inputs_of(model.base, rows)).wrenches
    left, apart = (((own - h) ** 2).mean(axis=0) for h in (model.predict(rows), rows.wrenches))
    assert (left < 0.25 * apart).all()


def test_volumes_are_more_data_on_the_same_coefficients(
    model: Model, train: Table, fresh: Table
) -> None:
    measured = fresh.matrix(VOLUMES)
    left = model.actuated.amounts(inputs_of(model.base, fresh)) - measured
    assert (left.std(axis=0) < 0.01 * measured.std(axis=0)).all()
    # Where the sensor is poor they show: an error of 5 % of the spread, and twenty rows.
    few, spread = train.select(np.arange(20)), train.wrenches.std(axis=0)
    noise = 0.05 * spread * np.random.default_rng(0).standard_normal((20, 6))
    noisy = few.with_columns(dict(zip(WRENCH, (few.wrenches + noise).T, strict=True)))
    with_volumes, without = (
        share_of_spread(ecm.fit_model(rows, "actuated3"), fresh).mean()
        for rows in (noisy, noisy.drop(*VOLUMES))
    )
    assert with_volumes < 0.8 * without


def with_noise(table: Table, position_sd_m: float, random: np.random.Generator) -> Table:
    """With noise of the pose, ten times that in rad, and of the wrench, as stated in its TOML."""
    noise = np.repeat([position_sd_m, 10.0 * position_sd_m], 3), np.repeat([0.005, 2e-4], 3)
    figures = {"pose_position_sd_m": position_sd_m, "force_sd_N": 0.005, "torque_sd_Nm": 2e-4}
    figures["pose_rotation_sd_rad"] = 10.0 * position_sd_m
    columns = {name: table[name] for name in PRESSURES}
    for names, sds in zip((POSE, WRENCH), noise, strict=True):
        values = table.matrix(names) + sds * random.standard_normal((len(table), 6))
        columns |= dict(zip(names, values.T, strict=True))
    return ecm.as_table(columns, meta={**ARM, "instrument": figures})


def test_noise_of_the_pose_makes_no_stiffness_too_small(train: Table, model: Model) -> None:
    """Errors in variables: 0.1 mm and 1 mrad, the mean of eight campaigns across the arm."""
    rows = inputs_of(model.base, train)

    def across(fitted: Model) -> float:
        diagonals = [np.einsum("nii->ni", one.stiffness(rows)) for one in (fitted, model)]
        return float((diagonals[0] / diagonals[1] - 1.0)[:, [1, 2, 4, 5]].mean())

    campaigns = [with_noise(train, 1e-4, np.random.default_rng(seed)) for seed in range(8)]
    biases = {
        how: np.mean([across(ecm.fit_model(one, "actuated4", weights=how)) for one in campaigns])
        for how in ("noise", "spread")
    }
    assert biases["spread"] < -0.005
    assert abs(biases["noise"]) < 0.3 * abs(biases["spread"])
    # Far beyond what a rig has the poses may run away; then the weights alone are kept.
    wild = ecm.fit_model(with_noise(train, 4e-4, np.random.default_rng(0)), "actuated4")
    assert np.isfinite(wild.predict(train)).all()


def test_a_noisy_table_is_fitted_to_its_noise(table: Table) -> None:
    """And it knows how far it is from the truth."""
    random = np.random.default_rng(2)
    fitted = ecm.fit_model(with_noise(table, 1e-5, random), "actuated4")
    assert 0.7 < fitted.training["over_noise"] < 1.1
    sd = fitted.predict_sd(inputs_of(fitted.base, table))
    assert sd is not None
    errors = (fitted.predict(table) - table.wrenches) / sd
    assert 0.7 < np.sqrt((errors**2).mean()) < 1.4


def test_k_g_and_c_are_derivatives_and_reciprocal(model: Model, fresh: Table) -> None:
    rows = inputs_of(model.base, fresh)[:5]
    base = model.actuated
    for j in range(9):
        step = np.zeros(9)
        step[j] = 1e-6 if j < 6 else 1.0
        up, down = base.predict(rows + step), base.predict(rows - step)
        slope = (up - down) / (2.0 * step[j])
        given = base.stiffness(rows)[:, :, j] if j < 6 else None
        given = base.actuation_jacobian(rows)[:, :, j - 6] if given is None else given
        np.testing.assert_allclose(slope, given, rtol=1e-4, atol=1e-4 * np.abs(given).max())
        volumes = (base.amounts(rows + step) - base.amounts(rows - step)) / (2.0 * step[j])
        if j < 3:
            # dq/dr = -G' for the position; for the rotation J(theta) stands between.
            of_force = -base.actuation_jacobian(rows)[:, j]
            np.testing.assert_allclose(volumes, of_force, rtol=1e-4, atol=1e-9)
        if j >= 6:
            of_input = base.amount_jacobian(rows)[:, :, j - 6]
            np.testing.assert_allclose(volumes, of_input, rtol=1e-4, atol=1e-15)


def test_stiffness_and_g_are_those_of_the_body(model: Model) -> None:
    """FEM solved beside poses and pressures of the fit."""
    body = read_config(ARM_FILE).mechanism
    wrench, pressures = np.array([[1.0, 0.5, -0.3, 0.01, 0.02, 0.01]]), np.array([[8e3, 2e3, 1e4]])
    here = body.fem().solve_wrenches(np.hstack([wrench, pressures]))
    g, c = here.actuation_jacobians
    rows = np.hstack([here.poses, pressures])
    assert np.abs(model.stiffness(rows) - here.stiffness).max() < 0.01 * here.stiffness.max()
    found = model.actuation_jacobian(here.poses, pressures)
    assert np.abs(found - g).max() < 0.04 * np.abs(g).max()
    assert np.abs(model.actuated.amount_jacobian(rows) - c).max() < 0.05 * c.max()


def test_an_error_becomes_one_of_the_pose_at_the_inputs_of_its_row(
    model: Model, fresh: Table
) -> None:
    errors = np.tile([0.1, 0.1, 0.0, 0.0, 0.0, 1e-3], (len(fresh), 1))
    found = pose_error(model, fresh, errors)
    assert not len(found.left_out)
    rows = fresh.matrix((*POSE, *fresh.actuation_columns))
    # K at these poses and no pressure is another by a fifth and more.
    expected = np.linalg.solve(model.stiffness(rows), errors[:, :, None])[:, :, 0]
    np.testing.assert_allclose(found.change, expected, rtol=1e-9, atol=1e-15)
    unpressed = np.linalg.solve(model.stiffness(rows[:, :6]), errors[:, :, None])[:, :, 0]
    assert np.abs(unpressed / expected - 1.0).max() > 0.2


def test_turning_mirroring_and_end_for_end_leave_the_energy(model: Model, fresh: Table) -> None:
    rows = inputs_of(model.base, fresh)
    angle = 2.0 * np.pi / 3.0
    turn = Rotation.from_rotvec([angle, 0.0, 0.0]).as_matrix()
    turned = np.hstack(
        [rows[:, :3] @ turn.T, rows[:, 3:6] @ turn.T, np.roll(rows[:, 6:], 1, axis=1)]
    )
    wrench = model.predict(rows[:, :6], rows[:, 6:])
    expected = np.hstack([wrench[:, :3] @ turn.T, wrench[:, 3:] @ turn.T])
    np.testing.assert_allclose(model.predict(turned), expected, atol=1e-9)
    mirror = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
    mirrored = np.hstack([rows[:, :6] * mirror, rows[:, [6, 8, 7]]])
    np.testing.assert_allclose(model.predict(mirrored), wrench * mirror, atol=1e-9)
    free = ecm.fit_model(fresh, ActuatedModel(degree=3, symmetry="general", order=1))
    assert len(free.base.coefficients) > 3 * ActuatedTerms(0.1, ("pressure",) * 3, 3, 1).count()


def test_inputs_of_each_kind_are_moved_among_themselves() -> None:
    """Three chambers and three tendons: turned by a third, mirrored, and not all six alike."""
    random = np.random.default_rng(4)
    names = (*PRESSURES, "tension_1_N", "tension_2_N", "tension_3_N")
    terms = ActuatedTerms(0.1, ("pressure",) * 3 + ("tension",) * 3, degree=3, order=2)
    scale = np.repeat([1e4, 5.0], 3)
    coefficients = random.standard_normal(terms.count())
    pure = random.standard_normal(len(terms.pure()))
    own = ActuatedMap(terms, np.array([0.01, 0.3]), scale, coefficients, pure, names)
    at = np.array([[0.103, 0.002, -0.004, 0.1, 0.2, -0.3]])
    rows = np.hstack([at, random.uniform(0.0, 1.0, (1, 6)) * scale])
    c, s = np.cos(2.0 * np.pi / 3.0), np.sin(2.0 * np.pi / 3.0)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    turn6 = np.kron(np.eye(2), turn)
    places = [8, 6, 7, 11, 9, 10]
    turned = np.hstack([at @ turn6.T, rows[:, places]])
    np.testing.assert_allclose(own.predict(turned), own.predict(rows) @ turn6.T, atol=1e-9)
    mirror = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
    mirrored = np.hstack([at * mirror, rows[:, [6, 8, 7, 9, 11, 10]]])
    np.testing.assert_allclose(own.predict(mirrored), own.predict(rows) * mirror, atol=1e-9)
    swapped = np.hstack([at, rows[:, 9:] * 1e4 / 5.0, rows[:, 6:9] * 5.0 / 1e4])
    assert np.abs(own.predict(swapped) - own.predict(rows)).max() > 0.1
    together = sum(
        np.prod((rows[0, 6:] / own.input_scale) ** np.array(powers)) * energy.predict(at)
        for powers, energy in own.parts
    )
    np.testing.assert_allclose(together, own.predict(rows))
    again = ActuatedMap.from_document(own.document())
    np.testing.assert_array_equal(again.amounts(rows), own.amounts(rows))


def test_tensions_and_shortenings_are_inputs_and_amounts_like_pressures(
    train: Table, model: Model
) -> None:
    """The same arm with its chambers called tendons, some of whose lengths were read."""
    names = {old: f"tension_{i}_N" for i, old in enumerate(PRESSURES, 1)}
    names |= {VOLUMES[0]: "length_1_m", VOLUMES[2]: "length_3_m"}
    columns = {names.get(name, name): train[name] for name in train.columns}
    del columns[VOLUMES[1]]
    tendons = ecm.as_table(columns, meta=ARM)
    fitted = ecm.fit_model(tendons, "actuated4")
    assert fitted.actuated.actuators == ("tension_1_N", "tension_2_N", "tension_3_N")
    left = fitted.predict(tendons) - model.predict(train)
    assert (left.std(axis=0) < 2e-3 * train.wrenches.std(axis=0)).all()
    rows = inputs_of(fitted.base, tendons)
    amounts = fitted.actuated.amounts(rows)
    np.testing.assert_allclose(amounts[:, 2], train[VOLUMES[2]], atol=2e-8)
    written = ecm.predict(fitted, tendons, stiffness="partial")
    jacobian = fitted.actuated.actuation_jacobian(rows)
    for i, force in enumerate(("fx", "fy", "fz", "tau_x", "tau_y", "tau_z")):
        for j in range(3):
            np.testing.assert_array_equal(written[f"g_{force}_tension_{j + 1}"], jacobian[:, i, j])


def test_a_file_with_one_input_scale_is_read(model: Model, fresh: Table) -> None:
    document = model.actuated.document()
    document["parameters"]["scale"] = document["parameters"]["scale"][:3]
    again = ActuatedMap.from_document(document)
    rows = inputs_of(model.base, fresh)
    np.testing.assert_array_equal(again.predict(rows), model.predict(rows))
    document["parameters"]["scale"] *= 2
    with pytest.raises(InputError, match="scale has 6 numbers"):
        ActuatedMap.from_document(document)


def test_inputs_far_beyond_the_fitted_ones_are_told(
    model: Model, train: Table, fresh: Table, tmp_path: Path
) -> None:
    at, a = fresh.matrix(POSE), fresh.matrix(PRESSURES)
    rows = inputs_of(model.base, fresh)
    assert model.extrapolates(rows).mean() < 0.5
    assert model.extrapolates(np.hstack([at, 3.0 * a + 2e4])).all()
    strong = fresh.with_columns({PRESSURES[1]: fresh[PRESSURES[1]] + 4e4})
    compared = ecm.compare(model, strong)
    assert compared.outside_domain == len(fresh)
    said = compared.report().text()
    assert "pressure_2_Pa is 4.034e+04 to 5.923e+04, fitted 197.1 to 1.946e+04" in said
    assert "pressure_3_Pa is 4.484 to 1.99e+04, fitted 747.9" in said
    assert "pressure_2_Pa is 4.0" in ecm.predict(model, strong).warnings[-1]
    again = reread(model, tmp_path)
    np.testing.assert_array_equal(again.extrapolates(rows), model.extrapolates(rows))
    assert not model.extrapolates(inputs_of(model.base, train)).any()
    # At constant inputs the poses are what is left to be inside of.
    assert model.at_actuation(a[0]).extrapolates(at).mean() < 0.5


def test_a_model_without_the_pressures_is_told_that_it_lacks_them(
    train: Table, fresh: Table, tmp_path: Path
) -> None:
    plain = ecm.fit_model(train.drop(*PRESSURES), "energy4")
    names = "pressure_1_Pa, pressure_2_Pa, pressure_3_Pa"
    compared = ecm.compare(plain, fresh)
    assert compared.to_dict()["unused_inputs"] == list(PRESSURES)
    text = compared.report().text()
    assert f"{names} vary, and energy4 does not take them" in text
    assert 'better = ecm.fit(table, "actuated4")' in text
    levels = compared.references
    assert levels is not None
    assert levels.energy is not None
    assert levels.energy < 0.1 * compared.whitened_rms
    found = ecm.diagnose(plain, fresh)
    assert found.model.answer == "inputs"
    assert found.summary().missing.startswith(f"the model does not take {names}: energy4 errs")
    assert found.summary().add == 'better = ecm.fit(table, "actuated4")'
    assert "better form" not in str(found.summary())
    # Pressures that do nothing are not missed.
    idle = np.random.default_rng(0).uniform(0.0, 1e4, (len(train), 3))
    driven = train.with_columns(dict(zip(PRESSURES, idle.T, strict=True)))
    wrench = plain.predict(train) + 0.01 * np.random.default_rng(1).standard_normal((60, 6))
    driven = driven.with_columns(dict(zip(WRENCH, wrench.T, strict=True))).drop(*VOLUMES)
    assert ecm.diagnose(plain, driven).model.answer == "fits"


def test_the_free_pose_takes_the_wrench_and_moves_with_the_inputs(
    model: Model, fresh: Table
) -> None:
    row = inputs_of(model.base, fresh)[0]
    a, wrench = row[6:], fresh.wrenches[0]
    pose, slope = model.free_pose(a, wrench)
    np.testing.assert_allclose(model.predict(pose, a), wrench, atol=1e-6)
    assert np.abs(pose - row[:6]).max() < 1e-3
    step = np.array([0.0, 20.0, 0.0])
    up, down = (model.free_pose(a + sign * step, wrench)[0] for sign in (1.0, -1.0))
    np.testing.assert_allclose((up - down) / 40.0, slope[:, 1], rtol=1e-3, atol=1e-10)
    with pytest.raises(ComputationError, match="no equilibrium was found beyond"):
        model.free_pose(1e3 * a)


def test_inputs_for_a_pose_stay_within_their_limits(model: Model, fresh: Table) -> None:
    row = inputs_of(model.base, fresh)[3]
    a, left = model.actuation_for(row[:6], fresh.wrenches[3], limits=[(0.0, 2e4)] * 3)
    np.testing.assert_allclose(a, row[6:], atol=500.0)
    assert np.abs(left[:3]).max() < 0.02
    narrow, more = model.actuation_for(row[:6], fresh.wrenches[3], limits=[(0.0, 2e3)] * 3)
    assert (narrow <= 2e3).all()
    assert np.abs(more).max() > np.abs(left).max()
    some = [(0.0, 1.0)] * 3
    for limits in (some[:2], [(0.0, np.inf)] * 3, [(0.0, np.nan)] * 3):
        with pytest.raises(InputError, match=r"limits = .*finite numbers of shape \(3, 2\)"):
            model.actuation_for(row[:6], limits=limits)
    with pytest.raises(InputError, match="limits of pressure_1_Pa are 1 and 0"):
        model.actuation_for(row[:6], limits=[(1.0, 0.0)] * 3)
    for pose in (row[:3], np.full(6, np.nan)):
        with pytest.raises(InputError, match=r"pose = .*finite numbers of shape \(6,\)"):
            model.actuation_for(pose, limits=some)
    with pytest.raises(InputError, match=r"actuation = .*of shape \(3,\)"):
        model.free_pose(a[:2])


def test_an_input_that_nothing_tells_about_is_refused(train: Table) -> None:
    """With equal chambers the others tell what one does that never moves."""
    still = train.with_columns({"pressure_3_Pa": np.full(len(train), 1e4)})
    assert ecm.fit_model(still, "actuated3").base.coefficients.all()
    with pytest.raises(InputError, match="pressure_3_Pa is the same in every row: nothing tells"):
        ecm.fit_model(still, "actuated3-general")


def test_the_stiffness_that_can_be_had_at_a_pose_holds_it(model: Model) -> None:
    """The surroundings guide the arm along its axis: three chambers are more than are needed."""
    pose, limits = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]), [(0.0, 2e4)] * 3
    tolerance = np.array([np.inf, 0.02, 0.02, 1e-3, 1e-3, 1e-3])
    (low, soft), (high, stiff) = model.stiffness_range(
        pose, limits=limits, along="y_m", tolerance=tolerance
    )
    assert low < high - 3.0
    for value, a in ((low, soft), (high, stiff)):
        assert (np.abs(model.predict(pose, a)) <= tolerance + 1e-5).all()
        assert ((a >= 0.0) & (a <= 2e4)).all()
        own = model.stiffness(model.with_actuation(pose, a)[None])[0, 1, 1]
        assert value == pytest.approx(own, rel=1e-9)
    # None of many others that hold it is softer or stiffer.
    some = np.random.default_rng(0).uniform(0.0, 2e4, (4000, 3))
    rows = model.with_actuation(pose, some)
    holding = (np.abs(model.predict(rows)) <= tolerance).all(axis=1)
    own = model.stiffness(rows[holding])[:, 1, 1]
    assert holding.sum() > 20
    assert low - 1e-6 <= own.min() <= own.max() <= high + 1e-6
    with pytest.raises(ComputationError, match=r"no inputs within the limits hold the pose: f"):
        model.stiffness_range(np.array([0.1, 0.01, 0, 0, 0, 0]), limits=limits, along="y_m")
    with pytest.raises(InputError, match="along = 'y'"):
        model.stiffness_range(pose, limits=limits, along="y")


def test_a_file_gives_the_same_model_back(model: Model, fresh: Table, tmp_path: Path) -> None:
    again = reread(model, tmp_path)
    np.testing.assert_array_equal(again.predict(fresh), model.predict(fresh))
    assert again.actuated.actuators == PRESSURES
    assert again.name == "actuated4"


def test_a_few_rows_tell_the_modulus_and_the_gain_of_a_stated_body(
    model: Model, table: Table, tmp_path: Path, ecm_command: Command
) -> None:
    """A body of 0.8 times the modulus, whose chambers push by a tenth more than is recorded."""
    softer = {name: 0.8 * table[name] for name in WRENCH}
    softer |= {name: 0.8 / 1.1 * table[name] for name in PRESSURES}
    real = table.with_columns(softer).drop(*VOLUMES)
    few, others = real.select(np.arange(60, 68)), real.select(np.arange(68, 100))
    stated = WallStiffness(model.actuated)
    np.testing.assert_allclose(stated.factors(few), [0.8, 1.1], rtol=5e-3)
    fitted = ecm.fit_model(few, stated)
    assert share_of_spread(fitted, others).max() < 0.01
    assert share_of_spread(ecm.fit_model(few, "actuated3"), others).max() > 0.05
    # A body k times as stiff under k times the inputs: twice the modulus is twice K at rest.
    at_rest = np.array([[0.1, 0.0, 0.0, 0.0, 0.0, 0.0]])
    np.testing.assert_allclose(
        fitted.stiffness(at_rest), 0.8 * model.stiffness(at_rest), rtol=5e-3, atol=1e-3
    )
    # From the command line the file of the stated body is the model.
    model.save(tmp_path / "stated.json")
    few.write(tmp_path / "few.csv")
    (tmp_path / "few.toml").write_text("[mechanism]\nlength_m = 0.1\n", encoding="utf-8")
    files = [tmp_path / name for name in ("few.csv", "stated.json", "real.json")]
    ecm_command("fit", files[0], "--model", files[1], "--out", files[2]).good()
    again = ecm.load_model(files[2]).predict(others)
    np.testing.assert_allclose(again, fitted.predict(others), rtol=1e-5, atol=1e-6)
    with pytest.raises(InputError, match="the table has the inputs none, and no pressure_1_Pa"):
        ecm.fit_model(few.drop(*PRESSURES), stated)


def test_choose_takes_the_actuated_energy(table: Table, train: Table) -> None:
    chosen = choose_model(train, ["linear", "actuated3", "actuated4"], folds=5)
    assert chosen.best.name == "actuated4"
    # 130 rows carry no cubic of nine inputs: what weighs the components is what they carry.
    few = Table(dict(table.select(np.resize(np.arange(100), 130)).columns), {})
    assert choose_model(few, ["linear", "poly:2"], folds=5).best == PolynomialModel(2)


def test_chambers_in_no_order_are_offered_a_model_without_symmetry(table: Table) -> None:
    one, two = PRESSURES[:2]
    moved = table.with_columns({one: table[two], two: 1.2 * table[one]})
    tried = [item for item in default_candidates(moved) if item.name in ("poly:2", "actuated3")]
    tried += [item for item in default_candidates(moved) if "general" in item.name][:1]
    chosen = choose_model(moved, tried, folds=5)
    assert chosen.best.name == "actuated3-general:1"
    assert chosen.error[-1] < 0.5 * chosen.error[:-1].min()


def test_a_diagnosis_adds_no_thousand_terms_to_a_model_without_symmetry(
    table: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = ecm.fit_model(table, "actuated3-general:1")
    tried: list[str] = []
    monkeypatch.setattr(
        fit, "_by_degree", lambda table, models: tried.extend(item.name for item in models)
    )
    fit.choose_base(model, table)
    assert tried == ["actuated3-general:1", "actuated4-general:1"]


def test_what_does_not_fit_is_said(train: Table, model: Model) -> None:
    with pytest.raises(InputError, match="needs the actuators' columns, pressure_1_Pa"):
        ecm.fit_model(train.drop(*PRESSURES), "actuated4")
    with pytest.raises(InputError, match="volume_1_m3 has no pressure_1 beside it"):
        ecm.fit_model(train.drop("pressure_1_Pa"), "actuated4")
    with pytest.raises(InputError, match="coefficients, 10 rows give"):
        ecm.fit_model(train.select(np.arange(10)).drop(*VOLUMES), "actuated5")
    with pytest.raises(InputError, match="actuatedD with D from 3 to 6"):
        ecm.fit_model(train, "actuated")
    with pytest.raises(InputError, match="has no actuators"):
        ecm.fit_model(train, "energy4", force=True).free_pose(np.zeros(3))
    with pytest.raises(InputError, match=r"vary, and energy4 does not take them") as refused:
        ecm.fit_model(train, "energy4")
    assert "--model actuated4" in way_out(refused.value).command
    with pytest.raises(InputError, match=r"expected \(N, 6\) and \(N, 3\)"):
        model.predict(np.zeros((2, 6)), np.zeros((2, 2)))


def test_at_constant_inputs_it_is_an_energy_of_the_pose(model: Model, fresh: Table) -> None:
    a = np.array([8e3, 0.0, 3e3])
    held = model.at_actuation(a)
    poses = fresh.matrix(POSE)
    np.testing.assert_allclose(held.predict(poses), model.predict(poses, a), atol=1e-9)
    np.testing.assert_allclose(
        held.stiffness(poses), model.stiffness(model.with_actuation(poses, a)), atol=1e-6
    )
    np.testing.assert_allclose(model.predict(poses), model.predict(poses, np.zeros(3)))


def recorded_wrong(table: Table, model: Model, true: F) -> Table:
    """The table as if these pressures (N, 3) had acted in place of the recorded ones."""
    return measured(table.drop(*VOLUMES), model, true)


@pytest.mark.parametrize(
    ("name", "actuator", "size"),
    [("pressure_offset", "pressure_2_Pa", 600.0), ("pressure_gain", "pressure_3_Pa", 0.05),
     ("none", "pressure_1_Pa", 0.0)],
)  # fmt: skip
def test_a_wrong_pressure_is_named(
    name: str, actuator: str, size: float, table: Table, model: Model, plant: Model
) -> None:
    true = table.matrix(PRESSURES)
    acted = true[:, PRESSURES.index(actuator)]
    acted += size if name == "pressure_offset" else size * acted
    found = ecm.diagnose(model, recorded_wrong(table, plant, true))
    if name == "none":
        assert found.verdict == name
        return
    assert [item.id for item in found.effects] == [name]
    assert found.effects[0].effect.shape["actuator"] == actuator
    assert found.effects[0].values[0] == pytest.approx(size, rel=0.1)
    assert f"; in {actuator})" in found.summary().missing


@pytest.mark.parametrize(("name", "size"), [("pressure_gain", 0.1), ("none", 0.0)])
def test_three_forces_fit_and_name_as_six_loads_do(
    name: str, size: float, table: Table, model: Model, plant: Model, tmp_path: Path
) -> None:
    true = table.matrix(PRESSURES)
    true[:, 1] *= 1.0 + size
    of_forces = recorded_wrong(table, plant, true).drop(*WRENCH[3:])
    fitted = ecm.fit_model(of_forces, "actuated4")
    assert fitted.outputs == WRENCH[:3]
    left = fitted.predict(of_forces) - of_forces.matrix(WRENCH[:3])
    assert name != "none" or np.all(left.std(axis=0) < 0.008)
    again = reread(fitted, tmp_path)
    np.testing.assert_array_equal(again.predict(of_forces), fitted.predict(of_forces))
    found = ecm.diagnose(fitted, of_forces)
    assert [item.id for item in found.effects] == [name] * (name != "none")
    assert "pressure_gain" not in {item.id for item in found.not_testable}
    with pytest.raises(InputError, match="known for fx_N, fy_N, fz_N alone") as refused:
        ecm.export(fitted, "c", tmp_path / "out")
    assert "--model cubic" in way_out(refused.value).command


def test_what_chambers_that_act_for_themselves_take_in_is_named_beside_equal_ones(
    table: Table, model: Model, plant: Model
) -> None:
    true = table.matrix(PRESSURES)
    true[:, 1] += 3000.0
    wrong = recorded_wrong(table, plant, true)
    found = ecm.diagnose(ecm.fit_model(wrong, "actuated3-general:1"), wrong)
    assert [item.id for item in found.effects] == ["pressure_offset"]
    assert found.effects[0].effect.shape["actuator"] == "pressure_2_Pa"


def test_effects_of_actuators_are_listed_where_there_are_some(table: Table) -> None:
    names = {item.id for item in ecm.effects.effects_of(table)}
    assert {"pressure_offset", "regulator_lag", "chamber_leak"} <= names
    assert "pressure_gain" not in {i.id for i in ecm.effects.effects_of(table.drop(*PRESSURES))}
    assert get_effect("pressure_cross_talk").parameters[0].unit == "1"
