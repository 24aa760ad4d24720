"""Twenty to sixty poses in any order, each once, of a body of which the length alone is stated.

Laws are written here, by other formulas than those of the catalogue where it has one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ecm.diagnosis import diagnose
from ecm.diagnosis.procedure import find_missing
from ecm.effects import get_effect
from ecm.io.columns import POSE, WRENCH
from ecm.io.se3 import rotation
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from ecm.models.fit import choose_base
from ecm.models.joint_fit import joint_fit
from ecm.models.maps import EnergyTerms
from ecm.regression.noise import Noise
from support.campaigns import INSTRUMENT, NOISE, workspace_poses
from support.stand_in import L, wrench

F = NDArray[np.float64]
FORCES = WRENCH[:3]


def rows(poses: F, measured: F, seed: int, names: tuple[str, ...] = WRENCH, **more: F) -> Table:
    """The table of a user who knows the length, with times at rest and noise."""
    random = np.random.default_rng(seed)
    read = measured + NOISE * random.standard_normal(measured.shape)
    rest = np.exp(random.uniform(np.log(1.5), np.log(45.0), len(poses)))
    columns = dict(zip(POSE, poses.T, strict=True))
    columns |= {name: read[:, WRENCH.index(name)] for name in names}
    columns |= {"dwell_s": rest, "time_s": np.cumsum(rest + 6.0)} | more
    figures = {name: getattr(INSTRUMENT, name) for name in INSTRUMENT.__dataclass_fields__}
    return as_table(columns, meta={"mechanism": {"length_m": L}, "instrument": figures})


def linear(table: Table) -> object:
    return fit_model(table, "linear", force=True)


def answer(table: Table) -> set[str]:
    return {id for members in diagnose(linear(table), table).answer for id in members}


def nearest_first(poses: F) -> F:
    """Poses as a hand takes them, each near the one before."""
    left, order = list(range(1, len(poses))), [0]
    scale = poses.std(axis=0)
    while left:
        away = (((poses[left] - poses[order[-1]]) / scale) ** 2).sum(axis=1)
        order.append(left.pop(int(np.argmin(away))))
    return poses[order]


@pytest.mark.parametrize("seed", [1, 2])
def test_an_offset_of_a_sensor_of_three_axes_is_found(seed: int) -> None:
    """It was the constant term of the model, which no energy has."""
    poses = workspace_poses(50, seed)
    zero = rotation(poses[:, 3:]) @ np.array([0.6, -0.9, 0.7])
    measured = wrench(poses) + np.hstack([zero, np.zeros_like(zero)])
    assert "fts_offset" in answer(rows(poses, measured, seed, FORCES))


def test_nothing_hidden_in_three_forces_is_nothing() -> None:
    poses = workspace_poses(50, 3)
    table = rows(poses, wrench(poses), 3, FORCES)
    assert diagnose(linear(table), table).verdict == "none"


def test_an_effect_whose_forces_follow_from_torques_needs_them() -> None:
    """A base that tilts by the torque: its forces are a guess where only forces are measured."""
    poses = workspace_poses(50, 4)
    table = rows(poses, wrench(poses), 4, FORCES)
    why = {one.id: one for one in diagnose(linear(table), table).not_testable}
    assert "torques" in why["base_compliance"].reason
    assert "tau_x_Nm" in why["base_compliance"].record
    assert "fts_offset" not in why


def test_relaxation_of_poses_held_by_hand_is_named() -> None:
    """A held-out cluster of poses is far from the others: the base errs there by more than it."""
    poses = nearest_first(workspace_poses(32, 5))
    table = rows(poses, wrench(poses), 5)
    lost = np.exp(-((table.column("dwell_s") / 8.0) ** 0.45))[:, None] * wrench(poses)
    relaxed = table.with_columns(
        {name: table.column(name) + 0.08 * lost[:, j] for j, name in enumerate(WRENCH)}
    )
    assert "stress_relaxation" in answer(relaxed)


def test_friction_between_poses_in_any_order_is_testable() -> None:
    poses = workspace_poses(40, 6)
    table = rows(poses, wrench(poses), 6)
    assert get_effect("hysteresis").missing(table) is None
    straight = table.with_columns({"approach": np.full(len(table), "initial")})
    lacking = get_effect("hysteresis").missing(straight)
    assert lacking is not None
    assert lacking.reason == "one approach direction"


def test_ageing_is_testable_where_time_is_in_the_order_of_no_pose_column() -> None:
    poses = workspace_poses(40, 7)
    assert get_effect("ageing").missing(rows(poses, wrench(poses), 7)) is None
    ramp = poses[np.argsort(poses[:, 1])]
    lacking = get_effect("ageing").missing(rows(ramp, wrench(ramp), 7))
    assert lacking is not None
    assert lacking.reason == "no pose was measured again"


def test_what_a_choice_of_the_degree_leaves_out_gets_no_name() -> None:
    """Terms of degree 5 at half the noise: an energy of degree 4 predicts as well without them."""
    poses = workspace_poses(60, 8)
    measured = wrench(poses)
    fitted = EnergyTerms(L, 4).fit(poses, measured)
    further = EnergyTerms(L, 5).regressor(poses, fitted.model.scale)
    found = []
    for seed in range(6):
        random = np.random.default_rng(seed)
        own = further @ random.standard_normal(further.shape[2]) / NOISE
        base = (fitted.columns(poses) / NOISE[:, None]).reshape(own.size, -1)
        left = own.ravel() - base @ np.linalg.lstsq(base, own.ravel(), rcond=None)[0]
        more = (left * 0.5 / np.sqrt((left**2).mean())).reshape(own.shape) * NOISE
        table = rows(poses, fitted.predict(poses) + more, seed)
        found.append(find_missing(linear(table), table).verdict)
    assert found.count("none") >= 5, found


def test_a_fit_whose_full_step_runs_away_takes_a_part_of_it() -> None:
    """Friction that slips, from a value a hundred times too large: half a step is a step."""
    poses = workspace_poses(40, 9)
    table = rows(poses, wrench(poses), 9)
    base = choose_base(linear(table), table)
    effect = get_effect("length_error")
    fit = joint_fit(base, (effect,), table, Noise(source="assumed"), freeze_base=True)
    start = replace(fit.effects[0], values=fit.effects[0].values + 0.02)
    again = joint_fit(base, (start,), table, Noise(source="assumed"), freeze_base=True)
    np.testing.assert_allclose(again.effects[0].values, fit.effects[0].values, atol=1e-6)
