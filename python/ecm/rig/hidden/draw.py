"""Which physical truth stands behind an id of the catalogue, and how its shape is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ecm.rig.elastic import COS2, SIN2, STIFF, TAPER, THICK
from ecm.rig.physics import Physics, Sized
from ecm.rig.physics.ageing import Ageing
from ecm.rig.physics.anisotropy import Anisotropy
from ecm.rig.physics.base_frame import BaseFrame
from ecm.rig.physics.base_plate import BasePlate
from ecm.rig.physics.cable import Cable
from ecm.rig.physics.camera_scale import CameraScale
from ecm.rig.physics.face_tilt import FaceTilt
from ecm.rig.physics.graded import Graded
from ecm.rig.physics.hysteresis import Hysteresis
from ecm.rig.physics.leds import LEDS, Leds
from ecm.rig.physics.lift_off import LiftOff
from ecm.rig.physics.marker_motion import MarkerMotion
from ecm.rig.physics.mounting_gap import MountingGap
from ecm.rig.physics.natural_bend import NaturalBend
from ecm.rig.physics.own_weight import OwnWeight
from ecm.rig.physics.payload import Payload
from ecm.rig.physics.permanent_set import PermanentSet
from ecm.rig.physics.platform_slip import PlatformSlip
from ecm.rig.physics.relaxation import Relaxation
from ecm.rig.physics.sensor_crosstalk import SensorCrosstalk
from ecm.rig.physics.sensor_gain import SensorGain
from ecm.rig.physics.sensor_knee import SensorKnee
from ecm.rig.physics.sensor_play import SensorPlay
from ecm.rig.physics.sensor_seat import SensorSeat
from ecm.rig.physics.sensor_strain import SensorStrain
from ecm.rig.physics.sensor_thermal import SensorThermal
from ecm.rig.physics.sensor_warm_up import SensorWarmUp
from ecm.rig.physics.softening import Softening
from ecm.rig.physics.stop import Stop
from ecm.rig.physics.temperature import Temperature
from ecm.rig.physics.time_skew import TimeSkew
from ecm.rig.physics.tip_target import TipTarget

Random = np.random.Generator


@dataclass(frozen=True)
class Scale:
    """What a draw needs to know of the rig."""

    length_m: float
    duration_s: float
    mean_temperature_degC: float
    mean_sensor_degC: float
    energy_J: float
    """Of a typical pose."""
    tilts_rad: tuple[float, ...] = (0.3,)
    """Of the platform's axis at the poses, growing."""
    far_m: float = 0.02
    """Median distance from rest, rotation counted with the length."""
    loads: tuple[float, ...] = (50.0, 30.0, 30.0, 1.0, 2.0, 2.0)
    """Largest load of each axis of the sensor, N and N m."""
    ranges: tuple[float, ...] = (400.0, 200.0, 200.0, 20.0, 20.0, 20.0)
    """Of the sensor, N and N m."""
    rest_stiffness: tuple[float, ...] = (24585.0, 3461.0, 3468.0, 4.0, 16.0, 16.0)
    """Diagonal of K of the mechanism at rest, N/m and N m/rad."""


def _unit(random: Random, count: int) -> tuple[float, ...]:
    vector = random.standard_normal(count)
    return tuple((vector / np.linalg.norm(vector)).tolist())


def _balanced(random: Random) -> tuple[float, ...]:
    """A direction of six in which no axis is forgotten."""
    sizes = random.uniform(0.4, 1.0, 6) * random.choice([-1.0, 1.0], 6)
    return tuple((sizes / np.linalg.norm(sizes)).tolist())


def _sign(random: Random) -> float:
    return float(random.choice([-1.0, 1.0]))


def _strain(random: Random, scale: Scale) -> Sized:
    return SensorStrain(0.5, direction=_balanced(random))


def _warm_up(random: Random, scale: Scale) -> Sized:
    return SensorWarmUp(
        1.0,
        direction=_balanced(random),
        time_s=float(random.uniform(1.0, 3.0)) * scale.duration_s,
        wander=float(random.uniform(0.0, 0.05)),
        later_readings_lost=True,
    )


def _payload(random: Random, scale: Scale) -> Sized:
    share = float(random.uniform(0.5, 0.8))
    first = (float(random.uniform(0.01, 0.05)), *random.uniform(-0.01, 0.01, 2).tolist())
    second = (float(random.uniform(0.0, 0.03)), *random.uniform(-0.03, 0.03, 2).tolist())
    places = ((first[0], first[1], first[2]), (second[0], second[1], second[2]))
    return Payload(0.1, shares=(share, 1.0 - share), places_m=places)


def _base_plate(random: Random, scale: Scale) -> Sized:
    return BasePlate(
        1e-3,
        uneven=float(random.uniform(-0.2, 0.2)),
        twist_share=float(random.uniform(0.1, 0.4)),
        lateral_share=float(random.uniform(0.02, 0.08)),
        axial_share=float(random.uniform(0.0, 0.02)),
    )


def _tip_target(random: Random, scale: Scale) -> Sized:
    axis = _unit(random, 3)
    shift = 0.3 * scale.length_m * random.uniform(0.2, 1.0) * np.asarray(_unit(random, 3))
    return TipTarget(
        2e-3, axis=(axis[0], axis[1], axis[2]), shift_m_rad=(shift[0], shift[1], shift[2])
    )


def _hysteresis(random: Random, scale: Scale) -> Sized:
    return Hysteresis(
        1e-4,
        yield_m=float(random.uniform(0.02, 0.05)) * scale.length_m,
        exponent=float(random.uniform(1.2, 2.0)),
        beta=float(random.uniform(0.5, 0.8)),
    )


def _temperature(random: Random, scale: Scale) -> Sized:
    return Temperature(_sign(random) * 0.01, reference_degC=scale.mean_temperature_degC)


def _anisotropy(random: Random, scale: Scale) -> Sized:
    return Anisotropy(0.03, angle_rad=float(random.uniform(0.0, np.pi)))


def _relaxation(random: Random, scale: Scale) -> Sized:
    shares = random.dirichlet([4.0, 4.0, 4.0])
    return Relaxation(
        0.05,
        shares=tuple(shares.tolist()),
        times_s=tuple((np.array([1.0, 8.0, 60.0]) * random.uniform(0.6, 1.6, 3)).tolist()),
    )


def _ageing(random: Random, scale: Scale) -> Sized:
    return Ageing(0.02, time_s=float(random.uniform(0.5, 2.0)) * scale.duration_s)


def _softening(random: Random, scale: Scale) -> Sized:
    return Softening(0.05, energy_J=float(random.uniform(0.3, 1.0)) * scale.energy_J)


def _thermal(random: Random, scale: Scale) -> Sized:
    return SensorThermal(0.3, direction=_balanced(random), reference_degC=scale.mean_sensor_degC)


def _gain(random: Random, scale: Scale) -> Sized:
    return SensorGain(0.01, pattern=tuple((np.sqrt(6.0) * np.asarray(_balanced(random))).tolist()))


def _camera_scale(random: Random, scale: Scale) -> Sized:
    return CameraScale(_sign(random) * 0.005)


def _base_frame(random: Random, scale: Scale) -> Sized:
    axis = _unit(random, 3)
    shift = 0.3 * scale.length_m * random.uniform(0.2, 1.0) * np.asarray(_unit(random, 3))
    return BaseFrame(
        2e-3, axis=(axis[0], axis[1], axis[2]), shift_m_rad=(shift[0], shift[1], shift[2])
    )


def _marker_motion(random: Random, scale: Scale) -> Sized:
    end = scale.duration_s
    step = float(random.uniform(0.3, 0.7)) * end if random.random() < 0.5 else 1e12
    return MarkerMotion(
        1e-4,
        direction=_balanced(random),
        time_s=float(random.uniform(0.3, 2.0)) * end,
        end_s=end,
        step_s=step,
    )


def _platform_slip(random: Random, scale: Scale) -> Sized:
    at = float(random.uniform(0.3, 0.7)) * scale.duration_s
    return PlatformSlip(1e-4, direction=_balanced(random), at_s=at)


def _mounting_gap(random: Random, scale: Scale) -> Sized:
    return MountingGap(_sign(random) * 1e-4)


def _crosstalk(random: Random, scale: Scale) -> Sized:
    matrix = random.standard_normal((6, 6)) * (1.0 - np.eye(6))
    return SensorCrosstalk(0.005, matrix=tuple(tuple(row) for row in matrix.tolist()))


def _cable(random: Random, scale: Scale) -> Sized:
    length = scale.length_m
    azimuth = float(random.uniform(0.0, 2.0 * np.pi))
    side = np.array([np.cos(azimuth), np.sin(azimuth)])
    place, clamp = 0.3 * length * side, float(random.uniform(2.0, 3.0)) * length * side
    way = float(random.uniform(0.3, 1.2)) * length
    return Cable(
        20.0,
        place_m=(0.1 * length, float(place[0]), float(place[1])),
        clamp_m=(way, float(clamp[0]), float(clamp[1])),
        free_m=float(np.linalg.norm(clamp - place)) * float(random.uniform(0.9, 1.05)),
    )


def _axis(random: Random) -> tuple[float, float, float]:
    a, b, c = _unit(random, 3)
    return a, b, c


def _stop(random: Random, scale: Scale) -> Sized:
    return Stop(
        1e3,
        limit_rad=float(np.quantile(scale.tilts_rad, random.uniform(0.5, 0.75))),
        friction=float(random.uniform(0.1, 0.3)),
    )


def _permanent_set(random: Random, scale: Scale) -> Sized:
    return PermanentSet(
        1e-4,
        yield_m=float(random.uniform(0.8, 1.1)) * scale.far_m,
        time_s=float(random.uniform(3.0, 20.0)),
    )


def _lift_off(random: Random, scale: Scale) -> Sized:
    return LiftOff(1e-4, opening_N=float(random.uniform(10.0, 30.0)))


def _face_tilt(random: Random, scale: Scale) -> Sized:
    return FaceTilt(2e-3, azimuth_rad=float(random.uniform(0.0, 2.0 * np.pi)))


def _natural_bend(random: Random, scale: Scale) -> Sized:
    return NaturalBend(2e-3, azimuth_rad=float(random.uniform(0.0, 2.0 * np.pi)))


def _taper(random: Random, scale: Scale) -> Sized:
    return Graded(_sign(random) * 0.02, grade=TAPER)


def _thick(random: Random, scale: Scale) -> Sized:
    return Graded(_sign(random) * 0.01, grade=THICK)


def _stiff(random: Random, scale: Scale) -> Sized:
    return Graded(0.05, grade=STIFF)


def _own_weight(random: Random, scale: Scale) -> Sized:
    return OwnWeight(0.3)


def _knee(random: Random, scale: Scale) -> Sized:
    # An axis that works: the load with most of its range.
    axis = int(random.choice(3))
    return SensorKnee(1e-3, axis=axis, knee=float(random.uniform(0.1, 0.4)) * scale.loads[axis])


def _play(random: Random, scale: Scale) -> Sized:
    share = random.uniform(0.05, 0.5, (6, 3)) * np.asarray(scale.loads)[:, None]
    return SensorPlay(0.05, widths=tuple(tuple(row) for row in share.tolist()))


def _seat(random: Random, scale: Scale) -> Sized:
    shift = random.uniform(0.05, 0.2) * np.asarray(_unit(random, 3))
    return SensorSeat(5e-3, axis=_axis(random), shift_m_rad=(shift[0], shift[1], shift[2]))


def _leds(random: Random, scale: Scale) -> Sized:
    errors = random.standard_normal((LEDS, 3))
    return Leds(1e-3, errors=tuple(tuple(row) for row in errors.tolist()))


def _time_skew(random: Random, scale: Scale) -> Sized:
    return TimeSkew(
        _sign(random) * 0.02, creep=float(random.uniform(-0.3, 0.3)), end_s=scale.duration_s
    )


Draw = Callable[[Random, Scale], Sized]

DRAWS: dict[str, tuple[str, Draw]] = {
    "fts_offset": ("sensor_strain", _strain),
    "fts_drift": ("sensor_warm_up", _warm_up),
    "payload": ("payload", _payload),
    "base_compliance": ("base_plate", _base_plate),
    "tip_frame_misalignment": ("tip_target", _tip_target),
    "hysteresis": ("hysteresis", _hysteresis),
    "temperature_modulus": ("temperature", _temperature),
    "anisotropy": ("anisotropy", _anisotropy),
    "stress_relaxation": ("relaxation", _relaxation),
    "ageing": ("ageing", _ageing),
    "mullins_softening": ("softening", _softening),
    "fts_thermal_drift": ("sensor_thermal", _thermal),
    "fts_gain": ("sensor_gain", _gain),
    "fts_crosstalk": ("sensor_crosstalk", _crosstalk),
    "camera_scale": ("camera_scale", _camera_scale),
    "base_frame_misalignment": ("base_frame", _base_frame),
    "marker_motion": ("marker_motion", _marker_motion),
    "platform_slip": ("platform_slip", _platform_slip),
    "length_error": ("mounting_gap", _mounting_gap),
    "cable_drag": ("cable", _cable),
    "contact_stop": ("stop", _stop),
    "permanent_set": ("permanent_set", _permanent_set),
    "debonding": ("lift_off", _lift_off),
    "face_tilt": ("face_tilt", _face_tilt),
    "pre_curvature": ("natural_bend", _natural_bend),
    "taper": ("taper", _taper),
    "diameter_error": ("thickness", _thick),
    "strain_stiffening": ("stiffening", _stiff),
    "own_weight": ("own_weight", _own_weight),
    "fts_saturation": ("sensor_knee", _knee),
    "fts_hysteresis": ("sensor_play", _play),
    "fts_frame": ("sensor_seat", _seat),
    "led_occlusion": ("leds", _leds),
}
"""What can be hidden: id, field of `Physics`, and how its shape is drawn."""

MOVING: dict[str, tuple[str, Draw]] = {"time_skew": ("time_skew", _time_skew)}
"""What acts only while the arm moves: it can be hidden where the rig keeps the raw stream."""

GRADES: dict[str, tuple[str, ...]] = {
    "anisotropy": (COS2, SIN2),
    "taper": (TAPER,),
    "diameter_error": (THICK,),
    "strain_stiffening": (STIFF,),
}
"""Further solutions of the mechanism that an effect needs."""


def draw(effect: str, random: Random, scale: Scale) -> tuple[str, Sized]:
    """Field of `Physics` and a first guess of the truth behind an id."""
    name, shape = (DRAWS | MOVING)[effect]
    return name, shape(random, scale)


def put(physics: Physics, name: str, truth: Sized) -> Physics:
    """The physics with one truth added."""
    changes = {name: truth}
    return replace(physics, **changes)  # type: ignore[arg-type]
