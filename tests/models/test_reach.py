"""A TOML as MODEL: the physics is built as wide as the data reach, as for `ecm fit`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.comparison import compare
from ecm.errors import ComputationError
from ecm.io.arrays import F
from ecm.io.cache import Stage
from ecm.io.columns import POSE, WRENCH
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table, as_table
from ecm.models import Model
from ecm.models.layout import plain
from ecm.models.physics import body_fits
from ecm.models.physics.body_fits import Solved
from ecm.models.physics.build import (
    BuildSettings,
    held_by_loads,
    shape_of,
    usual_rotation_rad,
)
from ecm.models.physics.family import PhysicsFamily
from ecm.models.physics.map import PhysicsMap, kept_physics, physics_map
from ecm.models.prediction import predict
from support.campaigns import physics, workspace_poses
from support.meshes import block_mesh
from support.neck import Command, columns_of, saved
from support.stand_in import L

REACH_RAD = 1.1
STIFF = np.diag([2e4, 4e3, 4e3, 4.0, 16.0, 16.0])


def far_table() -> Table:
    """Rows that all turn by more than the physics base is usually built for."""
    poses = workspace_poses(40, 5)
    poses[:, 3:] *= (REACH_RAD / np.linalg.norm(poses[:, 3:], axis=1))[:, None]
    wrenches = physics().predict(poses)
    noise = [0.3, 0.3, 0.3, 0.01, 0.01, 0.01]
    wrenches += noise * np.random.default_rng(0).standard_normal(wrenches.shape)
    return as_table(columns_of(poses, wrenches))


@pytest.mark.parametrize(
    "command",
    [
        ("compare", "body.toml", "d.csv"),
        ("diagnose", "body.toml", "d.csv"),
        ("refit", "body.toml", "d.csv", "--add", "fts_offset", "--out", "m.json"),
        ("predict", "body.toml", "d.csv", "--out", "p.csv"),
    ],
)
def test_the_physics_of_a_toml_is_as_wide_as_the_data(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ecm_command: Command
) -> None:
    """Catches a surrogate of 0.8 rad that is asked beyond without a word."""
    asked: list[float] = []

    def built(*_: Any, poses: F, **__: Any) -> PhysicsMap:
        asked.append(float(np.linalg.norm(poses[:, 3:], axis=1).max()))
        return physics()

    monkeypatch.setattr("ecm.cli.models.physics_map", built)
    monkeypatch.chdir(tmp_path)
    far_table().write("d.csv")
    Path("body.toml").write_text(f"[mechanism]\nlength_m = {L}\n", encoding="utf-8")
    ecm_command(*command).good()
    assert asked == [pytest.approx(REACH_RAD)]


def test_a_wide_family_has_the_poses_that_its_energy_needs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """80 poses cannot hold the 157 terms of degree 8; within 0.88 rad nothing changes."""
    asked: list[BuildSettings] = []

    def built(_: Any, settings: BuildSettings, **__: Any) -> PhysicsFamily:
        asked.append(settings)
        raise ComputationError("stop here")

    monkeypatch.setattr("ecm.models.physics.map.build_family", built)
    monkeypatch.setattr("ecm.models.physics.map.BROUGHT", tmp_path)  # the neck's is there
    for reach in (0.88, 2.3, 3.0):
        with pytest.raises(ComputationError, match="stop here"):
            physics_map(Mechanism(), cache=tmp_path, reach_rad=reach)
    near, far, farthest = asked
    assert near == BuildSettings()
    assert far.poses == 160
    assert 1.1 * far.rotation_limit_rad >= 2.3
    assert farthest == far


def test_a_thick_body_is_solved_where_it_stands() -> None:
    """A rubber mount, 60 mm across and 30 long, gave way in every third pose: FEM took hours."""
    mount = shape_of(Mechanism(builtin="cylinder", length_m=0.03, radius_m=0.03))
    limit = usual_rotation_rad(mount)
    assert limit == pytest.approx(0.4)
    assert usual_rotation_rad(shape_of(Mechanism())) == 0.8
    fem = mount.fem()
    limits = {"rotation_limit_rad": limit, "usual_rad": limit}
    poses = body_fits.spread_poses(fem.rest_stiffness(), 32, seed=20, **limits)
    # Pushed aside by less than its own length, not by twice of it.
    assert np.abs(poses[:, 1:3]).max() < body_fits.LENGTH_M
    assert set(fem.solve_poses(poses).status) == {"solved"}


def test_a_mesh_is_solved_as_far_as_its_poses_reach(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Half of the poses of a thick bushing up to 0.8 rad had no stable state: FEM took 12 h."""
    path = saved(tmp_path / "body.msh", block_mesh())
    own, usual = Mechanism(mesh_file=path, young_modulus_Pa=1e6), 0.565685
    asked: list[float] = []

    def built(_: Any, settings: BuildSettings, **__: Any) -> PhysicsFamily:
        asked.append(settings.rotation_limit_rad)
        raise ComputationError("stop here")

    monkeypatch.setattr("ecm.models.physics.map.build_family", built)
    for reach in (0.0, 0.1, 0.5, 0.85):
        with pytest.raises(ComputationError, match="stop here"):
            physics_map(own, cache=tmp_path, reach_rad=reach)
    assert asked == pytest.approx([usual, 0.4, usual, 0.8])


def test_fit_says_which_poses_the_fem_does_not_reach(
    neck_physics: PhysicsMap,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ecm_command: Command,
) -> None:
    monkeypatch.setattr("ecm.cli.models.physics_map", lambda *_, **__: neck_physics)
    monkeypatch.chdir(tmp_path)
    far_table().write("d.csv")
    Path("body.toml").write_text(f"[mechanism]\nlength_m = {L}\n", encoding="utf-8")
    done = ecm_command("fit", "d.csv", "--model", "body.toml", "--force", "--out", "m.json").good()
    assert "poses turn further than the FEM behind the physics, 0.8" in done.err


def test_a_wide_family_of_other_poses_is_not_taken_from_the_cache(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of the same settings, but of poses that a load does not hold; nor are its finished bodies."""
    keys: list[str] = []

    def built(*_: Any, stage: Stage, **__: Any) -> PhysicsFamily:
        keys.append(stage.key)
        raise ComputationError("stop here")

    monkeypatch.setattr("ecm.models.physics.map.build_family", built)
    for limit in (0.8, 1.2):
        settings = BuildSettings(poses=160, rotation_limit_rad=limit)
        with pytest.raises(ComputationError, match="stop here"):
            physics_map(Mechanism(), cache=tmp_path, settings=settings)
        key = {"version": 4, "shape": shape_of(Mechanism()).key(), "settings": settings}
        before = Stage(tmp_path, "physics-bodies", key).key
        assert (keys[-1] == before) == (limit == 0.8)


def turned_in_place(base: PhysicsMap) -> PhysicsMap:
    """The same of a FEM that has met every shift: only turns are beyond it."""
    assert base.family is not None
    return replace(base, family=replace(base.family, shifts=np.array([-1.0, 1.0, 1.0])))


def test_poses_beyond_the_fem_are_said(neck_physics: PhysicsMap, tmp_path: Path) -> None:
    """`predict` and `compare`; not within the reach, and not by a map of given pairs."""
    assert neck_physics.reach_rad == pytest.approx(0.88, abs=0.02)
    neck_physics = turned_in_place(neck_physics)
    poses = np.tile([0.1, 0.0, 0.0, 0.0, 0.0, 0.8], (3, 1))
    poses[:, 1] = [0.0, 1e-3, 2e-3]
    table = as_table(dict(zip(POSE, poses.T.copy(), strict=True)))
    assert not predict(Model(base=neck_physics), table).warnings
    poses[1:, 5] = [1.3, 1.2]
    far = as_table(dict(zip(POSE, poses.T.copy(), strict=True)))
    (said,) = predict(Model(base=neck_physics), far).warnings
    assert said.startswith("2 of 3 poses turn further than the FEM behind the physics, 0.8")
    assert "reach_rad=1.30" in said
    # Each far row carries the error, the others that of the base.
    predicted = predict(Model(base=neck_physics), far)
    wrenches = neck_physics.predict(poses)
    sd, force = predicted["sd_fy_N"], np.linalg.norm(wrenches[:, :3], axis=1)
    assert sd[0] == pytest.approx(neck_physics.error[1])
    assert sd[1] == pytest.approx(np.hypot(neck_physics.error[1], 0.0096 * force[1]), rel=0.05)
    assert sd[1] / force[1] > sd[2] / force[2]
    both = far.with_columns(dict(zip(WRENCH, wrenches.T.copy(), strict=True)))
    assert said in compare(Model(base=neck_physics), both).warnings
    assert not predict(Model(base=physics()), far).warnings


def test_shifts_beyond_the_fem_are_said_and_their_error_is_in_the_sd() -> None:
    """A neck pulled by 30 mm had a force of the wrong sign, without a word and within 1 N."""
    neck = Mechanism()
    poses = np.tile([0.1034, 0.0, 0.0, 0.0, 0.0, 0.0], (6, 1))
    poses[:, 0] += [-0.008, 0.0, 0.01, 0.015, 0.02, 0.03]
    poses[1, 1] = 0.03
    base = physics_map(neck)
    predicted = predict(Model(base=base), dict(zip(POSE, poses.T.copy(), strict=True)))
    (said,) = predicted.warnings
    assert said.startswith("4 of 6 poses are pulled, pressed or pushed aside further than the FEM")
    truth = neck.fem().solve_poses(poses).wrenches
    error = np.abs(predicted["fx_N"] - truth[:, 0])
    sd = predicted["sd_fx_N"]
    assert (error < 3.0 * sd)[2:].all()
    assert (np.maximum(error, sd)[:2] < 0.01 * np.linalg.norm(truth[:2, :3], axis=1)).all()
    assert base.family is not None
    # A file of before has one scale of all directions, and no shifts.
    before = {key: value for key, value in plain(base.family).items() if key != "shifts"}
    scale = float(base.family.scale[0])
    assert PhysicsFamily.from_dict(before).shifts.tolist() == [-scale, scale, scale]


def test_poses_that_shift_far_ask_for_a_family_of_larger_forces(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Neither near poses do, nor those that no such body reaches, nor turns without positions."""
    asked: list[tuple[tuple[float, ...], str]] = []
    usual = physics_map(Mechanism()).family
    assert usual is not None

    def built(*_: Any, more_force: tuple[float, ...], stage: Stage, **__: Any) -> PhysicsFamily:
        asked.append((more_force, stage.key))
        if more_force[0] > 1.0:
            raise ComputationError("only 17 of 80 poses have a stable state")
        return usual

    monkeypatch.setattr("ecm.models.physics.map.build_family", built)
    poses = np.tile([0.1034, 0.0, 0.0, 0.0, 0.0, 0.0], (40, 1))
    near, aside, far, wrong = poses.copy(), poses.copy(), poses.copy(), poses.copy()
    near[:, 2] = 0.1034 * usual.shifts[2]
    aside[:, 2] = 2.0 * near[:, 2]
    low, high, _ = usual.shifts
    far[:, 0] *= 1.0 + 0.5 * (low + high) - 2.0 * (high - low)
    wrong[:, 0] = 0.0
    turned = np.full((40, 6), [np.nan, np.nan, np.nan, 0.1, 0.0, 0.0])
    for some in (near, wrong, turned, aside, far, aside):
        physics_map(Mechanism(), cache=tmp_path, poses=some)
    assert [force for force, _ in asked] == [(1.0, 1.5**2), (1.5**4, 1.0)]
    assert len({key for _, key in asked}) == 2
    # Of the second, whose states are not stable, compare and diagnose take the usual one as well.
    assert all(kept_physics(Mechanism(), cache=tmp_path, poses=some) for some in (aside, far))
    shifts = [
        body_fits.workspace_poses(STIFF, 100, seed=1, more_force=more)[:, 1:3].std()
        for more in ((1.0, 1.0), (1.0, 2.0))
    ]
    assert shifts[1] > 1.3 * shifts[0]


def test_the_rows_of_a_wide_family_carry_its_error_where_they_turn_far(
    neck_physics: PhysicsMap,
) -> None:
    """1.0 % from 1.6 to 2 rad and 1.5 % beyond were measured; up to 1.2 rad a tenth of that."""
    assert neck_physics.family is not None
    scale = np.array([neck_physics.family.scale[0], 2.3])
    wide = replace(neck_physics, family=replace(neck_physics.family, scale=scale))
    wide = turned_in_place(wide)
    poses = np.tile([0.1, 0.0, 0.0, 0.0, 0.0, 0.0], (4, 1))
    poses[:, 5] = [1.1, 1.7, 2.1, 2.3]
    predicted = predict(Model(base=wide), dict(zip(POSE, poses.T.copy(), strict=True)))
    assert not predicted.warnings
    size = np.linalg.norm(wide.predict(poses)[:, :3], axis=1)
    share = np.sqrt(predicted["sd_fy_N"] ** 2 - wide.error[1] ** 2) / size
    assert share[0] < 1e-9
    assert 0.007 < share[1] < 0.015 < share[2] < share[3] < 0.03


def test_a_wide_family_rests_on_poses_that_loads_hold() -> None:
    """A column that is pushed together beyond its load stays in a clamp, but no load holds it."""
    poses = np.tile([0.1034, 0.0, 0.0, 0.0, 0.0, 0.0], (4, 1))
    stable = np.diag([2e4, 4e3, 4e3, 4.0, 17.0, 17.0])
    stable[1, 5] = stable[5, 1] = -200.0
    stable[2, 4] = stable[4, 2] = 200.0
    buckled = stable.copy()
    buckled[1, 1] = 2000.0  # below 200^2 / 17
    stiffness = np.stack([stable, buckled, stable, stable])
    wrenches = np.zeros((4, 6))
    # An axial moment makes K unsymmetric: it is K_s whose symmetric part counts.
    wrenches[3, 3] = 1.0
    stiffness[3, 4, 5], stiffness[3, 5, 4] = 0.5, -0.5
    solved = Solved(wrenches, stiffness, np.array([True, True, False, True]))
    assert held_by_loads(poses, solved).tolist() == [True, False, False, True]
