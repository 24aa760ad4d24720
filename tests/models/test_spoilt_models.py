"""Model files with a right checksum and wrong content: a result that is finite, or an error.

A seeded part of all changes of every kind of model; `model_documents` makes and changes them.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm._native import seal_model
from ecm.errors import EcmError, InputError
from ecm.io.table import Table, as_table
from ecm.models import Model, load_model
from ecm.models.export import export_files
from support.model_documents import Document, at, changed, changes, documents, neck_table, places

CHANGES, EXPORTS = 60, 2
"""Changes of each document that are tried, and how many of those that load are exported."""
KINDS = (
    "polynomial", "one axis", "one angle", "energy", "physics", "family", "rod", "arc", "gp", "mlp",
    "with effects", "refitted",
)  # fmt: skip

all_documents = lru_cache(maxsize=1)(documents)


def resealed(document: Document, folder: Path) -> Path:
    """A model file with this content and the checksum of it."""
    path = folder / "model.json"
    path.write_text(seal_model(json.dumps(document)), encoding="utf-8")
    return path


def poses_of(model: Model) -> Table:
    """A few rows that every such model can be asked at."""
    if len(model.inputs) == 6:
        return neck_table(4, time_s=np.arange(4.0), temperature_degC=20.0 + np.arange(4.0))
    return as_table({name: np.linspace(1e-4, 5e-4, 4) for name in model.inputs})


def calls(model: Model) -> Iterator[tuple[str, Callable[[], Any]]]:
    """What a user asks a model for."""
    table = poses_of(model)
    known = [name for name in model.inputs if table.has(name)]
    poses = np.resize(table.matrix(known).T, (len(model.inputs), len(table))).T.copy()
    yield "predict", lambda: model.predict(poses)
    yield "predict a table", lambda: model.predict(table, skip_untestable=True)
    yield "stiffness", lambda: model.stiffness(poses)
    yield "both", lambda: model.wrench_and_stiffness(poses)
    yield "predict_sd", lambda: model.predict_sd(poses)
    yield "reading_sd", lambda: model.reading_sd(poses)
    yield "stiffness_sd", lambda: model.stiffness_sd(poses)
    yield "leverage", lambda: model.leverage(poses)
    yield "extrapolates", lambda: model.extrapolates(poses)
    yield "report", lambda: str(model) and None
    yield "document", lambda: json.dumps(model.document(), allow_nan=False) and None


def is_finite(value: Any, kind: str) -> bool:
    """Whether numbers are finite; of a rod NaN says that no equilibrium was found at a row."""
    if isinstance(value, tuple):
        return all(is_finite(part, kind) for part in value)
    if not isinstance(value, np.ndarray) or value.dtype.kind != "f":
        return True
    return not np.isinf(value).any() if kind == "rod" else bool(np.isfinite(value).all())


def problem(name: str, kind: str, call: Callable[[], Any]) -> str:
    """What is wrong with the outcome of a call; empty where nothing is."""
    try:
        return "" if is_finite(call(), kind) else f"{name}: not finite"
    except EcmError as error:
        return "" if len(str(error)) > 20 else f"{name}: says nothing: {error}"
    except BaseException as error:
        return f"{name}: {type(error).__name__}: {error}"


def chosen_changes(document: Document, count: int) -> list[tuple[tuple[str | int, ...], Any]]:
    """Some of all changes, the same in every run."""
    every = [(place, value) for place in places(document) for value in changes(at(document, place))]
    return random.Random(31).sample(every, count)


@pytest.mark.parametrize("kind", KINDS)
def test_a_changed_file_ends_in_a_result_or_an_error(kind: str, tmp_path: Path) -> None:
    document = all_documents()[kind]
    problems, loaded = [], 0
    for place, value in chosen_changes(document, CHANGES):
        where = f"{'.'.join(map(str, place))} = {value!r:.60}"
        try:
            path = resealed(changed(document, place, value), tmp_path)
        except EcmError:  # no JSON, or not even what a checksum is made for
            continue
        try:
            model = load_model(path)
        except InputError as error:
            problems += [] if str(path) in str(error) else [f"{where}: no file named: {error}"]
            continue
        except BaseException as error:
            problems.append(f"{where}: load_model: {type(error).__name__}: {error}")
            continue
        asked = list(calls(model))
        loaded += 1
        if loaded <= EXPORTS and document["kind"] in ("polynomial", "energy", "physics"):
            asked.append(("export", lambda model=model: export_files(model, "c") and None))
        found = [problem(name, document["kind"], call) for name, call in asked]
        problems += [f"{where}: {text}" for text in found if text]
    assert problems == []
    assert loaded > 5


def test_every_document_is_tried_and_good_as_it_is(tmp_path: Path) -> None:
    assert set(KINDS) == set(all_documents())
    for document in all_documents().values():
        model = load_model(resealed(document, tmp_path))
        assert [problem(name, document["kind"], call) for name, call in calls(model)] == [""] * 11


@pytest.mark.parametrize(
    ("kind", "place", "value", "says"),
    [
        ("gp", ("parameters", "weights"), [[1.0]], r"parameters.weights: found shape \(1, 1\)"),
        ("gp", ("parameters", "lengths", 0), 0.0, r"lengths\[0\]: found 0.0, expected a number ab"),
        ("mlp", ("parameters", "layers", 1, "matrix"), [[1.0] * 6], r"layers\[1\].matrix: found "),
        ("mlp", ("parameters", "layers"), [], "layers: found .., expected a list of at least 1"),
        ("energy", ("noise", "force_sd_N"), "0.3", "noise.force_sd_N: found '0.3', expected a num"),
        ("rod", ("length_m",), None, "length_m: found None, expected a number above 0"),
        ("family", ("family", "table"), [[1.0]], r"family.table: found shape \(1, 1\), expected"),
        ("one axis", ("domain", "x_m"), [1.0, 0.0], r"domain.'x_m': found .*, expected the small"),
        ("one axis", ("domain",), {"y_m": [0.0, 1.0]}, "domain.x_m: missing"),
        ("refitted", ("history", 0, "train"), "good", r"history\[0\].train: found 'good'"),
        ("polynomial", ("covariance_of_outputs",), None, r"covariance: found shape \(7, 7\), exp"),
        ("with effects", ("effects", 0, "shape", "tau_s"), "x", "shape of effect stress_relaxat"),
    ],
)  # fmt: skip
def test_the_message_names_the_place(
    kind: str, place: tuple[str | int, ...], value: Any, says: str, tmp_path: Path
) -> None:
    path = resealed(changed(all_documents()[kind], place, value), tmp_path)
    with pytest.raises(InputError, match=says):
        load_model(path)
