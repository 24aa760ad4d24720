"""Models as scikit-learn estimators."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ecm.errors import ComputationError, InputError
from ecm.io.description import Meta
from ecm.io.table import Table
from ecm.models import EnergyModel, ModelEstimator, PolynomialModel, choose_model, fit_model
from support.campaigns import exact_table, workspace_poses
from support.neck import Done, columns_of
from support.stand_in import L, wrench

X = workspace_poses(60, 1)
Y = wrench(X)


def test_the_estimator_fits_and_predicts_as_the_model() -> None:
    model = fit_model(exact_table(X, Y), "energy4")
    estimator = ModelEstimator(EnergyModel(4), length_m=L).fit(X, Y)
    np.testing.assert_array_equal(estimator.predict(X), model.predict(X))
    assert estimator.score(X, Y) > 1.0 - 1e-9
    flat = Y.copy()
    flat[:, 0] = 0.0
    assert estimator.score(X, flat) == pytest.approx(5.0 / 6.0)


def test_what_is_worse_than_the_mean_on_held_out_rows_is_refused_as_by_the_command(
    tmp_path: Path, ecm_command: Callable[..., Done]
) -> None:
    """With as many coefficients as readings a cubic went through all of them, and was returned."""
    random = np.random.default_rng(0)
    noise = 0.3 * Y.std(axis=0) * random.standard_normal((97, 6))
    poses = workspace_poses(97, 1)
    Table(columns_of(poses, wrench(poses) + noise)).write(tmp_path / "few.csv")
    with pytest.raises(ComputationError, match="the mean errs once") as caught:
        fit_model(tmp_path / "few.csv", "cubic")
    reason = str(caught.value).splitlines()[0].removeprefix("fit: ").partition("; force=True")[0]
    done = ecm_command("fit", tmp_path / "few.csv", "--model", "cubic")
    assert done.code != 0
    assert reason in done.err
    assert fit_model(tmp_path / "few.csv", "cubic", force=True).name == "poly:3"
    assert fit_model(tmp_path / "few.csv", "linear").name == "poly:1"


def test_choose_fits_the_model_that_held_out_rows_choose() -> None:
    x = np.linspace(-0.01, 0.01, 20)
    table = Table({"x_m": x, "fx_N": 2e3 * x + 1e7 * x**3})
    assert fit_model(table, "choose").name == choose_model(table).best.name != "poly:1"


def test_scikit_learn_clones_validates_and_searches() -> None:
    missing = "scikit-learn is not installed (extra learn)"
    base = pytest.importorskip("sklearn.base", reason=missing)
    metrics = pytest.importorskip("sklearn.metrics", reason=missing)
    selection = pytest.importorskip("sklearn.model_selection", reason=missing)

    estimator = ModelEstimator(EnergyModel(degree=4), length_m=L)
    fitted = estimator.fit(X, Y)
    assert base.is_regressor(estimator)
    fresh = base.clone(fitted)
    assert fresh.get_params() == estimator.get_params()
    assert not hasattr(fresh, "model_")
    assert fitted.score(X, Y) == pytest.approx(metrics.r2_score(Y, fitted.predict(X)))
    scores = selection.cross_val_score(ModelEstimator("linear"), X, Y, cv=3)
    assert scores.shape == (3,)
    assert np.all(selection.cross_val_score(estimator, X, Y, cv=3) > scores)
    options = {"model": ["linear", EnergyModel(4)]}
    found = selection.GridSearchCV(ModelEstimator(length_m=L), options, cv=3).fit(X, Y)
    assert found.best_estimator_.model == EnergyModel(4)


def test_options_have_names_and_shapes() -> None:
    estimator = ModelEstimator("cubic")
    assert estimator.set_params(model__degree=2, weights="noise").model == PolynomialModel(2)
    assert estimator.get_params(deep=False)["weights"] == "noise"
    with pytest.raises(InputError, match="option 'degree': expected one of model, length_m"):
        estimator.set_params(degree=2)
    with pytest.raises(InputError, match="not fitted"):
        estimator.predict(X)
    with pytest.raises(InputError, match=r"y has shape \(60, 5\): expected \(N, 6\)"):
        estimator.fit(X, Y[:, :5])
    lost = X.copy()
    lost[7, 1] = np.nan
    with pytest.raises(InputError, match=r"X, y: 1 bad place:\s+row 7, column 'y_m'"):
        estimator.fit(lost, Y)


def test_of_a_few_poses_an_energy_is_chosen_and_no_command_refuses_what_it_prints() -> None:
    """Six poses carry no linear model of six coordinates, but an energy, which needs the length."""
    stated = exact_table(X[:6], Y[:6])
    assert choose_model(stated).best.name.startswith("energy")
    for model in ("linear", "energy4", "choose"):
        with pytest.raises(InputError, match="length_m in the data's TOML") as refused:
            fit_model(stated.with_meta(Meta()), model)
        assert "choose" not in str(refused.value)
