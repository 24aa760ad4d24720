"""The largest size of an effect that something real could have.

A strength s is what is left after the base is projected out. Where the plan hardly shows an effect
beside the modulus (relaxation with a single rest), a requested strength needs an absurd size: a
rubber that loses more than all of its stress. Such a request is refused, with what would make it
possible. Each effect states its largest size in shares of what the rig is built for (length and
stiffness of the mechanism, range of the sensor), so that the limits serve a finger as well as a
neck. They are round figures by judgement, with the reason in the effect's file; none is measured.
"""

from __future__ import annotations

from ecm.rig.hidden.calibrate import CannotHide
from ecm.rig.physics.true_effect import RigScale, TrueEffect

GRAVITY_M_S2 = 9.81


def measure(unit: str, rig: RigScale) -> float:
    """What a share of 1 is for sizes in a unit."""
    force = min(rig.ranges[:3])
    lateral, bending = min(rig.rest_stiffness[1:3]), min(rig.rest_stiffness[4:])
    return {
        "1": 1.0,
        "rad": 1.0,
        "1/K": 1.0,
        "s": 1.0,
        "m": rig.length_m,
        "N": force,
        "N/K": force,
        "kg": force / GRAVITY_M_S2,
        "1/N or 1/(N m)": 1.0 / force,
        "N/m": lateral,
        "rad/(N m)": 1.0 / bending,
    }[unit]


def check_size(truth: TrueEffect, strength: float, size: float, rig: RigScale) -> None:
    """Raise CannotHide where the requested strength needs a size beyond that of real things."""
    largest = truth.limit.share * measure(truth.unit, rig)
    if abs(size) <= largest:
        return
    command = f" (`ecm design … --preset diagnosable --effects {truth.effect}`)"
    raise CannotHide(
        f"--hide {truth.effect}={strength:g}: with this plan that strength asks for a size of "
        f"{_with_unit(abs(size), truth.unit)}, and nothing real exceeds "
        f"{_with_unit(largest, truth.unit)}. Hide it at "
        f"most at s = {_rounded_down(strength * largest / abs(size))}, an estimate from this size, "
        f"or plan {truth.limit.remedy}{'' if truth.only_in_motion else command}"
    )


def _with_unit(size: float, unit: str) -> str:
    """A size with its unit; a share in percent."""
    return f"{100.0 * size:.3g} %" if unit == "1" else f"{size:.3g} {unit}"


def _rounded_down(value: float) -> str:
    """Two digits, never above."""
    digits = f"{0.95 * value:.1e}"
    return f"{float(digits):g}"
