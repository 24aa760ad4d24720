"""All true effects of the plant, one line each, in the order in which a stage applies them."""

from __future__ import annotations

from ecm.rig.physics.body import (
    Anisotropy,
    FaceTilt,
    MountingGap,
    NaturalBend,
    PlatformSlip,
    Stiffening,
    Taper,
    Thickness,
)
from ecm.rig.physics.camera import BaseFrame, CameraScale, Leds, MarkerMotion, TimeSkew, TipTarget
from ecm.rig.physics.load import BasePlate, Cable, LiftOff, OwnWeight, Payload, Stop
from ecm.rig.physics.material import (
    Ageing,
    Hysteresis,
    PermanentSet,
    Relaxation,
    Softening,
    Temperature,
)
from ecm.rig.physics.sensor import (
    SensorCrosstalk,
    SensorGain,
    SensorKnee,
    SensorPlay,
    SensorSeat,
    SensorStrain,
    SensorThermal,
    SensorWarmUp,
)
from ecm.rig.physics.true_effect import TrueEffect

_ORDER: tuple[type[TrueEffect], ...] = (
    PlatformSlip,
    PermanentSet,
    FaceTilt,
    NaturalBend,
    MountingGap,
    Anisotropy,
    Taper,
    Thickness,
    Stiffening,
    Temperature,
    Ageing,
    Relaxation,
    Softening,
    Hysteresis,
    LiftOff,
    BasePlate,
    Payload,
    Cable,
    Stop,
    OwnWeight,
    SensorSeat,
    SensorCrosstalk,
    SensorGain,
    SensorKnee,
    SensorPlay,
    SensorStrain,
    SensorWarmUp,
    SensorThermal,
    Leds,
    TipTarget,
    CameraScale,
    BaseFrame,
    MarkerMotion,
    TimeSkew,
)
TRUE_EFFECTS: dict[str, type[TrueEffect]] = {effect.effect: effect for effect in _ORDER}
"""What can be hidden, by its id in the catalogue of effects."""
