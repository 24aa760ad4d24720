"""One motion of the robot under one controller, and what is measured of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from compiled import CompiledController, build_plugin, compile_controller
from ecm import ComputationError, Model
from motions import Motion
from neck import TrueNeck
from plant import HeadPlant, PoseReadings
from robot import F, HeadSettings

_REFERENCE_DEGC = 22.0


@dataclass(frozen=True)
class Record:
    """What happened, at every step of the controller."""

    motion: str
    wanted: F
    """(N, 6) poses."""
    reached: F
    """(N, 6) true poses."""
    forces_N: F
    """(N, 4) true tendon forces."""
    limited: F
    """(N,) tendons at a limit of their command."""
    holds: tuple[tuple[int, int], ...]
    fallen: bool = False

    def figures(self) -> dict[str, float]:
        """Return the numbers of the motion; NaN where it has no hold.

        - settled_mm, settled_deg: largest error over the holds, of the mean pose of their end; with
          _median_ the median of the holds.
        - tracking_mm, tracking_deg: root mean square over the motion; largest_deg: its largest
          error.
        - overshoot_deg: largest turn beyond the end of a way, along it.
        - least_force_N, mean_force_N: of the tendons; effort_N_per_step: mean change of a force
          from step to step; limited_share: share of steps with a tendon at a limit.
        - fallen: whether the head fell.
        """
        away, turned = errors(self.wanted, self.reached)
        ends = [slice(begin, end) for begin, end in self.holds]
        none = np.full((1, 6), np.nan)
        wanted = np.concatenate([self.wanted[end][-1:] for end in ends] or [none])
        mean = np.concatenate([self.reached[end].mean(axis=0)[None] for end in ends] or [none])
        mm, deg = errors(wanted, mean) if ends else (none[:, 0], none[:, 0])
        change = np.abs(np.diff(self.forces_N, axis=0))
        found = {
            "settled_mm": mm.max(), "settled_deg": deg.max(),
            "settled_median_mm": np.median(mm), "settled_median_deg": np.median(deg),
            "tracking_mm": np.sqrt(np.mean(away**2)), "tracking_deg": np.sqrt(np.mean(turned**2)),
            "largest_deg": turned.max(), "overshoot_deg": self._overshoot_deg(),
            "least_force_N": self.forces_N.min(), "mean_force_N": self.forces_N.mean(),
            "effort_N_per_step": change.mean() if len(change) else 0.0,
            "limited_share": (self.limited > 0).mean(),
        }  # fmt: skip
        return {name: float(value) for name, value in found.items()} | {"fallen": self.fallen}

    def _overshoot_deg(self) -> float:
        """Largest turn beyond the end of a way; ways end in the holds."""
        beyond, begin = [], 0
        for _, end in self.holds:
            way = self.wanted[end - 1, 3:] - self.wanted[begin, 3:]
            size = float(np.linalg.norm(way))
            if size > 0.0:
                past = (self.reached[begin:end, 3:] - self.wanted[end - 1, 3:]) @ way / size
                beyond.append(max(0.0, float(past.max())))
            begin = end - 1
        return float(np.degrees(max(beyond))) if beyond else float("nan")


def errors(wanted: F, reached: F) -> tuple[F, F]:
    """Distance in mm and angle in degrees between poses (N, 6), (N,) each."""
    away = 1e3 * np.linalg.norm(reached[:, :3] - wanted[:, :3], axis=1)
    turn = Rotation.from_rotvec(wanted[:, 3:]).inv() * Rotation.from_rotvec(reached[:, 3:])
    return away, np.degrees(turn.magnitude())


@dataclass(frozen=True)
class Robot:
    """Plant, controller and sensor that belong together.

    Parameters
    ----------
    settings
        The robot.
    neck
        The true neck.
    library, plugin
        The compiled controller and neck.
    knows_the_truth
        Whether the controller is told what the true neck remembers; the model is then its energy.
    more_delay_s
        Delay of the readings that the controller does not expect.
    built
        The robot as it is, where it differs from what the controller was told; None: as told.
    """

    settings: HeadSettings
    neck: TrueNeck
    library: Path
    plugin: Path
    knows_the_truth: bool = False
    more_delay_s: float = 0.0
    built: HeadSettings | None = None

    @staticmethod
    def with_model(
        settings: HeadSettings, neck: TrueNeck, model: Model | None, folder: Path
    ) -> Robot:
        """Compile the controller of a model, and the neck, into a folder; None: no model."""
        return Robot(settings, neck, compile_controller(model, folder), build_plugin(neck, folder))

    @staticmethod
    def told_the_truth(settings: HeadSettings, neck: TrueNeck, folder: Path) -> Robot:
        """The robot whose controller has the true energy, and is told what the neck remembers."""
        library = compile_controller(Model(neck.elastic), folder)
        return Robot(settings, neck, library, build_plugin(neck, folder), knows_the_truth=True)

    def controller(self, pose: F) -> CompiledController:
        """Load the controller for a head at rest at a pose (6,)."""
        return CompiledController(self.library, self.settings, pose, self.neck.length_m)

    def run(self, motion: Motion, seed: int = 0) -> Record:
        """Carry out a motion; a head that falls ends it. The seed is that of all noise."""
        settings, dt = self.built or self.settings, self.settings.control.dt_s
        plant = HeadPlant(settings, self.neck, self.plugin, seed)
        controller = self.controller(motion.poses[0])
        readings = PoseReadings(settings.sensor, dt, seed, self.more_delay_s)
        thermometer = np.random.default_rng([seed, 13])
        inputs, begin = controller.inputs, motion.poses[0]
        inputs.temperature = _REFERENCE_DEGC
        inputs.pose[:] = begin
        inputs.forces[:] = [settings.tendons.rest_N] * 4
        controller.step()  # the forces that it begins with
        controller.restart(begin)
        plant.at(begin, controller.commands.copy())
        measured = plant.measured_forces_N()
        n = len(motion.poses)
        reached, forces, limited = np.empty((n, 6)), np.empty((n, 4)), np.zeros(n)
        pauses = {step: (length_s, degC) for step, length_s, degC in motion.pauses}
        fallen = False
        for i in range(n):
            inputs.pause = 0.0
            if i in pauses:
                inputs.pause, temperature = pauses[i]
                plant.memory.rest(inputs.pause)
                plant.memory.set_temperature(temperature)
                inputs.temperature = temperature + 0.05 * thermometer.standard_normal()
            reached[i], forces[i] = plant.pose, plant.forces_N
            reading = readings.at(plant.pose)
            inputs.fresh = int(reading is not None)
            if reading is not None:
                inputs.reading[:] = reading
            inputs.pose[:] = motion.poses[i]
            inputs.twist[:] = motion.twists[i]
            inputs.acceleration[:] = motion.accelerations[i]
            inputs.forces[:] = measured
            if self.knows_the_truth:
                inputs.known[:] = plant.added_N
            controller.step()
            limited[i] = controller.limited
            try:
                measured = plant.step(controller.commands, motion.push(i * dt), controller.drive)
            except ComputationError:
                fallen = True
                reached[i:], forces[i:], limited[i:] = reached[i], forces[i], 4
                break
        return Record(motion.name, motion.poses, reached, forces, limited, motion.holds, fallen)
