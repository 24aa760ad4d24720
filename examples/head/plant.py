"""The plant: head, tendons and motors in MuJoCo, the neck as its plugin, and the pose sensor."""

from __future__ import annotations

import math
from collections import deque
from pathlib import Path

import mujoco
import numpy as np

from ecm import ComputationError
from neck import NeckMemory, TrueNeck
from robot import F, HeadSettings, PoseSensor, displaced, tendon_lengths

_SCENE = Path(__file__).with_name("scene.xml")
_REEL_M = 0.05
"""Distance from a guide to its motor."""
_TOO_FAR_RAD = 2.5
"""Rotation of the head at which a simulation is given up."""

_loaded: set[str] = set()
"""MuJoCo takes a plugin once in a process; its name holds the hash of its source."""


class HeadPlant:
    """The robot without its controller; `step` goes on by one period of the control loop.

    Parameters
    ----------
    settings
        Masses, tendons, motors and step of the plant.
    neck
        The true neck.
    plugin
        Its energy as MuJoCo's plugin, as `compiled.build_plugin` returns it.
    seed
        Of the noise of the force sensors.
    free
        Without tendons and damping: the head on the neck alone.
    """

    def __init__(
        self, settings: HeadSettings, neck: TrueNeck, plugin: Path, seed: int = 0, *,
        free: bool = False,
    ) -> None:  # fmt: skip
        self.settings = settings
        tendons = settings.tendons
        self.model = _scene(settings, neck.length_m, plugin)
        self.data = mujoco.MjData(self.model)
        # Views of MuJoCo's arrays: to ask for one costs more than to use it.
        self._qpos, self._applied = self.data.qpos, self.data.qfrc_applied
        self._lengths = self.data.ten_length
        self._elastic, self.memory = neck.elastic, NeckMemory(neck)
        self._k = tendons.stiffness_N_m
        self._slack = tendon_lengths(tendons, neck.rest) + _REEL_M - tendons.rest_N / self._k
        self.model.tendon_lengthspring[:] = np.stack([np.zeros(4), self._slack], axis=1)
        self.model.tendon_stiffness[:] = 0.0 if free else self._k
        stiffness = np.diag(neck.elastic.stiffness(neck.rest[None])[0])
        self.model.dof_damping[:4] = tendons.motor_damping_N_s_m
        self.model.dof_frictionloss[:4] = tendons.friction_N
        self.model.dof_damping[4:] = np.zeros(6) if free else settings.damping_s * stiffness
        self._substeps = max(1, round(settings.control.dt_s / settings.plant_step_s))
        self._random = np.random.default_rng([seed, 7])
        self.pose: F = np.zeros(6)
        """(6,) of the head."""
        self.added_N: F = np.zeros(6)
        """(6,) wrench of the neck beyond its elastic one, of the last step."""
        self._axes = np.zeros(9)
        self.at(neck.rest, np.full(4, tendons.rest_N))

    def at(self, pose: F, forces_N: F) -> None:
        """Put the head at a pose (6,), at rest, with forces (4,) in the tendons."""
        self.data.qvel[:] = 0.0
        self.pose[:] = pose
        lengths = tendon_lengths(self.settings.tendons, pose) + _REEL_M
        self._qpos[:4] = self._slack + forces_N / self._k - lengths
        self._qpos[4:7] = pose[:3]
        angle = float(np.linalg.norm(pose[3:]))
        axis = pose[3:] / angle if angle > 0.0 else np.array([1.0, 0.0, 0.0])
        mujoco.mju_axisAngle2Quat(self._qpos[7:11], axis, angle)
        self._current, self._command = forces_N.copy(), forces_N.copy()
        self._sum, self._error = np.zeros(4), np.zeros(4)
        mujoco.mj_forward(self.model, self.data)

    @property
    def forces_N(self) -> F:
        """(4,) true forces of the tendons."""
        return np.asarray(np.maximum(0.0, self._k * (self._lengths - self._slack)))

    def measured_forces_N(self) -> F:
        """(4,) forces as their sensors read them."""
        noise = self.settings.tendons.force_noise_N * self._random.standard_normal(4)
        return self.forces_N + noise

    def step(self, commands_N: F, push: F | None = None, drive_N: F | float = 0.0) -> F:
        """Go on by one period of the loop; return the tendon forces (4,) as they were measured.

        Parameters
        ----------
        commands_N
            (4,) wanted forces of the tendons.
        push
            (6,) wrench on the head beside all else.
        drive_N
            (4,) what the motors pull beyond the wanted forces, for their own losses.

        Raises
        ------
        ComputationError
            Where the head has fallen.
        """
        tendons, dt = self.settings.tendons, self.settings.control.dt_s
        most = tendons.rate_N_per_s * dt
        self._command += _within(commands_N - self._command, -most, most)
        measured = self.measured_forces_N()
        error = self._command - measured
        self._sum = _within(self._sum + tendons.force_rate_per_s * dt * error, -30.0, 30.0)
        wanted = self._command + tendons.force_gain * error + self._sum + drive_N
        # A stuck motor is pushed to where friction gives way, in the direction of the error.
        self._error += (error - self._error) * dt / tendons.friction_lag_s
        stuck = tendons.friction_share * tendons.friction_N
        wanted += stuck * np.tanh(self._error / tendons.friction_error_N)
        wanted = _within(wanted, 0.0, 2.0 * tendons.most_N)
        elastic = self._elastic.predict(self.pose[None])[0]
        self.added_N = self.memory.step(self.pose, elastic, dt)
        self._apply(-self.added_N if push is None else push - self.added_N)
        share = self.settings.plant_step_s / tendons.current_lag_s
        decay = math.exp(-share)
        mean = (1.0 - decay) / share
        for _ in range(self._substeps):
            self._applied[:4] = wanted + mean * (self._current - wanted)
            self._current = wanted + decay * (self._current - wanted)
            mujoco.mj_step(self.model, self.data)
        self.pose[:3] = self._qpos[4:7]
        turn = self.pose[3:]
        mujoco.mju_quat2Vel(turn, self._qpos[7:11], 1.0)
        if not (turn @ turn < _TOO_FAR_RAD**2 and math.isfinite(self._qpos.sum())):
            raise ComputationError(f"the head has fallen at {self.data.time:.2f} s")
        return measured

    def _apply(self, wrench: F) -> None:
        """Let a wrench (6,) act on the head until the next call, turning with the head."""
        mujoco.mju_quat2Mat(self._axes, self._qpos[7:11])
        self._applied[4:7] = wrench[:3]
        self._applied[7:] = wrench[3:] @ self._axes.reshape(3, 3)


def _scene(settings: HeadSettings, length_m: float, plugin: Path) -> mujoco.MjModel:
    """`scene.xml` with the plugin and the numbers of the robot."""
    if plugin.name not in _loaded:
        mujoco.mj_loadPluginLibrary(str(plugin))
        _loaded.add(plugin.name)
    name = plugin.stem.removeprefix("lib").removesuffix("_plugin")
    text = _SCENE.read_text(encoding="utf-8").replace('"NECK"', f'"ecm.{name}"')
    spec = mujoco.MjSpec.from_string(text)
    body, tendons = settings.body, settings.tendons
    spec.option.timestep, spec.option.gravity = settings.plant_step_s, settings.gravity_m_s2
    head = spec.body("head")
    head.pos, head.mass = [length_m, 0.0, 0.0], body.mass_kg
    head.ipos, head.inertia = body.centre_m, body.inertia_kg_m2
    for i, (guide, anchor) in enumerate(zip(tendons.guides_m, tendons.anchors_m, strict=True)):
        spec.site(f"guide_{i}").pos, spec.site(f"anchor_{i}").pos = guide, anchor
        motor = spec.body(f"motor_{i}")
        motor.pos, motor.mass = guide - [_REEL_M, 0.0, 0.0], tendons.motor_mass_kg
    return spec.compile()


def _within(values: F, low: float, high: float) -> F:
    """Clip without the checks of `np.clip`, which cost more than the rest of a step's motors."""
    return np.asarray(np.minimum(np.maximum(values, low), high))


class PoseReadings:
    """What the controller sees of the pose: readings at a rate, late, with noise.

    `at` is called once per step of the controller.
    """

    def __init__(
        self, sensor: PoseSensor, dt_s: float, seed: int, more_delay_s: float = 0.0
    ) -> None:
        self._random = np.random.default_rng([seed, 11])
        self._period = 1.0 / (sensor.rate_Hz * dt_s)
        self._scale = np.repeat([sensor.noise_m, sensor.noise_rad], 3)
        constant = np.repeat([sensor.constant_m, sensor.constant_rad], 3)
        self._constant = constant * self._random.standard_normal(6)
        delay = round((sensor.delay_s + more_delay_s) / dt_s)
        self._late: deque[F] = deque(maxlen=delay + 1)
        self._steps = 0

    def at(self, pose: F) -> F | None:
        """Return the reading (6,) that arrives while the head is at a pose (6,), or None."""
        self._late.append(pose.copy())
        before, self._steps = self._steps, self._steps + 1
        fresh = int(self._steps / self._period) > int(before / self._period)
        if not fresh or len(self._late) < (self._late.maxlen or 0):
            return None
        noise = self._scale * self._random.standard_normal(6)
        return displaced(self._late[0], self._constant + noise)
