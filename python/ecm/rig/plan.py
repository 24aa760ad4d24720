"""A plan as the rig reads it: requests, the visits they become, and which of them it can reach."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import B, F, I, float_of
from ecm.io.columns import POSE as POSE_COLUMNS
from ecm.io.columns import POSE_OFFSETS
from ecm.io.events import tell
from ecm.io.se3 import displaced, rotation, transpose, turn_wrench, wrench_adjoint
from ecm.io.settings import did_you_mean
from ecm.io.table import Table
from ecm.rig.elastic import SolvedPoses, unique_poses
from ecm.rig.instruments import Optics
from ecm.rig.physics.camera import LEDS, LEDS_NEEDED
from ecm.rig.physics.true_effect import LEVER_M
from ecm.rig.settings import Procedure, RigSettings

HOME = "initial"
"""`approach` of a pose that is driven to from the rest pose."""


def tell_begun(plan: Table, **more: Any) -> None:
    """Tell those who follow a measurement what is planned."""
    poses = {name: plan.column(name).tolist() for name in POSE_COLUMNS if plan.has(name)}
    told = {"at": time.time(), "poses": poses, "mechanism": plan.meta.absolute_mechanism()}
    tell(begun={**told, **more})


ARGUMENT_UNITS = {
    "measure": "",
    "home": "",
    "unload": "",
    "remount": "degrees",
    "remove_payload": "",
    "warm_up": "minutes",
    "dead_weight": "kg",
}


@dataclass(frozen=True)
class Action:
    """One action of a plan: `remount:90` is ("remount", 90.0)."""

    name: str
    value: float = 0.0

    @staticmethod
    def parse(text: str, where: str) -> Action:
        """Parse an action cell; empty means `measure`.

        Raises
        ------
        InputError
            Naming place, what was found, and the known actions.
        """
        name, colon, rest = text.strip().partition(":")
        name = name.strip() or "measure"
        if name not in ARGUMENT_UNITS:
            raise InputError(
                f"{where}: unknown action `{text}`, {did_you_mean(name, ARGUMENT_UNITS)}"
            )
        unit = ARGUMENT_UNITS[name]
        if not unit:
            if colon:
                raise InputError(f"{where}: action `{text}` takes no value; write `{name}`")
            return Action(name)
        value = float_of(rest)
        if not math.isfinite(value) or (name != "remount" and value <= 0.0):
            raise InputError(
                f"{where}: action `{text}`: expected a number of {unit}, such as `{name}:10`"
            )
        return Action(name, value)


@dataclass(frozen=True)
class Request:
    """One row of a plan."""

    row: int
    """Counted from 0."""
    action: Action
    pose: F
    """Commanded (6,), or (6 + m,) with the inputs of the actuators."""
    pose_id: int
    approach: str
    """`initial`, a pose_id, or empty where the plan leaves it to the rig."""
    dwell_s: float
    run: int
    offset: F | None = None
    """Way (6,) from the free pose at the row's inputs, where the robot follows the mechanism."""
    free: F | None = None
    """That free pose with the inputs (6 + m,), once it is solved."""


def rest_pose(length_m: float, actuators: int = 0) -> F:
    """Top frame of the undeformed mechanism, with the inputs of its actuators: 0."""
    return np.array([length_m, 0.0, 0.0, 0.0, 0.0, 0.0] + [0.0] * actuators)


def requests(plan: Table, procedure: Procedure, length_m: float) -> list[Request]:
    """The rows of a plan in visiting order.

    Raises
    ------
    InputError
        Empty plan, an unknown action or kind, an approach from a pose that the plan has not.
    """
    count = len(plan)
    where = plan.source or "plan"
    if count == 0:
        raise InputError(f"{where}: the plan has no rows; expected poses to measure")
    kinds, words = plan.text("kind"), plan.text("action")
    approaches = [_approach(str(text).strip()) for text in plan.text("approach")]
    dwell = plan.column("dwell_s") if plan.has("dwell_s") else np.full(count, np.nan)
    runs = plan.column("run") if plan.has("run") else np.zeros(count)
    actions = [_action(str(words[i]), kinds[i], f"{where} row {i + 1}") for i in range(count)]
    moves = np.asarray([a.name == "measure" for a in actions])
    driven = plan.actuation_columns
    rows = plan.matrix((*POSE_COLUMNS, *driven))
    poses = np.where(moves[:, None], rows, rest_pose(length_m, len(driven)))
    follows = bool(driven) and plan.has(*POSE_OFFSETS)
    offsets = plan.matrix(POSE_OFFSETS) if follows else np.zeros((count, 6))
    ids = plan.column("pose_id").astype(np.int64) if plan.has("pose_id") else unique_poses(poses)[1]
    known = {"", HOME, *map(str, ids[moves].tolist())}
    result = []
    for i in range(count):
        place = f"{where} row {i + 1}"
        approach = approaches[i]
        if approach not in known:
            raise InputError(
                f"{place}, column approach: `{approach}` is no pose_id of this plan; "
                f"expected `{HOME}`, a pose_id, or nothing"
            )
        wait = float(dwell[i])
        result.append(
            Request(
                row=i,
                action=actions[i],
                pose=poses[i],
                pose_id=int(ids[i]),
                approach=approach,
                dwell_s=procedure.dwell_s if math.isnan(wait) else wait,
                run=int(runs[i]),
                offset=offsets[i] if follows and moves[i] else None,
            )
        )
    return result


def followed(
    requests: list[Request], free: Callable[[F], SolvedPoses]
) -> tuple[list[Request], list[Skipped], SolvedPoses | None]:
    """Requests whose poses start at the free pose at their inputs, and those free poses.

    free: the poses that the mechanism takes without a load at inputs (k, m).
    """
    own = [r for r in requests if r.offset is not None]
    if not own:
        return requests, [], None
    inputs = np.unique(np.stack([r.pose[6:] for r in own]), axis=0)
    solved = free(inputs)
    place = {row.tobytes(): i for i, row in enumerate(inputs)}

    def follow(request: Request) -> Request:
        if request.offset is None:
            return request
        row = solved.poses[place[request.pose[6:].tobytes()]]
        pose = displaced(row[None, :6], request.offset[None])[0]
        return replace(request, pose=np.concatenate([pose, row[6:]]), free=row)

    def reason(request: Request) -> str:
        if request.offset is None:
            return ""
        status = solved.status[place[request.pose[6:].tobytes()]]
        found = f"the mechanism has no free pose at these pressures ({status})"
        return "" if status == "solved" else found

    remaining, skipped = _without(requests, [], reason)
    return [follow(request) for request in remaining], skipped, solved


def _approach(text: str) -> str:
    """The text, a pose_id as a whole number: a table program may have written 12 as 12.0."""
    number = float_of(text)
    return str(int(number)) if number.is_integer() else text


def _action(word: str, kind: str, place: str) -> Action:
    implied: Mapping[str, str] = {"": "", "pose": "", "home": "home", "unloaded": "unload"}
    if kind not in implied:
        raise InputError(f"{place}, column kind: found `{kind}`, expected pose, home or unloaded")
    return Action.parse(word or implied[kind], f"{place}, column action")


LOOK_HOME = -2
"""In an order of rows: a look at the rest pose that is no row of the plan."""

POSE, AT_HOME, UNLOADED, OFFSET = "pose", "home", "unloaded", "offset"
"""Kinds of reading; `offset` serves the compensation alone and is in no table."""


@dataclass(frozen=True)
class Visit:
    """One reading of a plan: where, when, how the rig came there."""

    kind: str
    row: int
    """Row of the plan; -1 for a visit that the rig adds."""
    pose: F
    """Commanded pose (6,), or (6 + m,) with the inputs of the actuators."""
    pose_id: int
    repeat: int
    run: int
    time_s: float
    """Middle of the window."""
    window_s: float
    way: F
    """Way points (k, 6), or (k, 6 + m), since the visit before, ending at `pose`."""
    rested: bool
    """The history of the mechanism restarts."""
    mount_rad: float
    payload_on: bool
    approach: str = HOME
    travel_s: float = 0.0
    """Duration of the last leg."""
    dwell_s: float = 0.0
    dead_weight_kg: float = 0.0
    free: F | None = None
    """The free pose with the inputs (6 + m,) from which the robot went on to `pose`."""
    set_s: float = 0.0
    """When the actuators were last set to something else."""

    @property
    def serial(self) -> tuple[str, int, int]:
        """Name of its random streams, whatever the order of visits."""
        return (self.kind, self.pose_id, self.repeat)


@dataclass(frozen=True)
class Visits:
    """All visits as arrays, with the poses that the robot really reaches."""

    rows: tuple[Visit, ...]
    reached: F
    """True top frame in the world, (N, 6)."""
    nearest: I
    """Index of each visit's solved pose, (N,)."""
    time_s: F
    temperature_degC: F
    """Temperature of the mechanism, (N,)."""
    sensor_temperature_degC: F
    walk: F
    """Random process of unit variance of the sensor's zero, (N, 6)."""
    moving: bool = False
    """The visits are samples of one motion in the order of time, not each a rest after its way."""
    memory: dict[Any, F] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Histories along these visits that were computed before."""

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Visit]:
        return iter(self.rows)

    def of_kind(self, *kinds: str) -> B:
        """Which visits are of one of the kinds, (N,)."""
        return np.asarray([visit.kind in kinds for visit in self.rows])

    @property
    def at_poses(self) -> B:
        """Which visits measure a pose of the plan, (N,)."""
        return self.of_kind(POSE)

    @property
    def zero_readings(self) -> B:
        """Which visits read the sensor with nothing on it, (N,)."""
        return np.asarray(self.of_kind(OFFSET, UNLOADED) & (self.numbers("dead_weight_kg") == 0.0))

    def numbers(self, name: str) -> F:
        """One number of every visit, (N,)."""
        return np.asarray([getattr(visit, name) for visit in self.rows], dtype=np.float64)

    @property
    def inputs(self) -> F:
        """What the actuators were set to, (N, m)."""
        return np.stack([visit.pose[6:] for visit in self.rows])

    @property
    def states(self) -> F:
        """What is reached, (N, 6), or (N, 6 + m) with what the actuators were set to."""
        return np.hstack([self.reached, self.inputs])

    @property
    def arrivals_m(self) -> F:
        """Last translation (N, 3) of the way to each visit; in a motion, also what it came by."""
        steps = np.zeros((len(self), 3))
        for i, visit in enumerate(self.rows):
            if len(visit.way) > 1:
                steps[i] = (visit.way[-1] - visit.way[-2])[:3]
            if self.moving and i and not steps[i].any():
                steps[i] = steps[i - 1]
        return steps


@dataclass(frozen=True)
class Skipped:
    """A pose that was not visited, and why."""

    row: int
    pose_id: int
    reason: str


def split_by_limits(
    requests: list[Request], procedure: Procedure, length_m: float, skipped: Sequence[Skipped] = ()
) -> tuple[list[Request], list[Skipped]]:
    """Split requests into poses within the rig's limits and the others with the reason."""
    rest = rest_pose(length_m)

    def reason(request: Request) -> str:
        turn = float(np.linalg.norm(request.pose[3:6]))
        shift = float(np.linalg.norm(request.pose[:3] - rest[:3])) / length_m
        if turn > procedure.rotation_limit_rad:
            return (
                f"rotation {turn:.3f} rad, limit {procedure.rotation_limit_rad:g} rad "
                "([rig] rotation_limit_rad)"
            )
        if shift > procedure.stretch_limit:
            return (
                f"displacement {shift:.3f} of the length, limit {procedure.stretch_limit:g} "
                "([rig] stretch_limit)"
            )
        return ""

    return _without(requests, list(skipped), reason)


def _without(
    requests: list[Request], skipped: list[Skipped], reason: Callable[[Request], str]
) -> tuple[list[Request], list[Skipped]]:
    """Skip the requests that have a reason, and the poses approached from one that is skipped."""
    reasons = [reason(request) for request in requests]
    remaining = [r for r, why in zip(requests, reasons, strict=True) if not why]
    lost = [(r, why) for r, why in zip(requests, reasons, strict=True) if why]
    while lost:
        skipped = [*skipped, *(Skipped(r.row, r.pose_id, why) for r, why in lost)]
        known = {str(r.pose_id) for r in remaining if r.action.name == "measure"} | {"", HOME}
        lost = [
            (r, f"is approached from pose {r.approach}, which is skipped")
            for r in remaining
            if r.approach not in known
        ]
        remaining = [r for r in remaining if r.approach in known]
    return remaining, skipped


def reachable(
    requests: list[Request], skipped: list[Skipped], solved: SolvedPoses, settings: RigSettings
) -> tuple[list[Request], list[Skipped]]:
    """Skip poses without a stable solution, beyond the sensor's range or out of sight."""
    instrument, table = settings.instrument, settings.plant
    # What is left for the mechanism after the sensor's zero and three sigma of a sample.
    reserve = np.array(
        [table.offset_N + table.drift_N + 3.0 * instrument.force_noise_N] * 3
        + [table.offset_Nm + LEVER_M * table.drift_N + 3.0 * instrument.torque_noise_Nm] * 3
    )
    limits = np.asarray(instrument.fts_range) - reserve
    sensor_from_top = np.linalg.inv(wrench_adjoint(instrument.top_from_sensor))
    back = transpose(rotation(solved.poses[:, 3:6]))
    felt = turn_wrench(back, solved.wrenches) @ sensor_from_top.T
    leds = Optics(instrument).visible(solved.poses[:, :6]).sum(axis=1)

    def reason(request: Request) -> str:
        i = solved.place[request.pose.tobytes()]
        if request.action.name != "measure":
            return ""
        if solved.status[i] != "solved":
            return f"the mechanism has no stable solution there ({solved.status[i]})"
        if np.any(np.abs(felt[i]) > limits):
            axis = int(np.argmax(np.abs(felt[i]) - limits))
            unit = "N" if axis < 3 else "N m"
            return (
                f"needs {felt[i, axis]:.4g} {unit} on axis {axis + 1} of the sensor, whose "
                f"range leaves {limits[axis]:.4g} {unit} beside zero and noise "
                "([instrument] fts_range)"
            )
        if leds[i] < LEDS_NEEDED:
            return (
                f"the camera would see {leds[i]} of {LEDS} LEDs, {LEDS_NEEDED} are needed "
                "([instrument] camera_place_m, led_angle_rad)"
            )
        return ""

    return _without(requests, skipped, reason)
