"""What every physical effect of the plant declares: size and shape, draw, largest size, stage.

A true effect is one class in one file of this folder. The base class that it derives from is its
stage: where the plant applies it (`ecm.rig.plant` goes through the
stages in order and knows no effect by name).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, ClassVar, TypeVar

import numpy as np

from ecm.errors import ComputationError, InputError
from ecm.io.arrays import B, F, I
from ecm.io.se3 import rotation, seen_from, turn_wrench
from ecm.rig.elastic import Elastic, Grading

T = TypeVar("T", bound="TrueEffect")
Random = np.random.Generator
Mechanism = Callable[[F], F]
"""Wrenches (N, 6) of the mechanism at poses (N, 6) of its top."""

LEVER_M = 0.033
"""Scales a force into a torque wherever one size scales both: N m per N."""
SENSOR_SCALE: F = np.repeat([1.0, LEVER_M], 3)
"""Units of a direction in sensor axes: forces, and torques over LEVER_M."""
MOTION_SCALE: F = np.repeat([1.0, 1.0 / 0.1], 3)
"""Units of a direction of motion: translations, and rotations times 0.1 m."""


@dataclass(frozen=True)
class RigScale:
    """What a draw and a largest size need to know of the rig and its plan."""

    length_m: float
    duration_s: float
    mean_temperature_degC: float
    mean_sensor_degC: float
    energy_J: float
    """Elastic energy of a typical pose."""
    tilts_rad: tuple[float, ...] = (0.3,)
    """Tilts of the platform's axis at the poses, in increasing order."""
    far_m: float = 0.02
    """Median distance from rest, rotation times the length."""
    loads: tuple[float, ...] = (50.0, 30.0, 30.0, 1.0, 2.0, 2.0)
    """Largest load of each axis of the sensor, N and N m."""
    ranges: tuple[float, ...] = (400.0, 200.0, 200.0, 20.0, 20.0, 20.0)
    """Range of the sensor, N and N m."""
    rest_stiffness: tuple[float, ...] = (24585.0, 3461.0, 3468.0, 4.0, 16.0, 16.0)
    """Diagonal of K of the mechanism at rest, N/m and N m/rad."""
    actuators: int = 3
    largest_input: float = 2e4
    """Largest input of all actuators, Pa."""


_PER_VISIT = {"per_visit": True}


def _no_rows() -> Any:
    return np.zeros(0)


@dataclass(frozen=True)
class Conditions:
    """What true effects may depend on: one row per visit, and the rig; unused parts stay empty."""

    length_m: float
    poses: F = field(default_factory=_no_rows, metadata=_PER_VISIT)
    """True poses of the platform; the rest pose where it is not connected to the sensor."""
    nearest: I = field(default_factory=_no_rows, metadata=_PER_VISIT)
    """Index of the solved pose of each visit."""
    time_s: F = field(default_factory=_no_rows, metadata=_PER_VISIT)
    temperature_degC: F = field(default_factory=_no_rows, metadata=_PER_VISIT)
    """Temperature of the mechanism."""
    sensor_temperature_degC: F = field(default_factory=_no_rows, metadata=_PER_VISIT)
    walk: F = field(default_factory=_no_rows, metadata=_PER_VISIT)
    """Random process of unit variance of the sensor's zero."""
    loaded: B = field(default_factory=_no_rows, metadata=_PER_VISIT)
    """Whether the mechanism is connected to the sensor."""
    mount_rad: F = field(default_factory=_no_rows, metadata=_PER_VISIT)
    """Angle about x at which the mechanism is mounted."""
    travel_s: F = field(default_factory=_no_rows, metadata=_PER_VISIT)
    dwell_s: F = field(default_factory=_no_rows, metadata=_PER_VISIT)
    arrival_m: F = field(default_factory=_no_rows, metadata=_PER_VISIT)
    """Last translation of the way to each visit."""
    inputs: F = field(default_factory=_no_rows, metadata=_PER_VISIT)
    """What acts in the actuators, (N, m); to a stage of the supply what they were set to."""
    actuators: tuple[str, ...] = ()
    """Columns of the actuators, such as pressure_1_Pa."""
    since_set_s: F = field(default_factory=_no_rows, metadata=_PER_VISIT)
    """Time since the actuators were set to something else."""
    ways: tuple[F, ...] = ()
    """Way points (k, 6), or (k, 6 + m) with what the actuators were set to, of each visit, from the
    one before on; always of all visits."""
    rested: tuple[bool, ...] = ()
    """Whether the mechanism's history starts again with that way; always of all visits."""
    moving: bool = False
    """The visits are samples of one motion in the order of time."""
    leg_s: Callable[[F], float] = lambda leg: 0.0
    """Duration of a leg (6,) of a way."""
    gravity_m_s2: F = field(default_factory=lambda: np.zeros(3))
    fts_range: F = field(default_factory=lambda: np.full(6, np.inf))
    sensor_from_top: F = field(default_factory=lambda: np.eye(6))
    """Adjoint (6, 6) that moves a wrench from the top frame to the sensor's."""
    elastic: Elastic | None = None
    gradings: Mapping[str, Grading] = field(default_factory=dict)
    led_places_m: F = field(default_factory=_no_rows)
    """Places (9, 3) of the LEDs about the target's centre."""
    leds_visible: Callable[[F], B] | None = None
    """Whether the camera locates each of the nine LEDs at poses (N, 6): (N, 9)."""
    whole: Conditions | None = None
    """All visits, where this is a selection of them."""
    selected: B | None = None
    """Which visits of `whole` these are."""
    memory: dict[Any, F] = field(default_factory=dict)
    """Histories that were computed before for the same visits, by their key."""

    def select(self, rows: B) -> Conditions:
        """The conditions of some visits."""
        names = [item.name for item in fields(self) if item.metadata == _PER_VISIT]
        parts = {name: getattr(self, name)[rows] for name in names}
        return replace(self, **parts, whole=self, selected=rows)

    def from_all(self, states: Callable[[Conditions], F]) -> F:
        """Rows of these visits, of states that are computed for all visits."""
        if self.whole is None or self.selected is None:
            return states(self)
        return states(self.whole)[self.selected]

    def from_history(self, effect: TrueEffect, states: Callable[[Conditions], F]) -> F:
        """The same for slow states that belong to an effect: they are computed only once."""

        def computed_once(whole: Conditions) -> F:
            key = (effect, self.elastic)
            if key not in self.memory:
                self.memory[key] = states(whole)
            return self.memory[key]

        return self.from_all(computed_once)

    @property
    def rest(self) -> F:
        """Top frame of the undeformed mechanism, (6,)."""
        return np.array([self.length_m, 0.0, 0.0, 0.0, 0.0, 0.0])

    def material_wrenches(self) -> F:
        """Wrenches (N, 6) of the elastic material at the true poses, without what inputs push."""
        assert self.elastic is not None
        at = np.hstack([self.poses, self.inputs])
        return self.elastic.wrench(self.nearest, at) - self.elastic.pushed(self.nearest, at)

    def per_way(self, wrenches: Callable[[F, F], F], *, of_material: bool = False) -> list[F]:
        """For each visit `wrenches` of its way points (k, 6) and of the elastic wrenches there."""
        assert self.elastic is not None
        points = np.concatenate(self.ways)
        ends = np.cumsum([len(way) for way in self.ways], dtype=np.int64)
        there = self.elastic.at_points(points, of_material=of_material)
        return np.split(wrenches(points[:, :6], there), ends[:-1])


@dataclass(frozen=True)
class Limit:
    """The largest size that something real could have, and what would show the effect better."""

    share: float
    """In shares of the unit's measure (`ecm.rig.inject.measure`)."""
    remedy: str
    """What to plan instead of a larger size."""


def drawn(how: Callable[[Random, RigScale], Any]) -> dict[str, Any]:
    """Metadata of a field of an effect that is drawn, or taken from the rig."""
    return {"drawn": how}


def between(low: float, high: float, of: str = "") -> dict[str, Any]:
    """The same of a number that lies between two, as shares of a scale of the rig if one is named.

    Examples
    --------
    >>> time_s = between(2.0, 2.0, of="duration_s")["drawn"]
    >>> time_s(np.random.default_rng(0), RigScale(0.1, 60.0, 22.0, 28.0, 0.3))
    120.0
    """
    return drawn(lambda random, rig: random.uniform(low, high) * (getattr(rig, of) if of else 1.0))


TRUE_EFFECTS: dict[str, type[TrueEffect]] = {}
"""What can be hidden, by its id in the catalogue of effects, in the order of application."""


@dataclass(frozen=True)
class TrueEffect:
    """A physical effect of the plant: `size` scales it, the other fields are its shape.

    A class says effect, name and unit in its head; one that names its effect can be hidden.
    """

    size: float

    effect: ClassVar[str]
    """Id in the catalogue of effects, for `--hide`."""
    name: ClassVar[str]
    """Name in the sealed file, where it is not the id."""
    unit: ClassVar[str]
    """Unit of `size`."""
    limit: ClassVar[Limit]
    grades: ClassVar[tuple[str, ...]] = ()
    """Further FEM solutions of the mechanism that the effect needs."""
    only_in_motion: ClassVar[bool] = False
    """Only the raw stream shows it."""
    of_actuators: ClassVar[bool] = False
    """It acts in an actuator."""
    follows_the_way: ClassVar[bool] = False
    """It depends on the wrenches at all way points, not only at the visits."""
    first_size: ClassVar[float] = 1.0
    """First guess of the size."""
    either_sign: ClassVar[bool] = False
    """Whether the size may be negative as well."""

    def __init_subclass__(cls, effect: str = "", name: str = "", unit: str = "") -> None:
        super().__init_subclass__()
        if unit:
            cls.unit = unit
        if effect:
            cls.effect, cls.name = effect, name or effect
            TRUE_EFFECTS[effect] = cls

    @classmethod
    def draw(cls: type[T], random: Random, rig: RigScale) -> T:
        """A random shape with a first guess of the size; only its sign is used."""
        sign = float(random.choice([-1.0, 1.0])) if cls.either_sign else 1.0
        shape = {f.name: f.metadata["drawn"] for f in fields(cls) if "drawn" in f.metadata}
        values = {name: _tuples(how(random, rig)) for name, how in shape.items()}
        return cls(sign * cls.first_size, **values)

    def resized(self: T, size: float) -> T:
        """The same shape at another size."""
        return replace(self, size=size)

    def parameters(self) -> dict[str, Any]:
        """Unit, size and shape for the sealed file."""
        return {"unit": self.unit, **asdict(self)}

    def with_parameters(self: T, parameters: Mapping[str, Any]) -> T:
        """The effect that `parameters` describe, which may have gone through JSON.

        Raises
        ------
        InputError
            Where the names are not those of this effect.
        """
        own = {item.name for item in fields(self)}
        names = set(parameters) - {"unit"}
        if names != own:
            raise InputError(
                f"sealed parameters {', '.join(sorted(names))}, expected "
                f"{', '.join(sorted(own))}: the truth was sealed by another version"
            )
        return replace(self, **{name: _tuples(parameters[name]) for name in own})

    def afterwards(self: T) -> T:
        """The same effect in a later campaign: what happened once stays.

        Processes of time and memory (ageing, creep, set, softening) start again.
        """
        return self


# --- the stages, in the order in which the plant applies them ----------------------------------


class Supply(TrueEffect):
    """Stage 0: an actuator does something else than what it was set to."""

    of_actuators: ClassVar[bool] = True
    acts_on: ClassVar[str] = "pressure"
    """Kind of the actuators in which it acts: pressure or tension."""

    def acting(self, inputs: F, at: Conditions) -> F:
        """What acts (N, m), from what the stage before gives; `at.inputs` is what was set."""
        raise NotImplementedError


class BodyPose(TrueEffect):
    """Stage 1: the body is deformed by another pose than that of the platform."""

    def body_pose(self, poses: F, at: Conditions) -> F:
        """Poses (N, 6) of the body for poses (N, 6) of the platform."""
        raise NotImplementedError

    def platform_wrench(self, wrenches: F, poses: F, body: F, at: Conditions) -> F:
        """Wrenches (N, 6) of the body at the platform; `body` is `body_pose` of `poses`."""
        return wrenches


class BodyVariation(TrueEffect):
    """Stage 2: the body has another shape or modulus, known from further FEM solutions."""

    def wrench(self, step: F, at: Conditions) -> F:
        """Added wrench (N, 6) at `step` (N, 6) from the solved poses."""
        raise NotImplementedError


class MaterialFactor(TrueEffect):
    """Stage 3: the wrench of the material is multiplied by a factor, what inputs push is not."""

    def factor(self, at: Conditions) -> F:
        """Factor (N,) on the wrench of the material."""
        raise NotImplementedError


class MaterialMemory(TrueEffect):
    """Stage 4: the material adds a wrench that depends on its history."""

    def memory_wrench(self, at: Conditions) -> F:
        """Added wrench (N, 6)."""
        raise NotImplementedError


class Clamp(TrueEffect):
    """Stage 5: the base gives way; mechanism and base are in equilibrium, exact in SE(3)."""

    part: ClassVar[str]
    """Words for error messages."""
    iterations: ClassVar[int] = 100
    tolerance: ClassVar[float] = 1e-12
    tilt_limit_rad: ClassVar[float] = 0.5
    half_steps: ClassVar[bool] = False

    def motion(self, wrenches: F, length_m: float) -> F:
        """Motion (N, 6) of the base under wrenches (N, 6) about the base origin."""
        raise NotImplementedError

    def solve(self, poses: F, length_m: float, mechanism: Mechanism) -> F:
        """World wrench at top poses given in the world, by fixed-point iteration.

        Parameters
        ----------
        poses
            Top frames in the world (N, 6).
        mechanism
            Its wrenches in the axes of the base at top poses relative to the base.

        Returns
        -------
        ndarray
            Wrenches (N, 6) at the top in world axes.

        Raises
        ------
        ComputationError
            Where the base is so soft that it does not hold the mechanism.
        """
        base = np.zeros_like(poses)
        for _ in range(self.iterations):
            if not np.max(np.abs(base[:, 3:]), initial=0.0) <= self.tilt_limit_rad:
                break
            about_base = self._in_world(base, poses, mechanism)
            about_base[:, 3:] += np.cross(poses[:, :3], about_base[:, :3])
            moved = self.motion(about_base, length_m)
            change = float(np.max(np.abs(moved - base), initial=0.0))
            base = 0.5 * (base + moved) if self.half_steps else moved
            if change < self.tolerance:
                return self._in_world(base, poses, mechanism)
        raise ComputationError(
            f"{self.part}: no equilibrium at a rotation compliance of {self.size:g} rad/(N m); "
            "expected one much below 1/K of the mechanism. Hide a smaller effect"
        )

    @staticmethod
    def _in_world(base: F, poses: F, mechanism: Mechanism) -> F:
        return turn_wrench(rotation(base[:, 3:]), mechanism(seen_from(base, poses)))


class PlatformLoad(TrueEffect):
    """Stage 6: something besides mechanism and sensor acts on the platform."""

    def load(self, at: Conditions) -> F:
        """Wrench (N, 6) on the platform in base axes, about the top frame's origin."""
        raise NotImplementedError


class SensorFrame(TrueEffect):
    """Stage 7: the sensor is not where its frame says."""

    def reading(self, wrenches: F, at: Conditions) -> F:
        """Wrenches (N, 6) in the true sensor frame, from those in the stated one."""
        raise NotImplementedError


class SensorReading(TrueEffect):
    """Stage 8: the sensor reads something else than the wrench."""

    def reading(self, wrenches: F, at: Conditions) -> F:
        """Readings (N, 6) in sensor axes."""
        raise NotImplementedError


class CameraPose(TrueEffect):
    """Stage 9: the camera reports another pose."""

    def measured(self, poses: F, at: Conditions) -> F:
        """Poses (N, 6) as the camera reports them."""
        raise NotImplementedError


class Clock(TrueEffect):
    """Stage 10: a row of the raw stream holds the wrench of another moment."""

    only_in_motion: ClassVar[bool] = True

    def read_s(self, stamp_s: F) -> F:
        """Moments (N,) whose wrenches stand under these time stamps."""
        raise NotImplementedError


# --- draws and formulas that several effects share ---------------------------------------------


def unit_vector(random: Random) -> F:
    """A random direction (3,) in space."""
    vector = random.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


def balanced_direction(random: Random) -> F:
    """A direction of six axes with no small entry."""
    sizes = random.uniform(0.4, 1.0, 6) * random.choice([-1.0, 1.0], 6)
    return np.asarray(sizes / np.linalg.norm(sizes))


UNIT_VECTOR = drawn(lambda random, rig: unit_vector(random))
"""Metadata of a field that holds a direction in space."""
DIRECTION = drawn(lambda random, rig: balanced_direction(random))
"""Metadata of a field that holds a balanced direction."""
DURATION = drawn(lambda random, rig: rig.duration_s)
"""Metadata of a field that holds the end of the campaign."""
MEAN_TEMPERATURE = drawn(lambda random, rig: rig.mean_temperature_degC)
"""Metadata of a field that holds the temperature about which the effect is 0."""


def metric_root(length_m: float) -> F:
    """Scales (6,) of a deflection: rotations times the length."""
    return np.repeat([1.0, length_m], 3)


def _tuples(value: Any) -> Any:
    """Arrays and lists as tuples of plain numbers, which an effect can be compared by."""
    listed = value.tolist() if isinstance(value, np.ndarray) else value
    return tuple(_tuples(item) for item in listed) if isinstance(listed, list) else listed
