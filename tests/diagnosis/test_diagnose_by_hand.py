"""Effects that the rig cannot hide, put into tables by formulas other than the fitted ones."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from ecm import _native
from ecm.diagnosis import Diagnosis, diagnose
from ecm.io.arrays import F
from ecm.io.columns import VELOCITY
from ecm.io.se3 import left_jacobian_inverse, rotate, rotation, transpose
from ecm.io.table import Table
from ecm.models import Model, fit_model, surrogate_of
from ecm.models.literature import RodMap
from ecm.regression.history import pose_before
from support import stand_in
from support.campaigns import campaign, found_in, model, workspace_poses
from support.campaigns import with_change as with_wrench
from support.neck import columns_of
from support.stand_in import L

REST: F = np.array([L, 0.0, 0.0, 0.0, 0.0, 0.0])
METRIC: F = np.array([1.0, 1.0, 1.0, L, L, L])


def with_change(table: Table, change: F) -> Table:
    """The table with a change (N, 6) of the wrench wherever the mechanism hangs on the sensor."""
    return with_wrench(table, change * (table.text("kind") != "unloaded")[:, None])


def named(table: Table) -> Diagnosis:
    return diagnose(model(), table)


def ways(table: Table) -> F:
    """(N, 6) pose minus that from which it was approached, zero where unknown."""
    return np.nan_to_num(table.poses - pose_before(table, REST))


# --- material -----------------------------------------------------------------


def test_another_poisson_ratio_is_named() -> None:
    """A Cosserat rod of stiffer shear and torsion, seen from the stated one, whose nu is held."""
    table = campaign("", 1.0, 4)
    stated = np.array([2224.0, 640.0, 0.605, 0.406])
    rod, other = RodMap(L, stated), RodMap(L, stated * [1.0, 1.02, 1.0, 1.02])
    train, test = workspace_poses(150, 1), workspace_poses(40, 2)
    base = surrogate_of(
        train, rod.predict(train), L, test_poses=test, test_wrenches=rod.predict(test),
        mechanism={"length_m": L},
    )  # fmt: skip
    change = other.predict(table.poses) - stand_in.wrench(table.poses)
    diagnosis = diagnose(Model(base=base), with_change(table, change))
    assert found_in(diagnosis, "compressibility"), diagnosis.sentence()
    # A base whose own numbers can do the same says so.
    absorbed = diagnose(fit_model(table, "cubic"), table).not_testable
    reasons = {item.id: item.reason for item in absorbed}
    assert "the base absorbs it" in reasons["compressibility"]


def stretched_length(poses: F) -> F:
    """(N,) length of the cubic between base and top that leaves both along their axes."""
    s = 0.5 * (np.polynomial.legendre.leggauss(12)[0] + 1.0)
    weight = 0.5 * np.polynomial.legendre.leggauss(12)[1]
    axis = rotation(poses[:, 3:])[:, :, 0]
    chord, first = poses[:, :3], np.array([1.0, 0.0, 0.0]) * L
    slope = (
        (6.0 * s * (1.0 - s))[:, None, None] * chord
        + ((1.0 - s) * (1.0 - 3.0 * s))[:, None, None] * first
        + (s * (3.0 * s - 2.0))[:, None, None] * (axis * L)
    )
    return np.asarray(weight @ np.linalg.norm(slope, axis=2))


def pulled(poses: F, tension_N: float) -> F:
    """Wrench of a tension along that curve: the gradient of tension times length."""
    slope = np.zeros_like(poses)
    for j, step in enumerate([1e-6] * 3 + [1e-5] * 3):
        d = step * np.eye(6)[j]
        slope[:, j] = (stretched_length(poses + d) - stretched_length(poses - d)) / (2.0 * step)
    slope[:, 3:] = rotate(transpose(left_jacobian_inverse(poses[:, 3:])), slope[:, 3:])
    return tension_N * slope


def test_a_stretched_mounting_is_named() -> None:
    table = campaign("", 1.0, 4)
    meta = replace(table.meta, mechanism={**table.meta.mechanism, "free_length_m": 0.1032})
    diagnosis = named(with_change(table.with_meta(meta), pulled(table.poses, 3.0)))
    assert found_in(diagnosis, "pretension"), diagnosis.sentence()
    assert diagnosis.effects[0].values[0] == pytest.approx(3.0, rel=0.15)


# --- friction of tendons, damping, mass ----------------------------------------


@pytest.mark.parametrize("run", ["guided", "free"])
def test_friction_along_tendons_is_named(run: str) -> None:
    """It builds up over the way instead of jumping, and grows with the bend, as on a capstan."""
    table = campaign("", 1.0, 4)
    n, random = len(table), np.random.default_rng(4)
    tension = random.uniform(5.0, 25.0, (n, 3))
    side = np.einsum("ni,ni->n", ways(table) * METRIC**2, table.poses - REST)
    side = np.tanh(side / (0.2 * side.std()))
    wrapped = 0.03 + 0.05 * np.linalg.norm(table.poses[:, 4:], axis=1)
    azimuth = 2.0 * np.pi * np.arange(3) / 3.0
    holes = 0.025 * np.stack([np.zeros(3), np.cos(azimuth), np.sin(azimuth)], axis=1)
    turn = rotation(table.poses[:, 3:])
    change = np.zeros((n, 6))
    for j, hole in enumerate(holes):
        lever = np.einsum("nij,j->ni", turn, hole)
        along = turn[:, :, 0]
        if run == "free":
            along = table.poses[:, :3] + lever - hole
            along = along / np.linalg.norm(along, axis=1)[:, None]
        force = -along * (tension[:, j] * np.expm1(wrapped * side))[:, None]
        change += np.concatenate([force, np.cross(lever, force)], axis=1)
    table = table.with_columns({f"tendon{j + 1}_N": tension[:, j] for j in range(3)})
    diagnosis = named(with_change(table, change))
    assert found_in(diagnosis, "tendon_friction"), diagnosis.sentence()
    assert diagnosis.effects[0].effect.shape == {"run": run}


def test_damping_is_named_where_readings_were_taken_on_the_way() -> None:
    """Two speeds of approach, and a damper that thins the faster it is sheared."""
    table = campaign("", 1.0, 4)
    way = ways(table)
    size = np.sqrt(((way * METRIC) ** 2).sum(axis=1))[:, None]
    speed = np.random.default_rng(4).choice([2e-3, 8e-3], len(table))[:, None]
    velocity = way / np.where(size > 1e-9, size, np.inf) * speed
    thinned = (1.0 + speed / 5e-3) ** -0.3
    change = velocity * thinned * ([200.0] * 3 + [0.8] * 3)
    table = table.with_columns(dict(zip(VELOCITY, velocity.T, strict=True)))
    diagnosis = named(with_change(table, change))
    assert found_in(diagnosis, "viscous_damping"), diagnosis.sentence()
    along, about = diagnosis.effects[0].values
    # Thinned by 10 % at the slow speed and by a quarter at the fast one, which counts more.
    assert along == pytest.approx(150.0, rel=0.15)
    assert about == pytest.approx(0.6, rel=0.15)


@lru_cache(maxsize=1)
def swinging() -> tuple[Table, F, F]:
    """400 samples of a continuous test in four runs, and their velocity and acceleration."""
    random = np.random.default_rng(2)
    samples, step = 100, 0.02
    time = np.arange(samples) * step
    values = np.zeros((3, 4, samples, 6))
    for run in range(4):
        for rate in random.uniform(3.0, 14.0, 4):
            phase = random.uniform(0.0, 2.0 * np.pi, 6)
            size = random.uniform(0.3, 1.0, 6) * [5e-4, 4e-3, 4e-3, 0.1, 0.1, 0.1]
            angle = rate * time[:, None] + phase
            values[0, run] += size * np.sin(angle)
            values[1, run] += size * rate * np.cos(angle)
            values[2, run] -= size * rate**2 * np.sin(angle)
    pose, velocity, acceleration = values.reshape(3, -1, 6)
    pose = pose + REST
    wrench = stand_in.wrench(pose)
    wrench += random.standard_normal(wrench.shape) * ([0.3] * 3 + [0.01] * 3)
    columns = columns_of(pose, wrench)
    columns["run"] = np.repeat(np.arange(4.0), samples)
    columns["time_s"] = np.concatenate([time + 10.0 * run for run in range(4)])
    meta = campaign("", 1.0, 4).meta
    meta = replace(meta, file=replace(meta.file, kind="continuous"))
    return Table(columns, meta, "swing"), velocity, acceleration


def swung_mass(table: Table, velocity: F, acceleration: F) -> F:
    """Newton and Euler of a body whose centre is off and whose moments differ by axis."""
    jacobian = _native.left_jacobians(np.ascontiguousarray(table.poses[:, 3:]))
    spin = rotate(jacobian, velocity[:, 3:])
    # d(J theta')/dt by differences over a short step of the path.
    ahead = table.poses[:, 3:] + 1e-6 * velocity[:, 3:]
    later = _native.left_jacobians(np.ascontiguousarray(ahead))
    angular = (
        rotate(jacobian, acceleration[:, 3:]) + rotate(later - jacobian, velocity[:, 3:]) / 1e-6
    )
    turn = rotation(table.poses[:, 3:])
    centre = np.einsum("nij,j->ni", turn, [0.004, 0.001, 0.0])
    inertia = turn @ np.diag([1.3e-3, 1.0e-3, 0.9e-3]) @ transpose(turn)
    force = acceleration[:, :3] + np.cross(angular, centre)
    force = 0.5 * (force + np.cross(spin, np.cross(spin, centre)))
    moment = rotate(inertia, angular) + np.cross(spin, rotate(inertia, spin))
    return np.concatenate([force, moment + np.cross(centre, force)], axis=1)


def test_a_mass_that_swings_is_named_in_a_continuous_test() -> None:
    table, velocity, acceleration = swinging()
    diagnosis = named(with_change(table, swung_mass(table, velocity, acceleration)))
    assert found_in(diagnosis, "inertia"), diagnosis.sentence()
    mass, moment = diagnosis.effects[0].values
    assert mass == pytest.approx(0.5, rel=0.15)
    assert moment == pytest.approx(1.07e-3, rel=0.15)


def test_a_continuous_test_without_a_mass_names_nothing() -> None:
    assert named(swinging()[0]).verdict == "none"
