"""Every public name answers an argument of a wrong type with an error of this package, in words."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import ecm
from ecm.errors import EcmError
from ecm.io.columns import POSE

WRONG: dict[str, Any] = {
    "None": None,
    "negative": -7,
    "float": 2.5,
    "nan": float("nan"),
    "text": "nonsense",
    "bytes": b"ab",
    "list": [1, "a"],
    "no list": [],
    "array": np.zeros(3),
    "matrix": np.zeros((4, 3)),
    "frame": pd.DataFrame({"a": [1, 2]}),
    "dict": {"a": 1},
    "object": object(),
    "class": int,
}
RESULTS = {
    "Comparison", "Design", "Diagnosis", "ImportedLog", "Model", "PlannedDesign", "Simulated",
    "ComputationError", "EcmError", "InputError", "MissingExtra",
}  # fmt: skip
"""Classes that functions return or raise; nobody makes one of values."""
WITHOUT_ARGUMENTS = {
    "ConstantCurvatureModel", "GaussianProcessModel", "NeuralNetworkModel", "RodModel",
}  # fmt: skip
HEAVY = {
    "campaign",
    "fem_poses",
    "identify",
    "measure",
    "run_campaign",
    "serve",
    "simulate",
    "solve_wrenches",
}
"""Functions that would work for minutes, or for ever, with a value that is right."""

X = np.linspace(-0.01, 0.01, 21)
COLUMNS = {"x_m": X, "fx_N": 2000.0 * X + 0.01 * np.sin(1e5 * X)}
TABLE = ecm.as_table(COLUMNS)
MODEL = ecm.fit(TABLE, "linear")
POSES = np.random.default_rng(0).uniform(-0.01, 0.01, (14, 6))
CANDIDATES = ecm.as_table(dict(zip(POSE, POSES.T, strict=True)))
LINEAR = ecm.DesignSettings(model="linear", iterations=5)
CHOSEN = ecm.optimal_design(POSES, 12, LINEAR)


def right(folder: Path) -> dict[str, dict[str, Any]]:
    """Arguments of each public name that are right."""
    MODEL.save(folder / "model.json")
    TABLE.write(folder / "table.csv")
    fit = {
        "table": TABLE, "model": "linear", "parameters": None, "meta": None, "weights": "auto",
        "zero_at_home": False, "stable": False, "progress": None,
    }  # fmt: skip
    calls: dict[str, dict[str, Any]] = {
        "Expression": {"equations": "fx_N = k * x_m", "parameters": {"k": 1.0}},
        "ModelEstimator": {"model": "cubic", "length_m": None, "weights": "auto"},
        "Table": {"columns": COLUMNS, "meta": None, "source": "table"},
        "as_table": {"data": COLUMNS, "meta": None, "source": "table", "need": None},
        "check": {"table": TABLE, "meta": None, "progress": None},
        "compare": {
            "model": MODEL, "table": TABLE, "meta": None, "noise": None, "seed": 0,
            "most_rows": 3000, "progress": None,
        },
        "cross_validate": {
            "table": TABLE, "model": "linear", "meta": None, "folds": 3, "grouped": True,
            "seed": 0, "fitted": None, "progress": None,
        },
        "design": {
            "candidates": CANDIDATES, "n": 12, "preset": "paper", "base": None, "rig": None,
            "effects": (), "how_many": False, "model": "linear",
        },
        "diagnosable_plan": {
            "candidates": CANDIDATES, "chosen": CHOSEN, "visits": None, "seed": 0,
            "dwells_s": (2.0, 8.0),
        },
        "diagnose": {
            "model": MODEL, "table": TABLE, "meta": None, "effects": ["kink"], "noise": None,
            "settings": ecm.DiagnosisSettings(), "seed": 0,
        },
        "dynamic_stiffness": {"table": TABLE, "model": MODEL, "skip": 1.0, "meta": None},
        "export": {
            "model": MODEL, "to": "c", "directory": folder, "name": "a", "precision": "double",
            "loop": None, "adapt": None, "force": False,
        },
        "fit": fit,
        "fit_model": fit,
        "import_log": {
            "log": {"x [mm]": X, "Fx [N]": X}, "columns": None, "rotation": "", "units": (),
            "axis": "", "topics": (), "meta": None, "leave_out": False,
        },
        "load_model": {"path": folder / "model.json"},
        "optimal_design": {
            "poses": POSES, "n": 12, "settings": LINEAR, "include": (), "exclude": (),
        },
        "paper_plan": {"candidates": CANDIDATES, "chosen": CHOSEN, "seed": 0},
        "predict": {
            "model": MODEL, "table": {"x_m": X}, "meta": None, "stiffness": None,
            "leverage": False, "progress": None,
        },
        "read_table": {"paths": folder / "table.csv", "meta": None, "need": None},
        "refit": {
            "model": MODEL, "table": TABLE, "meta": None, "add": ["kink"], "remove": (),
            "freeze": (), "progress": None,
        },
        "reveal": {"data": folder / "table.csv", "answer": None},
    }  # fmt: skip
    for name in ecm.__all__:
        made = getattr(ecm, name)
        plain = {*calls, *RESULTS, *WITHOUT_ARGUMENTS}
        if dataclasses.is_dataclass(made) and name not in plain:
            own = ecm.Parameter(1.0, 0.0, 2.0) if name == "Parameter" else made()
            calls[name] = {item.name: getattr(own, item.name) for item in dataclasses.fields(own)}
    return calls


NAMES = sorted(
    name
    for name in ecm.__all__
    if callable(getattr(ecm, name)) and name not in RESULTS | WITHOUT_ARGUMENTS | HEAVY
)


def refuse_wrong(function: Callable[..., Any], given: dict[str, Any], argument: str) -> None:
    """Call with each wrong value in place of one argument: a result, or an error in words."""
    for word, value in WRONG.items():
        try:
            function(**given | {argument: value})
        except EcmError:
            continue
        except Exception as error:
            where = f"{function.__name__}({argument} = {word})"
            pytest.fail(f"{where}: {type(error).__name__}: {error}")


@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_type_is_refused_in_words(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # a text is the name of a file to some
    given = right(tmp_path)[name]
    for argument in given:
        refuse_wrong(getattr(ecm, name), given, argument)


@pytest.mark.parametrize(
    ("name", "given", "wrong"),
    [
        ("simulate", {"mechanism": ecm.Mechanism(), "n": 1}, ("mechanism", "n", "seed", "threads")),
        (
            "solve_wrenches",
            {"mechanism": ecm.Mechanism(), "wrenches": np.zeros((1, 6))},
            ("mechanism",),
        ),
        ("campaign", {"plan": CANDIDATES, "rig": ecm.RigSettings()}, ("plan", "rig", "seed")),
        ("identify", {"config": "c.toml", "out": "o"}, ("config", "out", "seed")),
        ("serve", {"folder": "f"}, ("folder", "port", "tables")),
    ],
)
def test_long_work_does_not_begin_with_a_wrong_type(
    name: str, given: dict[str, Any], wrong: tuple[str, ...]
) -> None:
    for argument in wrong:
        for value in (object(), 2.5, np.zeros((2, 2)), {"a": 1}, int, b"a"):
            with pytest.raises(EcmError):
                getattr(ecm, name)(**given | {argument: value})


@pytest.mark.parametrize(
    "method",
    ["predict", "stiffness", "add", "remove", "freeze", "save", "fit", "undo", "extrapolates",
     "predict_sd", "reading_sd", "stiffness_sd", "leverage"],
)  # fmt: skip
def test_methods_of_a_model_refuse_wrong_types(method: str, tmp_path: Path) -> None:
    for word, value in WRONG.items():
        if method == "save" and word in ("text", "bytes"):
            continue  # a path
        try:
            getattr(MODEL, method)(value)
        except EcmError:
            continue
        except Exception as error:
            pytest.fail(f"Model.{method}({word}): {type(error).__name__}: {error}")


def test_what_is_refused_is_named_with_what_was_expected() -> None:
    with pytest.raises(ecm.InputError, match="seed = 'two': expected a whole number"):
        ecm.compare(MODEL, TABLE, seed="two")  # type: ignore[arg-type]
    with pytest.raises(ecm.InputError, match="poses = a dict: expected an array of numbers"):
        ecm.optimal_design({}, 3)  # type: ignore[arg-type]
    with pytest.raises(ecm.InputError, match="degree = 'three': expected a whole number"):
        ecm.PolynomialModel(degree="three")  # type: ignore[arg-type]
