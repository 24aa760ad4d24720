r"""The paper's procedure as a state machine (its Fig. 7), one trip from home to home.

    impedance -> settle -> position -> rest -> reading -> (next pose, or return -> home)
        \___________________ a safety limit is exceeded ___________________/

Impedance control drives towards the goal and covers part of the distance, since the mechanism is
the stiffer spring along x. When the arm has come to rest, inverse kinematics and joint position
control go to the exact pose. The encoder angles of every step are recorded; the return repeats them
backwards.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from ecm.io.arrays import F
from ecm.io.se3 import displaced
from ecm.rig.arm.mechanism import (
    STEPS_BETWEEN,
    ControllerModel,
    HiddenPhysics,
    NonElasticWrench,
    Surrogate,
)
from ecm.rig.arm.simulation import (
    RANGE_RAD,
    SPEED_RAD_S,
    TORQUE_NM,
    Diverged,
    Impedance,
    Servo,
    Simulation,
    inverse_kinematics,
    joints_at_swivel,
    scene,
    swivel_angle,
)
from ecm.rig.arm.trips import Stop, StopResult, TripResult, cubic_profile, duration_s, motion_s
from ecm.rig.physics.camera import LEDS, LEDS_NEEDED
from ecm.rig.physics.true_effect import SENSOR_SCALE
from ecm.rig.plan import rest_pose
from ecm.rig.readings import Reading
from ecm.rig.settings import Instruments, RigSettings

TICK = 10
"""Steps between two checks of the safety limits, two damping designs, two points of the trace."""
_AT_REST_RAD_S = 2e-3
_AT_REST_TICKS = 5
_FOLLOWS_S = 0.3
"""Time constant with which the wrench of a driven mechanism is given way to."""
_SLOW_RAD_S = 0.3
"""Peak joint speed of the position phase, and of the return after a stop in motion."""
_MOVED_RAD = 1e-6
_WAY_POINTS = 24
"""Points of the position phase solved by inverse kinematics; a spline joins them."""
_HOME_S = 0.4
"""Time to come to rest at home before the brakes close."""


class LimitExceeded(Exception):
    """A safety limit was exceeded; the message says which."""


@dataclass(frozen=True)
class ArmSetup:
    """Everything that a simulated arm is built from; can be sent to another process."""

    settings: RigSettings
    surrogate: Surrogate
    library: Path
    hidden: HiddenPhysics | None = None


class SimulatedArm:
    """Simulation, controllers and safety limits of one process."""

    def __init__(self, setup: ArmSetup) -> None:
        settings, length_m, hidden = setup.settings, setup.surrogate.length_m, setup.hidden
        self._settings = settings
        self._arm = arm = settings.arm
        self._scene = scene(settings, length_m)
        mechanism, actuators = setup.surrogate.wrench(), len(setup.surrogate.pushes)
        self.simulation = Simulation(self._scene, mechanism, actuators)
        self._model = model = ControllerModel(setup.library)
        self._impedance = Impedance(arm, self.simulation, model)
        self._servo = Servo(arm, self.simulation, model)
        self._limits = SafetyLimits(settings, self.simulation, model, length_m)
        self._elbow_rad = swivel_angle(self._scene.home_rad)
        self._non_elastic = NonElasticWrench(hidden, setup.surrogate) if hidden else None
        self._rest = rest_pose(length_m)
        self._recorded: list[F] = []
        self._result = StopResult(-1)
        self._target: F = np.zeros(7)
        self._phase_begin_s = 0.0
        self._times: list[float] = []
        self._poses: list[F] = []

    def trip(self, stops: Sequence[Stop]) -> TripResult:
        """Visit the stops one after the other and return home; a stop that fails is skipped."""
        self.simulation.reset()
        self._servo.release()
        self._recorded = [self._servo.encoders_rad().copy()]
        results, from_home = [], True
        if self._non_elastic is not None:
            self._non_elastic.begin(self._rest, stops[0].depart_s)
        for stop in stops:
            if self._non_elastic is not None:
                self._non_elastic.next_visit(stop.visit)
            self._result = StopResult(stop.visit, from_home=from_home)
            results.append(self._result)
            try:
                for via in stop.via:
                    self.simulation.inputs[:] = via[6:]
                    self._drive(via[:6])
                    self._result.from_home = False
                begin = self._result.set_s = self.simulation.time_s
                self.simulation.inputs[:] = stop.inputs
                goal = stop.goal if stop.offset is None else self._followed(stop.offset)
                begin = begin if stop.offset is None else self.simulation.time_s
                self._result.goal = goal
                self._drive(goal)
                self._result.travel_s = self.simulation.time_s - begin
                self._read(stop, goal)
                if not from_home and not stop.via:
                    self._recorded = self._direct_path()
                from_home = False
            except LimitExceeded as error:
                self._result.reason = str(error)
                self._return()
                from_home = True
            except (Diverged, np.linalg.LinAlgError):
                self._result.reason = "the simulation diverged; choose a smaller [rig] step_s"
                self._reset_to_home()
                from_home = True
        home = self._result = StopResult(-1)
        if not from_home:
            self._return()
        return TripResult(tuple(results), self.simulation.time_s, home)

    def _reset_to_home(self) -> None:
        """Put the arm at home after a divergence; the clock goes on."""
        with self._phase("return"):
            steps = self.simulation.steps
            self._servo.release()
            self.simulation.reset()
            self.simulation.steps = steps
            self._recorded = [self._servo.encoders_rad().copy()]

    # --- phases ---------------------------------------------------------------

    def _drive(self, goal: F) -> None:
        """Phases impedance, settle and position."""
        simulation = self.simulation
        goal_rotation = Rotation.from_rotvec(goal[3:])
        self._servo.release()
        start = simulation.pose.copy()
        start_rotation = Rotation.from_rotvec(start[3:])
        # A loaded arm stays in place if its virtual spring begins where it balances the wrench.
        lead = simulation.wrench / self._impedance.stiffness
        first_rotation = Rotation.from_rotvec(lead[3:]) * start_rotation
        turn = (goal_rotation * first_rotation.inv()).as_rotvec()
        duration = motion_s(
            goal[:3] - start[:3],
            (goal_rotation * start_rotation.inv()).magnitude(),
            self._settings.rig,
        )
        share, _ = cubic_profile(duration, simulation.step_s)
        shift = goal[:3] - (start[:3] + lead[:3])
        positions = start[:3] + lead[:3] + share[:, None] * shift
        rotations = Rotation.from_rotvec(share[:, None] * turn) * first_rotation
        quaternions = rotations.as_quat(scalar_first=True)
        with self._phase("impedance"):
            self._cartesian("impedance", positions, quaternions)
        with self._phase("settle"):
            self._settle(positions[-1], quaternions[-1])
        self._result.after_impedance = simulation.pose.copy()
        with self._phase("position"):
            self._position(goal, goal_rotation)

    def _followed(self, offset: F) -> F:
        """Phase follow: the arm gives way until the driven mechanism no longer pushes it.

        The target goes where the stiffness of the controller's model says that the wrench vanishes;
        without a spring the arm's own inertia would swing on the soft body for half a minute.
        Returns the pose (6,) that is `offset` away from where it ends.
        """
        simulation, rig = self.simulation, self._settings.rig
        self._servo.release()
        place, turned = simulation.position.copy(), Rotation.from_rotvec(simulation.pose[3:])
        share = TICK * simulation.step_s / _FOLLOWS_S
        with self._phase("follow"):
            for _ in range(max(1, round(rig.follow_s / (TICK * simulation.step_s)))):
                self._impedance.design()
                step = -share * np.linalg.solve(self._model.stiffness, simulation.wrench)
                place = place + step[:3]
                turned = Rotation.from_rotvec(step[3:]) * turned
                quaternion = turned.as_quat(scalar_first=True)
                self._cartesian("follow", np.tile(place, (TICK, 1)), np.tile(quaternion, (TICK, 1)))
                if (np.abs(simulation.wrench) < rig.free_N * SENSOR_SCALE).all():
                    break
            self._settle(place, quaternion)
        return np.asarray(displaced(simulation.pose[None], offset[None])[0])

    def _cartesian(self, phase: str, positions: F, quaternions: F) -> None:
        for k in range(len(positions)):
            if k % TICK == 0:
                self._impedance.design()
            self._step(self._impedance.torque(positions[k], quaternions[k]), phase)

    def _settle(self, position: F, quaternion: F) -> None:
        ticks = max(1, round(self._arm.settle_limit_s / (TICK * self.simulation.step_s)))
        quiet = 0
        positions, quaternions = np.tile(position, (TICK, 1)), np.tile(quaternion, (TICK, 1))
        for _ in range(ticks):
            self._cartesian("settle", positions, quaternions)
            fastest = float(np.abs(self.simulation.speeds_rad_s).max())
            quiet = quiet + 1 if fastest < _AT_REST_RAD_S else 0
            if quiet >= _AT_REST_TICKS:
                return
        raise LimitExceeded(
            f"the arm did not come to rest under impedance control within "
            f"{self._arm.settle_limit_s:g} s ([rig] settle_limit_s)"
        )

    def _position(self, goal: F, rotation: Rotation) -> None:
        simulation = self.simulation
        joints, pose = self._servo.encoders_rad().copy(), self._servo.pose().copy()
        axes = rotation.as_matrix()
        flange_m, flange_axes = self._scene.flange_goal(goal[:3], axes)
        solution = inverse_kinematics(
            flange_m, flange_axes, self._elbow_rad, joints, self._arm.joint_margin_rad
        )
        if solution.reason:
            raise LimitExceeded(f"inverse kinematics: {solution.reason}")
        start_rotation = Rotation.from_rotvec(pose[3:])
        turn = Rotation.from_matrix(axes) * start_rotation.inv()
        points = self._between(joints, solution.joints_rad, pose, goal, turn.as_rotvec())
        duration = max(
            motion_s(goal[:3] - pose[:3], turn.magnitude(), self._settings.rig),
            duration_s(float(np.abs(np.diff(points, axis=0)).sum(axis=0).max()), _SLOW_RAD_S),
        )
        share, rate = cubic_profile(duration, simulation.step_s)
        curve = CubicSpline(np.linspace(0.0, 1.0, len(points)), points)
        self._servo.engage()
        self._follow("position", curve(share), rate[:, None] * curve(share, 1))
        self._target = solution.joints_rad
        last = points[-1] - points[-2]
        self._result.directions = np.where(np.abs(last) > _MOVED_RAD, np.sign(last), 0.0)

    def _between(self, start: F, end: F, pose: F, goal: F, turn: F) -> F:
        """Joints (n, 7) on the straight line of poses and swivel angles from `pose` to `goal`.

        A straight line in joint space would move the top aside if the elbow moves far.
        """
        rotation = Rotation.from_rotvec(pose[3:])
        first = swivel_angle(start)
        change = swivel_angle(end) - first
        points = [start]
        for share in np.linspace(0.0, 1.0, _WAY_POINTS + 1)[1:-1]:
            flange_m, flange_axes = self._scene.flange_goal(
                pose[:3] + share * (goal[:3] - pose[:3]),
                (Rotation.from_rotvec(share * turn) * rotation).as_matrix(),
            )
            solution = joints_at_swivel(flange_m, flange_axes, first + share * change, points[-1])
            if solution.reason:
                raise LimitExceeded(f"inverse kinematics on the way: {solution.reason}")
            points.append(solution.joints_rad)
        return np.stack([*points, end])

    def _read(self, stop: Stop, wanted: F) -> None:
        """Phases rest and reading."""
        simulation, arm, result = self.simulation, self._arm, self._result
        with self._phase("rest"):
            self._hold("rest", stop.dwell_s)
        with self._phase("reading"):
            result.rest_s = stop.dwell_s
            result.joints_rad = self._servo.encoders_rad().copy()
            result.reached = self._hold("reading", stop.window_s).mean(axis=0)
            result.reading_s = 0.5 * (self._phase_begin_s + simulation.time_s)
        # The arm judges by its encoders; a yield behind them is seen by the camera only.
        lag = simulation.jacobian.dot(self._servo.encoders_rad() - simulation.joints_rad)
        error_m = float(np.linalg.norm(result.reached[:3] + lag[:3] - wanted[:3]))
        goal = Rotation.from_rotvec(wanted[3:])
        turn = goal.inv() * Rotation.from_rotvec(simulation.pose[3:])
        error_rad = float(np.linalg.norm(turn.as_rotvec() + goal.as_matrix().T @ lag[3:]))
        if error_m > arm.reach_tolerance_m or error_rad > arm.reach_tolerance_rad:
            raise LimitExceeded(
                f"stayed {error_m * 1e3:.2f} mm and {error_rad * 1e3:.2f} mrad from the goal; "
                f"limits {arm.reach_tolerance_m * 1e3:g} mm, {arm.reach_tolerance_rad * 1e3:g} "
                "mrad ([rig] reach_tolerance_m, reach_tolerance_rad)"
            )

    def _hold(self, phase: str, duration: float) -> F:
        """Hold the target for a time; poses (n, 6) at every step."""
        count = max(1, round(duration / self.simulation.step_s)) if duration > 0.0 else 0
        zero = np.zeros(7)
        poses = np.zeros((count, 6))
        for k in range(count):
            self._step(self._servo.torque(self._target, zero), phase, record=False)
            poses[k] = self.simulation.pose
        return poses

    def _follow(self, phase: str, joints: F, speeds: F, *, record: bool = True) -> None:
        for k in range(len(joints)):
            self._step(self._servo.torque(joints[k], speeds[k]), phase, record=record)

    def _return(self) -> None:
        """Go back along the recorded joints; put there where the simulation diverges."""
        try:
            with self._phase("return"):
                self._go_back()
            self._servo.release()
        except (Diverged, np.linalg.LinAlgError):
            self._reset_to_home()

    def _go_back(self) -> None:
        """The way back, without safety limits: it was free before."""
        simulation = self.simulation
        simulation.inputs[:] = 0.0
        self._servo.engage()
        back = np.stack(self._recorded[::-1])
        joints = self._servo.encoders_rad().copy()
        gap = float(np.abs(back[0] - joints).max())
        if gap > 1e-4:  # stopped in motion: move slowly to the recorded way first
            duration = max(0.2, duration_s(gap, _SLOW_RAD_S))
            share, rate = cubic_profile(duration, simulation.step_s)
            shift = back[0] - joints
            targets, speeds = joints + share[:, None] * shift, rate[:, None] * shift
            self._follow("return", targets, speeds, record=False)
        speeds = np.diff(back, axis=0, prepend=back[:1]) / simulation.step_s
        self._follow("return", back, speeds, record=False)
        self._target = back[-1]
        self._hold("return", _HOME_S)
        self._recorded = [simulation.home_rad.copy()]

    def _direct_path(self) -> list[F]:
        """Joints from home to here in one cubic motion.

        After several poses the recorded path would lead back through each of them.
        """
        pose, home = self._servo.pose(), self.simulation.home_rad
        shift = self._servo.encoders_rad() - home
        angle = float(np.linalg.norm(pose[3:]))
        duration = max(
            motion_s(pose[:3] - self._rest[:3], angle, self._settings.rig),
            duration_s(float(np.abs(shift).max()), _SLOW_RAD_S),
        )
        share, _ = cubic_profile(duration, self.simulation.step_s)
        return list(home + share[:, None] * shift)

    # --- one step --------------------------------------------------------------

    def _step(self, torque: F, phase: str, *, record: bool = True) -> None:
        self.simulation.advance(torque)
        if record:
            self._recorded.append(self._servo.encoders_rad().copy())
        if self.simulation.steps % TICK == 0:
            self._tick(torque, phase)

    def _tick(self, torque: F, phase: str) -> None:
        simulation = self.simulation
        self._times.append(simulation.time_s)
        self._poses.append(simulation.pose.copy())
        if self._non_elastic is not None and simulation.steps % STEPS_BETWEEN == 0:
            wrench = self._non_elastic.at(
                simulation.pose,
                simulation.time_s,
                STEPS_BETWEEN * simulation.step_s,
                moving=phase not in ("settle", "rest", "reading"),
            )
            simulation.ramp_extra_wrench(wrench, STEPS_BETWEEN)
        if phase == "return":
            return
        total = torque + simulation.gravity_Nm
        if phase not in ("follow", "impedance", "settle"):
            total = total - self._servo.damper_torque_Nm()
        broken = self._limits.broken(total)
        if not broken and simulation.steps % (10 * TICK) == 0:
            broken = self._limits.singular()
        if broken:
            self._end_phase(phase)
            raise LimitExceeded(f"while in phase {phase}: {broken}")

    @contextmanager
    def _phase(self, name: str) -> Iterator[None]:
        """Record a phase; one that a limit ends is recorded where that is found."""
        self._phase_begin_s = self.simulation.time_s
        yield
        self._end_phase(name)

    def _end_phase(self, phase: str) -> None:
        """Record a phase and its trace."""
        result = self._result
        result.phases.append((phase, self._phase_begin_s, self.simulation.time_s))
        result.trace_s = np.concatenate([result.trace_s, self._times])
        if self._poses:
            result.trace = np.concatenate([result.trace, np.stack(self._poses)])
        self._times.clear()
        self._poses.clear()


def unusable(reading: Reading, leds: int, instrument: Instruments) -> str:
    """Return why a reading that shows so many LEDs cannot be used; empty if it can."""
    if leds < LEDS_NEEDED:
        return f"{leds} of {LEDS} LEDs were visible, {LEDS_NEEDED} are needed"
    saturated = np.abs(reading.sensor) >= np.asarray(instrument.fts_range) - 1e-9
    if saturated.any():
        axis = int(np.argmax(saturated))
        return (
            f"the force-torque sensor is saturated on axis {axis + 1} "
            f"({reading.sensor[axis]:.4g} at a range of {instrument.fts_range[axis]:.4g})"
        )
    return ""


_REFERENCE_M = 0.4
"""Length that makes the rows of the Jacobian comparable."""


class SafetyLimits:
    """Limits of force, torque, stretch, speed, joints, singularity and contact."""

    def __init__(
        self, settings: RigSettings, simulation: Simulation, model: ControllerModel, length_m: float
    ) -> None:
        self._arm = settings.arm
        self._simulation = simulation
        self._model = model
        self._length_m = length_m
        self._stretch_m = settings.rig.stretch_limit * length_m
        self._range_rad = RANGE_RAD - settings.arm.joint_margin_rad

    def broken(self, torque_Nm: F) -> str:
        """Message about the first limit that is broken by the state and the joint torques (7,)."""
        arm, simulation, pose = self._arm, self._simulation, self._simulation.pose
        force, tau = np.linalg.norm(simulation.wrench[:3]), np.linalg.norm(simulation.wrench[3:])
        moved = math.hypot(pose[0] - self._length_m, pose[1], pose[2])
        speed = np.linalg.norm(simulation.jacobian[:3].dot(simulation.speeds_rad_s))
        for found, limit, unit, words, key in (
            (force, arm.force_limit_N, 1.0, "force {:.1f} N, limit {:g} N", "force_limit_N"),
            (tau, arm.torque_limit_Nm, 1.0, "torque {:.2f} N m, limit {:g} N m", "torque_limit_Nm"),
            (moved, self._stretch_m, 1e3, "top moved {:.1f} mm, limit {:.1f} mm", "stretch_limit"),
            (speed, arm.speed_limit_m_s, 1.0, "speed {:.3f} m/s, limit {:g}", "speed_limit_m_s"),
        ):
            if found > limit:
                return f"{words.format(unit * found, unit * limit)} ([rig] {key})"
        return self._joints(torque_Nm) or self._contact()

    def _joints(self, torque_Nm: F) -> str:
        for values, limit, verb, factor, unit in (
            (self._simulation.joints_rad, self._range_rad, "is at", 180.0 / math.pi, "degrees"),
            (self._simulation.speeds_rad_s, SPEED_RAD_S, "turns at", 180.0 / math.pi, "degrees/s"),
            (torque_Nm, TORQUE_NM, "needs", 1.0, "N m"),
        ):
            excess = np.abs(values) - limit
            if (excess > 0.0).any():
                i = int(np.argmax(excess))
                return (
                    f"joint {i + 1} {verb} {values[i] * factor:.1f} {unit}, "
                    f"limit {limit[i] * factor:.1f}"
                )
        return ""

    def singular(self) -> str:
        """Message if the arm is near a singular configuration (checked every 0.1 s)."""
        scaled = self._simulation.jacobian.copy()
        scaled[:3] /= _REFERENCE_M
        smallest = float(np.linalg.svd(scaled, compute_uv=False)[-1])
        if smallest < self._arm.singularity_limit:
            return (
                f"near a singular configuration: smallest singular value {smallest:.3f}, limit "
                f"{self._arm.singularity_limit:g} ([rig] singularity_limit)"
            )
        return ""

    def _contact(self) -> str:
        simulation = self._simulation
        if simulation.data.ncon == 0:
            return ""
        # What the sensor reads beyond the model of the mechanism.
        self._model.evaluate(simulation.pose)
        unexplained = simulation.contact_N() + np.linalg.norm(
            simulation.wrench[:3] - self._model.wrench[:3]
        )
        if unexplained > self._arm.contact_limit_N:
            return (
                f"contact: {unexplained:.1f} N that the model of the mechanism does not explain, "
                f"limit {self._arm.contact_limit_N:g} N ([rig] contact_limit_N)"
            )
        return ""
