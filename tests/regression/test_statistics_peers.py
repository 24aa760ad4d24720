"""The library's statistics against statsmodels wherever both have them.

Estimates and deviations of the joint refit, F tests, BIC, leave one out, Holm, REML, the score
test of the scatter. What statsmodels has not (noise through a stiffness, groups, bounds) is tested
where it lives.
"""

from __future__ import annotations

import numpy as np
import pytest
from statsmodels.stats.diagnostic import het_breuschpagan
from statsmodels.stats.multitest import multipletests

from ecm.diagnosis.problem import Problem, assemble
from ecm.diagnosis.search import delta_bic, delta_chi2, rank
from ecm.diagnosis.statements import _score
from ecm.effects import Rows, all_effects, get_effect
from ecm.io.arrays import F
from ecm.io.description import Meta
from ecm.io.table import Table
from ecm.models import fit_model
from ecm.models.fit import choose_base
from ecm.models.joint_fit import joint_fit
from ecm.regression.f_test import lack_of_fit, omnibus_test
from ecm.regression.noise import Noise, declared_noise, reml_noise
from ecm.regression.normal_equations import NormalEquations
from support.acceptance import acceptance_check
from support.campaigns import campaign, model, physics, workspace_poses

sm = pytest.importorskip("statsmodels.api", reason="statsmodels is missing: dependency group dev")


@pytest.fixture(scope="module")
def problem() -> Problem:
    table = campaign("payload", 1.0, 4)
    return assemble(choose_base(model(), table), table, all_effects(), None)


def flat(problem: Problem, columns: list[int]) -> tuple[F, F]:
    """Response and columns as one regression of unit variance."""
    root = np.sqrt(problem.weights / problem.scale)
    y = (problem.response * root[:, None]).ravel()
    z = (problem.design[:, :, columns] * root[:, None, None]).reshape(len(y), -1)
    return y, z


# --- least squares ------------------------------------------------------------------------------
def test_the_joint_refit_is_generalised_least_squares_with_its_intervals() -> None:
    """Payload and factor on E on 40 rows: GLS with the whole covariance, its scale known."""
    table = campaign("payload", 1.0, 4)
    table = table.select(np.flatnonzero(table.text("kind") == "pose")[:40])
    noise = declared_noise(table)
    rows = Rows(table, physics())
    ours = joint_fit(physics(), [get_effect("payload")], table, noise)
    design = np.concatenate(
        [physics().columns(table.poses), get_effect("payload").jacobian(rows, np.zeros(4))], axis=2
    )
    n = len(table)
    sigma = np.zeros((6 * n, 6 * n))
    for i, block in enumerate(noise.covariance(rows, physics().error)):
        sigma[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = block
    peer = sm.GLS(table.wrenches.ravel(), design.reshape(6 * n, -1), sigma=sigma).fit(
        cov_type="fixed scale", cov_kwds={"scale": 1.0}
    )
    values = np.concatenate([ours.base.coefficients, ours.effects[0].values])
    sd = np.sqrt(np.diag(ours.covariance))
    assert values == pytest.approx(peer.params, rel=1e-6, abs=1e-3 * sd.min())
    assert sd == pytest.approx(peer.bse, rel=1e-6)
    assert ours.effects[0].sd == pytest.approx(peer.bse[1:], rel=1e-6)
    ends = np.stack([values - 1.6448536 * sd, values + 1.6448536 * sd], axis=1)
    np.testing.assert_allclose(ends, peer.conf_int(0.1), rtol=1e-5, atol=2e-3 * sd.min())


def test_a_polynomial_of_other_columns_is_ordinary_least_squares() -> None:
    random = np.random.default_rng(2)
    x = random.uniform(-1e-3, 1e-3, 60)
    force = 3.0 + 1e4 * x - 2e9 * x**3 + 0.5 * random.standard_normal(60)
    table = Table({"x_m": x, "fx_N": force}, Meta(), "spring")
    ours = fit_model(table, "cubic")
    u = x / 1e-3
    peer = sm.OLS(force, np.stack([u**0, u, u**2, u**3], axis=1)).fit()
    left = force - ours.predict(table)[:, 0]
    np.testing.assert_allclose(left, peer.resid, atol=1e-8)


def test_leave_one_out_is_press() -> None:
    """On groups of one row each."""
    random = np.random.default_rng(3)
    z, y = random.standard_normal((50, 4)), random.standard_normal(50)
    peer = sm.OLS(y, z).fit().get_influence().resid_press
    own = np.arange(50)
    gram = NormalEquations.of(z[:, None, :], y[:, None], own)
    found = gram.held_out([0, 1, 2, 3], own, np.ones(50))
    np.testing.assert_allclose(found, peer**2, rtol=1e-6)


# --- F tests ------------------------------------------------------------------------------------
def test_lack_of_fit_is_the_f_test_against_the_means_of_the_cells() -> None:
    random = np.random.default_rng(4)
    cells = np.repeat(np.arange(12), 4)
    x = np.linspace(-1.0, 1.0, 12)[cells]
    y = 1.0 + 2.0 * x + 0.4 * x**2 + 0.3 * random.standard_normal(48)
    line = sm.OLS(y, sm.add_constant(x)).fit()
    means = sm.OLS(y, (cells[:, None] == np.arange(12)) * 1.0).fit()
    ratio, p, dof = means.compare_f_test(line)
    found = lack_of_fit(line.resid[:, None], cells, 2)
    assert found is not None
    assert (found.F, found.p) == pytest.approx((ratio, p), rel=1e-9)
    assert (found.dof, found.dof_error) == (dof, means.df_resid)


def test_the_omnibus_is_the_f_test_of_nested_models() -> None:
    random = np.random.default_rng(5)
    fitted, more = random.standard_normal((70, 3)), random.standard_normal((70, 4))
    y = fitted @ [1.0, -2.0, 0.5] + more @ [0.3, 0.0, 0.0, 0.2] + random.standard_normal(70)
    small = sm.OLS(y, fitted).fit()
    large = sm.OLS(y, np.concatenate([fitted, more], axis=1)).fit()
    ratio, p, dof = large.compare_f_test(small)
    found = omnibus_test(small.resid[:, None], more[:, None, :], fitted[:, None, :])
    assert (found.F, found.p) == pytest.approx((ratio, p), rel=1e-9)
    assert (found.dof, found.dof_error) == (dof, large.df_resid)


# --- choosing among effects ---------------------------------------------------------------------
@pytest.mark.parametrize("place", [0, 1, 3, 5])
def test_bic_and_its_p_are_those_of_a_regression_of_known_variance(
    problem: Problem, place: int
) -> None:
    item = rank(problem)[place]
    base = list(problem.base_index)
    y, z = flat(problem, [*base, *item.candidate.columns])
    gauss = sm.families.Gaussian()
    small = sm.GLM(y, z[:, : len(base)], family=gauss).fit(scale=1.0)
    large = sm.GLM(y, z, family=gauss).fit(scale=1.0)
    assert int((problem.weights > 0.0).sum()) == len(problem.weights)
    own = len(item.candidate.columns)
    ratio = 2.0 * (large.llf_scaled(1.0) - small.llf_scaled(1.0))
    drop = delta_chi2(problem, [item.candidate])
    assert drop == pytest.approx(ratio, rel=1e-6)
    # BIC is -2 log L + k ln n.
    gain = ratio - own * np.log(small.nobs)
    assert delta_bic(problem, [item.candidate]) == pytest.approx(gain, rel=1e-6)
    # A coefficient of a sign that its parameter may not have explains nothing in the ranking.
    signs = problem.signs[list(item.candidate.columns)]
    if np.any(signs * large.params[len(base) :] < 0.0):
        assert item.drop < drop
        return
    assert item.drop == pytest.approx(drop, rel=1e-9)
    if problem.base_error < 1e-9 and len(item.candidate.effect.variants(problem.table)) == 1:
        wald = large.wald_test(np.eye(z.shape[1])[len(base) :], use_f=False, scalar=True)
        assert wald.statistic == pytest.approx(drop, rel=1e-6)
        assert item.p == pytest.approx(float(wald.pvalue), rel=1e-5)


def test_the_first_of_many_is_corrected_as_holm_does(problem: Problem) -> None:
    ranked = rank(problem)
    p = np.array([item.p for item in ranked])
    corrected = multipletests(p, method="holm")[1]
    for k in (int(p.argmin()), len(p) // 2, len(p) - 1):
        found = acceptance_check(problem, [ranked[k].candidate], ranked[k].candidate, [], 0)
        if p[k] == p.min():
            assert found.p_holm == pytest.approx(corrected[k], rel=1e-9)
        # An effect that is not the first is never judged more kindly.
        assert found.p_holm >= corrected[k] * (1.0 - 1e-9)


# --- noise --------------------------------------------------------------------------------------
def test_the_floor_is_the_residual_variance_of_a_mixed_model() -> None:
    """Without stiffness forces and torques are two one-way layouts with a drift as fixed effect."""
    random = np.random.default_rng(6)
    count, repeats = 40, 4
    poses = np.repeat(workspace_poses(count, 7), repeats, axis=0)
    n = len(poses)
    cells = np.repeat(np.arange(count), repeats)
    time = random.uniform(-1.0, 1.0, n)
    sd = np.repeat([0.5, 0.02], 3)
    residual = 3.0 * sd * random.standard_normal((count, 6))[cells]
    residual += sd * (random.standard_normal((n, 6)) + 2.0 * time[:, None])
    table = Table(
        {name: poses[:, j] for j, name in enumerate(physics().inputs)},
        Meta(mechanism={"length_m": physics().length_m}),
        "repeats",
    )
    soft = physics().with_coefficients(np.zeros(len(physics().coefficients)))
    nuisance = time[:, None, None] * np.eye(6)
    found = reml_noise(Rows(table, soft), residual, cells, nuisance, Noise())
    assert found is not None
    for names, value in ((slice(0, 3), found.force_sd_N), (slice(3, 6), found.torque_sd_Nm)):
        y = residual[:, names].T.ravel()
        axis = np.repeat(np.arange(3), n)
        drift = np.tile(time, 3)[:, None] * (axis[:, None] == np.arange(3))
        fixed = np.concatenate([drift, (axis[:, None] == np.arange(3)) * 1.0], axis=1)
        groups = np.tile(cells, 3) + count * axis
        # Cells as fixed effects: REML of the rest is the residual mean square.
        dummies = (groups[:, None] == np.arange(3 * count)) * 1.0
        within = sm.OLS(y, np.concatenate([drift, dummies], axis=1)).fit()
        assert value == pytest.approx(np.sqrt(within.scale), rel=2e-3)
        # As random effects the same to the little that cells tell about the drift.
        mixed = sm.MixedLM(y / y.std(), fixed, groups=groups).fit(reml=True)
        assert value == pytest.approx(y.std() * np.sqrt(mixed.scale), rel=1e-2)


def test_the_score_of_growing_scatter_is_breusch_and_pagan_s() -> None:
    random = np.random.default_rng(8)
    size = random.uniform(0.0, 2.0, 300)
    residual = random.standard_normal(300) * np.sqrt(1.0 + 0.5 * size**2)
    z, _ = _score(residual[:, None], np.ones((300, 1, 1)), np.asarray(size**2)[:, None, None])
    peer = het_breuschpagan(residual, sm.add_constant(size**2), robust=False)
    assert z**2 == pytest.approx(peer[0], rel=1e-9)


def test_lack_of_fit_of_a_robust_row_is_left_out() -> None:
    """Weights of 0 leave rows out, as a regression without them does."""
    random = np.random.default_rng(9)
    cells = np.repeat(np.arange(8), 3)
    x = np.linspace(0.0, 1.0, 8)[cells]
    y = x + 0.1 * random.standard_normal(24)
    y[5] += 30.0
    keep = np.arange(24) != 5
    line = sm.OLS(y[keep], sm.add_constant(x[keep])).fit()
    means = sm.OLS(y[keep], (cells[keep, None] == np.arange(8)) * 1.0).fit()
    left = y - line.predict(sm.add_constant(x))
    found = lack_of_fit(left[:, None], cells, 2, keep * 1.0)
    assert found is not None
    assert pytest.approx(means.compare_f_test(line)[0], rel=1e-9) == found.F


def test_a_column_of_one_fold_alone_stays_at_zero_when_it_is_held_out() -> None:
    """Of its squares only rounding is left outside; divided by it the error was beyond 1e300."""
    random, n = np.random.default_rng(0), 600
    response, groups = random.standard_normal((n, 3)), np.arange(n) // 7
    fold = (np.arange(groups[-1] + 1) * 5) // (groups[-1] + 1)
    design = random.standard_normal((n, 3, 2))
    design[:, :, 1] *= (fold[groups] == 0)[:, None]
    equations = NormalEquations.of(design, response, groups)
    every = np.ones(len(fold))
    both = equations.held_out([0, 1], fold, every)
    alone = equations.held_out([0], fold, every)
    assert both[fold == 0] == pytest.approx(alone[fold == 0])
