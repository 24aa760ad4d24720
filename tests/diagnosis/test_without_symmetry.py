"""A platform on unlike springs is no body of revolution: names are against a general energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ecm.diagnosis import diagnose, find_missing
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.se3 import inverse_left_jacobians
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from ecm.models.selection import choose_model
from support.neck import LENGTH_M, columns_of, neck_columns

L = 0.06
NOISE = np.array([0.02] * 3 + [0.001] * 3)
META = Meta(
    mechanism={"length_m": L},
    instrument=Instrument(
        pose_position_sd_m=1e-6, pose_rotation_sd_rad=2e-5, force_sd_N=0.02, torque_sd_Nm=0.001
    ),
)
REST = np.array([L, 0.0, 0.0])
REGULAR, LEGS = 0, [45, -45, 165, 75, 285, 195]
"""The platform on six alike legs, and where these hold it, in degrees."""


def on_springs(poses: F, seed: int) -> F:
    """(N, 6) wrench on the platform of six springs, whose forces stiffen along their lines."""
    random = np.random.default_rng(seed)
    base, tip = (
        np.c_[random.uniform(*x, 6), random.uniform(-0.03, 0.03, (6, 2))]
        for x in ((-0.01, 0.0), (-0.005, 0.005))
    )
    stiffness, curve = random.uniform(300.0, 3000.0, 6), random.uniform(0.0, 3.0, 6)
    if seed == REGULAR:
        base, tip = (
            radius * np.c_[np.zeros(6), np.cos(np.deg2rad(at)), np.sin(np.deg2rad(at))]
            for radius, at in ((0.05, [12, -12, 132, 108, 252, 228]), (0.03, LEGS))
        )
        stiffness, curve = np.full(6, 2000.0), np.zeros(6)
    free = np.linalg.norm(REST + tip - base, axis=1)
    arms = np.einsum("nij,kj->nki", Rotation.from_rotvec(poses[:, 3:]).as_matrix(), tip)
    along = poses[:, None, :3] + arms - base
    length = np.linalg.norm(along, axis=2)
    strain = length / free - 1.0
    pull = stiffness * free * (strain + curve * strain**3) / length
    forces = pull[:, :, None] * along
    return np.hstack([forces.sum(axis=1), np.cross(arms, forces).sum(axis=1)])


def measured(seed: int, hidden: str = "") -> Table:
    random = np.random.default_rng(1000 + seed)
    poses = random.uniform(-1.0, 1.0, (120, 6)) * [4e-3, 6e-3, 6e-3, 0.12, 0.12, 0.12]
    poses[:, :3] += REST
    time = 30.0 * np.arange(120)
    warm = 22.0 + 4.0 * np.sin(time / 700.0) + random.normal(0.0, 0.5, 120)
    wrench = on_springs(poses, seed)
    if hidden == "temperature_modulus":
        wrench = wrench * (1.0 - 0.012 * (warm - 22.0))[:, None]
    if hidden == "fts_drift":
        wrench = wrench + time[:, None] / time[-1] * [0.0, 0.0, 0.6, 0.0, 0.02, 0.0]
    if hidden == "fts_frame":
        turn = Rotation.from_rotvec(poses[:, 3:])
        turned = turn * Rotation.from_rotvec([0.05, -0.04, 0.03]) * turn.inv()
        wrench = np.hstack([turned.apply(wrench[:, :3]), turned.apply(wrench[:, 3:])])
    columns = columns_of(poses, wrench + random.normal(size=(120, 6)) * NOISE)
    return as_table(columns | {"time_s": time, "temperature_degC": warm}, meta=META)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("hidden", ["", "temperature_modulus", "fts_drift"])
def test_names_are_against_an_energy_without_symmetry(seed: int, hidden: str) -> None:
    table = measured(seed, hidden)
    found = diagnose(fit_model(table, "quadratic"), table)
    assert any("the body is none of revolution" in words for words in found.warnings)
    expected = ("named", ((hidden,),)) if hidden else ("none", ())
    assert (found.verdict, found.answer) == expected, found.sentence()


def test_a_turned_sensor_is_named_and_added_to_an_energy_without_symmetry() -> None:
    """A turn has no potential: by itself this energy is led astray by it, and fits no better."""
    table = measured(REGULAR, "fts_frame")
    found = diagnose(fit_model(table, "quadratic"), table)
    assert len(found.answer) == 1, found.sentence()
    assert "fts_frame" in found.answer[0]
    assert found.addition is not None
    assert found.addition.remedy is not None
    assert "--model energy4-general --add " in found.addition.remedy.command


def test_and_where_three_forces_are_measured() -> None:
    table = measured(1).drop(*WRENCH[3:])
    found = diagnose(fit_model(table, "quadratic"), table)
    assert (found.verdict, found.answer) == ("none", ()), found.sentence()


def test_the_choice_of_a_model_tries_it() -> None:
    assert choose_model(measured(1)).best.name == "energy4-general"


def skewed_bushing(poses: F) -> F:
    """(N, 6) wrench of rubber that locks up along skewed directions, as no symmetric body does.

    Each strain x = a q, or two across the axis together, has the force k x (1 + c x^2/(b^2 + x^2)).
    """
    q = np.hstack([poses[:, :3] - REST, poses[:, 3:]])
    axes = np.eye(6)
    skewed = [
        axes[i] + sign * 0.02 * axes[j] + 0.3 * axes[0]
        for i, j, sign in ((1, 5, -1.0), (2, 4, 1.0))
    ]
    strains = [
        ([axes[0]], 3e5, 1.2, 4e-3),
        ([axes[1] + 0.012 * axes[5], axes[2] - 0.012 * axes[4]], 1.6e5, 2.0, 5e-3),
        ([axes[3]], 9.0, 0.8, 0.15),
        ([axes[4], axes[5]], 25.0, 1.5, 0.12),
        *(([along], 3e4, 1.0, 4e-3) for along in skewed),
    ]
    forces = np.zeros_like(q)
    for directions, k, c, locks in strains:
        a = np.array(directions)
        x = q @ a.T
        square = (x**2).sum(axis=1, keepdims=True)
        forces += k * x * (1.0 + c * square / (locks**2 + square)) @ a
    torque = np.einsum("nji,nj->ni", inverse_left_jacobians(poses[:, 3:]), forces[:, 3:])
    return np.hstack([forces[:, :3], torque])


@pytest.mark.parametrize("hidden", ["", "humidity"])
def test_a_skewed_body_does_not_mix_the_axes_of_the_sensor(hidden: str) -> None:
    """An energy of its degree without symmetry has hundreds of terms; a lower one tells the two."""
    random, rows = np.random.default_rng(2), 160 if hidden else 80
    poses = random.uniform(-1.0, 1.0, (rows, 6)) * [2.5e-3, 5e-3, 5e-3, 0.15, 0.12, 0.12]
    poses[:, :3] += REST
    wrench = skewed_bushing(poses)
    noise = 0.005 * np.array([np.sqrt((w**2).mean()) for w in (wrench[:, :3], wrench[:, 3:])])
    humid = random.uniform(30.0, 60.0, rows)
    if hidden:
        wrench = wrench * (1.0 - 0.005 * (humid - 45.0))[:, None]
    rig = Instrument(
        pose_position_sd_m=1e-5, pose_rotation_sd_rad=1e-4,
        force_sd_N=noise[0], torque_sd_Nm=noise[1],
    )  # fmt: skip
    read = wrench + random.normal(size=(rows, 6)) * np.repeat(noise, 3)
    columns = columns_of(poses, read) | {"time_s": 10.0 * np.arange(rows), "humidity": humid}
    table = as_table(columns, meta=Meta(mechanism={"length_m": L}, instrument=rig))
    found = find_missing(fit_model(table, "energy6-revolution"), table)
    assert (found.verdict, found.answer) == ("unknown", ()), found.answer
    kept = {item.id for item in found.accepted.effects}
    assert kept == {"unused_column:humidity"} if hidden else not found.family


def folded(poses: F) -> F:
    """(N, 6) wrench of a folded column, whose twelve stiffening struts turn it when pressed."""
    at = np.deg2rad(60.0 * np.arange(6))
    ring = 0.03 * np.c_[np.zeros(6), np.cos(at), np.sin(at)]
    tip = Rotation.from_rotvec([np.deg2rad(32.0), 0.0, 0.0]).apply(ring)
    arms = np.einsum("nij,kj->nki", Rotation.from_rotvec(poses[:, 3:]).as_matrix(), tip)
    found = np.hstack([poses[:, :3] - REST, poses[:, 3:]]) * [800.0, 300.0, 300.0, *[0.06] * 3]
    for shift, stiffness in ((0, 9e3), (1, 1.4e4)):
        base = np.roll(ring, -shift, axis=0)
        along = poses[:, None, :3] + arms - base
        length = np.linalg.norm(along, axis=2)
        longer = length - np.linalg.norm(REST + tip - base, axis=1)
        pulls = ((stiffness * longer + 6e8 * longer**3) / length)[:, :, None] * along
        found += np.hstack([pulls.sum(axis=1), np.cross(arms, pulls).sum(axis=1)])
    return found


def test_a_form_without_symmetry_that_leaves_nothing_is_the_answer_to_a_cubic() -> None:
    """It was something that no known effect explains, beside a mixing of the sensor's axes."""
    random = np.random.default_rng(4)
    poses = random.uniform(-1.0, 1.0, (250, 6)) * [3.5e-3, 2e-3, 2e-3, 0.1, 0.06, 0.06]
    poses[:, :3] += REST
    wrench = folded(poses) + random.normal(size=(250, 6)) * 10.0 * NOISE
    noise = Instrument(
        pose_position_sd_m=1e-5, pose_rotation_sd_rad=2e-4, force_sd_N=0.2, torque_sd_Nm=0.01
    )
    meta = Meta(mechanism={"length_m": L}, instrument=noise)
    table = as_table(columns_of(poses, wrench), meta=meta)
    found = diagnose(fit_model(table, "cubic"), table)
    assert (found.verdict, found.model.answer) == ("none", "form"), found.sentence()
    assert found.summary().add == 'better = ecm.fit(table, "energy5-general")'
    assert any(words.endswith("fit energy5-general") for words in found.warnings)


def test_an_energy_that_does_not_foretell_the_rows_hides_no_turned_base() -> None:
    """Its hundreds of terms took the turn in, and erred as much where no row was."""
    random, rows = np.random.default_rng(1), 120
    length = Meta(mechanism={"length_m": LENGTH_M})
    body = fit_model(as_table(neck_columns(300), meta=length), "energy4")
    poses = random.uniform(-1.0, 1.0, (rows, 6)) * [6e-4, 6e-3, 6e-3, 0.12, 0.14, 0.14]
    poses *= np.linspace(0.35, 1.0, rows)[:, None]
    bend = (poses[:, 4:] ** 2).sum(axis=1)
    poses[:, 0] += LENGTH_M
    wrench = body.predict(poses)
    wrench *= (1.0 - 0.12 * np.tanh(np.maximum.accumulate(bend) / 0.01 - bend / 0.01))[:, None]
    turn = Rotation.from_rotvec([0.0, 0.012, 0.03])
    turns = turn * Rotation.from_rotvec(poses[:, 3:])
    poses = np.hstack([turn.apply(poses[:, :3]), turns.as_rotvec()])
    wrench = np.hstack([turn.apply(wrench[:, :3]), turn.apply(wrench[:, 3:])])
    columns = columns_of(poses, wrench + 1.5 * random.normal(size=(rows, 6)) * NOISE)
    meta = replace(META, mechanism=length.mechanism)
    table = as_table(columns | {"time_s": 20.0 * np.arange(rows)}, meta=meta)
    found = diagnose(fit_model(table, "energy4"), table)
    assert "base_frame_misalignment" in {id for members in found.answer for id in members}, found
