"""The MuJoCo plugin, built here: wrench at any pose, stable steps, kept energy, states."""

from __future__ import annotations

import copy
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ecm._native import rotation_matrices
from ecm.io.arrays import F
from ecm.models.export.simulators import largest_step
from support.exports import HEAD, fitted, thousand_poses, written
from support.models import with_time
from support.neck import ROOT
from support.programs import ended, need_program

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed (extra robot)")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the scenes `neck` and, with effects of time, `slow`; their plugins are loaded."""
    need_program("g++", "c++")
    folder = tmp_path_factory.mktemp("plugins")
    for name, model in (("neck", fitted("energy6")), ("slow", with_time(fitted("energy4")))):
        written(model, folder, "mujoco", name=name, loop=HEAD)
        built = ended("sh", folder / f"{name}_build.sh", sys.executable)
        assert built.stderr == ""
        mujoco.mj_loadPluginLibrary(built.stdout.strip())
    return folder


def scene(folder: Path, file: str, **settings: Any) -> tuple[Any, Any]:
    """Model and data of a file, without gravity."""
    model = mujoco.MjModel.from_xml_path(str(folder / file))
    model.opt.gravity[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    for key, value in settings.items():
        setattr(model.opt, key, value)
    return model, mujoco.MjData(model)


def quaternions(theta: F) -> F:
    """(N, 4) w, x, y, z of rotation vectors (N, 3)."""
    return np.roll(Rotation.from_rotvec(theta).as_quat(), 1, axis=1)


def passive_force(model: Any, data: Any) -> F:
    """What acts on the joints where they stand."""
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    return np.array(data.qfrc_passive)


def test_the_plugin_is_the_whole_model_at_a_thousand_poses(scenes: Path) -> None:
    poses, base = thousand_poses(), fitted("energy6").base
    wrenches = base.predict(poses)
    model, data = scene(scenes, "neck_free.xml")
    found = np.zeros_like(wrenches)
    for row, pose, turn in zip(found, poses, quaternions(poses[:, 3:]), strict=True):
        data.qpos[:] = [*pose[:3], *turn]
        row[:] = -passive_force(model, data)
    # A free joint has its moment in axes of the body.
    turned = rotation_matrices(np.ascontiguousarray(poses[:, 3:]))
    found[:, 3:] = np.einsum("nij,nj->ni", turned, found[:, 3:])
    error = np.abs(found - wrenches).max(axis=0) / np.abs(wrenches).max(axis=0)
    assert error.max() < 1e-9, error


def test_tendons_and_plugin_together_are_the_whole_model(scenes: Path) -> None:
    model, data = scene(scenes, "neck_plugin.xml")
    base, moved = fitted("energy6").base, np.zeros((2, 3, 6))
    for joints in np.random.default_rng(3).uniform(-1, 1, (50, 6)) * ([0.003] * 3 + [0.3] * 3):
        data.qpos[:] = joints
        found = passive_force(model, data)
        turn, theta = np.zeros(4), np.zeros(3)
        mujoco.mju_mat2Quat(turn, data.site("neck_top").xmat)
        mujoco.mju_quat2Vel(theta, turn, 1.0)
        h = base.predict(np.array([[*data.site("neck_top").xpos, *theta]]))[0]
        mujoco.mj_jacSite(model, data, moved[0], moved[1], model.site("neck_top").id)
        expected = -(moved[0].T @ h[:3] + moved[1].T @ h[3:])
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_a_moving_base_feels_the_opposite_wrench(scenes: Path) -> None:
    text = (scenes / "neck_free.xml").read_text(encoding="utf-8")
    base = '<body name="base"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    text = text.replace('<site name="neck_base"/>', base + '<site name="neck_base"/></body>')
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    pose = thousand_poses()[0]
    h = fitted("energy6").base.predict(pose[None])[0]
    turn = quaternions(np.array([[0.3, -0.8, 0.5]]))[0]
    rotated, place, quaternion = np.zeros(3), np.array([0.2, -0.1, 0.4]), np.zeros(4)
    mujoco.mju_rotVecQuat(rotated, pose[:3], turn)
    mujoco.mju_mulQuat(quaternion, turn, quaternions(pose[None, 3:])[0])
    data.qpos[:] = [*place, *turn, *(place + rotated), *quaternion]
    found = passive_force(model, data)
    force = -found[6:9]
    back = np.zeros(3)
    mujoco.mju_rotVecQuat(back, force, turn * [1, -1, -1, -1])
    np.testing.assert_allclose(back, h[:3], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found[:3], force, rtol=1e-9, atol=1e-9)
    # The base's moment is the platform's and that of the force at its arm, in the base's axes.
    moment = h[3:] + np.cross(pose[:3], h[:3])
    np.testing.assert_allclose(found[3:6], moment, rtol=1e-9, atol=1e-9)


def growth(folder: Path, file: str, step: float) -> float:
    """Largest speed of the last thousand of 4000 steps at rest, over that of the first."""
    model, data = scene(folder, file)
    model.tendon_damping *= step / model.opt.timestep
    model.opt.timestep = step
    largest = [1e-6] * 4
    for i in range(4000):
        mujoco.mj_step(model, data)
        speed = float(np.abs(data.qvel).max())
        if not speed < 1.0:
            return np.inf
        largest[i // 1000] = max(largest[i // 1000], speed)
    return largest[-1] / largest[0]


def test_the_stated_largest_step_is_the_largest_stable_one(scenes: Path) -> None:
    model = fitted("energy6")
    rest = model.rest_pose("a test")
    settings = (model, rest, HEAD.mass_kg, HEAD.inertia_kg_m2)
    limit = largest_step(*settings)  # type: ignore[arg-type]
    assert growth(scenes, "neck_free.xml", 0.97 * limit) < 2.0
    assert growth(scenes, "neck_free.xml", 1.03 * limit) > 100.0
    # With the linear part in the tendons there is no limit near rest.
    stiffness = model.base.stiffness(rest, "generalised")[0]
    assert largest_step(*settings, stiffness) == np.inf  # type: ignore[arg-type]
    assert growth(scenes, "neck_plugin.xml", 20.0 * limit) < 2.0


def test_a_free_body_keeps_its_energy(scenes: Path) -> None:
    model, data = scene(scenes, "neck_free.xml", timestep=5e-5)
    start = np.array([[0.0, 0.004, -0.003, 0.1, 0.15, -0.1]]) + fitted("energy6").rest_pose(
        "a test"
    )
    energy = fitted("energy6").base.model  # type: ignore[attr-defined]
    data.qpos[:] = [*start[0, :3], *quaternions(start[:, 3:])[0]]
    steps = []
    for _ in range(20_000):
        mujoco.mj_step(model, data)
        theta = np.zeros(3)
        mujoco.mju_quat2Vel(theta, data.qpos[3:], 1.0)
        steps.append([*data.qpos[:3], *theta, *data.qvel])
    poses, speeds = np.split(np.array(steps), 2, axis=1)
    moving = 0.5 * speeds**2 @ ([HEAD.mass_kg] * 3 + [HEAD.inertia_kg_m2] * 3)
    total = moving + energy.energy_J(poses)
    least = float(energy.energy_J(fitted("energy6").rest_pose("a test"))[0])
    early, late = total[:4000].mean(), total[-4000:].mean()
    print(f"energy drift in 1 s: {abs(late - early) / (early - least):.2g}")
    assert moving.max() > 0.2 * (early - least)
    assert abs(late - early) < 1e-3 * (early - least)


def test_effects_of_time_live_in_the_state_of_mujoco(scenes: Path) -> None:
    model, data = scene(scenes, "slow_free.xml", timestep=0.01)
    controller = with_time(fitted("energy4")).controller()
    poses = fitted("energy4").rest_pose("a test") + np.cumsum(
        np.random.default_rng(5).normal(size=(60, 6)) * ([2e-4] * 3 + [0.01] * 3), axis=0
    )
    turns = quaternions(poses[:, 3:])
    rotated = rotation_matrices(np.ascontiguousarray(poses[:, 3:]))

    def passive(row: int, at: Any) -> F:
        at.qpos[:], at.qvel[:] = [*poses[row, :3], *turns[row]], 0.0
        mujoco.mj_step(model, at)
        found = -at.qfrc_passive.copy()
        found[3:] = rotated[row] @ found[3:]
        return found

    static = fitted("energy4").base.predict(poses)
    for row in range(40):
        if row == 20:
            saved = copy.copy(data)
            state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
            mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        if row == 0:
            controller.init(poses[0])
        h = controller.step(poses[row], 0.01 * (row > 0))[0]
        np.testing.assert_allclose(passive(row, data), h, rtol=1e-9, atol=1e-9)
    assert np.abs(h - static[39]).max() > 0.05 * np.abs(static[39]).max()
    last = data.qfrc_passive.copy()
    mujoco.mj_resetData(model, data)
    np.testing.assert_allclose(passive(0, data), static[0], rtol=0.05, atol=1e-3)
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    for again in (saved, data):
        for row in range(20, 40):
            passive(row, again)
        np.testing.assert_array_equal(again.qfrc_passive, last)


@pytest.mark.parametrize(
    ("before", "after", "reason"),
    [
        ('value="slow_top"', 'value="nowhere"', "config top"),
        ('value="slow_base"', 'value="nowhere"', "config base"),
        ('integrator="Euler"', 'integrator="RK4"', "RK4"),
        ('<config key="top"', '<config key="age_s" value="old"/><config key="top"', "age_s"),
    ],
)
def test_a_wrong_scene_is_refused(scenes: Path, before: str, after: str, reason: str) -> None:
    text = (scenes / "slow_free.xml").read_text(encoding="utf-8")
    assert before in text
    with pytest.raises((ValueError, mujoco.FatalError), match=reason):
        mujoco.MjData(mujoco.MjModel.from_xml_string(text.replace(before, after)))


def test_the_callback_of_the_page_is_the_model() -> None:
    """The five lines of docs/export.md, run as they stand."""
    page = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
    (lines,) = re.findall(r"```python\n(def passive.*?)```", page, re.DOTALL)
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><freejoint/><inertial pos="0 0 0" mass="1" '
        'diaginertia="1 1 1"/><site name="neck_top"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    names: dict[str, Any] = {"mujoco": mujoco, "np": np, "model": fitted("energy6")}
    try:
        exec(lines, names)
        pose = thousand_poses()[1]
        data.qpos[:] = [*pose[:3], *quaternions(pose[None, 3:])[0]]
        mujoco.mj_forward(model, data)
    finally:
        mujoco.set_mjcb_passive(None)
    h = fitted("energy6").base.predict(pose[None])[0]
    moment = rotation_matrices(np.ascontiguousarray(pose[None, 3:]))[0]
    np.testing.assert_allclose(-data.qfrc_passive[:3], h[:3], rtol=1e-9)
    np.testing.assert_allclose(moment @ -data.qfrc_passive[3:], h[3:], rtol=1e-9, atol=1e-12)
