"""What can be hidden in the instruments of the rod: sensor, camera, frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blind_parts.rod import turn, turn_back
from blind_parts.rod_effects import Draw, Made, _sign, _unit
from blind_parts.rod_state import RANGE, Change, Physics, RodState
from blind_parts.rod_visits import Visits

F = NDArray[np.float64]
_ARM = np.array([1.0, 1.0, 1.0, 0.033, 0.033, 0.033])


def _sensor(first: float, change_of: object) -> Made:
    make = change_of
    return first, lambda size: Physics(sensor=[make(size)])  # type: ignore[operator]


def _seen(first: float, change_of: object) -> Made:
    make = change_of
    return first, lambda size: Physics(seen=[make(size)])  # type: ignore[operator]


def fts_offset(random: np.random.Generator, rod_state: RodState) -> Made:
    """Bolts strain the sensor when the platform is fastened: never seen when it is free."""
    direction = _unit(random, 6) * _ARM

    def make(size: float) -> Change:
        return lambda raw, top, c: raw + size * direction * c.loaded[:, None]

    return _sensor(0.5, make)


def fts_drift(random: np.random.Generator, rod_state: RodState) -> Made:
    """Creep of the gauges' glue: a power of time, zeroed once at the beginning."""
    direction = _unit(random, 6) * _ARM
    power = float(random.uniform(0.7, 1.2))
    end = float(rod_state.first.time_s[-1])

    def make(size: float) -> Change:
        return lambda raw, top, c: raw + size * np.outer((c.time_s / end) ** power, direction)

    return _sensor(1.0, make)


def fts_thermal_drift(random: np.random.Generator, rod_state: RodState) -> Made:
    direction = _unit(random, 6) * _ARM
    bend = float(random.uniform(-0.02, 0.02))

    def make(size: float) -> Change:
        def change(raw: F, top: F, c: Visits) -> F:
            warm = c.sensor_degC - c.sensor_degC[0]
            return raw + size * np.outer(warm + bend * warm**2, direction)

        return change

    return _sensor(0.2, make)


def fts_gain(random: np.random.Generator, rod_state: RodState) -> Made:
    pattern = _unit(random, 6) * np.sqrt(6.0)

    def make(size: float) -> Change:
        return lambda raw, top, c: raw * (1.0 + size * pattern * (1.0 - (raw / RANGE) ** 2))

    return _sensor(0.01, make)


def fts_crosstalk(random: np.random.Generator, rod_state: RodState) -> Made:
    matrix = random.standard_normal((6, 6)) * (1.0 - np.eye(6))
    matrix = _ARM[:, None] * matrix / _ARM

    def make(size: float) -> Change:
        return lambda raw, top, c: raw + size * raw @ matrix.T

    return _sensor(0.005, make)


def fts_saturation(random: np.random.Generator, rod_state: RodState) -> Made:
    """An amplifier that bends before it clips: the stated range is not reached."""
    first = len(rod_state.first.poses)
    raw = rod_state.raw(Physics())[:first][rod_state.loaded[:first]]
    axis = int(random.choice([0, 1, 2]))
    knee = 0.6 * float(np.abs(raw[:, axis]).max())

    def make(size: float) -> Change:
        def change(raw: F, top: F, c: Visits) -> F:
            out = np.array(raw)
            over = np.maximum(0.0, np.abs(raw[:, axis]) - knee)
            out[:, axis] -= np.sign(raw[:, axis]) * over * over / (over + 1.0 / size)
            return out

        return change

    return _sensor(0.05, make)


def fts_hysteresis(random: np.random.Generator, rod_state: RodState) -> Made:
    """Prandtl and Ishlinskii: a few play operators along the sensor's own loading."""
    widths = RANGE[:, None] * random.uniform(0.005, 0.06, (6, 3))

    def make(size: float) -> Change:
        def change(raw: F, top: F, c: Visits) -> F:
            state = np.zeros((6, 3))
            out = np.array(raw)
            for i, way in enumerate(c.ways):
                for goal, _, _ in way:
                    load = np.zeros(6) if goal < 0 else raw[goal]
                    state = np.clip(state, load[:, None] - widths, load[:, None] + widths)
                # What hangs on the free sensor is no place on the way.
                state = np.clip(state, raw[i][:, None] - widths, raw[i][:, None] + widths)
                out[i] = raw[i] + size * (state.mean(axis=1) - raw[i])
            return out

        return change

    return _sensor(0.05, make)


def fts_frame(random: np.random.Generator, rod_state: RodState) -> Made:
    """The sensor is bolted on askew and off the centre."""
    shift, axis = _unit(random, 3), _unit(random, 3)

    def make(size: float) -> Change:
        def change(raw: F, top: F, c: Visits) -> F:
            matrix = turn(2.0 * size * axis / 0.1)
            force = raw[:, :3] @ matrix.T
            moment = raw[:, 3:] @ matrix.T + np.cross(size * shift, force)
            return np.concatenate([force, moment], axis=1)

        return change

    return _sensor(1e-3, make)


def base_frame_misalignment(random: np.random.Generator, rod_state: RodState) -> Made:
    axis, shift = _unit(random, 3), _unit(random, 3) * float(random.uniform(0.01, 0.03))

    def make(size: float) -> Change:
        def change(p: F, raw: F, c: Visits) -> F:
            matrix = turn(size * axis)
            place = size * shift + p[:, :3] @ matrix.T
            return np.concatenate([place, turn_back(matrix @ turn(p[:, 3:]))], axis=1)

        return change

    return _seen(2e-3, make)


def tip_frame_misalignment(random: np.random.Generator, rod_state: RodState) -> Made:
    axis, shift = _unit(random, 3), _unit(random, 3) * float(random.uniform(0.01, 0.03))

    def make(size: float) -> Change:
        def change(p: F, raw: F, c: Visits) -> F:
            matrices = turn(p[:, 3:])
            place = p[:, :3] + size * np.einsum("nij,j->ni", matrices, shift)
            return np.concatenate([place, turn_back(matrices @ turn(size * axis))], axis=1)

        return change

    return _seen(2e-3, make)


def camera_scale(random: np.random.Generator, rod_state: RodState) -> Made:
    """A focal length that is off: sideways by s, along the line of sight by a little more."""
    sign, depth = _sign(random), float(random.uniform(0.9, 1.3))
    scale = np.array([1.0, depth, 1.0])

    def make(size: float) -> Change:
        def change(p: F, raw: F, c: Visits) -> F:
            place = p[:, :3] + sign * size * scale * (p[:, :3] - c.rest[:3])
            return np.concatenate([place, p[:, 3:]], axis=1)

        return change

    return _seen(3e-3, make)


def marker_motion(random: np.random.Generator, rod_state: RodState) -> Made:
    """The base marker is knocked, or sags: everything seems to move the other way."""
    direction = _unit(random, 6) * np.repeat([1.0, 1.0 / 0.15], 3)
    end = float(rod_state.first.time_s[-1])
    at, width = float(random.uniform(0.3, 0.7)) * end, float(random.choice([0.01, 0.3])) * end

    def make(size: float) -> Change:
        def change(p: F, raw: F, c: Visits) -> F:
            move = np.outer(0.5 + 0.5 * np.tanh((c.time_s - at) / width), size * direction)
            matrices = turn(-move[:, 3:])
            place = np.einsum("nij,nj->ni", matrices, p[:, :3] - move[:, :3])
            return np.concatenate([place, turn_back(matrices @ turn(p[:, 3:]))], axis=1)

        return change

    return _seen(1e-4, make)


def led_occlusion(random: np.random.Generator, rod_state: RodState) -> Made:
    """Beyond an angle some LEDs are hidden: the mean of the rest lies off the centre."""
    offset = _unit(random, 6) * np.repeat([1.0, 1.0 / 0.05], 3)

    def make(size: float) -> Change:
        def change(p: F, raw: F, c: Visits) -> F:
            hidden = occluded(p, rod_state.lens_azimuth_rad) / 9.0
            matrices = turn(p[:, 3:])
            move = np.outer(hidden, size * offset)
            place = p[:, :3] + np.einsum("nij,nj->ni", matrices, move[:, :3])
            return np.concatenate([place, turn_back(matrices @ turn(move[:, 3:]))], axis=1)

        return change

    return _seen(2e-4, make)


def occluded(poses: F, azimuth: float) -> F:
    """How many of nine LEDs the lenses do not see, (N,)."""
    tilt = poses[:, 4] * np.cos(azimuth) + poses[:, 5] * np.sin(azimuth)
    return np.asarray(np.clip(np.floor((tilt - 0.15) / 0.06), 0.0, 5.0))


INSTRUMENTS: dict[str, Draw] = {
    "fts_offset": fts_offset,
    "fts_drift": fts_drift,
    "fts_thermal_drift": fts_thermal_drift,
    "fts_gain": fts_gain,
    "fts_crosstalk": fts_crosstalk,
    "fts_saturation": fts_saturation,
    "fts_hysteresis": fts_hysteresis,
    "fts_frame": fts_frame,
    "base_frame_misalignment": base_frame_misalignment,
    "tip_frame_misalignment": tip_frame_misalignment,
    "camera_scale": camera_scale,
    "marker_motion": marker_motion,
    "led_occlusion": led_occlusion,
}
