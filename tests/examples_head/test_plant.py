"""The plant: energy of the free head, convergence in the step, and the true neck's memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from neck import USUAL, NeckMemory
from plant import HeadPlant
from robot import HeadSettings, Tendons
from support.head_example import closed_neck, neck_pairs

SETTINGS = HeadSettings()
RELAXATION, HYSTERESIS, TEMPERATURE = USUAL


def energy_J(plant: HeadPlant) -> float:
    """Kinetic, potential and elastic energy of the head."""
    data, model, body = plant.data, plant.model, plant.model.body("head").id
    mujoco.mj_forward(model, data)
    velocity = np.where(np.arange(10) < 4, 0.0, data.qvel)  # that of the head alone
    momentum = np.zeros(10)
    mujoco.mj_mulM(model, data, momentum, velocity)
    weight = -model.body_subtreemass[body] * (model.opt.gravity @ data.subtree_com[body])
    stored = closed_neck().elastic.model.energy_J(plant.pose[None])[0]
    return float(0.5 * velocity @ momentum + weight + stored)


def test_the_free_head_keeps_its_energy_within_a_tenth_of_a_percent_in_a_minute(
    plugin: Path,
) -> None:
    neck = closed_neck()
    plant = HeadPlant(SETTINGS, neck, plugin, free=True)
    lowest = energy_J(plant)
    plant.at(neck.rest + np.array([-0.001, 0.002, -0.003, 0.05, 0.04, 0.08]), np.zeros(4))
    begin = energy_J(plant) - lowest
    for _ in range(3000):  # of the 60,000 of a minute: the drift is even
        plant.step(np.zeros(4))
    assert np.linalg.norm(plant.pose - neck.rest) > 0.01
    assert abs(energy_J(plant) - lowest - begin) < 1e-3 * begin * 3000 / 60000


def test_the_motion_converges_with_the_step(plugin: Path) -> None:
    neck = closed_neck(RELAXATION, HYSTERESIS)

    def after(step_s: float) -> np.ndarray:
        tendons = Tendons(force_noise_N=0.0, friction_N=0.0)
        settings = replace(SETTINGS, plant_step_s=step_s, tendons=tendons)
        plant = HeadPlant(settings, neck, plugin)
        for _ in range(100):
            plant.step(np.array([60.0, 40.0, 30.0, 50.0]))
        return plant.pose.copy()

    exact = after(1.25e-4)
    errors = [np.linalg.norm(after(step) - exact) for step in (1e-3, 5e-4)]
    assert errors[1] < 0.3 * errors[0]
    assert errors[1] < 1e-4 * np.linalg.norm(exact - neck.rest)


def test_the_memory_goes_on_like_that_of_the_rig() -> None:
    neck = closed_neck(RELAXATION, HYSTERESIS)
    time = np.linspace(0.0, 2.0, 41)
    poses = neck.rest + np.sin(3.0 * time)[:, None] * np.array([0.001, 0.004, 0, 0.05, 0, 0.06])
    elastic = neck.elastic.predict(poses)
    memory = NeckMemory(neck)
    stepped = np.stack([memory.step(p, h, 0.05) for p, h in zip(poses, elastic, strict=True)])
    relaxing = RELAXATION.along(poses, elastic, time, np.zeros(len(time), dtype=bool))
    states = HYSTERESIS.states(
        [(poses[:1], False)] + [(poses[i : i + 2], False) for i in range(len(poses) - 1)],
        neck.length_m,
    )
    rest = neck.elastic.stiffness(neck.rest[None])[0]
    assert np.allclose(
        stepped, relaxing + HYSTERESIS.wrench(states, rest, neck.length_m), atol=1e-9
    )
    memory.rest(1e5)
    late = memory.step(poses[-1], elastic[-1], 0.05)
    assert np.allclose(late, HYSTERESIS.wrench(states[-1], rest, neck.length_m), atol=1e-9)


def test_a_warm_neck_is_softer() -> None:
    neck = closed_neck(TEMPERATURE)
    memory = NeckMemory(neck)
    memory.set_temperature(32.0)
    elastic = np.array([10.0, 0, 0, 0, 0, 1.0])
    assert np.allclose(memory.step(neck.rest, elastic, 0.001), -0.0559 * elastic, rtol=0.002)


def test_what_is_hidden_in_a_campaign_is_the_same_neck() -> None:
    neck = closed_neck(RELAXATION, HYSTERESIS, TEMPERATURE)
    hidden = {item.effect: dict(item.shape) for item in neck.hidden()}
    assert hidden["hysteresis"]["size"] == HYSTERESIS.size
    assert hidden["stress_relaxation"]["times_s"] == RELAXATION.times_s


def test_the_neck_of_the_plant_is_the_energy_at_any_pose(plugin: Path) -> None:
    neck = closed_neck()
    plant = HeadPlant(SETTINGS, neck, plugin, free=True)
    for pose in neck_pairs(50, seed=8)[0]:
        plant.at(pose, np.zeros(4))
        axes = plant.data.body("head").xmat.reshape(3, 3)
        force = plant.data.qfrc_passive[4:10]
        wrench = -np.concatenate([force[:3], axes @ force[3:]])
        expected = neck.elastic.predict(pose[None])[0]
        assert np.allclose(wrench, expected, rtol=1e-9, atol=1e-9)
