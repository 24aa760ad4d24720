"""Groups, constraints, thresholds, choice of a model, leverage; agreement with numpy."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm import _native
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table, as_table
from ecm.models import (
    GROUPS,
    EnergyMap,
    Model,
    PolynomialModel,
    choose_model,
    cross_validate,
    fit_model,
    learning_curve,
    load_model,
)
from ecm.models.fit import constrained
from ecm.models.polynomial import press_rank, singular_threshold
from ecm.regression.folds import split_words
from ecm.rig.elastic import COS2
from support.campaigns import campaign, exact_table, workspace_poses
from support.models import reread
from support.neck import Command
from support.stand_in import L, wrench

HOME = np.array([[L, 0.0, 0.0, 0.0, 0.0, 0.0]])


def energy(groups: list[str], seed: int) -> EnergyMap:
    """Stiff enough to be stable at rest, with groups of random coefficients."""
    found = fit_model(campaign(seed=3), "+".join(["energy4", *groups])).base
    assert isinstance(found, EnergyMap)
    beta = found.coefficients.copy()
    own = len(found.model.terms)
    beta[own:] = np.random.default_rng(seed).normal(0.0, 0.02, len(beta) - own)
    return found.with_coefficients(beta)


@pytest.mark.parametrize("group", GROUPS)
def test_a_group_recovers_what_it_stands_for(group: str, tmp_path: Path) -> None:
    truth = energy([group], 1)
    train, test = workspace_poses(200, 1), workspace_poses(50, 2)
    table = exact_table(train, truth.predict(train))
    scale = np.abs(truth.predict(test)).max(axis=0)
    with_group = fit_model(table, f"energy4+{group}")
    error = np.abs(with_group.predict(test) - truth.predict(test)).max(axis=0)
    assert np.all(error < 1e-7 * scale)
    without = fit_model(table, "energy4")
    assert np.any(np.abs(without.predict(test) - truth.predict(test)).max(axis=0) > 1e-3 * scale)
    again = reread(with_group, tmp_path)
    assert again.base.name == f"energy4+{group}"
    np.testing.assert_array_equal(again.predict(test), with_group.predict(test))


def test_anisotropy_is_what_the_rig_hides() -> None:
    """The rig's cos 2 phi contrast of the modulus needs the group, and the group is enough."""
    train, test = workspace_poses(200, 1), workspace_poses(50, 2)
    table = exact_table(train, wrench(train, COS2))

    def error(name: str) -> float:
        off = fit_model(table, name).predict(test) - wrench(test, COS2)
        return float(np.abs(off / np.abs(wrench(test, COS2)).max(axis=0)).max())

    assert error("energy6+anisotropy") < 0.1 * error("energy6")


def test_rotation_about_the_axis_turns_the_groups_phase_only() -> None:
    """A body turned by 30 degrees is fitted by the same groups as exactly."""
    truth = energy(["anisotropy", "precurvature"], 6)
    angle = np.deg2rad(30.0)
    turn = np.eye(3)
    turn[1:, 1:] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    both = np.kron(np.eye(2), turn)
    poses, test = workspace_poses(200, 7), workspace_poses(40, 8)
    turned = exact_table(poses @ both.T, truth.predict(poses) @ both.T)
    fitted = fit_model(turned, "energy4+anisotropy+precurvature")
    expected = truth.predict(test) @ both.T
    error = np.abs(fitted.predict(test @ both.T) - expected).max(axis=0)
    assert np.all(error < 1e-7 * np.abs(expected).max(axis=0))


def test_names_of_groups() -> None:
    with pytest.raises(InputError, match=r"groups\[0\] = 'crooked': expected one of unlike_ends"):
        fit_model(campaign(seed=3), "energy4+crooked")
    with pytest.raises(InputError, match="named twice"):
        fit_model(campaign(seed=3), "energy4+anisotropy+anisotropy")
    with pytest.raises(InputError, match="already"):
        fit_model(campaign(seed=3), "energy4-general+anisotropy")


@pytest.mark.parametrize("name", ["cubic", "energy4", "energy4+precurvature"])
def test_no_wrench_at_home_where_asked(name: str) -> None:
    table = campaign(seed=3)
    plain, zero = fit_model(table, name), fit_model(table, name, zero_at_home=True)
    assert np.abs(plain.base.predict(HOME)).max() > 1e-4
    assert np.abs(zero.base.predict(HOME)).max() < 1e-9
    poses = workspace_poses(50, 9)
    sd = plain.predict_sd(poses)
    assert sd is not None
    if name != "cubic":
        moved = np.abs(zero.base.predict(poses) - plain.base.predict(poses)) / sd
        assert np.median(moved) < 2.0


def test_stable_at_rest_where_asked() -> None:
    fitted = fit_model(campaign(seed=3), "energy4")
    assert constrained(fitted, stable=True) is fitted
    beta = fitted.base.coefficients.copy()
    terms = fitted.base.model.terms.tolist()  # type: ignore[attr-defined]
    beta[terms.index([0, 0, 1, 0, 0, 0])] *= -0.1  # |theta_perp|^2
    broken = replace(fitted, base=fitted.base.with_coefficients(beta))
    assert np.linalg.eigvalsh(broken.base.stiffness(HOME, "generalised")[0])[0] < 0.0
    held = constrained(broken, stable=True)
    assert np.linalg.eigvalsh(held.base.stiffness(HOME, "generalised")[0])[0] > 0.0


def test_pcr_thresholds_in_four_ways() -> None:
    table = campaign(seed=3).measured()
    poses, wrenches = table.poses.copy(), table.wrenches.copy()
    regressor = _native.polynomial_regressor(poses, 3, poses.min(axis=0), poses.max(axis=0))
    values = np.linalg.svd(regressor, compute_uv=False)
    assert fit_model(table, PolynomialModel(3, pcr="rank:40")).base.model.rank == 40  # type: ignore[attr-defined]
    b = 0.02 * np.sqrt(len(poses))
    assert singular_threshold("0.02/sqrtN", poses, wrenches, 3) == pytest.approx(b)
    kept = fit_model(table, PolynomialModel(3, pcr="0.02/sqrtN")).base.model.rank  # type: ignore[attr-defined]
    assert kept == int((values >= b).sum())
    found, rmse = _native.PolynomialEvaluator.leave_one_out(poses, wrenches, 3)
    np.testing.assert_allclose(found, values, rtol=1e-9)
    rank = press_rank(rmse, len(poses))
    assert fit_model(table, PolynomialModel(3, pcr="press")).base.model.rank == rank  # type: ignore[attr-defined]
    for wrong in ("rank:0", "rank:x", "presss", "-0.1", -0.1, "nan"):
        with pytest.raises(InputError, match="expected"):
            fit_model(table, PolynomialModel(3, pcr=wrong))


def test_leave_one_out_is_leaving_one_out() -> None:
    """Every rank against the naive loop over left-out rows, directions held."""
    table = campaign(seed=3).measured()
    poses, wrenches = table.poses[:110].copy(), table.wrenches[:110].copy()
    _, rmse = _native.PolynomialEvaluator.leave_one_out(poses, wrenches, 2)
    x = _native.polynomial_regressor(poses, 2, poses.min(axis=0), poses.max(axis=0))
    _, _, vt = np.linalg.svd(x, full_matrices=False)
    for rank in (3, 10, 28):
        scores = x @ vt[:rank].T
        left = np.empty_like(wrenches)
        for i in range(len(x)):
            keep = np.arange(len(x)) != i
            beta = np.linalg.lstsq(scores[keep], wrenches[keep], rcond=None)[0]
            left[i] = wrenches[i] - scores[i] @ beta
        np.testing.assert_allclose(rmse[rank - 1], np.sqrt((left**2).mean(axis=0)), rtol=1e-9)


def test_the_energy_fit_is_numpys_generalised_least_squares() -> None:
    table = campaign(seed=3).measured()
    poses, wrenches = table.poses.copy(), table.wrenches.copy()
    random = np.random.default_rng(1)
    root = random.normal(size=(len(poses), 6, 6)) + 4.0 * np.eye(6)
    covariance = root @ np.swapaxes(root, 1, 2)
    model = _native.EnergyEvaluator.fit(
        poses, wrenches, length_m=L, degree=4, covariance=covariance, groups=["anisotropy"]
    )
    columns = EnergyMap(model).columns(poses)
    inverse = np.linalg.inv(np.linalg.cholesky(covariance))
    z = (inverse @ columns).reshape(-1, columns.shape[2])
    y = np.einsum("nij,nj->ni", inverse, wrenches).ravel()
    size = np.linalg.norm(z, axis=0)
    beta = np.linalg.lstsq(z / size, y, rcond=None)[0] / size
    np.testing.assert_allclose(
        z @ model.coefficients, z @ beta, rtol=0, atol=1e-9 * np.abs(y).max()
    )
    normal = np.linalg.inv((z / size).T @ (z / size)) / np.outer(size, size)
    np.testing.assert_allclose(
        np.sqrt(np.diag(model.covariance)), np.sqrt(np.diag(normal)), rtol=1e-6
    )


def test_scikit_learn_gives_the_same_polynomials() -> None:
    missing = "scikit-learn is not installed (extra learn)"
    decomposition = pytest.importorskip("sklearn.decomposition", reason=missing)
    linear_model = pytest.importorskip("sklearn.linear_model", reason=missing)
    preprocessing = pytest.importorskip("sklearn.preprocessing", reason=missing)

    table = campaign(seed=3).measured()
    poses, wrenches = table.poses.copy(), table.wrenches.copy()
    test = workspace_poses(40, 11)
    lower, upper = poses.min(axis=0), poses.max(axis=0)

    def features(points: F) -> F:
        unit = 2.0 * (points - lower) / (upper - lower) - 1.0
        return np.asarray(preprocessing.PolynomialFeatures(3).fit_transform(unit))

    size = np.abs(wrenches).max(axis=0)
    plain = linear_model.LinearRegression(fit_intercept=False).fit(features(poses), wrenches)
    ours = _native.PolynomialEvaluator.fit(poses, wrenches, 3)
    assert np.all(np.abs(ours.predict(poses) - plain.predict(features(poses))) < 1e-9 * size)
    ridge = linear_model.Ridge(alpha=0.3, fit_intercept=False, solver="svd").fit(
        features(poses), wrenches
    )
    ours = _native.PolynomialEvaluator.fit(poses, wrenches, 3, method="ridge", ridge=0.3)
    assert np.all(np.abs(ours.predict(test) - ridge.predict(features(test))) < 1e-9 * size)
    svd = decomposition.TruncatedSVD(40, algorithm="arpack", tol=1e-13, random_state=0)
    scores = svd.fit_transform(features(poses))
    component = linear_model.LinearRegression(fit_intercept=False).fit(scores, wrenches)
    threshold = singular_threshold("rank:40", poses, wrenches, 3)
    ours = _native.PolynomialEvaluator.fit(poses, wrenches, 3, method="pcr", threshold=threshold)
    expected = component.predict(scores)
    assert np.all(np.abs(ours.predict(poses) - expected) < 1e-9 * size)


def test_leverage_grows_outside_and_the_flag_says_so(tmp_path: Path) -> None:
    for name in ("cubic", "energy4"):
        model = fit_model(campaign(seed=3), name)
        inside = campaign(seed=3).measured().poses
        outside = HOME + 2.5 * (inside[:50] - HOME)
        found = model.leverage(inside)
        assert found is not None
        # The cubic's variance holds its misfit to this body, several times the noise.
        assert 0.0 < found.mean() < (1.0 if name == "energy4" else 20.0)
        assert not model.extrapolates(np.ascontiguousarray(inside)).any()
        assert model.extrapolates(outside).mean() > 0.8
        again = reread(model, tmp_path)
        np.testing.assert_array_equal(again.extrapolates(outside), model.extrapolates(outside))
    cut = fit_model(campaign(seed=3), PolynomialModel(3, pcr=0.5))
    assert cut.leverage(inside) is None
    assert cut.extrapolates(outside).mean() > 0.8


def test_the_one_standard_error_rule_takes_the_small_model() -> None:
    table = campaign(seed=3)
    cut = PolynomialModel(3, pcr=0.1)
    with pytest.raises(InputError, match="folds = 1: expected 2 or more"):
        choose_model(table, ["linear"], folds=1)
    choice = choose_model(table, ["linear", "energy4", "energy5", cut], folds=5)
    assert choice.best.name == "energy4"
    assert choice.error[0] > 2.0 * choice.error[1]
    assert choice.coefficients[1] == 22
    # Degree and b the same way: a smaller error has to be worth its coefficients.
    told: list[tuple[int, int, str]] = []
    degrees = choose_model(
        table, ["linear", "quadratic", "cubic"], folds=5, progress=lambda *at: told.append(at)
    )
    assert [at[:2] for at in told] == [(i, 15) for i in range(15)]
    assert told[-1][2] == "cubic"
    within = degrees.error <= degrees.error.min() + degrees.standard_error[degrees.error.argmin()]
    assert degrees.chosen == int(np.argmax(within))
    cuts = [PolynomialModel(3, pcr=b) for b in (0.01, 0.1, 0.5, 2.0)]
    assert choose_model(table, cuts, folds=5).error.argmax() == 3
    with pytest.raises(InputError, match="no candidates"):
        choose_model(table, [])


def test_rows_along_one_path_are_held_out_in_stretches() -> None:
    """Between its neighbours a row of a path is told by many terms, which err far beside it."""

    def path(seed: int) -> Table:
        random, way = np.random.default_rng(seed), 2.0 * np.pi * np.arange(160) / 160
        turns = np.array([4.1, 2.7, 6.3])
        poses = 0.01 * np.sin(np.outer(way, turns) + random.uniform(0.0, 6.0, 3))
        rubs = np.sign(np.diff(poses, axis=0, prepend=poses[:1]))
        forces = 400.0 * poses + rubs + random.normal(0.0, 0.01, poses.shape)
        columns = dict(zip((*POSE[:3], *WRENCH[:3]), np.hstack([poses, forces]).T, strict=True))
        return as_table(columns | {"time_s": 1.5 * np.arange(160.0)})

    table, fresh = path(1), path(2)
    assert choose_model(table).best.name in ("poly:1", "poly:2")
    wild = fit_model(table, "poly:6", force=True)
    error = (wild.predict(fresh.matrix(POSE[:3])) - fresh.matrix(WRENCH[:3])).std(axis=0)
    told = np.array(list(cross_validate(table, "poly:6").rmse.values()))
    assert min(*error, *told) > 3.0
    # Rows in any order lie between others.
    mixed = table.select(np.random.default_rng(3).permutation(160)).drop("time_s")
    assert split_words(table, 10) == "10 parts of stretches of rows, 12 a run"
    assert split_words(mixed, 10) == "10 parts of rows"


def test_an_energy_is_chosen_of_three_forces_as_well() -> None:
    table = campaign(seed=3).drop(*WRENCH[3:])
    choice = choose_model(table, folds=5)
    assert choice.best.name.startswith("energy")
    polynomials = [e for c, e in zip(choice.candidates, choice.error, strict=True)
                   if c.name.startswith("poly")]  # fmt: skip
    assert choice.error[choice.chosen] < 0.5 * min(polynomials)


def test_a_learning_curve_stops_where_it_is_flat() -> None:
    table = campaign(seed=3)
    curve = learning_curve(table, "energy4", [4, 8, 16, 32, 64], draws=4, seed=1)
    assert curve.enough in (8, 16, 32, 64)
    assert curve.error[0] > curve.error[-1]
    # Within what the draws can tell apart, and never more poses than the best.
    assert curve.one_standard_error in (8, 16, 32, 64)
    short = learning_curve(table, "energy6", [12, 16], draws=4, seed=1)
    assert short.enough is None
    with pytest.raises(InputError, match="held out"):
        learning_curve(table, "energy4", [5000])


def test_the_command_chooses_and_says_how_many_poses(tmp_path: Path, ecm_command: Command) -> None:
    campaign(seed=3).write(tmp_path / "data.csv")
    ecm_command(
        "fit", tmp_path / "data.csv", "--model", "choose", "--curve", "--out", tmp_path / "m.json",
        "--json", tmp_path / "j.json",
    ).good()  # fmt: skip
    said = json.loads((tmp_path / "j.json").read_text(encoding="utf-8"))
    assert said["model"] == "energy4"
    listed = {(c["model"], c["pcr"]): c for c in said["choice"]["candidates"]}
    assert listed["energy4", None]["chosen"]
    assert listed["cubic", "0.01/sqrtN"]["coefficients"] < listed["cubic", None]["coefficients"]
    assert said["curve"]["enough"] in said["curve"]["sizes"]
    assert load_model(tmp_path / "m.json").name == "energy4"


def test_a_model_without_covariance_has_no_leverage() -> None:
    base = fit_model(campaign(seed=3), "energy4").base
    assert Model(base=base).leverage(HOME) is None
    assert Model(base=base).stiffness_sd(HOME) is None
