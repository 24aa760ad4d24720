"""Continuous tests in closed form: one relaxing branch under ramps and holds."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.diagnosis import diagnose
from ecm.effects import Rows
from ecm.effects.relaxation import StressRelaxation, fading, play
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import FileMeta, Meta
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from ecm.regression.folds import distinct_rows
from support.neck import LENGTH_M

STIFFNESS = 1e4
SHARE, TAU_S = 0.5, 20.0


def ramps(step_N: float = 0.0, start_m: float = 0.0) -> Table:
    """Three runs of a ramp and a hold of 200 s; the force in steps, the displacement from start."""
    columns: dict[str, list[F]] = {"x_m": [], "fx_N": [], "time_s": [], "run": []}
    begins = 0.0
    for run, (way, rate) in enumerate(((4e-3, 1e-4), (4e-3, 4e-4), (6e-3, 2e-4))):
        time = np.arange(0.0, way / rate + 200.0)
        moving = np.minimum(time, way / rate)
        x = rate * moving
        # Closed form of SHARE k int exp(-(t - s) / tau) dx under a ramp that ends.
        grown = SHARE * STIFFNESS * rate * TAU_S * -np.expm1(-moving / TAU_S)
        over = grown * np.exp(-(time - moving) / TAU_S)
        columns["x_m"].append(start_m + x)
        columns["fx_N"].append(STIFFNESS * x + over)
        columns["time_s"].append(begins + time)
        columns["run"].append(np.full(len(time), float(run)))
        begins += float(time[-1]) + 60.0
    whole = {name: np.concatenate(parts) for name, parts in columns.items()}
    whole["fx_N"] += 0.02 * np.random.default_rng(0).standard_normal(len(whole["fx_N"]))
    if step_N > 0.0:
        whole["fx_N"] = np.round(whole["fx_N"] / step_N) * step_N
    return as_table(whole, meta=Meta(file=FileMeta(kind="continuous")))


def test_samples_at_rest_that_read_the_same_are_no_copies() -> None:
    """A hold in coarse steps: only the time differs, and that is what relaxation is seen by."""
    table = ramps(step_N=0.5)
    assert len(distinct_rows(table)) == len(table)
    found = diagnose(fit_model(table, "linear"), table)
    assert not [text for text in found.warnings if "repeat an earlier row" in text]
    assert found.answer == (("stress_relaxation",),)
    assert found.effects[0].effect.shape["tau_s"] == pytest.approx(TAU_S, rel=0.1)


def test_rows_of_a_static_table_that_repeat_to_the_last_digit_are_copies() -> None:
    """Without a clock's samples the same row twice is a copy, whatever else is in it."""
    table = as_table({"x_m": np.array([1.0, 2.0, 1.0]) * 1e-3, "fx_N": np.array([1.0, 2.0, 1.0])})
    assert distinct_rows(table).tolist() == [0, 1]


@pytest.mark.parametrize("start_m", [0.0, 0.05, -0.05])
def test_where_a_displacement_counts_from_is_no_strain(start_m: float) -> None:
    """A pose taken for a strain would let every run begin with a large step."""
    table = ramps(start_m=start_m)
    found = diagnose(fit_model(table, "linear"), table)
    assert found.answer == (("stress_relaxation",),)
    (named,) = found.effects
    assert named.effect.shape["overstress"] == "linear"
    assert named.effect.shape["tau_s"] == pytest.approx(TAU_S, rel=0.05)
    assert named.values[0] == pytest.approx(SHARE, rel=0.05)
    assert found.held_out.after < 0.1 * found.held_out.before


@pytest.mark.parametrize("overstress", ["linear", "elastic"])
@pytest.mark.parametrize("frame", ["", "middle"])
def test_a_log_begins_relaxed_at_its_first_sample(overstress: str, frame: str) -> None:
    """Held from the first sample on nothing relaxes: a load of long standing is no fresh move."""
    meta = Meta(file=FileMeta(kind="continuous"), mechanism={"length_m": LENGTH_M})
    way = np.zeros((40, 6))
    way[:, 0] = -1e-3
    rows = Rows(linear_body(way, meta), fit_model(linear_body(_SPREAD, meta), "poly:1").base)
    assert not StressRelaxation(TAU_S, overstress, frame=frame).columns(rows).any()


_SPREAD = np.random.default_rng(0).uniform(-1e-2, 1e-2, (40, 6))


def linear_body(way: F, meta: Meta) -> Table:
    """A sample a second of a body that is linear in the way from its rest pose."""
    wrenches = way * [2e4, 3e3, 3e3, 4.0, 16.0, 16.0]
    rows = np.hstack([way + np.array([LENGTH_M, 0.0, 0.0, 0.0, 0.0, 0.0]), wrenches])
    columns = dict(zip((*POSE, *WRENCH), rows.T, strict=True))
    return as_table(columns | {"time_s": np.arange(float(len(way)))}, meta=meta)


@pytest.mark.parametrize("rows", [0, 1, 2, 3, 7, 60, 1001])
def test_stretches_give_the_states_of_a_loop_over_the_rows(rows: int) -> None:
    random = np.random.default_rng(rows)
    fades, grown = random.uniform(0.0, 1.0, rows), random.standard_normal((rows, 2))
    loads = np.cumsum(random.standard_normal((rows, 2)), axis=0)
    width = np.array([0.5, 2.0])
    states, sliders = [np.array([1.0, -2.0])], [np.zeros(2)]
    for fade, more, load in zip(fades, grown, loads, strict=True):
        states.append(states[-1] * fade + more)
        sliders.append(np.clip(sliders[-1], load - width, load + width))
    np.testing.assert_allclose(fading(fades, grown, states[0]), states, atol=1e-12)
    np.testing.assert_array_equal(play(loads, width), np.array(sliders[1:]).reshape(rows, 2))
