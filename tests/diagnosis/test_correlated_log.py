"""A log at a hundred hertz whose noise is slow: its rows are not that many readings."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from scipy.signal import lfilter

import ecm
from ecm.diagnosis.procedure import find_missing
from support.neck import columns_of
from support.stand_in import L, wrench

ROWS, STEP_S = 12000, 0.01


def slow_log(seed: int, correlation_s: float) -> ecm.Table:
    """A cubic spring; noise that forgets itself after some tenths of a second."""
    time = STEP_S * np.arange(ROWS)
    angle = 0.4 * np.sin(2.0 * np.pi * time / 17.0) * (0.6 + 0.4 * np.sin(0.13 * time + 1.0))
    keep = np.exp(-STEP_S / correlation_s)
    shocks = np.random.default_rng(seed).standard_normal(ROWS) * np.sqrt(1.0 - keep**2)
    torque = 2.0 * angle + 1.5 * angle**3 + 0.01 * lfilter([1.0], [1.0, -keep], shocks)
    return ecm.Table(
        {"theta_z_rad": angle, "tau_z_Nm": torque, "time_s": time},
        {
            "file": {"kind": "continuous"},
            "instrument": {"torque_sd_Nm": 0.01, "pose_rotation_sd_rad": 1e-6},
        },
    )


@pytest.mark.parametrize(
    ("seed", "correlation_s"), [(0, 0.3), (1, 0.3), (2, 0.3), (7, 1.0), (1, 3.0)]
)
def test_slow_noise_is_no_effect(seed: int, correlation_s: float) -> None:
    """The log holds it 40 times and more, and it is as large as it was said to be."""
    table = slow_log(seed, correlation_s)
    found = ecm.diagnose(ecm.fit(table, "cubic"), table)
    assert found.answer == ()
    assert found.verdict == "none"


def test_slow_noise_is_said_with_its_time() -> None:
    table = slow_log(7, 1.0)
    found = find_missing(ecm.fit(table, "cubic"), table)
    slow = found.slow_noise
    assert slow is not None
    assert slow.time_s == pytest.approx(1.0, rel=0.3)
    report = ecm.diagnose(ecm.fit(table, "cubic"), table)
    assert slow.sentence() in report.warnings
    # To a comparison it looks like structure: the model lacked "what is too weak to be named".
    assert report.model.answer == "fits"


def test_noise_that_stays_alike_for_much_of_the_log_may_be_an_effect() -> None:
    table = slow_log(1, 12.0)
    found = ecm.diagnose(ecm.fit(table, "cubic"), table)
    assert found.answer == ()
    assert found.unknown is not None
    slow = found.unknown.slow_noise
    assert slow is not None
    assert 1.5 < slow.time_s < 36.0  # what the base takes of it makes it look faster
    assert "or an effect as slow" in found.sentence()
    assert "a pause, or the same motion again" in found.sentence()
    assert found.to_dict()["unknown"]["slow_noise"]["p"] == slow.p


def test_more_than_the_noise_may_be_an_effect() -> None:
    """What stays alike for a while is three times what the sensor was said to scatter."""
    table = slow_log(0, 0.3)
    figures = {"torque_sd_Nm": 0.003, "pose_rotation_sd_rad": 1e-6}
    meta = {"file": {"kind": "continuous"}, "instrument": figures}
    found = ecm.diagnose(ecm.fit(table, "cubic"), ecm.Table(table.columns, meta))
    assert found.answer == ()
    assert found.unknown is not None
    assert found.unknown.slow_noise is not None


def test_rows_of_white_noise_are_as_many_as_before() -> None:
    table = slow_log(0, 1e-4)
    found = find_missing(ecm.fit(table, "cubic"), table)
    assert found.verdict == "none"
    assert len(found.problem.table) == 3000


def six_columns(rows: int, step_s: float, friction_N: float = 0.0) -> ecm.Table:
    """A log of six coordinates at once: no sum of cubics of each is the wrench, but a model is."""
    time, poses = step_s * np.arange(rows), np.zeros((rows, 6))
    random = np.random.default_rng(0)
    for j, size in enumerate((0.001, 0.012, 0.012, 0.25, 0.25, 0.25)):
        for _ in range(3):
            turn, phase = 0.03 + 0.12 * random.random(), 6.0 * random.random()
            poses[:, j] += size / 2.0 * np.sin(2.0 * np.pi * turn * time + phase)
    poses[:, 0] += L
    sd = np.array([0.3] * 3 + [0.01] * 3)
    loads = wrench(poses) + sd * random.standard_normal((rows, 6))
    slip = 0.0
    for i, step in enumerate(np.diff(poses[:, 1], prepend=0.0) / 3e-3):
        slip += step * (1.0 - abs(slip) ** 1.5 * (0.6 * np.sign(step * slip) + 0.4))
        loads[i, 1] += friction_N * slip
    columns = columns_of(poses, loads)
    return ecm.Table(
        columns | {"time_s": time},
        {"file": {"kind": "continuous"}, "mechanism": {"length_m": L}},
    )


def test_what_the_model_explains_is_no_slow_noise() -> None:
    table = six_columns(6000, 0.02)
    found = find_missing(ecm.fit_model(table, "energy4"), table, effects=["fts_offset"])
    assert len(found.problem.table) == 3000


def test_friction_of_one_axis_of_six_is_named() -> None:
    """A bush that slips along y: friction alike along all axes left most, and drag was named."""
    table = six_columns(800, 0.1, friction_N=5.0)
    found = ecm.diagnose(ecm.fit(table, "energy6"), table)
    assert found.answer == (("hysteresis",),)
    assert found.held_out.after < 0.5 * found.held_out.before


@pytest.mark.parametrize("id", ["fts_drift", "kink"])
def test_an_effect_is_still_named_in_slow_noise(id: str) -> None:
    table = slow_log(0, 1.0)
    more = {
        "fts_drift": 0.05 * table["time_s"] / table["time_s"][-1],
        "kink": 0.6 * np.maximum(0.0, table["theta_z_rad"] - 0.15),
    }[id]
    table = table.with_columns({"tau_z_Nm": table["tau_z_Nm"] + more})
    ((members),) = find_missing(ecm.fit(table, "cubic"), table).answer
    assert members[0] == id
    assert len(members) <= 3


def test_any_number_of_cores_gives_the_same_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draws of groups and the grid of slow noise are shared by threads."""
    table = slow_log(2, 1.0).select(np.arange(0, ROWS, 6))
    model, found = ecm.fit(table, "cubic"), set()
    for cores in (1, 3):
        own = set(range(cores))
        monkeypatch.setattr(os, "sched_getaffinity", lambda _, own=own: own, raising=False)
        found.add(json.dumps(ecm.diagnose(model, table).to_dict()))
    assert len(found) == 1
