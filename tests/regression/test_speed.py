"""Velocities of poses: one rule, wherever they are used."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from ecm import fit_model
from ecm.effects.motion import velocity, velocity_of
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.table import Table, as_table
from ecm.regression.history import rates, speeds
from ecm.regression.rows import Rows


def log(time: F, run: F) -> Table:
    """Samples of a motion along all six coordinates."""
    poses = np.outer(np.sin(time + 3.0 * run), [1e-3, 2e-3, 3e-3, 0.1, 0.2, 0.3])
    columns = dict(zip(POSE, poses.T, strict=True))
    force = np.arange(len(time)) / 1e3
    return as_table(
        columns | {"time_s": time, "run": run, "fx_N": force}, meta={"file": {"kind": "continuous"}}
    )


@pytest.mark.parametrize("twice", [False, True])
def test_all_who_need_velocities_have_the_same(twice: bool) -> None:
    """Also where a stamp stands twice, which gave none to damping of a full table."""
    time, run = np.tile(np.linspace(0.0, 6.0, 601), 2), np.repeat([0.0, 1.0], 601)
    if twice:
        time = np.insert(time, 100, time[100])
        run = np.insert(run, 100, 0.0)
    table = log(time, run)
    expected = np.outer(np.cos(time + 3.0 * run), [1e-3, 2e-3, 3e-3, 0.1, 0.2, 0.3])
    size = np.abs(expected).max(axis=0)
    found = velocity(Rows(table, fit_model(table, "linear", force=True).base))
    assert (np.abs(found - expected) < 6e-3 * size).all()
    each = np.stack([velocity_of(table, name) for name in POSE], axis=1)
    assert np.array_equal(each, found)
    known = speeds(table)
    assert np.array_equal(np.stack([known[f"v_{name}"] for name in POSE], axis=1), found)


def test_two_moments_tell_no_rate() -> None:
    table = log(np.array([0.0, 1.0, 1.0]), np.zeros(3))
    assert np.array_equal(rates(table, table["x_m"]), np.zeros(3))


def test_a_noisy_path_has_its_velocity_over_more_rows() -> None:
    """Of neighbours it is nine parts of noise; where nothing is noisy both are alike."""
    random, time = np.random.default_rng(0), 0.02 * np.arange(2000)
    clean = log(time, np.zeros(2000))
    noisy = clean["z_m"] + 1e-4 * random.standard_normal(2000)
    table = clean.with_columns({"z_m": noisy})
    true = 3e-3 * np.cos(time)
    near, far = (rates(table, noisy, wide) - true for wide in (False, True))
    assert near.std() > 10.0 * far.std()
    assert far.std() < 0.15 * true.std()
    smooth = rates(clean, clean["z_m"], wide=True)
    assert np.array_equal(smooth, rates(clean, clean["z_m"]))


def test_rows_are_freed_when_nothing_asks_for_them() -> None:
    """Rows that kept themselves held the arrays of each step of a fit: 230 MB of a long log."""
    table = log(np.linspace(0.0, 6.0, 101), np.zeros(101))
    base = fit_model(table, "linear").base
    rows = Rows(table, base, quiet=True)
    kept = [weakref.ref(one) for one in (rows, rows.measured, rows.whole, rows.quieted)]
    assert rows.whole is rows.quieted is rows
    assert rows.measured.of_six.stiffness.shape == (101, 1, 6)
    gc.disable()
    try:
        del rows
        assert not any(one() for one in kept)
    finally:
        gc.enable()
