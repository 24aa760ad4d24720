"""The plugin of `ecm export --to mujoco` as the plant's neck: same wrench, same motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm.errors import ComputationError
from ecm.workflow.head.neck_wrench import HYSTERESIS, RELAXATION
from ecm.workflow.head.plant import HeadPlant
from ecm.workflow.head.plugin import NeckPlugin, build_plugin
from ecm.workflow.head.settings import HeadSettings, Tendons
from support.head import closed_neck, neck_pairs
from support.programs import need_program

mujoco = pytest.importorskip("mujoco")
SETTINGS = HeadSettings(plant_step_s=1e-3, tendons=Tendons(force_noise_N=0.0))


@pytest.fixture(scope="module")
def plugin(tmp_path_factory: pytest.TempPathFactory) -> NeckPlugin:
    need_program("g++", "c++")
    return build_plugin(closed_neck().energy, tmp_path_factory.mktemp("plugin"))


def test_the_plugin_is_the_neck_of_the_plant_at_any_pose(plugin: NeckPlugin) -> None:
    neck = closed_neck()
    plant = HeadPlant(SETTINGS, neck, free=True, plugin=plugin)
    for pose in neck_pairs(50, seed=8)[0]:
        plant.at(pose)
        axes = plant.data.body("head").xmat.reshape(3, 3)
        force = plant.data.qfrc_passive[4:10]
        wrench = -np.concatenate([force[:3], axes @ force[3:]])
        expected = neck.energy.predict(pose[None])[0]
        assert np.allclose(wrench, expected, rtol=1e-9, atol=1e-9)


def test_the_head_moves_alike_on_the_plugin_and_on_the_neck_through_python(
    plugin: NeckPlugin,
) -> None:
    neck = closed_neck(RELAXATION, HYSTERESIS)
    push = np.array([0.0, 0.0, 20.0, 0.0, -1.6, 0.5])

    def motion(with_plugin: NeckPlugin | None) -> np.ndarray:
        plant = HeadPlant(SETTINGS, neck, plugin=with_plugin)
        poses = np.empty((400, 6))
        for i, pose in enumerate(poses):
            plant.step(np.array([60.0, 40.0, 30.0, 50.0]), push if i < 50 else None)
            pose[:] = plant.pose
        return poses

    ours, plain = motion(plugin), motion(None)
    assert np.ptp(plain[:, 5]) > 0.05
    assert np.abs(ours[:, :3] - plain[:, :3]).max() < 1e-9  # m
    assert np.abs(ours[:, 3:] - plain[:, 3:]).max() < 1e-8  # rad


def test_a_plugin_is_built_once_and_a_missing_compiler_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plugin: NeckPlugin
) -> None:
    before = plugin.library.stat().st_mtime_ns
    assert build_plugin(closed_neck().energy, plugin.library.parent) == plugin
    assert plugin.library.stat().st_mtime_ns == before
    monkeypatch.setenv("CXX", "no-such-compiler")
    with monkeypatch.context() as patch:
        patch.setattr(mujoco, "__version__", "of tomorrow")
        with pytest.raises(ComputationError):
            build_plugin(closed_neck().energy, plugin.library.parent)
    with pytest.raises(ComputationError, match="install a C and a C\\+\\+ compiler"):
        build_plugin(closed_neck().energy, tmp_path)
    assert list(tmp_path.iterdir()) == []
    settings = replace(SETTINGS, plant_step_s=5e-4)
    HeadPlant(settings, closed_neck(), plugin=plugin)  # loaded a second time
