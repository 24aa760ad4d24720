"""The paper's procedure as a state machine (its Fig. 7), one sortie from home to home.

    impedance -> settle -> position -> rest -> reading -> (next pose, or return -> home)
        \\___________________ a limit is broken ___________________/

Impedance control drives towards the goal and reaches a fraction of it, the mechanism being the
stiffer spring along x. When the arm has come to rest, inverse kinematics and joint position control
go to the exact pose. The joints of every step, as the encoders read them, lie on a stack; the way
home is that stack backwards.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from ecm.io.arrays import F
from ecm.rig.arm.feed_forward import compiled
from ecm.rig.arm.impedance import Impedance
from ecm.rig.arm.inverse import joints_at, solve, swivel
from ecm.rig.arm.safety_limits import Guard
from ecm.rig.arm.scene import scene
from ecm.rig.arm.servo import Servo
from ecm.rig.arm.simulation import Diverged, Simulation
from ecm.rig.arm.surroundings import EVERY, Surroundings
from ecm.rig.arm.timing import duration_s, progress
from ecm.rig.settings import RigSettings

Frame = Callable[[Simulation, str], None] | None

TICK = 10
"""Steps between two looks of the guard, two designs of the damping, two points of the trace."""
_AT_REST_RAD_S = 2e-3
_AT_REST_TICKS = 5
_SLOW_RAD_S = 0.3
"""Peak joint speed in the position phase and on the way home after a fault."""
_MOVED_RAD = 1e-6
_WAY_POINTS = 24
"""Of the position phase, solved by inverse kinematics; a spline joins them."""
_HOME_S = 0.4
"""At home the arm comes to rest before its brakes close."""


@dataclass(frozen=True)
class Stop:
    """A pose to be read, as the arm is told to reach it."""

    visit: int
    goal: F
    """Pose (6,), with the arm's own error of calibration."""
    via: tuple[F, ...]
    """Poses to pass on the way."""
    dwell_s: float
    window_s: float
    depart_s: float = 0.0
    """When the sortie leaves home, by the plan."""


@dataclass
class Outcome:
    """What became of a stop; poses are the true ones."""

    visit: int
    reason: str = ""
    """Why it was skipped; empty where it was reached."""
    from_home: bool = True
    """Whether the last leg began at home."""
    reached: F = field(default_factory=lambda: np.zeros(6))
    """Mean over the window."""
    after_impedance: F = field(default_factory=lambda: np.zeros(6))
    reading_s: float = 0.0
    """Middle of the window, since the sortie began."""
    travel_s: float = 0.0
    rest_s: float = 0.0
    joints_rad: F = field(default_factory=lambda: np.zeros(7))
    directions: F = field(default_factory=lambda: np.zeros(7))
    trace_s: F = field(default_factory=lambda: np.zeros(0))
    trace: F = field(default_factory=lambda: np.zeros((0, 6)))
    """Poses since the stop before, every TICK steps."""
    phases: list[tuple[str, float, float]] = field(default_factory=list)
    """Name, begin, end in s since the sortie began."""


@dataclass(frozen=True)
class Sortie:
    """All stops between two stays at home."""

    outcomes: tuple[Outcome, ...]
    duration_s: float
    home: Outcome
    """The way back: its phases and trace alone."""


def whole_way(sortie: Sortie) -> tuple[F, F]:
    """Times (n,) and poses (n, 6) of a sortie with one stop, from home and back."""
    parts = (sortie.outcomes[0], sortie.home)
    return np.concatenate([p.trace_s for p in parts]), np.concatenate([p.trace for p in parts])


class Halt(Exception):
    """A limit was broken; the message says which."""


class Machine:
    """Simulation, controllers and guard of one process."""

    def __init__(
        self,
        settings: RigSettings,
        length_m: float,
        mechanism: Callable[[F], F],
        library: Path,
        *,
        frame: Frame = None,
        around: Surroundings | None = None,
    ) -> None:
        self._settings = settings
        self._arm = arm = settings.arm
        self._scene = scene(settings, length_m)
        self.simulation = Simulation(self._scene, mechanism)
        model = compiled(library)
        self._impedance = Impedance(arm, self.simulation, model)
        self._servo = Servo(arm, self.simulation, model)
        self._guard = Guard(settings, self.simulation, model, length_m)
        self._frame = frame
        self._elbow = swivel(self._scene.home_rad)
        self._around = around
        self._rest = np.array([length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
        self._stack: list[F] = []
        self._outcome = Outcome(-1)
        self._target: F = np.zeros(7)
        self._begin_s = 0.0
        """When the present phase began."""
        self._times: list[float] = []
        self._poses: list[F] = []

    def sortie(self, stops: Sequence[Stop]) -> Sortie:
        """Visits the stops one after the other and comes home; what fails is skipped."""
        self.simulation.reset()
        self._servo.release()
        self._stack = [self._servo.encoders_rad().copy()]
        outcomes, from_home = [], True
        if self._around is not None:
            self._around.leave(self._rest, stops[0].depart_s)
        for stop in stops:
            if self._around is not None:
                self._around.towards(stop.visit)
            self._outcome = Outcome(stop.visit, from_home=from_home)
            outcomes.append(self._outcome)
            try:
                for via in stop.via:
                    self._drive(via)
                    self._outcome.from_home = False
                begin = self.simulation.time_s
                self._drive(stop.goal)
                self._outcome.travel_s = self.simulation.time_s - begin
                self._read(stop)
                if not from_home and not stop.via:
                    self._stack = self._straight()
                from_home = False
            except Halt as halt:
                self._outcome.reason = str(halt)
                self._retrace()
                from_home = True
            except (Diverged, np.linalg.LinAlgError):
                self._outcome.reason = "the simulation diverged; choose a smaller [rig] step_s"
                self._put_home()
                from_home = True
        home = self._outcome = Outcome(-1)
        if not from_home:
            self._retrace()
        return Sortie(tuple(outcomes), self.simulation.time_s, home)

    def _put_home(self) -> None:
        """Where no motion is left to come home by; the clock goes on."""
        steps = self.simulation.steps
        self._servo.release()
        self.simulation.reset()
        self.simulation.steps = steps
        self._stack = [self._servo.encoders_rad().copy()]
        self._log("return", self.simulation.time_s)

    # --- phases ---------------------------------------------------------------

    def _drive(self, goal: F) -> None:
        simulation = self.simulation
        goal_turn = Rotation.from_rotvec(goal[3:])
        begin = self._begin_s = simulation.time_s
        self._servo.release()
        start = simulation.pose.copy()
        start_turn = Rotation.from_rotvec(start[3:])
        # A loaded arm keeps its place when its virtual spring begins where it balances h.
        lead = simulation.wrench / self._impedance.stiffness
        first_turn = Rotation.from_rotvec(lead[3:]) * start_turn
        way = (goal_turn * first_turn.inv()).as_rotvec()
        procedure = self._settings.rig
        duration = max(
            duration_s(float(np.linalg.norm(goal[:3] - start[:3])), procedure.speed_m_s),
            duration_s((goal_turn * start_turn.inv()).magnitude(), procedure.speed_rad_s),
        )
        share, _ = progress(duration, simulation.step_s)
        shift = goal[:3] - (start[:3] + lead[:3])
        positions = start[:3] + lead[:3] + share[:, None] * shift
        turns = (Rotation.from_rotvec(share[:, None] * way) * first_turn).as_quat(scalar_first=True)
        self._cartesian("impedance", positions, turns)
        self._log("impedance", begin)
        begin = self._begin_s = simulation.time_s
        self._settle(positions[-1], turns[-1])
        self._log("settle", begin)
        self._outcome.after_impedance = simulation.pose.copy()
        begin = self._begin_s = simulation.time_s
        self._position(goal, goal_turn.as_matrix())
        self._log("position", begin)

    def _cartesian(self, phase: str, positions: F, turns: F) -> None:
        for k in range(len(positions)):
            if k % TICK == 0:
                self._impedance.design()
            torque = self._impedance.torque(positions[k], turns[k])
            self._step(torque, phase)

    def _settle(self, position: F, turn: F) -> None:
        ticks = max(1, round(self._arm.settle_limit_s / (TICK * self.simulation.step_s)))
        quiet = 0
        still_position, still_turn = np.tile(position, (TICK, 1)), np.tile(turn, (TICK, 1))
        for _ in range(ticks):
            self._cartesian("settle", still_position, still_turn)
            fastest = float(np.abs(self.simulation.speeds_rad_s).max())
            quiet = quiet + 1 if fastest < _AT_REST_RAD_S else 0
            if quiet >= _AT_REST_TICKS:
                return
        raise Halt(
            f"the arm did not come to rest under impedance control within "
            f"{self._arm.settle_limit_s:g} s ([rig] settle_limit_s)"
        )

    def _position(self, goal: F, axes: F) -> None:
        simulation = self.simulation
        now, pose = self._servo.encoders_rad().copy(), self._servo.pose().copy()
        flange_m, flange_axes = self._scene.flange_goal(goal[:3], axes)
        found = solve(flange_m, flange_axes, self._elbow, now, self._arm.joint_margin_rad)
        if found.reason:
            raise Halt(f"inverse kinematics: {found.reason}")
        points = self._between(now, found.joints_rad, pose, goal, axes)
        procedure = self._settings.rig
        here = Rotation.from_rotvec(pose[3:])
        duration = max(
            duration_s(float(np.linalg.norm(goal[:3] - pose[:3])), procedure.speed_m_s),
            duration_s(
                (Rotation.from_matrix(axes) * here.inv()).magnitude(), procedure.speed_rad_s
            ),
            duration_s(float(np.abs(np.diff(points, axis=0)).sum(axis=0).max()), _SLOW_RAD_S),
        )
        share, rate = progress(duration, simulation.step_s)
        curve = CubicSpline(np.linspace(0.0, 1.0, len(points)), points)
        self._servo.engage()
        self._follow("position", curve(share), rate[:, None] * curve(share, 1))
        self._target = found.joints_rad
        last = points[-1] - points[-2]
        self._outcome.directions = np.where(np.abs(last) > _MOVED_RAD, np.sign(last), 0.0)

    def _between(self, now: F, end: F, pose: F, goal: F, axes: F) -> F:
        """Joints on the straight line of poses and elbows from here to the goal, (n, 7).

        Straight joints would swing the top aside where the elbow has far to go.
        """
        here = Rotation.from_rotvec(pose[3:])
        turn = (Rotation.from_matrix(axes) * here.inv()).as_rotvec()
        first = swivel(now)
        way = swivel(end) - first
        points = [now]
        for share in np.linspace(0.0, 1.0, _WAY_POINTS + 1)[1:-1]:
            flange_m, flange_axes = self._scene.flange_goal(
                pose[:3] + share * (goal[:3] - pose[:3]),
                (Rotation.from_rotvec(share * turn) * here).as_matrix(),
            )
            found = joints_at(flange_m, flange_axes, first + share * way, points[-1])
            if found.reason:
                raise Halt(f"inverse kinematics on the way: {found.reason}")
            points.append(found.joints_rad)
        return np.stack([*points, end])

    def _read(self, stop: Stop) -> None:
        simulation, arm = self.simulation, self._arm
        begin = self._begin_s = simulation.time_s
        self._hold("rest", stop.dwell_s)
        self._log("rest", begin)
        begin = self._begin_s = simulation.time_s
        self._outcome.rest_s = stop.dwell_s
        self._outcome.joints_rad = self._servo.encoders_rad().copy()
        poses = self._hold("reading", stop.window_s)
        self._outcome.reached = poses.mean(axis=0)
        self._outcome.reading_s = 0.5 * (begin + simulation.time_s)
        self._log("reading", begin)
        # By the encoders: what yields behind them is seen by the camera alone.
        hung = simulation.jacobian.dot(self._servo.encoders_rad() - simulation.joints_rad)
        off_m = float(np.linalg.norm(self._outcome.reached[:3] + hung[:3] - stop.goal[:3]))
        goal = Rotation.from_rotvec(stop.goal[3:])
        axes = goal.as_matrix()
        turn = goal.inv() * Rotation.from_rotvec(simulation.pose[3:])
        off_rad = float(np.linalg.norm(turn.as_rotvec() + axes.T @ hung[3:]))
        if off_m > arm.reach_tolerance_m or off_rad > arm.reach_tolerance_rad:
            raise Halt(
                f"stayed {off_m * 1e3:.2f} mm and {off_rad * 1e3:.2f} mrad from the goal; limits "
                f"{arm.reach_tolerance_m * 1e3:g} mm, {arm.reach_tolerance_rad * 1e3:g} mrad "
                "([rig] reach_tolerance_m, reach_tolerance_rad)"
            )

    def _hold(self, phase: str, duration: float) -> F:
        """Stays; poses at every step (n, 6)."""
        count = max(1, round(duration / self.simulation.step_s)) if duration > 0.0 else 0
        still = np.zeros(7)
        poses = np.zeros((count, 6))
        for k in range(count):
            self._step(self._servo.torque(self._target, still), phase, keep=False)
            poses[k] = self.simulation.pose
        return poses

    def _follow(self, phase: str, joints: F, speeds: F, *, keep: bool = True) -> None:
        for k in range(len(joints)):
            self._step(self._servo.torque(joints[k], speeds[k]), phase, keep=keep)

    def _retrace(self) -> None:
        """Back along the recorded joints, whatever the guard says: that way was free before."""
        simulation = self.simulation
        begin = self._begin_s = simulation.time_s
        self._servo.engage()
        back = np.stack(self._stack[::-1])
        now = self._servo.encoders_rad().copy()
        gap = float(np.abs(back[0] - now).max())
        if gap > 1e-4:  # stopped in motion: ease back onto the recorded way first
            share, rate = progress(max(0.2, duration_s(gap, _SLOW_RAD_S)), simulation.step_s)
            way = back[0] - now
            self._follow("return", now + share[:, None] * way, rate[:, None] * way, keep=False)
        speeds = np.diff(back, axis=0, prepend=back[:1]) / simulation.step_s
        self._follow("return", back, speeds, keep=False)
        self._target = back[-1]
        self._hold("return", _HOME_S)
        self._stack = [simulation.home_rad.copy()]
        self._log("return", begin)
        self._servo.release()

    def _straight(self) -> list[F]:
        """Joints from home to here in one cubic motion: the way home of the direct strategy.

        The recorded way would lead through every pose before.
        """
        simulation, procedure = self.simulation, self._settings.rig
        pose, home = self._servo.pose(), simulation.home_rad
        way = self._servo.encoders_rad() - home
        duration = max(
            duration_s(float(np.linalg.norm(pose[:3] - self._rest[:3])), procedure.speed_m_s),
            duration_s(float(np.linalg.norm(pose[3:])), procedure.speed_rad_s),
            duration_s(float(np.abs(way).max()), _SLOW_RAD_S),
        )
        share, _ = progress(duration, simulation.step_s)
        return list(home + share[:, None] * way)

    # --- one step --------------------------------------------------------------

    def _step(self, torque: F, phase: str, *, keep: bool = True) -> None:
        simulation = self.simulation
        simulation.advance(torque)
        if keep:
            self._stack.append(self._servo.encoders_rad().copy())
        if simulation.steps % TICK == 0:
            self._tick(torque, phase)

    def _tick(self, torque: F, phase: str) -> None:
        simulation = self.simulation
        self._times.append(simulation.time_s)
        self._poses.append(simulation.pose.copy())
        if self._frame is not None:
            self._frame(simulation, phase)
        if self._around is not None and simulation.steps % EVERY == 0:
            beside = self._around.wrench(
                simulation.pose,
                simulation.time_s,
                EVERY * simulation.step_s,
                moving=phase not in ("settle", "rest", "reading"),
            )
            simulation.drift(beside, EVERY)
        if phase == "return":
            return
        total = torque + simulation.gravity_Nm
        if phase not in ("impedance", "settle"):
            total = total - self._servo.dampers_Nm()
        breach = self._guard.breach(total)
        if not breach and simulation.steps % (10 * TICK) == 0:
            breach = self._guard.singular()
        if breach:
            self._log(phase, self._begin_s)
            raise Halt(f"while in phase {phase}: {breach}")

    def _log(self, phase: str, begin: float) -> None:
        outcome = self._outcome
        outcome.phases.append((phase, begin, self.simulation.time_s))
        outcome.trace_s = np.concatenate([outcome.trace_s, self._times])
        if self._poses:
            outcome.trace = np.concatenate([outcome.trace, np.stack(self._poses)])
        self._times.clear()
        self._poses.clear()
