"""Any columns and any description: each step in Python ends in a result or in a refusal."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import pytest

import ecm
from ecm.effects import Rows, effects_of
from ecm.errors import EcmError
from ecm.io.arrays import rms
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models.export import export_files

LENGTH_M = 0.1
SPAN = dict(zip(POSE, (4e-3, 1e-2, 1e-2, 0.3, 0.3, 0.3), strict=True))
OWN = ("temperature_degC", "sensor_temperature_degC", "dwell_s", "humidity")
INSTRUMENT = {
    "force_sd_N": 0.1, "torque_sd_Nm": 3e-3, "pose_position_sd_m": 1e-5,
    "pose_rotation_sd_rad": 1e-4, "fts_range": [400.0, 200.0, 200.0, 20.0, 20.0, 20.0],
    "fts_resolution": [0.1, 0.05, 0.05, 0.005, 0.005, 0.005],
}  # fmt: skip
BODY = {"radius_m": 0.02, "young_modulus_Pa": 6e5, "poisson_ratio": 0.49}
DESCRIPTIONS = {
    "nothing": {},
    "pressure": {},
    "length": {"mechanism": {"length_m": LENGTH_M}},
    "body": {"mechanism": {"length_m": LENGTH_M} | BODY, "instrument": INSTRUMENT},
    "log": {
        "mechanism": {"length_m": LENGTH_M, "free_length_m": 1.01 * LENGTH_M},
        "file": {"kind": "continuous"},
    },
}
PLANE = ("x_m", "y_m", "theta_z_rad")
CASES = [
    (("x_m",), ("fx_N",), "length"),
    (("x_m",), ("fx_N",), "log"),
    (("y_m",), ("fy_N", "fx_N"), "body"),
    (("theta_z_rad",), ("tau_z_Nm",), "body"),
    (("y_m", "theta_z_rad"), ("fy_N", "tau_z_Nm"), "length"),
    (PLANE, ("fx_N", "fy_N", "tau_z_Nm"), "length"),
    (PLANE, ("fx_N", "fy_N", "tau_z_Nm"), "body"),
    (POSE[:3], WRENCH[:3], "length"),
    (POSE[3:], WRENCH[3:], "body"),
    (POSE, ("fx_N",), "body"),
    (POSE, ("fy_N", "tau_z_Nm"), "body"),
    (POSE, WRENCH[3:], "length"),
    (POSE, WRENCH[:3], "nothing"),
    (POSE, WRENCH, "pressure"),
]


def measured(poses: Sequence[str], wrenches: Sequence[str], description: str) -> Table:
    """Rows of a soft body with an energy in the columns that are there."""
    random = np.random.default_rng(len(poses))
    n = 80
    unit = random.uniform(-1.0, 1.0, (n, 6))
    half = random.normal(size=(6, 6))
    stiff = np.eye(6) * 3.0 + 0.1 * (half + half.T)
    force = (unit @ stiff + unit**3) * np.repeat([10.0, 0.3], 3)
    force *= 1.0 + 0.01 * random.standard_normal((n, 6))
    columns = {name: unit[:, POSE.index(name)] * SPAN[name] for name in poses}
    if "x_m" in columns:
        columns["x_m"] += LENGTH_M
    if description == "pressure":
        columns["pressure_1_Pa"] = random.uniform(1e4, 5e4, n)
        force += 1e-4 * columns["pressure_1_Pa"][:, None] * np.repeat([1.0, 0.03], 3)
    columns |= {name: force[:, WRENCH.index(name)] for name in wrenches}
    columns |= {"time_s": 20.0 * np.arange(n)}
    columns |= dict(zip(OWN, 22.0 + random.uniform(0.0, 8.0, (len(OWN), n)), strict=True))
    return ecm.Table(columns, DESCRIPTIONS[description])


@pytest.mark.parametrize(("poses", "wrenches", "description"), CASES)
def test_each_step_ends_in_a_result_or_a_refusal(
    poses: tuple[str, ...], wrenches: tuple[str, ...], description: str
) -> None:
    table = measured(poses, wrenches, description)
    model = ecm.fit(table, "choose")
    assert str(ecm.check(table))
    assert ecm.compare(model, table).to_dict()
    assert json.dumps(ecm.diagnose(model, table).to_dict())
    assert export_files(model, "c", "any")
    added, refused = 0, list[str]()
    for effect in effects_of(table):
        if effect.kind == "noise" or effect.missing(table) is not None:
            continue
        try:
            with_effect = ecm.refit(model, table, add=effect.id)
        except EcmError as refusal:
            refused.append(str(refusal))
            continue
        added += 1
        if added <= 3:
            assert json.dumps(ecm.diagnose(with_effect, table).to_dict())
    assert added
    assert not [said for said in refused if "of shape" in said]


def test_a_base_of_inputs_is_one_of_six_poses_at_the_inputs_of_each_row() -> None:
    """Also where the sensor was free in some rows, and of some rows of a larger table."""
    table = measured(POSE, WRENCH, "pressure")
    kinds = np.where(np.arange(len(table)) % 20 == 0, "unloaded", "pose")
    table = table.with_columns({"kind": kinds})
    base = ecm.fit(table, "linear").base
    for some in (table, table.subsample(np.arange(0, len(table), 3))):
        rows = Rows(some, base)
        for own in (rows, rows.whole):
            np.testing.assert_allclose(own.of_six.wrench, own.wrench)
            np.testing.assert_allclose(own.of_six.stiffness, own.stiffness[:, :, :6])


def foreign_log(law: str, seed: int) -> Table:
    """A log of one column with a law that no effect of the catalogue has, 60 s at 10 Hz."""
    random = np.random.default_rng(seed)
    time = 0.1 * np.arange(600)
    phases = 2.0 * np.pi * random.random(4)
    waves = np.sin(np.outer(time, 2.0 * np.pi * np.array([0.11, 0.27, 0.053, 0.41])) + phases)
    x = waves @ [1.0, 0.5, 0.8, 0.3]
    x *= 0.02 / np.abs(x).max()
    force = 400.0 * x + 3.0 * np.tan(30.0 * x)
    speed = np.gradient(x, time)
    if law == "power law relaxation":
        kernel = (time + 0.05) ** -0.3
        force += 150.0 * np.convolve(np.diff(x, prepend=x[0]), kernel)[: len(x)]
    elif law == "an orifice":
        force += 8000.0 * speed * np.abs(speed)
    elif law == "a round stop":
        force += 1.2e4 * np.maximum(x - 0.013, 0.0) ** 1.5
    elif law == "a zero that settles":
        force += 0.8 * (1.0 - np.exp(-time / 25.0))
    sd = 0.05
    if law == "noise that grows":
        sd = 0.03 + 0.01 * np.abs(force)
        force += 8.0 * (random.random(600) < 0.01)
    force += sd * random.standard_normal(600)
    instrument = {"force_sd_N": 0.05, "pose_position_sd_m": 2e-5}
    meta = {"instrument": instrument, "file": {"kind": "continuous"}}
    return ecm.Table({"time_s": time, "x_m": x, "fx_N": force}, meta)


@pytest.mark.parametrize(
    "law",
    [
        "power law relaxation",
        "an orifice",
        "a round stop",
        "noise that grows",
        "a zero that settles",
    ],
)
@pytest.mark.parametrize("start", ["cubic", "poly:5"])
def test_what_add_it_says_is_done_until_nothing_is_left_to_add(law: str, start: str) -> None:
    """It ends, takes nothing out of the model, and no step errs more on rows of another day."""
    table, fresh = foreign_log(law, 1), foreign_log(law, 2)
    named: dict[str, object] = {"ecm": ecm, "table": table, "better": ecm.fit(table, start)}
    for _ in range(4):
        model = named["model"] = named["better"]
        assert isinstance(model, ecm.Model)
        found = ecm.diagnose(model, table)
        line = found.summary().add.split("   (")[0]
        if not line.startswith("better = "):
            break
        exec(line, named)
        better = named["better"]
        assert isinstance(better, ecm.Model)
        assert {item.id for item in model.effects} <= {item.id for item in better.effects}
        left = [rms(fresh["fx_N"] - one.predict(fresh)[:, 0]) for one in (model, better)]
        assert left[1] < 1.05 * left[0]
    else:
        raise AssertionError(f"{law}: still to add: {line}")
