"""E, nu, a length and the noise that are stated wrongly are said with their values."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.diagnosis import Diagnosis, diagnose
from ecm.diagnosis.procedure import find_missing
from ecm.errors import ComputationError
from ecm.io.arrays import F
from ecm.io.description import Scene
from ecm.io.table import Table, as_table
from ecm.models import Model, PhysicsMap, fit_model
from ecm.models.physics.refit import PhysicsModel
from ecm.models.refit import refuse_worse
from support.campaigns import META, NOISE, workspace_poses
from support.neck import columns_of
from support.stand_in import L, rotation, wrench

EFFECTS = ("base_frame_misalignment", "payload", "fts_frame")


def measured(poses: F, h: F, *, stated: float = 1.0, length_m: float = L) -> Table:
    """Rows with noise, the noise and the length as stated."""
    h = h + np.random.default_rng(8).standard_normal(h.shape) * NOISE
    columns = columns_of(poses, h)
    instrument = {
        "pose_position_sd_m": 1e-9, "pose_rotation_sd_rad": 1e-9,
        "force_sd_N": 0.3 * stated, "torque_sd_Nm": 0.01 * stated,
    }  # fmt: skip
    return as_table(columns, meta={"mechanism": {"length_m": length_m}, "instrument": instrument})


def energy(table: Table) -> Diagnosis:
    return diagnose(fit_model(table, "linear"), table, effects=EFFECTS)


def test_another_modulus_and_poisson_ratio_are_said(neck_physics: PhysicsMap) -> None:
    poses = workspace_poses(60, 7)
    truth = neck_physics.at(young_modulus_Pa=1.7 * 0.65e6, poisson_ratio=0.44)
    found = diagnose(Model(base=neck_physics), measured(poses, truth.predict(poses)))
    assert found.verdict == "none"
    said = next(words for words in found.warnings if "times the stated" in words)
    modulus, nu = re.findall(r"is (\d[\d.]+)", said)
    assert float(modulus) == pytest.approx(1.7, rel=0.01)
    assert float(nu) == pytest.approx(0.44, abs=0.005)
    right = diagnose(
        Model(base=neck_physics), measured(poses, neck_physics.predict(poses)), effects=EFFECTS
    )
    assert not any("times the stated" in words for words in right.warnings)


def test_a_ratio_that_no_poisson_ratio_gives_is_no_effect(neck_physics: PhysicsMap) -> None:
    poses = workspace_poses(60, 7)
    soft, hard = (neck_physics.at(poisson_ratio=nu).predict(poses) for nu in (0.5, 0.42))
    found = diagnose(Model(base=neck_physics), measured(poses, soft + 2.0 * (soft - hard)))
    assert found.answer == ()
    assert "no Poisson's ratio from" in found.sentence()
    assert found.model.answer == "table"


@pytest.mark.parametrize(("repeats", "within"), [(0, 0.1), (20, 0.15)])
@pytest.mark.parametrize("stated", [0.5, 1.0, 2.0])
def test_noise_that_is_stated_wrongly(stated: float, repeats: int, within: float) -> None:
    """The residual tells it, and so do repeats."""
    again = np.r_[np.arange(90 - repeats), np.arange(repeats)]
    poses = workspace_poses(90 - repeats, 7)[again]
    table = measured(poses, wrench(poses), stated=stated).with_columns({"pose_id": again})
    found = energy(table)
    said = [re.search(r"noise is ([\d.]+) times as large", words) for words in found.warnings]
    factors = [float(match[1]) for match in said if match]
    assert found.verdict == "none"
    assert factors == ([] if stated == 1.0 else [pytest.approx(1.0 / stated, rel=within)])


def test_a_base_that_errs_less_at_these_rows_is_no_quieter_noise(neck_physics: PhysicsMap) -> None:
    """Right figures were to be mended: 0.51 times, where the mount's own error filled the rest."""
    family = neck_physics.family
    assert family is not None
    larger = family.error * (1.5 * NOISE / neck_physics.own_error)
    careful = replace(neck_physics, family=replace(family, error=larger))
    careful = careful.with_coefficients(careful.coefficients)
    poses = workspace_poses(90, 7)
    table = measured(poses, careful.predict(poses))
    found = diagnose(Model(base=careful), table, effects=EFFECTS)
    assert not any("mend the figures" in words for words in found.warnings)


def test_few_repeats_and_all_rows_tell_that_the_declared_noise_is_too_large() -> None:
    """Eleven repeats alone are too few; the rest of the rows scatters as little."""
    random = np.random.default_rng(4)
    pose = np.r_[np.arange(45), np.arange(11)]
    angle = random.uniform(-0.4, 0.4, 45)[pose]
    torque = 2.0 * angle + 1.5 * angle**3 + 0.01 * random.standard_normal(56)
    table = as_table(
        {"theta_z_rad": angle, "tau_z_Nm": torque, "pose_id": pose.astype(float)},
        meta={"instrument": {"torque_sd_Nm": 0.02, "pose_rotation_sd_rad": 1e-9}},
    )
    said = " ".join(diagnose(fit_model(table, "cubic"), table).warnings)
    factor = re.search(r"noise is ([\d.]+) times as large as declared", said)
    assert factor is not None
    assert float(factor[1]) == pytest.approx(0.5, rel=0.2)


def test_a_payload_of_less_than_nothing_is_explained() -> None:
    poses = workspace_poses(90, 7)
    h = wrench(poses)
    h[:, 0] -= 3.0
    found = diagnose(fit_model(table := measured(poses, h), "linear"), table, effects=["payload"])
    assert found.answer == (("payload",),)
    assert any("taken off after the sensor's zero" in words for words in found.warnings)
    h[:, 0] += 6.0
    found = diagnose(fit_model(table := measured(poses, h), "linear"), table, effects=["payload"])
    assert not any("taken off" in words for words in found.warnings)


def test_a_drift_between_repeats_is_no_noise_that_is_stated_wrongly() -> None:
    random = np.random.default_rng(0)
    pose = random.permutation(np.repeat(np.arange(30), 2))
    angle, time = np.linspace(-0.4, 0.4, 30)[pose], 20.0 * np.arange(60.0)
    torque = 2.0 * angle + 1.5 * angle**3 + 2e-4 * time + 0.01 * random.standard_normal(60)
    table = as_table(
        {"theta_z_rad": angle, "tau_z_Nm": torque, "time_s": time, "pose_id": pose},
        meta={"instrument": {"torque_sd_Nm": 0.01, "pose_rotation_sd_rad": 1e-6}},
    )
    found = diagnose(fit_model(table, "cubic"), table)
    assert found.answer == (("fts_drift", "growing_load"),)
    assert not any("[instrument]" in words for words in found.warnings)


def test_a_component_that_is_noisier_than_was_assumed_holds_no_structure() -> None:
    """No repeats, no figures: force, torque and pose are assumed, each wrong by its own factor."""
    poses, chances = workspace_poses(60, 7), []
    for seed in range(6):
        random = np.random.default_rng([seed, 5])
        h = wrench(poses) + random.standard_normal((60, 6)) * NOISE * np.array([1, 1, 1, 6, 6, 6])
        columns = columns_of(poses, h)
        columns["time_s"] = 20.0 * np.arange(60.0)
        table = as_table(columns, meta={"mechanism": {"length_m": L}})
        found = find_missing(fit_model(table, "linear"), table, effects=["payload"])
        chances.append(found.gate.p)
    assert sum(p < 0.05 for p in chances) <= 1


@pytest.mark.parametrize("change", ["length", "origin"])
def test_another_length_of_a_stated_body_is_no_other_origin(
    neck_physics: PhysicsMap, change: str
) -> None:
    """At rest both show the same; E and nu of a body of the wrong length fit nothing."""
    poses = workspace_poses(60, 7) + np.r_[0.006, np.zeros(5)]
    body = neck_physics.at(length_m=L + 0.006) if change == "length" else neck_physics
    h = body.predict(poses if change == "length" else workspace_poses(60, 7))
    found = diagnose(Model(base=neck_physics), measured(poses, h), effects=["payload"])
    assert found.answer == ()
    assert found.unknown is not None
    assert found.unknown.misread
    of_length = "the length looks 0.1094 m, stated as 0.1034 m: " in found.sentence()
    of_origin = "positions look measured from a point (6.0, " in found.sentence()
    assert (of_length, of_origin) == (change == "length", change == "origin")
    assert not any("E is" in words for words in found.warnings)


@pytest.mark.parametrize("drift_N", [0.0, 3.0])
@pytest.mark.parametrize("shrunk", ["length", "both"])
def test_sizes_that_are_a_little_off_are_said_with_their_values(
    neck_physics: PhysicsMap, shrunk: str, drift_N: float
) -> None:
    """A body that shrank in its mould: an energy took its place, and nobody was told the sizes.

    Mended sizes come first: a drift beside them is named after that, and so is a diameter that is
    off by less than the drift.
    """
    length, width = 0.97 * L, 0.066 * (0.97 if shrunk == "both" else 1.0)
    poses = workspace_poses(60, 7) - np.r_[0.03 * L, np.zeros(5)]
    h = neck_physics.at(length_m=length, diameter_m=width).predict(poses)
    h[:, 2] += np.linspace(0.0, drift_N, 60)
    table = measured(poses, h).with_columns({"time_s": 20.0 * np.arange(60.0)})
    found = diagnose(Model(base=neck_physics), table)
    assert found.answer == ()
    said = dict(re.findall(r"the (\w+) looks ([\d.]+) m, stated as", found.summary().missing))
    assert float(said["length"]) == pytest.approx(length, rel=2e-3)
    assert ("diameter" in said) == (shrunk == "both" and not drift_N)
    if "diameter" in said:
        assert float(said["diameter"]) == pytest.approx(width, rel=2e-3)


def test_a_fit_of_a_body_of_another_length_is_refused_with_that_length(
    neck_physics: PhysicsMap, tmp_path: Path
) -> None:
    """One of negative modulus, too: its file was saved, and no command could open it again."""
    poses = workspace_poses(60, 7) - np.r_[0.0089, np.zeros(5)]
    table = measured(poses, neck_physics.at(length_m=L - 0.0089).predict(poses))
    said = r"; the length looks 0\.0945 m, stated as 0\.1034 m"
    with pytest.raises(ComputationError, match=said):
        ecm.fit(table, PhysicsModel(base=neck_physics))
    pulls = Model(base=neck_physics.with_coefficients(np.array([-1e4, 0.49])))
    with pytest.raises(ComputationError, match=rf"its modulus is -[\d.]+ times.*{said}"):
        refuse_worse(pulls, table)
    pulls.save(tmp_path / "forced.json")
    ecm.compare(ecm.load_model(tmp_path / "forced.json"), table)


@pytest.mark.parametrize("what", ["positions", "torque"])
def test_an_origin_ten_millimetres_off(what: str) -> None:
    poses = workspace_poses(90, 7)
    h, off = wrench(poses), np.array([0.0, 0.0, 0.01])
    if what == "torque":
        h = np.hstack([h[:, :3], h[:, 3:] - np.cross(off, h[:, :3])])
    else:
        poses = poses + np.r_[off, 0.0, 0.0, 0.0]
    found = energy(measured(poses, h))
    assert found.answer == ()
    assert f"the {what} look" in found.sentence()
    point = re.search(r"point \(([-\d.]+), ([-\d.]+), ([-\d.]+)\) mm", found.sentence())
    assert point is not None
    assert [float(part) for part in point.groups()] == pytest.approx([0.0, 0.0, 10.0], abs=0.3)


@pytest.mark.parametrize("factor", [0.95, 1.0, 1.1])
def test_a_length_that_is_stated_wrongly_shows_in_the_pose_without_force(factor: float) -> None:
    """No stiffness is stated: an energy of the wrong length fits as well as one of the right."""
    poses = workspace_poses(90, 7)
    found = energy(measured(poses, wrench(poses), length_m=factor * L))
    assert found.verdict == "none"
    said = [re.search(r"no force at a length of ([\d.]+) m", words) for words in found.warnings]
    lengths = [float(match[1]) for match in said if match]
    assert lengths == ([] if factor == 1.0 else [pytest.approx(L, rel=0.005)])


@pytest.mark.parametrize("mass_kg", [0.3, -0.3])
def test_a_part_that_is_picked_up_or_dropped_is_a_payload_from_then_on(mass_kg: float) -> None:
    """It was another zero of the sensor from that moment on, which its torques do not follow."""
    poses, hangs = workspace_poses(120, 3), np.arange(120) >= 70
    turned = rotation(poses[:, 3:])
    force = np.broadcast_to([0.0, 0.0, 9.81 * mass_kg], (120, 3))
    weight = np.hstack([force, np.cross(turned @ [0.06, 0.0, 0.02], force)])
    read = wrench(poses) + hangs[:, None] * weight
    read += NOISE * np.random.default_rng(8).standard_normal(poses.shape)
    meta = replace(META, scene=Scene(gravity_m_s2=(0.0, 0.0, -9.81)))
    table = Table(columns_of(poses, read) | {"time_s": 20.0 * np.arange(120.0)}, meta, "picked")
    found = diagnose(fit_model(table, "energy4"), table)
    assert found.answer[0][0] == "payload"
    (payload,) = found.effects
    assert payload.effect.acts_after_s == pytest.approx(1390.0, abs=21.0)
    assert payload.values[0] == pytest.approx(mass_kg, rel=0.05)
    assert not any("payload of" in words for words in found.warnings)
