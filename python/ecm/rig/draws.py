"""Which physical truth stands behind an id of the catalogue, and how its shape is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ecm.rig.physics import Physics, Sized
from ecm.rig.physics.ageing import Ageing
from ecm.rig.physics.anisotropy import Anisotropy
from ecm.rig.physics.base_frame import BaseFrame
from ecm.rig.physics.base_plate import BasePlate
from ecm.rig.physics.cable import Cable
from ecm.rig.physics.camera_scale import CameraScale
from ecm.rig.physics.hysteresis import Hysteresis
from ecm.rig.physics.marker_motion import MarkerMotion
from ecm.rig.physics.mounting_gap import MountingGap
from ecm.rig.physics.payload import Payload
from ecm.rig.physics.platform_slip import PlatformSlip
from ecm.rig.physics.relaxation import Relaxation
from ecm.rig.physics.sensor_crosstalk import SensorCrosstalk
from ecm.rig.physics.sensor_gain import SensorGain
from ecm.rig.physics.sensor_strain import SensorStrain
from ecm.rig.physics.sensor_thermal import SensorThermal
from ecm.rig.physics.sensor_warm_up import SensorWarmUp
from ecm.rig.physics.softening import Softening
from ecm.rig.physics.temperature import Temperature
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


Draw = Callable[[Random, Scale], Sized]

CORE: dict[str, tuple[str, Draw]] = {
    "fts_offset": ("sensor_strain", _strain),
    "fts_drift": ("sensor_warm_up", _warm_up),
    "payload": ("payload", _payload),
    "base_compliance": ("base_plate", _base_plate),
    "tip_frame_misalignment": ("tip_target", _tip_target),
    "hysteresis": ("hysteresis", _hysteresis),
    "temperature_modulus": ("temperature", _temperature),
    "anisotropy": ("anisotropy", _anisotropy),
}
"""What `random` chooses from: id, field of `Physics`, and how its shape is drawn."""

DRAWS: dict[str, tuple[str, Draw]] = {
    **CORE,
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
}


def draw(effect: str, random: Random, scale: Scale) -> tuple[str, Sized]:
    """Field of `Physics` and a first guess of the truth behind an id."""
    name, shape = DRAWS[effect]
    return name, shape(random, scale)


def put(physics: Physics, name: str, truth: Sized) -> Physics:
    """The physics with one truth added."""
    changes = {name: truth}
    return replace(physics, **changes)  # type: ignore[arg-type]
