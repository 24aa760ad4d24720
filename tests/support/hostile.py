"""Calls of public functions with hostile input; one line of JSON for each that breaks the contract.

The contract: a result whose numbers are finite, or an error of `ecm.errors` with a message.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

import ecm
from ecm import _native as native
from ecm.errors import EcmError

Call = Callable[[], Any]
NUMBERS = (0.0, -0.0, 1.0, -1.0, 1e200, -1e200, 1e-200, 5e-324, math.inf, -math.inf, math.nan)


def matrices(columns: int) -> dict[str, np.ndarray[Any, Any]]:
    """Hostile matrices of this width, and an ordinary one."""
    good = np.random.default_rng(1).uniform(-1.0, 1.0, (12, columns))

    def with_cell(value: float) -> np.ndarray[Any, Any]:
        changed = good.copy()
        changed[3, -1:] = value
        return changed

    def with_column(value: float) -> np.ndarray[Any, Any]:
        changed = good.copy()
        changed[:, -1:] = value
        return changed

    return (
        {"ordinary": good, "no rows": good[:0], "one row": good[:1], "no columns": good[:, :0]}
        | {"repeated": np.repeat(good[:2], 6, axis=0), "wide": np.hstack([good, good])}
        | {"Fortran": np.asfortranarray(good), "strided": np.repeat(good, 2, axis=0)[::2]}
        | {f"cell {v}": with_cell(v) for v in NUMBERS}
        | {f"column {v}": with_column(v) for v in NUMBERS}
        | {f"scaled {s}": s * good for s in (1e200, 1e-200, 1e99, 4.0)}
    )


def tame(*arrays: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Rows that must give finite results: finite, and with angles that have digits left."""
    rows = [np.abs(a).reshape(len(a), math.prod(a.shape[1:])) <= 1e6 for a in arrays]
    return np.all(np.hstack(rows), axis=1)


def se3_calls() -> Iterator[tuple[str, Call]]:
    """Rotations, poses and stiffnesses: other rows give NaN, as the stubs say."""
    for name, m in matrices(3).items():
        if m.shape[1] == 0:
            continue
        yield f"rotation_matrices {name}", lambda m=m: native.rotation_matrices(m)[tame(m)]
        for of in (native.left_jacobians, native.inverse_left_jacobians):
            yield f"{of.__name__} {name}", lambda m=m, of=of: of(m)[tame(m)]
        cubes = np.repeat(m[:, None, :], 3, axis=1)
        yield f"rotation_vectors {name}", lambda m=cubes: native.rotation_vectors(m)[tame(m)]
    for name, m in matrices(6).items():
        for length in (0.1, 0.0):
            yield (
                f"mid_frame {name} {length}",
                lambda m=m, x=length: native.mid_frame(m, x)[tame(m)],
            )
        k = np.repeat(m[:, None, :], 6, axis=1)
        for target in ("partial", "screw", "generalised"):
            yield (
                f"convert_stiffness {target} {name}",
                lambda m=m, k=k, to=target: native.convert_stiffness(
                    k, m, m, source="partial", target=to
                )[tame(m, k)],
            )


def fit_calls() -> Iterator[tuple[str, Call]]:
    """Polynomial and energy models of the native module."""
    poly = native.PolynomialEvaluator

    def fitted(*given: Any, **options: Any) -> Any:
        return model_numbers(poly.fit(*given, **options))

    def energy(*given: Any, **options: Any) -> Any:
        made = native.EnergyEvaluator.fit(*given, **{"length_m": 0.1, "degree": 2, **options})
        return model_numbers(made)

    good = matrices(2)["ordinary"]
    model = poly.fit(good, good, 2)
    for name, m in matrices(2).items():
        for how in ("least_squares", "ridge", "pcr"):
            for v in (0.1, *NUMBERS[4:]):
                options = {"method": how, "ridge": v, "threshold": v}
                yield f"fit {name} {how} {v}", partial(fitted, m, m, 2, **options)
        weights = m[:, 0] if m.shape[1] else m.sum(axis=1)
        some = good[: len(weights)]
        yield f"fit weights {name}", partial(fitted, some, some, 1, weights=weights)
        for call in (model.predict, model.jacobian, model.leverage, model.prediction_sd):
            yield f"{call.__name__} {name}", partial(call, m)
        yield f"leave_one_out {name}", lambda m=m: poly.leave_one_out(m, m, 1)[0]
        if len(m) == 0:
            continue
        yield (
            f"polynomial_regressor {name}",
            partial(native.polynomial_regressor, good, 2, m[0], m[-1]),
        )
        yield (
            f"polynomial from_coefficients {name}",
            lambda m=m: poly.from_coefficients(1, m[0], m[-1], m[:3]).predict(good),
        )
    for degree in (0, 1, 20, 21, 2**40):
        yield f"exponents {degree}", partial(native.polynomial_exponents, 2, degree)
        yield f"exponents of none {degree}", partial(native.polynomial_exponents, 0, degree)
    spread = np.array([1e-2, 1e-2, 1e-2, 0.3, 0.3, 0.3])
    poses = spread * np.random.default_rng(2).uniform(-1.0, 1.0, (30, 6)) + [0.1, 0, 0, 0, 0, 0]
    one = native.EnergyEvaluator.fit(poses, poses, length_m=0.1, degree=2)
    for name, m in matrices(6).items():
        yield f"energy fit {name}", partial(energy, m, m)
        yield f"energy wrenches {name}", partial(energy, poses[: len(m)], m)
        for call in (one.predict, one.stiffness, one.energy_J, one.prediction_covariance):
            yield f"energy {call.__name__} {name}", partial(call, m)
    for v in NUMBERS:
        covariance = np.full((30, 6, 6), v)
        yield f"energy length {v}", partial(energy, poses, poses, length_m=v)
        yield f"energy covariance {v}", partial(energy, poses, poses, covariance=covariance)


def model_numbers(model: Any) -> Any:
    """Numbers of a fitted model that are to be finite."""
    return [model.coefficients, np.nan_to_num(model.residual_variance, nan=0.0, posinf=math.inf)]


def design_calls() -> Iterator[tuple[str, Call]]:
    """Searches of designs of the native module and of `optimal_design`."""
    few = {"iterations": 2, "starts": 2}
    for name, m in matrices(3).items():
        for criterion, _, _ in native.criteria():
            yield (
                f"optimal_design {criterion} {name}",
                lambda m=m, c=criterion: ecm.optimal_design(
                    m, 5, ecm.DesignSettings(criterion=c, model="linear", **few)
                ),
            )
            if criterion != "maximin":
                options = {"criterion": criterion, "region": m, **few}
                yield f"d_optimal {criterion} {name}", partial(native.d_optimal, m, 5, **options)
        yield f"maximin {name}", partial(native.maximin, m, 4, iterations=1, starts=2)
    good = matrices(3)["ordinary"]
    lists = {"none": [], "all": range(12), "most": range(3, 12), "negative": [-1], "far": [99]}
    for n in (0, 1, 3, 12, 13, 2**62):
        for label, rows in lists.items():
            chosen = np.array(list(rows), dtype=np.int64)
            for key in ("include", "exclude"):
                options = {key: chosen, "iterations": 1, "starts": 2}
                for search in (native.d_optimal, native.maximin):
                    name = f"{search.__name__} {n} {key} {label}"
                    yield name, partial(search, good, n, **options)
    extremes: list[dict[str, Any]] = [
        *[{"starts": n} for n in (0, 2**62)],
        *[{"rows_per_pose": n} for n in (0, 2**62, 5)],
        *[{"threads": 2**62}, {"criterion": "z"}, {"method": "z"}],
        *[{"time_limit_s": v, "iterations": 1} for v in NUMBERS if not v > 1e9],
        *[{"criterion": "di", "share": v, "iterations": 1} for v in NUMBERS],
    ]
    for options in extremes:
        yield f"d_optimal {options}", partial(native.d_optimal, good, 5, **options)


def tables() -> dict[str, dict[str, Any]]:
    """Columns of a small measurement table, ordinary and hostile."""
    rng = np.random.default_rng(3)
    x, angle = np.linspace(-1e-3, 1e-3, 24), rng.uniform(-0.3, 0.3, 24)
    force = 1e4 * x + 0.5 * angle + rng.normal(0.0, 0.1, 24)
    good = {"x_m": x, "theta_y_rad": angle, "fx_N": force, "tau_y_Nm": 0.2 * angle - 3.0 * x}
    made: dict[str, dict[str, Any]] = {"ordinary": good, "nothing": {}, "no wrench": {"x_m": x}}
    for rows in (0, 1, 2, 3):
        made[f"{rows} rows"] = {name: values[:rows] for name, values in good.items()}
    made["repeated"] = {name: np.repeat(values[:2], 12) for name, values in good.items()}
    made["ragged"] = good | {"fx_N": force[:-1]}
    made["unknown column"] = good | {"spam": force}
    made["two-dimensional"] = good | {"fx_N": force[:, None]}
    made["turned"] = good | {"theta_y_rad": np.full(24, 4.0)}
    for name, values in good.items():
        for value in (*NUMBERS, 4.0, "text", None, "1e999"):
            cell: list[Any] = list(values)
            cell[5] = value
            made[f"{name} cell {value!r}"] = good | {name: cell}
            made[f"{name} constant {value!r}"] = good | {name: [value] * 24}
    for scale in (1e99, 1e200, 1e-200):
        made[f"scaled {scale}"] = {name: scale * values for name, values in good.items()}
    return made


def table_calls() -> Iterator[tuple[str, Call]]:
    """What a user does with a table; each call also reads it."""
    good = ecm.as_table(tables()["ordinary"])
    model = ecm.fit(good, "linear")

    def every(table: ecm.Table) -> dict[str, Call]:
        return {
            "as_table": lambda: [table.column(name) for name in ("x_m", "fx_N")],
            "fit quadratic": lambda: model_values(ecm.fit(table, "quadratic"), good),
            "fit pcr": lambda: model_values(
                ecm.fit(table, ecm.PolynomialModel(degree=2, pcr=0.1)), good
            ),
            "predict": lambda: ecm.predict(model, table)["fx_N"],
            "check": lambda: str(ecm.check(table)) and None,
            "compare": lambda: compared(ecm.compare(model, table)),
            "refit": lambda: model_values(ecm.refit(model, table), good),
            "cross_validate": lambda: list(
                ecm.cross_validate(table, "linear", folds=3).rmse.values()
            ),
            "diagnose": lambda: ecm.diagnose(model, table) and None,
            "design": lambda: ecm.optimal_design(
                table.matrix(("x_m", "theta_y_rad")),
                4,
                ecm.DesignSettings(model="linear", iterations=2),
            ),
        }

    for name, columns in tables().items():
        for task in every(good):
            yield f"{task} {name}", lambda c=columns, t=task: every(ecm.as_table(c))[t]()


def model_values(model: ecm.Model, table: ecm.Table) -> Any:
    """What a fitted model predicts of the ordinary table."""
    return ecm.predict(model, table)["fx_N"]


def compared(comparison: ecm.Comparison) -> Any:
    """Sizes of the residuals of a comparison."""
    str(comparison)
    return [component.rmse for component in comparison.components]


def finite(value: Any) -> bool:
    """Whether all numbers of a result are finite."""
    if isinstance(value, native.DesignResult | ecm.Design):
        return bool(np.isfinite([value.value, value.bound, value.efficiency]).all())
    if isinstance(value, list | tuple):
        return all(finite(v) for v in value)
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return bool(np.isfinite(value).all())
    return not isinstance(value, float) or math.isfinite(value)


GROUPS = {"se3": se3_calls, "fit": fit_calls, "design": design_calls, "table": table_calls}


def main(groups: list[str]) -> None:
    """Run the calls of the groups, and name each before it starts."""
    for group in groups:
        for name, call in GROUPS[group]():
            print(json.dumps({"call": name}), flush=True)
            problem = None
            try:
                if not finite(call()):
                    problem = "a result that is not finite"
            except EcmError as error:
                if len(str(error)) < 20 or "internal error" in str(error):
                    problem = f"no message: {error}"
            except BaseException as error:
                problem = f"{type(error).__name__}: {error}"
            if problem:
                print(json.dumps({"call": name, "problem": problem}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
