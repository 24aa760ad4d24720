"""Physical truths of the plant, one idea a file; formulas of their own."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from ecm.rig.physics.ageing import Ageing
from ecm.rig.physics.anisotropy import Anisotropy
from ecm.rig.physics.base_frame import BaseFrame
from ecm.rig.physics.base_plate import BasePlate
from ecm.rig.physics.cable import Cable
from ecm.rig.physics.camera_scale import CameraScale
from ecm.rig.physics.face_tilt import FaceTilt
from ecm.rig.physics.graded import Graded
from ecm.rig.physics.hysteresis import Hysteresis
from ecm.rig.physics.leds import Leds
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
from ecm.rig.physics.shape import Sized
from ecm.rig.physics.softening import Softening
from ecm.rig.physics.stop import Stop
from ecm.rig.physics.temperature import Temperature
from ecm.rig.physics.time_skew import TimeSkew
from ecm.rig.physics.tip_target import TipTarget

__all__ = ["Physics", "Sized"]


@dataclass(frozen=True)
class Physics:
    """What acts in the plant beside the elastic map; None is absent."""

    ageing: Ageing | None = None
    anisotropy: Anisotropy | None = None
    base_frame: BaseFrame | None = None
    base_plate: BasePlate | None = None
    cable: Cable | None = None
    camera_scale: CameraScale | None = None
    face_tilt: FaceTilt | None = None
    hysteresis: Hysteresis | None = None
    known_payload: Payload | None = None
    leds: Leds | None = None
    lift_off: LiftOff | None = None
    marker_motion: MarkerMotion | None = None
    mounting_gap: MountingGap | None = None
    natural_bend: NaturalBend | None = None
    own_weight: OwnWeight | None = None
    payload: Payload | None = None
    permanent_set: PermanentSet | None = None
    platform_slip: PlatformSlip | None = None
    relaxation: Relaxation | None = None
    sensor_crosstalk: SensorCrosstalk | None = None
    sensor_gain: SensorGain | None = None
    sensor_knee: SensorKnee | None = None
    sensor_play: SensorPlay | None = None
    sensor_seat: SensorSeat | None = None
    sensor_strain: SensorStrain | None = None
    sensor_thermal: SensorThermal | None = None
    sensor_warm_up: SensorWarmUp | None = None
    softening: Softening | None = None
    stiffening: Graded | None = None
    stop: Stop | None = None
    taper: Graded | None = None
    temperature: Temperature | None = None
    thickness: Graded | None = None
    time_skew: TimeSkew | None = None
    tip_target: TipTarget | None = None

    def parameters(self) -> dict[str, Any]:
        """Of all that is present, by name."""
        return {
            f.name: getattr(self, f.name).parameters()
            for f in fields(self)
            if getattr(self, f.name) is not None
        }
