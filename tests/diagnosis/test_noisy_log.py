"""A log of six columns whose poses are noisy: that noise is in each row's residual as well."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

import ecm
from ecm.diagnosis.procedure import find_missing
from ecm.effects.relaxation import hereditary
from ecm.io.arrays import F
from support.neck import columns_of
from support.stand_in import L, wrench

ROWS, STEP_S = 1500, 0.05
SD = np.repeat([0.3, 0.01], 3)
POSE_SD = np.repeat([4e-5, 4e-4], 3)


def path(rows: int = ROWS) -> F:
    """(N, 6) a smooth path of all coordinates that grows."""
    turns = rows / 400.0 * np.array([1.0, 1.31, 0.83, 0.57, 1.13, 1.73])
    reach = np.array([0.004, 0.012, 0.012, 0.25, 0.3, 0.3])
    along = np.linspace(0.0, 1.0, rows)
    poses = reach * np.sin(2.0 * np.pi * np.outer(along, turns)) * (0.2 + 0.8 * along)[:, None]
    poses[:, 0] += L
    return poses


def log(seed: int, memory: float = 0.0, more: F | float = 0.0, rows: int = ROWS) -> ecm.Table:
    """The path with noisy poses and wrenches, whose errors forget themselves by `memory` a row."""
    random, true = np.random.default_rng(seed), path(rows)
    shocks = random.standard_normal((rows, 6)) * np.sqrt(1.0 - memory**2)
    shocks[0] /= np.sqrt(1.0 - memory**2)
    loads = wrench(true) + SD * lfilter([1.0], [1.0, -memory], shocks, axis=0) + more
    poses = true + POSE_SD * random.standard_normal((rows, 6))
    figures = ("pose_position_sd_m", "pose_rotation_sd_rad", "force_sd_N", "torque_sd_Nm")
    instrument = dict(zip(figures, (4e-5, 4e-4, 0.3, 0.01), strict=True))
    columns = columns_of(poses, loads) | {"time_s": STEP_S * np.arange(rows)}
    meta = {"file": {"kind": "continuous"}, "mechanism": {"length_m": L}}
    return ecm.Table(columns, meta | {"instrument": instrument})


def found_in(table: ecm.Table) -> ecm.Diagnosis:
    return ecm.diagnose(ecm.fit_model(table, "energy4"), table)


@pytest.mark.parametrize("seed", range(4))
def test_noise_of_the_poses_is_no_way_to_the_pose(seed: int) -> None:
    """A step from the row before holds the noise that the residual holds: six of six were one."""
    table = log(seed)
    assert find_missing(ecm.fit_model(table, "energy4"), table).verdict == "none"


@pytest.mark.parametrize("seed", range(3))
def test_slow_noise_of_some_axes_has_no_cause(seed: int) -> None:
    """The noise of x is that of the pose, which is new in each row; that of the others is slow."""
    table = log(seed, memory=0.95)
    found = find_missing(ecm.fit_model(table, "energy4"), table)
    assert found.verdict == "none"
    slow = found.problem.noise.slow
    assert slow is not None
    assert slow.share[0] < 0.4 < min(slow.share[1:])


@pytest.mark.parametrize("id", ["stress_relaxation", "viscous_damping"])
def test_an_effect_of_the_size_of_slow_noise_is_named(id: str) -> None:
    """Both were `unknown`: the hundred rows that err independently are too few."""
    rows, true = 3000, path(3000)
    speed, loads = np.gradient(true, STEP_S, axis=0), wrench(true)
    steps, keep = np.diff(loads, axis=0, prepend=loads[:1]), np.exp(-STEP_S / 8.0)
    slow = lfilter([1.0], [1.0, -keep], steps, axis=0)
    more = {
        "stress_relaxation": slow * (SD / slow.std(axis=0)).mean(),
        "viscous_damping": SD * speed / np.repeat([speed[:, :3].std(), speed[:, 3:].std()], 3),
    }[id]
    found = found_in(log(1, 0.95, more, rows))
    assert id in found.answer[0]
    if id == "stress_relaxation":
        assert found.effects[0].effect.shape["tau_s"] == pytest.approx(8.0, rel=0.6)


def test_a_relaxation_keeps_its_time_constant() -> None:
    """The memory of two rows is most of the noise of their poses, and explained most."""
    loads, keep = wrench(path()), np.exp(-STEP_S / 3.0)
    slow = lfilter([1.0], [1.0, -keep], np.diff(loads, axis=0, prepend=loads[:1]), axis=0)
    found = found_in(log(0, more=0.15 * slow))
    assert found.answer == (("stress_relaxation",),)
    assert found.effects[0].effect.shape["tau_s"] == pytest.approx(3.0, rel=0.2)


def test_a_memory_does_not_hold_the_noise_of_its_own_row() -> None:
    table, row = log(0), 700
    moved = table.poses.copy()
    moved[row] += POSE_SD
    for both_sides in (True, False):
        before, after = (
            hereditary(table, poses, 0.1, both_sides) for poses in (table.poses, moved)
        )
        assert (before[row] == after[row]).all() == both_sides
        assert (before[row + 2] != after[row + 2]).all()


def test_a_clock_that_repeats_each_time_changes_no_answer() -> None:
    """Accelerations were differences over no time: they overflowed."""
    table = log(0)
    rounded = np.floor(table["time_s"] / (2.0 * STEP_S)) * 2.0 * STEP_S
    assert found_in(table.with_columns({"time_s": rounded})).verdict == "none"


@pytest.mark.parametrize(
    ("size", "said"), [(np.sqrt(2.0) * SD, "the wrench"), (0.02 * (np.arange(6) == 4), "tau_y")]
)
def test_a_period_is_that_of_the_axes_that_have_it(size: F, said: str) -> None:
    """One of six alone explains less than all smooth functions of the pose, all together more."""
    wave = np.sin(2.0 * np.pi * STEP_S * np.arange(ROWS) / 7.3)
    found = found_in(log(1, more=size * wave[:, None]))
    assert found.unknown is not None
    assert found.unknown.pattern is not None
    assert found.unknown.pattern.words.startswith(f"{said} follows time_s with period 7.")


def test_a_comparison_finds_nothing_in_it_and_what_is_there() -> None:
    """The noise of the poses was "a part of it follows the pose": F was 6 for each seed."""
    wave = np.zeros((ROWS, 6))
    wave[:, 1] = 0.3 * np.sin(path()[:, 3] / 0.05)
    clean, hidden = (
        ecm.compare(ecm.fit_model(table, "energy4"), table) for table in (log(0), log(0, more=wave))
    )
    assert not clean.structure.found
    assert "as good as the measurements can show" in str(clean)
    assert hidden.structure.found


@pytest.mark.parametrize("seed", range(3))
def test_noise_of_an_angle_is_no_kink_beside_slow_noise(seed: int) -> None:
    """Where only changes count, the noise of one angle was a kink or a power of seven."""
    random, time = np.random.default_rng(seed), 0.02 * np.arange(2000)
    angle = 0.4 * np.sin(2.0 * np.pi * time / 9.0) * (0.5 + 0.5 * time / time[-1])
    angle += 0.1 * np.sin(2.0 * np.pi * time / 3.7)
    slow = lfilter([1.0], [1.0, -0.9], random.standard_normal(2000) * np.sqrt(0.19))
    columns = {
        "theta_z_rad": angle + 2e-3 * random.standard_normal(2000),
        "tau_z_Nm": 3.0 * angle + 4.0 * angle**3 + 0.02 * slow,
        "time_s": time,
    }
    instrument = {"pose_rotation_sd_rad": 2e-3, "torque_sd_Nm": 0.02}
    table = ecm.Table(columns, {"file": {"kind": "continuous"}, "instrument": instrument})
    found = find_missing(ecm.fit(table, "cubic"), table)
    assert found.answer == ()
    assert found.family is None
    assert found.unknown is None or found.unknown.slow_noise is not None
