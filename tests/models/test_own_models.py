"""Models of one's own: equations, functions and predicted wrenches where a model is expected."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scipy.optimize import curve_fit

import ecm
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.models import parse_model, registry
from ecm.models.expression import FUNCTIONS, Expression
from support.exports import CompiledC
from support.models import reread
from support.neck import columns_of

NOISE_N = 0.05
META = {"instrument": {"force_sd_N": NOISE_N, "pose_position_sd_m": 1e-9}}
SPRING = "fx_N = k * x_m + c * x_m**3"
START: dict[str, Any] = {"k": (1e3, 0, 1e6), "c": 0.0}


def spring(poses: F, k: float = 2000.0, c: float = 4e6) -> F:
    return k * poses + c * poses**3


def line(seed: int = 0, rows: int = 41) -> ecm.Table:
    x = np.linspace(-0.01, 0.01, rows)
    noise = NOISE_N * np.random.default_rng(seed).standard_normal(rows)
    return ecm.as_table({"x_m": x, "fx_N": spring(x) + noise, "time_s": np.arange(rows)}, meta=META)


def test_an_expression_and_a_function_fit_as_curve_fit_does(tmp_path: Path) -> None:
    table = line()
    model = ecm.fit(table, ecm.Expression(SPRING, **START))
    values, covariance = curve_fit(
        spring, table["x_m"], table["fx_N"], (1e3, 0.0), np.full(41, NOISE_N), absolute_sigma=True
    )
    np.testing.assert_allclose(model.base.coefficients, values, rtol=1e-5)
    np.testing.assert_allclose(model.covariance, covariance, rtol=1e-3)
    by_function = ecm.fit(table, spring, parameters=START)
    np.testing.assert_allclose(by_function.base.coefficients, values, rtol=1e-5)
    # The words of a wrong name say that a TOML is taken, which the command alone did.
    law = tmp_path / "law.toml"
    law.write_text(f'[expression]\nequations = "{SPRING}"\nparameters = {{ k = 1e3, c = 0.0 }}\n')
    assert ecm.fit(table, str(law)).base.values == pytest.approx(model.base.values, rel=1e-6)
    law.write_text("[expression]\n")
    with pytest.raises(InputError, match=r"^model '[^']*law.toml': \[expression\]: expected"):
        ecm.fit(table, str(law))
    assert "k = 2002.55 +- 3.3" in model.fit_report()
    loaded = reread(model, tmp_path)
    np.testing.assert_array_equal(loaded.predict(table), model.predict(table))
    assert loaded.base.parameters == model.base.parameters


def test_bounds_priors_and_held_values_count() -> None:
    table = line()
    bounded = ecm.fit(table, Expression(SPRING, k=(1e3, 0, 1900), c=0.0))
    assert bounded.base.values["k"] == pytest.approx(1900.0)
    assert "at its bound" in bounded.fit_report()
    held = ecm.fit(table, Expression(SPRING, k={"value": 1950.0, "vary": False}, c=0.0))
    assert held.base.values["k"] == 1950.0
    assert held.base.parameter_names == ("c",)
    free = ecm.fit(table, Expression(SPRING, k=1e3, c=0.0))
    sd = math.sqrt(free.covariance[0, 0])
    before = free.base.values["k"] + 2.0 * sd
    prior = ecm.fit(table, Expression(SPRING, k={"value": before, "sd": sd}, c=0.0))
    # A prior as uncertain as the data: half way, and 1 / sqrt(2) of the error.
    assert prior.base.values["k"] == pytest.approx(before - sd, abs=0.1 * sd)
    assert math.sqrt(prior.covariance[0, 0]) == pytest.approx(sd / math.sqrt(2.0), rel=0.02)
    # A refit with an effect beside it knows the prior as well.
    again = ecm.refit(prior, table, add=["stress_relaxation"], force=True)
    assert math.sqrt(again.covariance[0, 0]) < 0.8 * sd


@pytest.mark.parametrize("model", ["function", "table", "expression", "file"])
def test_a_model_of_ones_own_is_compared_and_diagnosed(model: str, tmp_path: Path) -> None:
    table = line()
    shifted = table.with_columns({"fx_N": table["fx_N"] + 0.02 * table["time_s"]})
    given: Any = spring
    if model == "table":
        given = {"x_m": table["x_m"], "fx_N": spring(table["x_m"])}
    elif model == "expression":
        given = Expression(SPRING, k=2000.0, c=4e6)
    elif model == "file":
        given = tmp_path / "predicted.csv"
        ecm.as_table({"x_m": table["x_m"], "fx_N": spring(table["x_m"])}).write(given)
    right = ecm.compare(given, table)
    assert right.whitened_rms == pytest.approx(1.0, abs=0.25)
    assert not right.missing
    wrong = ecm.compare(given, shifted)
    assert wrong.whitened_rms > 3.0
    assert wrong.missing
    found = ecm.diagnose(given, table)
    assert found.verdict == "none"
    assert found.model.answer == "fits"


def test_functions_of_six_columns_are_differentiated_and_named() -> None:
    poses = np.random.default_rng(0).uniform(-0.01, 0.01, (30, 6))
    wrenches = poses @ np.diag([2e4, 900.0, 900.0, 4.0, 6.0, 6.0])
    table = ecm.as_table(columns_of(poses, wrenches))

    def body(at: F) -> F:
        return at @ np.diag([2e4, 900.0, 900.0, 4.0, 6.0, 6.0])

    model = ecm.compare(body, table).compared.model
    assert model.name == "body"
    stiffness = model.stiffness(poses[:2])
    np.testing.assert_allclose(stiffness[0], np.diag([2e4, 900, 900, 4, 6, 6]), atol=1e-4)
    with pytest.raises(InputError, match="cannot be stored in a model file, which holds no code"):
        model.save("nowhere.json")
    with pytest.raises(InputError, match=r"shape \(30, 3\).*expected \(30, 6\)"):
        ecm.compare(lambda at: at[:, :3], table)
    with pytest.raises(InputError, match="gives no number at x_m"):
        ecm.compare(lambda at: np.full_like(at, np.nan), table)
    with pytest.raises(InputError, match="ZeroDivisionError"):
        ecm.compare(lambda at: 1 / 0, table)


@pytest.mark.parametrize(
    ("length", "turn", "form"),
    [({"length_m": 0.1}, 0.02, "energy"), ({"length_m": 0.1}, 0.6, "poly:1"), ({}, 0.6, "poly:1")],
)
def test_an_expression_of_six_columns_is_exported_as_an_energy_or_else_a_polynomial(
    length: dict[str, float], turn: float, form: str, tmp_path: Path
) -> None:
    """A linear law over large turns is no energy; it was refused, with --force for the way out."""
    stiff = dict(zip("abcdef", (2e4, 900.0, 900.0, 4.0, 6.0, 6.0), strict=True))
    bent = ("", " - w * theta_z_rad", " + w * theta_y_rad", "", " + w * z_m", " - w * y_m")
    shape = ("(x_m - 0.1)", *POSE[1:])
    lines = [
        f"{wrench} = {name} * {pose}{more}"
        for wrench, name, pose, more in zip(WRENCH, stiff, shape, bent, strict=True)
    ]
    own = Expression("\n".join(lines), w=10.0, **stiff)
    poses = np.random.default_rng(1).uniform(-1.0, 1.0, (60, 6)) * np.repeat([2e-3, turn], 3)
    poses[:, 0] += 0.1
    wrenches = own.map().predict(poses)
    meta = {"mechanism": length, "instrument": {"force_sd_N": 0.3, "torque_sd_Nm": 0.01}}
    table = ecm.as_table(columns_of(poses, wrenches), meta=meta)
    model = ecm.fit(table, own)
    np.testing.assert_allclose(model.base.coefficients, own.map().coefficients, rtol=1e-6)
    exported = ecm.export(model, "c", tmp_path)
    assert any(f"Folded into {form}" in note for note in exported.notes)
    assert exported.folding < 0.2


@pytest.mark.parametrize(
    ("equations", "form"),
    [
        ([SPRING], "poly:3"),
        (["fx_N = k * x_m + c * tanh(x_m / 0.01)"], "poly:5"),
        ([SPRING, "fy_N = d * y_m + e * x_m * y_m"], "poly:3"),
        (
            [SPRING, "fy_N = d * y_m + e * x_m * y_m", "fz_N = d * z_m + e * z_m**3 * 100.0"],
            "poly:3",
        ),
    ],
)
def test_an_expression_of_few_columns_is_exported_as_a_polynomial(
    equations: list[str], form: str, tmp_path: Path
) -> None:
    random = np.random.default_rng(3)
    x, y, z = random.uniform(-0.01, 0.01, (3, 80))
    columns = {"x_m": x, "fx_N": spring(x), "y_m": y, "fy_N": 900.0 * y + 2e4 * x * y}
    columns |= {"z_m": z, "fz_N": 900.0 * z + 2e6 * z**3}
    kept = [name for name in columns if name[1 if name[0] == "f" else 0] in "xyz"[: len(equations)]]
    table = ecm.as_table(
        {name: columns[name] + (0.05 * random.standard_normal(80) if name[0] == "f" else 0.0)
         for name in kept}, meta=META
    )  # fmt: skip
    start = dict.fromkeys([n for n in "kcde" if any(f"{n} *" in text for text in equations)], 1.0)
    model = ecm.fit(table, Expression("\n".join(equations), **start))
    exported = ecm.export(model, "c", tmp_path)
    assert any(f"Folded into {form}: expression" in note for note in exported.notes)
    poses = np.ascontiguousarray(table.matrix(model.inputs))
    got = CompiledC(tmp_path / "ecm_model.c").wrenches(poses, len(model.outputs))
    error = got - model.predict(poses)
    assert np.sqrt((error**2).mean(axis=0)).max() < 0.2 * NOISE_N


def test_predictions_elsewhere_or_twice_are_refused_with_the_row() -> None:
    table = line()
    x = table["x_m"]
    with pytest.raises(InputError, match=r"no wrench at the pose of row 22 of .*20 of 41 rows"):
        ecm.compare({"x_m": x[:21], "fx_N": spring(x[:21])}, table)
    with pytest.raises(InputError, match="rows 1 and 42 have the same pose and other wrenches"):
        ecm.compare({"x_m": [*x, x[0]], "fx_N": [*spring(x), 0.0]}, table)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("fx_N = __import__('os').system('true')", "is not known here"),
        ("fx_N = x_m.real", "is not known here"),
        ("fx_N = (lambda: x_m)()", "is not known here"),
        ("fx_N = [x_m for _ in x_m]", "is not known here"),
        ("fx_N = x_m if k else 1", "is not known here"),
        ("fx_N = k * x_m^3", r"\^ is no power; write \*\*"),
        ("fx_N = gamma(x_m)", "is not known here"),
        ("fx_N = sin(x_m, 2)", "is not known here"),
        ("fx_N = 'a' * x_m", "is not known here"),
        ("fx_N = True * x_m", "is not known here"),
        ("fx_N = " + "-" * 5000 + "x_m", "nested too deep|expected WRENCH_COLUMN"),
        ("fx_N = " + "(" * 300 + "x_m" + ")" * 300, "expected WRENCH_COLUMN"),
        ("fx_N == x_m", "expected WRENCH_COLUMN = EXPRESSION"),
        ("import os", "expected WRENCH_COLUMN = EXPRESSION"),
        ("fx = k * x_m", "none sets a wrench column"),
        ("x_m = fx_N", "cannot be set"),
        ("fx_N = k * x_mm", "did you mean 'x_m'"),
        ("fx_N = k", "use no pose column"),
        ("", "none sets a wrench column"),
        ("fx_N = x_m\0", "expected WRENCH_COLUMN"),
    ],
)
def test_what_is_no_equation_is_refused_in_words(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Expression(text, {"k": 1.0} if "k" in text else {})


@pytest.mark.parametrize(
    "value",
    [None, "1", math.nan, (1, 2), (3, 0, 2), {"min": 0}, {"value": 1, "lo": 0}, [1, 1, 1], True],
)
def test_what_is_no_parameter_is_refused_with_its_name(value: Any) -> None:
    with pytest.raises(InputError, match="parameter k"):
        Expression("fx_N = k * x_m", k=value)
    with pytest.raises(InputError, match="parameter k"):
        ecm.fit(line(), spring, parameters={"k": value, "c": 0.0})


def test_a_parameter_without_effect_and_a_start_without_a_number_are_told() -> None:
    table = line()
    with pytest.raises(InputError, match="parameter c changes nothing on these rows"):
        ecm.fit(table, Expression("fx_N = k * x_m + 0 * c", k=1.0, c=1.0))
    with pytest.raises(InputError, match=r"no number at x_m = -0.01 \(row 1 of 41; k = -1\)"):
        ecm.fit(table, Expression("fx_N = log(k) * x_m", k=-1.0))
    assert ecm.fit(table, Expression("fx_N = log(k) * x_m", k=2.0)).base.values["k"] > 2.0


_NUMBERS = st.floats(0.2, 3.0).map(lambda x: f"{x:.3f}")
_TREES = st.recursive(
    st.sampled_from(["x_m", "y_m", "a", "b"]) | _NUMBERS,
    lambda tree: st.one_of(
        st.tuples(tree, st.sampled_from("+-*/"), tree).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        st.tuples(tree, st.sampled_from(["2", "3", "-1", "a"])).map(lambda t: f"{t[0]}**({t[1]})"),
        st.tuples(st.sampled_from(sorted(FUNCTIONS)), tree).map(lambda t: f"{t[0]}({t[1]})"),
        st.tuples(st.sampled_from(["min", "max"]), tree, tree).map(
            lambda t: f"{t[0]}({t[1]}, {t[2]})"
        ),
    ),
    max_leaves=6,
)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(_TREES)
@example("(x_m - x_m)**(a)")
@example("min(log(-1)**(a), x_m)")
@example("max(sqrt(x_m - x_m), x_m)")
def test_slopes_are_those_of_differences(tree: str) -> None:
    base = Expression(f"fx_N = x_m + y_m + a + b + {tree}", a=0.7, b=1.3).map()
    at = np.array([0.37, 0.83, 0.7, 1.3])

    def wrench(point: F) -> float:
        return float(base.with_coefficients(point[2:]).raw(point[None, :2])[0, 0])

    steps = 1e-6 * np.eye(4)
    with np.errstate(all="ignore"):
        ends = [(wrench(at - s), wrench(at + s)) for s in steps]
        slopes = np.array([(b - a) / 2e-6 for a, b in ends])
        curved = np.array([(a - 2.0 * wrench(at) + b) / 1e-12 for a, b in ends])
    if not np.isfinite([*slopes, *curved]).all() or np.abs(curved).max() > 1e4:
        return  # a pole, a kink or no number
    found = base.equations.wrench(at[None, :2], base.values, base.parameter_names)[1][0, 0]
    np.testing.assert_allclose(found, slopes, rtol=1e-4, atol=1e-4 * (1.0 + abs(wrench(at))))


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.text(max_size=30))
def test_any_text_is_an_expression_or_refused(text: str) -> None:
    try:
        Expression(text)
        Expression(f"fx_N = {text}")
    except InputError:
        pass


@pytest.mark.parametrize("change", ["equations", "value", "min", "inputs"])
def test_a_model_file_with_other_equations_is_refused(change: str, tmp_path: Path) -> None:
    model = ecm.fit(line(), Expression(SPRING, **START))
    document = model.document()
    if change == "equations":
        document["equations"] = "fx_N = __import__('os')"
    elif change == "inputs":
        document["inputs"] = ["y_m"]
    else:
        document["parameters"]["k"][change] = "a"
    path = tmp_path / "bad.json"
    registry.write_document(document, path)
    with pytest.raises(InputError, match=r"bad.json: the model file lacks or misstates"):
        ecm.load_model(path)


@pytest.mark.parametrize(
    "wrong", [None, 3, [1, 2], np.zeros(3), {}, "energy99", object(), ecm.Table]
)
def test_what_is_no_model_is_refused_with_what_is(wrong: Any) -> None:
    for function in (ecm.compare, ecm.diagnose):
        with pytest.raises(InputError, match=r"model: found|energy99"):
            function(wrong, line())
    with pytest.raises(InputError, match="not fitted"):
        ecm.compare(parse_model("cubic"), line())
