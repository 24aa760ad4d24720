"""The plant: head, tendons and motors in MuJoCo, the true neck's wrench between base and head."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ecm.errors import ComputationError
from ecm.io.arrays import F
from ecm.io.extras import require
from ecm.workflow.head.neck_wrench import TrueNeck
from ecm.workflow.head.plugin import NeckPlugin
from ecm.workflow.head.scene import scene_text
from ecm.workflow.head.settings import HeadSettings
from ecm.workflow.head.tendons import tendon_lengths

_TOO_FAR_RAD = 2.5
"""Rotation of the head at which a simulation is given up."""


class HeadPlant:
    """The robot without its controller; `step` goes on by one period of the control loop.

    Parameters
    ----------
    settings
        Masses, tendons, motors and step of the plant.
    neck
        The true neck.
    seed
        Of the noise of the force sensors.
    free
        Without tendons and damping: the head on the neck alone.
    plugin
        The neck's energy as MuJoCo's plugin; without it MuJoCo asks Python for the same wrench.
    """

    def __init__(
        self,
        settings: HeadSettings,
        neck: TrueNeck,
        *,
        seed: int = 0,
        free: bool = False,
        plugin: NeckPlugin | None = None,
    ) -> None:
        self.library: Any = require("mujoco", "robot", "The head")
        self.settings = settings
        if plugin is not None:
            plugin.load(self.library)
        scene = scene_text(settings, neck.length_m, plugin.plugin if plugin is not None else "")
        self._passive = None if plugin is not None else self._neck_force
        self.model: Any = self.library.MjModel.from_xml_string(scene)
        self.data: Any = self.library.MjData(self.model)
        # Views of MuJoCo's arrays: to ask for one costs more than to use it.
        self._qpos, self._applied = self.data.qpos, self.data.qfrc_applied
        self._lengths = self.data.ten_length
        self._energy = neck.energy
        self.memory = neck.memory()
        self._rest = neck.rest
        stiffness = np.diag(neck.energy.stiffness(neck.rest[None])[0])
        self.model.dof_damping[4:] = np.zeros(6) if free else settings.damping_s * stiffness
        tendons = settings.tendons
        if free:
            self.model.tendon_stiffness[:] = 0.0
        self._slack = tendon_lengths(tendons, neck.rest) + 0.05 - tendons.rest_N / self._k
        self.model.tendon_lengthspring[:, 1] = self._slack
        self._substeps = max(1, round(settings.control.dt_s / settings.plant_step_s))
        self._random = np.random.default_rng([seed, 7])
        self._pose = np.zeros(6)
        self._axes = np.zeros(9)
        self._stage_pose = np.zeros(6)
        self._added = np.zeros(6)
        self.at(neck.rest)

    @property
    def _k(self) -> float:
        return self.settings.tendons.stiffness_N_m

    def at(self, pose: F, forces_N: F | None = None) -> None:
        """Put the head at a pose (6,), at rest, with forces (4,) in the tendons."""
        forces = np.full(4, self.settings.tendons.rest_N) if forces_N is None else forces_N
        data = self.data
        data.qvel[:] = 0.0
        self._pose[:] = pose
        slides = self._slack + forces / self._k - tendon_lengths(self.settings.tendons, pose) - 0.05
        data.qpos[:4] = slides
        data.qpos[4:7] = pose[:3]
        angle = float(np.linalg.norm(pose[3:]))
        axis = pose[3:] / angle if angle > 0.0 else np.array([1.0, 0.0, 0.0])
        self.library.mju_axisAngle2Quat(data.qpos[7:11], axis, angle)
        self._current = forces.copy()
        self._command = forces.copy()
        self._sum = np.zeros(4)
        self._error = np.zeros(4)
        self.library.mj_forward(self.model, data)

    @property
    def pose(self) -> F:
        """(6,) pose of the head."""
        return np.array(self._pose)

    @property
    def added_N(self) -> F:
        """(6,) wrench of the neck beyond its elastic one, of the last step."""
        return self._added

    @property
    def time_s(self) -> float:
        """Time since the plant was made."""
        return float(self.data.time)

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
            (6,) wrench on the head beside all else, base axes about the top frame's origin.
        drive_N
            (4,) what the motors pull beyond the wanted forces, for their own losses.

        Raises
        ------
        ComputationError
            Where the head has fallen.
        """
        settings, data = self.settings, self.data
        tendons, dt = settings.tendons, settings.plant_step_s
        largest = tendons.rate_N_per_s * settings.control.dt_s
        self._command += _within(commands_N - self._command, -largest, largest)
        measured = self.measured_forces_N()
        error = self._command - measured
        more = tendons.force_rate_per_s * settings.control.dt_s * error
        self._sum = _within(self._sum + more, -30.0, 30.0)
        wanted = self._command + tendons.force_gain * error + self._sum + drive_N
        # A stuck motor is pushed to where friction gives way, in the direction of the error.
        self._error += (error - self._error) * settings.control.dt_s / tendons.friction_lag_s
        stuck = tendons.friction_share * tendons.friction_N
        wanted += stuck * np.tanh(self._error / tendons.friction_error_N)
        wanted = _within(wanted, 0.0, 2.0 * tendons.most_N)
        share = dt / tendons.current_lag_s
        decay = math.exp(-share)
        mean = (1.0 - decay) / share
        elastic = self._energy.predict(self._pose[None])[0]
        self._added = self.memory.step(self._pose, elastic, settings.control.dt_s)
        self._apply(-self._added if push is None else push - self._added)
        if self._passive is not None:
            self.library.set_mjcb_passive(self._passive)
        try:
            for _ in range(self._substeps):
                self._applied[:4] = wanted + mean * (self._current - wanted)
                self._current = wanted + decay * (self._current - wanted)
                self.library.mj_step(self.model, data)
        finally:  # it would act in every other model of this process
            if self._passive is not None:
                self.library.set_mjcb_passive(None)
        self._read_pose()
        turn = self._pose[3:]
        healthy = turn @ turn < _TOO_FAR_RAD**2 and math.isfinite(self._qpos.sum())
        if not healthy:
            raise ComputationError(f"the head has fallen at {self.time_s:.2f} s")
        return measured

    def energy_J(self) -> float:
        """Kinetic, potential and elastic energy of the head."""
        data, body = self.data, self.model.body("head").id
        self.library.mj_forward(self.model, data)
        velocity = np.where(np.arange(10) < 4, 0.0, data.qvel)  # that of the head alone
        momentum = np.zeros(10)
        self.library.mj_mulM(self.model, data, momentum, velocity)
        weight = -self.model.body_subtreemass[body] * (
            self.model.opt.gravity @ data.subtree_com[body]
        )
        stored = self._energy.energy_J(self.pose[None])[0]
        return float(0.5 * velocity @ momentum + weight + stored)

    def _neck_force(self, model: Any, data: Any) -> None:
        """Add the neck's wrench on the head, as the plugin does; MuJoCo calls it at each stage."""
        del model
        pose = self._stage_pose
        pose[:3] = data.qpos[4:7]
        self.library.mju_quat2Vel(pose[3:], data.qpos[7:11], 1.0)
        if not np.isfinite(data.qpos).all():
            return  # an exception cannot pass MuJoCo; `step` finds that the head has fallen
        wrench = self._energy.predict(pose[None])[0]
        self.library.mju_quat2Mat(self._axes, data.qpos[7:11])
        data.qfrc_passive[4:7] -= wrench[:3]
        data.qfrc_passive[7:10] -= wrench[3:] @ self._axes.reshape(3, 3)  # in axes of the body

    def _apply(self, wrench: F) -> None:
        """Let a wrench (6,) act on the head until the next call, turning with the head."""
        self.library.mju_quat2Mat(self._axes, self._qpos[7:11])
        self._applied[4:7] = wrench[:3]
        self._applied[7:] = wrench[3:] @ self._axes.reshape(3, 3)

    def _read_pose(self) -> None:
        self._pose[:3] = self._qpos[4:7]
        self.library.mju_quat2Vel(self._pose[3:], self._qpos[7:11], 1.0)


def _within(values: F, low: float, high: float) -> F:
    """Clip without the checks of `np.clip`, which cost more than the rest of a step's motors."""
    return np.asarray(np.minimum(np.maximum(values, low), high))
