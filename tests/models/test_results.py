"""Results of models print themselves, draw themselves, and become DataFrames."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np
import pytest

from ecm import (
    Mechanism,
    as_table,
    check,
    compare,
    cross_validate,
    diagnose,
    dynamic_stiffness,
    fit,
    import_log,
    refit,
    solve_wrenches,
)
from ecm._native import mid_frame
from ecm.errors import InputError
from ecm.models import (
    CrossValidation,
    EnergyModel,
    Expression,
    LearningCurve,
    Model,
    ModelChoice,
    PolynomialModel,
    choose_model,
)
from ecm.models.maps import EnergyTerms
from ecm.regression.noise import Noise
from ecm.rig.truth import Revealed
from support.campaigns import campaign, model
from support.neck import ROOT, columns_of

CURVE = LearningCurve(
    "energy4", (10, 20), np.array([1.6, np.inf]), np.ones(2), np.full(2, 2.0), None, None
)
CHOICE = ModelChoice(
    (PolynomialModel(3, pcr="press"), EnergyModel(4)), (60, 22), np.array([2.0, 1.0]), np.ones(2), 1
)


def test_a_choice_is_said_in_the_noise_of_the_repeats_or_in_an_assumed_one() -> None:
    random = np.random.default_rng(0)
    poses = np.repeat(random.uniform(-0.01, 0.01, (40, 6)), 2, axis=0)
    wrenches = 1e3 * poses + random.normal(0.0, 0.01, poses.shape)
    columns = columns_of(poses, wrenches)
    once = {name: values[::2] for name, values in columns.items()}
    pose_id = np.repeat(np.arange(40.0), 2)
    repeated = choose_model(as_table({**columns, "pose_id": pose_id}), ["linear"], folds=3)
    assumed = choose_model(as_table(once), ["linear"], folds=3)
    assert (repeated.over, assumed.over) == ("noise", "assumed noise")
    assert 0.8 < repeated.error[0] < 1.3
    assert Noise().unit == "an assumed noise"


def test_results_print_themselves() -> None:
    assert str(CHOICE).splitlines() == [
        "cubic --pcr press: 60 coefficients, held-out error 2 +- 1 of the noise",
        "energy4: 22 coefficients, held-out error 1 +- 1 of the noise",
        "chosen: the fewest coefficients within one standard error of the smallest error",
        "that is energy4",
    ]
    assert str(CURVE).splitlines() == [
        "energy4 from 10 poses: held-out error 1.6 of the noise",
        "not enough: the curve still falls at the last of these; measure more poses",
    ]


def test_results_become_data_frames() -> None:
    pytest.importorskip("pandas", reason="pandas is not installed (extra data)")
    assert CHOICE.to_pandas().loc["energy4", "error"] == 1.0
    assert CURVE.to_pandas().loc[10].tolist() == [1.6, 1.0, 2.0]
    held_out = CrossValidation({"fx_N": 0.5}, {"fx_N": 10.0}, 10, True)
    assert held_out.to_pandas().loc["fx_N"].tolist() == [0.5, 10.0]
    fitted = model().add("payload").fit(campaign("payload", 1.0, 0))
    frame = fitted.to_pandas()
    assert frame["value"].tolist() == [*fitted.base.coefficients, *fitted.effects[0].values]
    assert frame["effect"].tolist() == ["base"] + ["payload"] * (len(frame) - 1)
    assert len(model().to_pandas()) == len(model().base.coefficients)


def test_what_holds_columns_becomes_a_data_frame() -> None:
    pytest.importorskip("pandas", reason="pandas is not installed (extra data)")
    imported = import_log({"x [mm]": [0.0, 1.0], "Fx (lbf)": [0.0, 2.0]})
    assert imported.to_pandas()["x_m"].tolist() == [0.0, 1e-3]
    frame = check(imported.table).to_pandas()
    assert frame.loc["x_m", ["unit", "role", "max"]].tolist() == ["m", "pose", 1e-3]
    pairs = solve_wrenches(Mechanism(), np.zeros((1, 6)))
    assert pairs.to_pandas().shape == (1, len(pairs.table().columns))


@pytest.mark.parametrize(
    "given", [{}, {"builtin": "tube", "inner_radius_m": 0.02, "density_kg_m3": 0.0}]
)
def test_a_mechanism_prints_what_creates_it(given: dict[str, Any]) -> None:
    body = Mechanism(length_m=0.2, **given)
    assert eval(repr(body)) == body
    assert "length_m=0.2" in repr(body)
    assert len(repr(body)) < 150
    assert body._repr_html_() == f"<pre>{escape(repr(body))}</pre>"


def test_a_dynamic_stiffness_prints_in_the_units_of_a_report() -> None:
    time = np.linspace(0.0, 3.0, 301)
    for (pose, wrench), way, head, row in (
        (("x_m", "fx_N"), 1e-3, "|K*| N/mm", [1, 5, 3, 4, 53.1]),
        (("theta_z_rad", "tau_z_Nm"), np.pi / 180.0, "|K*| N m/rad", [1, 286, 172, 229, 53.1]),
    ):
        turn = 2.0 * np.pi * 1.5 * time
        log = {
            "time_s": time,
            pose: way * np.sin(turn),
            wrench: 3.0 * np.sin(turn) + 4.0 * np.cos(turn),
        }
        found = dynamic_stiffness(log)
        assert head in str(found)
        assert [float(n) for n in str(found).splitlines()[-1].split()[1:6]] == row
        assert repr(found).startswith("<DynamicStiffness: ")
        assert found["stiffness"] == pytest.approx(5.0 / way)
        pytest.importorskip("pandas", reason="pandas is not installed (extra data)")
        assert found.to_pandas()["loss_angle_deg"][0] == pytest.approx(53.13, abs=0.01)


def test_several_frequencies_in_one_run_have_no_dynamic_stiffness() -> None:
    """One number of all blocks of a log means nothing: each is a run."""
    time = np.arange(3000) / 100.0
    block = np.floor(time / 10.0)
    way = 1e-3 * np.sin(2.0 * np.pi * time * np.array([0.5, 1.0, 2.0])[block.astype(int)])
    log = {"time_s": time, "x_m": way, "fx_N": 5e3 * way}
    with pytest.raises(
        InputError, match=r"run 0 is no vibration of one frequency.* --map run=COLUMN"
    ):
        dynamic_stiffness(log)
    assert dynamic_stiffness(log | {"run": block})["stiffness"] == pytest.approx(5e3)


@pytest.mark.parametrize(
    "terms",
    [
        EnergyTerms(0.1, 4),
        EnergyTerms(0.1, 4, "revolution", ("handedness", "face_tilt")),
        EnergyTerms(0.1, 3, "general"),
    ],
    ids=lambda terms: terms.symmetry,
)
def test_the_names_of_an_energys_parameters_are_its_terms(terms: EnergyTerms) -> None:
    """Forces are the slopes of the energy that the names spell."""
    random = np.random.default_rng(4)
    poses = random.uniform(-1.0, 1.0, (20, 6)) * ([0.01] * 3 + [0.2] * 3) + [0.1, 0, 0, 0, 0, 0]
    scale = terms.frame(poses)
    count = len(terms.regressor(poses, scale)[0, 0])
    base = terms.map(scale, random.normal(size=count))
    assert base.parameter_unit == "J"
    assert len(set(base.parameter_names)) == count

    def energy(at: np.ndarray) -> np.ndarray:
        c, theta = np.split(mid_frame(at, 0.1), 2, axis=1)
        c, theta = c.T / scale[0], theta.T / scale[1]
        big_c, d = c[1] + 1j * c[2], -theta[2] + 1j * theta[1]
        known = {
            "c_x": c[0], "c_y": c[1], "c_z": c[2],
            "theta_x": theta[0], "theta_y": theta[1], "theta_z": theta[2],
            "|c_perp|^2": c[1] ** 2 + c[2] ** 2, "|theta_perp|^2": theta[1] ** 2 + theta[2] ** 2,
            "a": c[1] * theta[1] + c[2] * theta[2], "b": c[1] * theta[2] - c[2] * theta[1],
            "C": big_c, "C*": big_c.conj(), "D": d, "D*": d.conj(),
        }  # fmt: skip
        total = np.zeros(len(at))
        for name, coefficient in zip(base.parameter_names, base.coefficients, strict=True):
            first, *others = name.split()
            factors = others if first in ("Re", "Im") else [first, *others]
            product = np.ones(len(at), dtype=complex)
            for factor in factors:
                inner, _, digits = (factor, "", "1") if factor in known else factor.rpartition("^")
                product *= known[inner.strip("()")] ** int(digits)
            total += coefficient * (product.imag if first == "Im" else product.real)
        return total

    for j in range(3):
        step = 1e-6 * np.eye(6)[j]
        slope = (energy(poses + step) - energy(poses - step)) / 2e-6
        np.testing.assert_allclose(slope, base.predict(poses)[:, j], rtol=1e-5, atol=1e-4)


def test_results_draw_themselves() -> None:
    pytest.importorskip("plotly", reason="plotly is not installed (extra report)")
    lines = CURVE.plot().data
    assert [line.name for line in lines] == ["median", "lower quartile", "upper quartile"]
    assert tuple(lines[1].x) == (10, 20)
    with pytest.raises(InputError, match="no history"):
        model().plot()
    table = campaign("payload", 1.0, 0)
    traces = model().plot(table).data
    assert [trace.name for trace in traces] == ["measured"] * 6 + ["modelled"] * 6
    np.testing.assert_allclose(traces[1].y, table["fy_N"], rtol=1e-3)
    np.testing.assert_allclose(traces[1].x, traces[7].x)
    fitted = model().add("payload").fit(campaign("payload", 1.0, 0))
    fitted_rows, held_out = fitted.plot().data
    assert tuple(fitted_rows.y) == tuple(record.train for record in fitted.history)
    assert tuple(held_out.x) == tuple(record.name for record in fitted.history)


def one_column(**more: float) -> Model:
    x = np.linspace(-0.01, 0.01, 9)
    return fit({"x_m": x, "fx_N": 2000.0 * x + 0.1 * np.cos(9 * x * 1e3), **more}, "cubic")


def test_parameters_have_names_values_errors_and_bounds() -> None:
    params = one_column().params
    assert list(params) == ["fx_N:1", "fx_N:x", "fx_N:x^2", "fx_N:x^3"]
    slope = params["fx_N:x"]
    assert slope.value == pytest.approx(20.0, abs=0.2)
    assert slope.sd is not None
    assert 0.0 < slope.sd < 1.0
    fitted = model().add("payload").fit(campaign("payload", 1.0, 0))
    mass = fitted.params["payload.mass"]
    assert (mass.effect, mass.unit, mass.vary) == ("payload", "kg", True)
    assert mass.value == fitted.effects[0].values[0]
    assert not fitted.freeze("payload").params["payload.mass"].vary
    spring = Expression("fx_N = k * x_m + c", k=(1e3, 0.0, 1e4), c={"value": 0.0, "vary": False})
    own = fit({"x_m": [0.0, 0.01, 0.02, 0.03], "fx_N": [0.1, 20.2, 39.9, 60.1]}, spring)
    assert (own.params["k"].min, own.params["k"].max) == (0.0, 1e4)
    assert not own.params["c"].vary


def test_a_body_has_its_modulus_and_ratio_by_name() -> None:
    params = fit(ROOT / "examples" / "neck_measured.csv", "physics").params
    assert list(params) == ["young_modulus_Pa", "poisson_ratio"]
    assert params["poisson_ratio"].max <= 0.5
    for name, own in params.items():
        assert own.sd is not None
        assert 0.0 < own.sd < 0.01 * own.value, name
        assert own.min < own.value < own.max, name


def test_results_are_one_line_at_a_prompt_and_whole_in_a_notebook() -> None:
    x = np.linspace(-0.01, 0.01, 30)
    table = {"x_m": x, "fx_N": 2000.0 * x + 0.01 * np.sin(5e3 * x)}
    fitted = fit(table, "linear")
    results = [
        fitted,
        compare(fitted, table),
        diagnose(fitted, table, effects=[]),
        check(table),
        as_table(table),
        import_log(table),
        cross_validate(table, "linear"),
        CHOICE,
        CURVE,
        Revealed(effects=(), seed=0),
    ]
    for result in results:
        assert "\n" not in repr(result)
        assert len(repr(result)) < 250
        html = result._repr_html_() or ""
        assert html.strip()
        for tag in ("figure", "table", "div"):
            assert html.count(f"<{tag}") == html.count(f"</{tag}>"), type(result)
    assert repr(fitted) == "<Model poly:1: fx_N of x_m, 2 parameters>"
    assert "fx_N:x" in (fitted._repr_html_() or "")
    assert str(fitted) == fitted.fit_report()


def test_a_model_of_one_column_takes_a_number_and_a_row_of_numbers() -> None:
    fitted = one_column()
    x = np.linspace(-0.01, 0.01, 5)
    rows = fitted.predict(x[:, None])
    for given in (x, x.tolist(), tuple(x)):
        np.testing.assert_array_equal(fitted.predict(given), rows)
    np.testing.assert_array_equal(fitted.predict(0.005), fitted.predict(np.array([0.005])))
    assert fitted.stiffness(x).shape == (5, 1, 1)
    assert fitted.stiffness(0.005).shape == (1, 1)
    assert fitted.wrench_and_stiffness(x)[1].shape == (5, 1, 1)
    assert fitted.extrapolates(x * 2).tolist() == [True, False, False, False, True]
    sd = fitted.predict_sd(x)
    assert sd is not None
    assert sd.shape == (5, 1)
    with pytest.raises(InputError, match=r"of shape \(5,\): expected \(N, 6\)"):
        model().predict(x)


def test_one_name_needs_no_list() -> None:
    table = campaign("payload", 1.0, 0)
    alone = refit(model(), table, add="payload")
    assert alone.params == refit(model(), table, add=["payload"]).params
    assert refit(alone, table, remove="payload").effects == ()
    np.testing.assert_array_equal(table.matrix("fx_N"), table.matrix(["fx_N"]))
    log = {"x": [0.0, 20.0, 30.0], "Fx": [0.0, 1.0, 2.0]}
    imported = import_log(log, units="mm,N").table
    np.testing.assert_array_equal(imported["x_m"], import_log(log, units=["mm", "N"]).table["x_m"])
