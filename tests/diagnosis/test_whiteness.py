"""Before `none`: periods in time, a stiffness by the hour, neighbours that err alike, memory."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.diagnosis import diagnose
from ecm.diagnosis.left_over import find_pattern
from ecm.diagnosis.preparation import prepare
from ecm.diagnosis.problem import Problem, assemble
from ecm.effects import get_effect
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from ecm.models.fit import choose_base
from support.campaigns import META, NOISE, workspace_poses
from support.neck import columns_of
from support.one_angle import META as ONE_ANGLE
from support.one_angle import cycles, spring
from support.stand_in import wrench


def measured(seed: int, rows: int = 150, change: object = None) -> Table:
    """Rows of the closed form with white noise, and with a change (time, poses, h) -> (N, 6)."""
    poses, random = workspace_poses(rows, seed), np.random.default_rng([seed, 1])
    time = np.cumsum(random.uniform(5.0, 9.0, rows))
    h = wrench(poses)
    if change is not None:
        h = h + change(time, poses, h)  # type: ignore[operator]
    noise = random.standard_normal((rows, 6)) * NOISE
    return as_table(columns_of(poses, h + noise) | {"time_s": time}, meta=META)


def problem_of(table: Table) -> Problem:
    given = fit_model(table, "energy6")
    prepared = prepare(given, table, [get_effect("payload")])
    return assemble(choose_base(given, prepared.table), prepared.table, prepared.effects)


def test_a_period_in_time_is_unknown_with_its_period() -> None:
    hum = measured(
        1, change=lambda t, p, h: np.outer(np.sin(2 * np.pi * t / 47.0), [0, 0.5, 0, 0, 0, 0])
    )
    found = diagnose(fit_model(hum, "energy6"), hum, effects=["payload", "fts_drift"])
    assert found.verdict == "unknown"
    assert "fy follows time_s with period 47" in found.sentence()
    pattern = found.to_dict()["unknown"]["pattern"]
    assert pattern["period"] == pytest.approx(47.0, rel=0.01)
    assert pattern["p"] < 0.01


def test_a_stiffness_by_the_time_of_day() -> None:
    """A share of the wrench that comes and goes six times while it is measured."""
    day = measured(2, change=lambda t, p, h: 0.004 * np.sin(2 * np.pi * t / 170.0)[:, None] * h)
    pattern = find_pattern(problem_of(day))
    assert pattern is not None
    assert pattern.words.startswith("the stiffness follows time_s with period 17")


def test_what_depends_on_the_reading_before() -> None:
    def kept(t: np.ndarray, p: np.ndarray, h: np.ndarray) -> np.ndarray:
        return 0.004 * np.roll(h, 1, axis=0)

    pattern = find_pattern(problem_of(measured(3, change=kept)))
    assert pattern is not None
    assert "of the reading before" in pattern.words


def test_errors_that_the_components_of_a_row_share_are_no_trace_of_the_reading_before() -> None:
    """Six components that err together are one reading, not six."""

    def shared(seed: int) -> Table:
        random = np.random.default_rng([seed, 9])
        return measured(seed, 90, lambda t, p, h: random.standard_normal((len(t), 1)) * 3.0 * NOISE)

    found = [find_pattern(problem_of(shared(seed))) for seed in range(40)]
    assert not [one.words for one in found if one is not None and "reading before" in one.words]


def test_neighbours_in_a_column_that_err_alike() -> None:
    """A saw in the twist: no quadratic shows it."""

    def saw(t: np.ndarray, p: np.ndarray, h: np.ndarray) -> np.ndarray:
        return np.outer(np.sign(np.sin(60.0 * p[:, 3])), 0.8 * NOISE)

    pattern = find_pattern(problem_of(measured(4, rows=300, change=saw)))
    assert pattern is not None
    assert pattern.variable in ("theta_x_rad", "tau_x_Nm")


def test_neighbours_in_speed_that_err_alike() -> None:
    """Visits in a random order, each reached at another speed: a saw in it that no column shows."""

    def saw(t: np.ndarray, p: np.ndarray, h: np.ndarray) -> np.ndarray:
        step = np.diff(p, axis=0, prepend=p[:1]) / np.diff(t, prepend=t[0] - 1.0)[:, None]
        speed = np.sqrt(((step / np.sqrt((step**2).mean(axis=0))) ** 2).sum(axis=1))
        return np.outer(np.sign(np.sin(12.0 * speed)), 0.8 * NOISE)

    problem = problem_of(measured(4, rows=300, change=saw))
    pattern = find_pattern(problem)
    assert pattern is not None
    assert pattern.variable == "speed"
    assert pattern.words == "readings next to each other in speed err alike"


def test_white_noise_has_no_pattern() -> None:
    """At most one of forty, at a level of one in a hundred."""
    alarms = 0
    for seed in range(40):
        problem = problem_of(measured(100 + seed, rows=60))
        alarms += find_pattern(problem) is not None
    assert alarms <= 1


def test_a_stiffness_by_the_hour_is_said_in_place_of_what_imitates_a_part_of_it() -> None:
    """One angle, whose stiffness comes and goes with the time of day."""
    time, angle = cycles()
    torque = spring(angle) * (1.0 + 0.05 * np.sin(2.0 * np.pi * time / 100.0))
    torque = torque + 0.01 * np.random.default_rng(1).standard_normal(len(time))
    table = Table({"theta_z_rad": angle, "tau_z_Nm": torque, "time_s": time}, ONE_ANGLE)
    found = diagnose(fit_model(table, "cubic"), table)
    assert found.family is not None
    assert found.family.driver == "time"
    assert found.effects == ()
    assert "the stiffness follows time_s with period" in found.sentence()


@pytest.mark.parametrize("seed", [1, 3, 5, 7, 9, 11, 13])
def test_a_periodic_motion_does_not_take_the_name_of_damping(seed: int) -> None:
    """Beside a sine any damping is a period in time: it is no more than the effect."""
    time = 0.1 * np.arange(400.0)
    turn = 2.0 * np.pi / 8.0
    angle, speed = 0.4 * np.sin(turn * time), 0.4 * turn * np.cos(turn * time)
    noise = 0.01 * np.random.default_rng(seed).standard_normal(len(time))
    columns = {
        "theta_z_rad": angle,
        "tau_z_Nm": 2.0 * angle + 1.5 * angle**3 + 0.1 * speed + noise,
        "time_s": time,
    }
    instrument = {"torque_sd_Nm": 0.01, "pose_rotation_sd_rad": 1e-6}
    table = Table(columns, {"file": {"kind": "continuous"}, "instrument": instrument})
    found = diagnose(fit_model(table, "cubic"), table)
    assert "viscous_damping" in found.answer[0]
