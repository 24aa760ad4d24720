"""One motion of the robot under one controller, and what is measured of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ecm.errors import ComputationError
from ecm.io.arrays import F
from ecm.rig.frames import rotation, rotation_vector, transpose
from ecm.workflow.head.compiled import CompiledController
from ecm.workflow.head.motions import Motion
from ecm.workflow.head.neck_wrench import TrueNeck
from ecm.workflow.head.plant import HeadPlant
from ecm.workflow.head.plugin import NeckPlugin
from ecm.workflow.head.sensing import PoseReadings
from ecm.workflow.head.settings import HeadSettings

_REFERENCE_DEGC = 22.0


@dataclass(frozen=True)
class Record:
    """What happened, at every step of the controller.

    Examples
    --------
    >>> rest = np.array([[0.1, 0, 0, 0, 0, 0]])
    >>> record = Record("rest", rest, rest + [[1e-3, 0, 0, 0, 0, 0]], np.full((1, 4), 30.0),
    ...     np.zeros(1), ((0, 1),))
    >>> round(record.figures().settled_mm, 6)
    1.0
    """

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

    def errors(self) -> tuple[F, F]:
        """Distance in mm and angle in degrees between wanted and reached poses, (N,) each."""
        away = 1e3 * np.linalg.norm(self.reached[:, :3] - self.wanted[:, :3], axis=1)
        turn = transpose(rotation(self.wanted[:, 3:])) @ rotation(self.reached[:, 3:])
        return away, np.degrees(np.linalg.norm(rotation_vector(turn), axis=1))

    def figures(self) -> Figures:
        """Return the numbers of the table."""
        away, turned = self.errors()
        ends = [slice(begin, end) for begin, end in self.holds]
        settled = [self._settled(end) for end in ends]
        change = np.diff(self.forces_N, axis=0)
        return Figures(
            motion=self.motion,
            settled_mm=max((s[0] for s in settled), default=float("nan")),
            settled_deg=max((s[1] for s in settled), default=float("nan")),
            settled_median_mm=float(np.median([s[0] for s in settled]))
            if settled
            else float("nan"),
            settled_median_deg=float(np.median([s[1] for s in settled]))
            if settled
            else float("nan"),
            tracking_mm=float(np.sqrt(np.mean(away**2))),
            tracking_deg=float(np.sqrt(np.mean(turned**2))),
            largest_deg=float(turned.max()),
            overshoot_deg=self._overshoot_deg(),
            least_force_N=float(self.forces_N.min()),
            mean_force_N=float(self.forces_N.mean()),
            effort_N_per_step=float(np.abs(change).mean()) if len(change) else 0.0,
            limited_share=float((self.limited > 0).mean()),
            fallen=self.fallen,
        )

    def _overshoot_deg(self) -> float:
        """Largest turn beyond the end of a way, along it; ways end in the holds."""
        beyond, begin = [], 0
        for _, end in self.holds:
            way = self.wanted[end - 1, 3:] - self.wanted[begin, 3:]
            size = float(np.linalg.norm(way))
            if size > 0.0:
                past = (self.reached[begin:end, 3:] - self.wanted[end - 1, 3:]) @ way / size
                beyond.append(max(0.0, float(past.max())))
            begin = end - 1
        return float(np.degrees(max(beyond))) if beyond else float("nan")

    def _settled(self, part: slice) -> tuple[float, float]:
        """Error of the mean pose over a part, mm and degrees."""
        mean = self.reached[part].mean(axis=0)[None]
        one = Record(self.motion, self.wanted[part][-1:], mean, self.forces_N[:1], np.zeros(1), ())
        away, turned = one.errors()
        return float(away[0]), float(turned[0])


@dataclass(frozen=True)
class Figures:
    """The numbers of one motion.

    Examples
    --------
    >>> Figures("rest").settled_mm
    nan
    """

    motion: str
    settled_mm: float = float("nan")
    """Largest over the holds: distance of the mean pose of the last 0.3 s from the wanted one."""
    settled_deg: float = float("nan")
    settled_median_mm: float = float("nan")
    """Median over the holds."""
    settled_median_deg: float = float("nan")
    tracking_mm: float = float("nan")
    """Root mean square over the whole motion."""
    tracking_deg: float = float("nan")
    largest_deg: float = float("nan")
    """Largest error of the motion: overshoot and lag."""
    overshoot_deg: float = float("nan")
    """Largest angle beyond a set point, along the way to it."""
    least_force_N: float = float("nan")
    mean_force_N: float = float("nan")
    effort_N_per_step: float = float("nan")
    """Mean change of a tendon's force from step to step."""
    limited_share: float = float("nan")
    """Share of steps with a tendon at a limit."""
    fallen: bool = False

    def to_dict(self) -> dict[str, object]:
        """Plain values."""
        return asdict(self)


@dataclass(frozen=True)
class Robot:
    """Plant, controller and sensor that belong together.

    Parameters
    ----------
    settings
        The robot.
    neck
        The true neck.
    library
        The compiled controller.
    knows_the_truth
        Whether the controller is told what the true neck remembers; the model is then its energy.
    more_delay_s
        Delay of the readings that the controller does not expect.
    plugin
        The neck's energy as MuJoCo's plugin, which is faster; None: through Python.
    """

    settings: HeadSettings
    neck: TrueNeck
    library: Path
    knows_the_truth: bool = False
    more_delay_s: float = 0.0
    plugin: NeckPlugin | None = None

    def run(self, motion: Motion, seed: int = 0, plant: HeadPlant | None = None) -> Record:
        """Carry out a motion; a head that falls ends it.

        Parameters
        ----------
        motion
            What is wanted.
        seed
            Of all noise.
        plant
            A plant of these settings, for one that is filmed.
        """
        settings = self.settings
        dt = settings.control.dt_s
        plant = plant or HeadPlant(settings, self.neck, seed=seed, plugin=self.plugin)
        length = self.neck.length_m
        controller = CompiledController(self.library, settings, motion.poses[0], length)
        readings = PoseReadings(settings.sensor, dt, seed, self.more_delay_s)
        thermometer = np.random.default_rng([seed, 13])
        inputs, commands = controller.inputs, controller.commands
        inputs.temperature = _REFERENCE_DEGC
        inputs.pose[:] = motion.poses[0]
        inputs.forces[:] = [settings.tendons.rest_N] * 4
        controller.step()  # the forces that it begins with
        controller.restart(motion.poses[0])
        plant.at(motion.poses[0], commands.copy())
        measured = plant.measured_forces_N()
        reached = np.empty((motion.steps, 6))
        forces = np.empty((motion.steps, 4))
        limited = np.zeros(motion.steps)
        pauses = {step: (length_s, degC) for step, length_s, degC in motion.pauses}
        fallen = False
        for i in range(motion.steps):
            inputs.pause = 0.0
            if i in pauses:
                inputs.pause, temperature = pauses[i]
                plant.memory.rest(inputs.pause)
                plant.memory.set_temperature(temperature)
                inputs.temperature = temperature + 0.05 * thermometer.standard_normal()
            reached[i] = plant.pose
            reading = readings.at(reached[i])
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
            limited[i] = controller.state.limited
            forces[i] = plant.forces_N
            try:
                measured = plant.step(commands, motion.push(i * dt), controller.state.drive)
            except ComputationError:
                fallen = True
                reached[i:], forces[i:], limited[i:] = reached[i], forces[i], 4
                break
        return Record(motion.name, motion.poses, reached, forces, limited, motion.holds, fallen)
