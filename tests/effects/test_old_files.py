"""Model files that older versions wrote predict the same: each effect, each form, each name."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm._native import seal_model
from ecm.errors import EcmError
from ecm.io.columns import JOINT_SIGNS, JOINTS, POSE, VELOCITY, WRENCH
from ecm.io.table import Table
from ecm.models import load_model
from support.model_documents import at, changed, changes, places

FILES = Path(__file__).parent / "files"
PREDICTIONS = json.loads((FILES / "predictions.json").read_text(encoding="utf-8"))
"""Of each file the rms of each wrench column, and of what each effect adds."""


def rows() -> Table:
    """Sixty rows of all that the effects read; the poses go to and fro."""
    t = np.arange(60.0)
    sizes = np.array([2e-3, 4e-3, 3e-3, 0.05, 0.1, 0.2])
    poses = sizes * np.sin(np.outer(0.3 * t, 1.0 + 0.17 * np.arange(6))) + 0.1 * np.eye(6)[0]
    columns: dict[str, Any] = dict(zip(POSE, poses.T, strict=True)) | dict.fromkeys(WRENCH, t)
    columns |= {name: 0.01 * np.cos(t + j) for j, name in enumerate(VELOCITY)}
    columns |= {name: 0.4 * np.sin(0.1 * t + j) for j, name in enumerate(JOINTS)}
    columns |= {name: np.sign(np.sin(2.0 * t + j)) for j, name in enumerate(JOINT_SIGNS)}
    columns |= {
        "time_s": 5.0 * t, "dwell_s": 2.0 + t % 3.0, "run": (t >= 30.0) * 1.0,
        "temperature_degC": 21.0 + np.sin(t), "sensor_temperature_degC": 22.0 + np.cos(t),
        "leds_visible": 8.0 - t % 4.0, "slider_mm": t % 11.0,
        "kind": np.where(t % 10.0 == 9.0, "unloaded", "pose"),
    }  # fmt: skip
    return Table(columns, {"mechanism": {"length_m": 0.1}})


@pytest.mark.parametrize("name", PREDICTIONS)
def test_a_file_of_an_older_version_predicts_the_same(name: str) -> None:
    document = json.loads((FILES / f"{name}.json").read_text(encoding="utf-8"))
    model, expected = load_model(FILES / f"{name}.json"), PREDICTIONS[name]
    table = rows()
    predicted = model.predict(table)
    rms = np.sqrt((predicted**2).mean(axis=0))
    np.testing.assert_allclose(rms, expected["rms"], rtol=1e-9)
    for place, (item, stored) in enumerate(zip(model.effects, document["effects"], strict=True)):
        others = (*model.effects[:place], *model.effects[place + 1 :])
        added = predicted - replace(model, effects=others).predict(table)
        size = np.sqrt((added**2).mean())
        np.testing.assert_allclose(size, expected["effects"][item.id], rtol=1e-6)
        # What is written again has the same id, shape, names and units.
        again = {p.name: p.unit for p in item.effect.parameters}
        assert again == {key: value["unit"] for key, value in stored["parameters"].items()}
        assert item.effect.shape == stored["shape"]


@pytest.mark.parametrize("name", ["one_angle", "three_columns"])
def test_a_wrong_shape_is_refused_or_predicts(name: str, tmp_path: Path) -> None:
    """Each value of each shape in many wrong ways: a sentence about the file, or a prediction."""
    document = json.loads((FILES / f"{name}.json").read_text(encoding="utf-8"))
    own = {*document["inputs"], *document["outputs"]}
    table = rows().drop(*{*POSE, *WRENCH} - own)
    path, refused, tried = tmp_path / "model.json", 0, 0
    for place, item in enumerate(document["effects"]):
        shapes = [
            changed(item["shape"], key, value)
            for key in places(item["shape"])
            for value in changes(at(item["shape"], key))
        ] + list(changes(item["shape"]))
        for shape in filter(lambda shape: isinstance(shape, dict), shapes):
            effects = [*document["effects"]]
            effects[place] = {**item, "shape": shape}
            tried += 1
            try:
                path.write_text(seal_model(json.dumps({**document, "effects": effects})))
                model = load_model(path)
            except EcmError:
                refused += 1
                continue
            with suppress(EcmError):  # A size out of all bounds: the row is named.
                assert model.predict(table).shape == (60, len(document["outputs"]))
    assert 0.3 * tried < refused < tried
