"""Errors of the force-torque sensor: frame, cross-talk, gain, saturation, hysteresis, zero.

Largest sizes: a third in gain, a tenth in cross-talk, a quarter of the range in the zero or nearly
half of the hysteresis are beyond any data sheet; such a sensor is repaired, not modelled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.io.se3 import rotation, transpose, turn_wrench
from ecm.rig.physics.true_effect import (
    DIRECTION,
    SENSOR_SCALE,
    UNIT_VECTOR,
    Conditions,
    Limit,
    Random,
    RigScale,
    SensorFrame,
    SensorReading,
    balanced_direction,
    between,
    drawn,
    unit_vector,
)

_SHIFT = drawn(lambda random, rig: random.uniform(0.05, 0.2) * unit_vector(random))
_TALK = drawn(lambda random, rig: random.standard_normal((6, 6)) * (1.0 - np.eye(6)))
_GAINS = drawn(lambda random, rig: np.sqrt(6.0) * balanced_direction(random))
_WIDTHS = drawn(
    lambda random, rig: random.uniform(0.05, 0.5, (6, 3)) * np.asarray(rig.loads)[:, None]
)


@dataclass(frozen=True)
class SensorSeat(SensorFrame, effect="fts_frame", name="sensor_seat", unit="rad"):
    """The sensor sits askew: its frame is not where the rig file says, exact in SE(3).

    `size` is the rotation of the sensor's frame.
    """

    shift_m_rad: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), metadata=_SHIFT)
    """Shift of its origin per rad, sensor axes."""
    axis: tuple[float, float, float] = field(default=(1.0, 0.0, 0.0), metadata=UNIT_VECTOR)

    limit: ClassVar[Limit] = Limit(0.2, "larger forces")
    first_size: ClassVar[float] = 5e-3

    def reading(self, wrenches: F, at: Conditions) -> F:
        back = rotation(-self.size * np.asarray(self.axis)[None])
        moved = np.array(wrenches)
        moved[:, 3:] -= np.cross(self.size * np.asarray(self.shift_m_rad), wrenches[:, :3])
        return turn_wrench(back, moved)


@dataclass(frozen=True)
class SensorCrosstalk(SensorReading, effect="fts_crosstalk", name="sensor_crosstalk", unit="1"):
    """Axes that read each other, with a part that grows with the load of the other axis.

    r_i -> r_i + sum over j of c_ij r_j (1 + r_j/(10 range_j)), where a torque counts over LEVER_M.
    `size` is a typical entry of the matrix.
    """

    matrix: tuple[tuple[float, ...], ...] = field(metadata=_TALK)
    """Pattern (6, 6) with an empty diagonal."""

    limit: ClassVar[Limit] = Limit(0.1, "loads on every axis")
    first_size: ClassVar[float] = 0.005

    def reading(self, wrenches: F, at: Conditions) -> F:
        bent = wrenches * (1.0 + wrenches / (10.0 * at.fts_range)) / SENSOR_SCALE
        matrix = np.asarray(self.matrix)
        talk: F = self.size * SENSOR_SCALE * np.einsum("ij,nj->ni", matrix, bent)
        return wrenches + talk


@dataclass(frozen=True)
class SensorGain(SensorReading, effect="fts_gain", name="sensor_gain", unit="1"):
    """Gain errors of the axes, with a slight compression towards the range.

    r_i -> r_i (1 + g_i) / (1 + (g_i r_i / (4 range_i))^2): not a pure factor. `size` is a typical
    gain error.
    """

    pattern: tuple[float, ...] = field(default=(1.0, -1.0, 0.5, -0.5, 1.0, -1.0), metadata=_GAINS)
    """Gain error of each axis over `size`."""

    limit: ClassVar[Limit] = Limit(0.3, "loads on every axis")
    first_size: ClassVar[float] = 0.01

    def reading(self, wrenches: F, at: Conditions) -> F:
        gain = self.size * np.asarray(self.pattern)
        return wrenches * (1.0 + gain) / (1.0 + (gain * wrenches / (4.0 * at.fts_range)) ** 2)


@dataclass(frozen=True)
class SensorKnee(SensorReading, effect="fts_saturation", name="sensor_knee", unit="1/N or 1/(N m)"):
    """An amplifier that saturates softly: beyond a knee the reading grows ever less.

    r -> r below the knee k of an axis, and sign(r) (k + u/(1 + s u)) above it, with u = |r| - k:
    s = 0 is straight, and k + 1/s is never reached. `size` is s.
    """

    axis: int = 0
    knee: float = 50.0
    """Load in N or N m."""

    limit: ClassVar[Limit] = Limit(4.0, "larger loads")

    @classmethod
    def draw(cls, random: Random, rig: RigScale) -> SensorKnee:
        axis = int(random.choice(3))
        return cls(1e-3, axis=axis, knee=float(random.uniform(0.1, 0.4)) * rig.loads[axis])

    def reading(self, wrenches: F, at: Conditions) -> F:
        readings = np.array(wrenches)
        load = wrenches[:, self.axis]
        over = np.maximum(0.0, np.abs(load) - self.knee)
        lost = self.size * over**2 / (1.0 + self.size * over)
        readings[:, self.axis] = load - np.sign(load) * lost
        return readings


@dataclass(frozen=True)
class SensorPlay(SensorReading, effect="fts_hysteresis", name="sensor_play", unit="1"):
    """Hysteresis of the sensor: a Preisach model with a few play operators per axis.

    Each operator follows the load at a distance of its width; the reading lags by `size` times the
    mean lag of the operators. It acts without the mechanism as well (dead weights).
    """

    widths: tuple[tuple[float, ...], ...] = field(
        default=((1.0,), (1.0,), (1.0,), (0.03,), (0.03,), (0.03,)), metadata=_WIDTHS
    )
    """Widths of the operators of each axis, N and N m."""

    limit: ClassVar[Limit] = Limit(0.4, "approaches from several sides")
    follows_the_way: ClassVar[bool] = True
    first_size: ClassVar[float] = 0.05

    def lag(self, loads: Sequence[F]) -> F:
        """Mean lag (N, 6) after the loads (k, 6) on the sensor since the reading before.

        The first load of each entry may be the last one of the entry before.
        """
        widths = np.asarray(self.widths)
        state = np.zeros_like(widths)
        lags = np.zeros((len(loads), 6))
        for i, passed in enumerate(loads):
            for load in passed:
                state = np.clip(state, load[:, None] - widths, load[:, None] + widths)
            lags[i] = state.mean(axis=1) - passed[-1]
        return lags

    def reading(self, wrenches: F, at: Conditions) -> F:
        # The lag does not depend on the size, which the calibration of a strength varies.
        lag: F = self.size * at.from_history(self.resized(1.0), self._lag_on_the_way)
        return wrenches + lag

    def _lag_on_the_way(self, at: Conditions) -> F:
        def in_sensor_axes(points: F, wrenches: F) -> F:
            turned = turn_wrench(transpose(rotation(points[:, 3:])), wrenches)
            return np.asarray(turned @ at.sensor_from_top.T)

        loads = at.per_way(in_sensor_axes)
        return self.lag(
            [np.where(on, load, 0.0) for load, on in zip(loads, at.loaded, strict=True)]
        )


@dataclass(frozen=True)
class SensorStrain(SensorReading, effect="fts_offset", name="sensor_strain", unit="N"):
    """Strain that fastening puts into the sensor: a constant reading in its own frame.

    It comes when the sensor is bolted to the platform, so no unloaded reading shows it, and the
    zero that is subtracted does not contain it. `size` is the force part; the torque part is
    scaled by LEVER_M.
    """

    direction: tuple[float, ...] = field(default=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0), metadata=DIRECTION)
    """In sensor axes: force directions, then torque directions over LEVER_M."""

    limit: ClassVar[Limit] = Limit(0.25, "poses that turn on all sides")
    first_size: ClassVar[float] = 0.5

    def reading(self, wrenches: F, at: Conditions) -> F:
        strain: F = self.size * SENSOR_SCALE * np.asarray(self.direction)
        return wrenches + at.loaded[:, None] * strain


@dataclass(frozen=True)
class SensorWarmUp(SensorReading, effect="fts_drift", name="sensor_warm_up", unit="N"):
    """Zero of the sensor while it warms up: saturating, with a slow random part on top.

        b(t) = d (1 - exp(-t/tau)) + wander

    The rig reads the unloaded sensor before and after and subtracts the straight line between the
    readings; what is left then is the curvature. Hidden as an effect, the later readings are lost:
    only the first is subtracted, and the whole drift stays in the data. `size` is the force part
    of the change when warm.
    """

    direction: tuple[float, ...] = field(default=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0), metadata=DIRECTION)
    """In sensor axes: force directions, then torque directions over LEVER_M."""
    time_s: float = field(default=3600.0, metadata=between(1.0, 3.0, of="duration_s"))
    """tau."""
    wander: float = field(default=0.0, metadata=between(0.0, 0.05))
    """Standard deviation of the slow random part as a share of the change."""
    later_readings_lost: bool = field(default=False, metadata=drawn(lambda random, rig: True))
    """Only the first unloaded reading is subtracted."""

    limit: ClassVar[Limit] = Limit(0.25, "a longer campaign")

    def reading(self, wrenches: F, at: Conditions) -> F:
        warm = -np.expm1(-at.time_s / self.time_s)[:, None] * np.asarray(self.direction)
        drift: F = self.size * SENSOR_SCALE * (warm + self.wander * at.walk)
        return wrenches + drift


@dataclass(frozen=True)
class SensorThermal(SensorReading, effect="fts_thermal_drift", name="sensor_thermal", unit="N/K"):
    """Zero of the sensor against its own temperature: a bent curve, not a straight line.

        b(T) = d (exp((T - T0)/S) - 1) S,   with S some tens of kelvin

    No unloaded reading corrects it. `size` is the force part per kelvin at T0.
    """

    direction: tuple[float, ...] = field(default=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0), metadata=DIRECTION)
    """In sensor axes: force directions, then torque directions over LEVER_M."""
    reference_degC: float = field(
        default=28.0, metadata=drawn(lambda random, rig: rig.mean_sensor_degC)
    )
    bend_K: float = 25.0

    limit: ClassVar[Limit] = Limit(0.05, "a warm-up between the poses")
    first_size: ClassVar[float] = 0.3

    def reading(self, wrenches: F, at: Conditions) -> F:
        warm = (at.sensor_temperature_degC - self.reference_degC) / self.bend_K
        bent = self.size * (self.bend_K * np.expm1(warm))[:, None]
        drift: F = at.loaded[:, None] * (bent * (SENSOR_SCALE * np.asarray(self.direction)))
        return wrenches + drift
