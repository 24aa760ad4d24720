"""How large an effect can be before nothing real is that large.

A strength s is what is left after the base is projected out. Where the plan hardly shows an effect
beside the modulus (relaxation with a single rest), a wanted strength asks for an absurd size: a
rubber that loses more than all of its stress. Such a wish is refused, with what would make it
possible. The largest sizes are shares of what the rig is built for (length and stiffness of the
mechanism, range of the sensor), so that they serve a finger as well as a neck.
"""

from __future__ import annotations

from ecm.rig.hidden.calibrate import CannotHide
from ecm.rig.hidden.draw import MOVING, Scale

GRAVITY_M_S2 = 9.81

LARGEST: dict[str, tuple[float, str]] = {
    # The material. A rubber that lost or gained much more than half of its stiffness or stress, by
    # time, strain or direction, would be another material; 10 % per kelvin is a glass transition.
    "ageing": (0.5, "a longer campaign, the first poses again at its end"),
    "anisotropy": (0.5, "a remount by 90 degrees"),
    "mullins_softening": (0.6, "small poses again after large ones"),
    "strain_stiffening": (0.5, "larger poses"),
    "stress_relaxation": (0.6, "several dwells, from 2 to 60 s"),
    "temperature_modulus": (0.1, "a warm-up between the poses"),
    # Memory in displacements: friction that holds a twentieth of the length, or a set of a third of
    # the excess, is seen without any measurement.
    "hysteresis": (0.05, "approaches from several sides, poses measured twice"),
    "permanent_set": (0.3, "home checks, small poses after large ones"),
    # The body against its drawing: 9 degrees, a tenth of the length, a fifth of the diameter and a
    # quarter of the sensor's range in weight do not pass the eye.
    "diameter_error": (0.2, "bending and shear as well as stretch"),
    "face_tilt": (0.15, "a remount by 180 degrees"),
    "length_error": (0.1, "poses at which the axial force differs"),
    "own_weight": (0.25, "poses that bend on all sides"),
    "pre_curvature": (0.15, "a remount by 180 degrees"),
    "taper": (0.5, "bending and shear on all sides"),
    # What it is clamped in. Compliances are shares of the mechanism's own (a softer plate does not
    # hold it), stiffnesses multiples of its own (a stop of 300 is a wall), jumps shares of its
    # length (a clamp that gives way more lets go).
    "base_compliance": (0.4, "larger poses"),
    "cable_drag": (0.3, "larger poses on all sides"),
    "contact_stop": (300.0, "larger tilts"),
    "debonding": (0.6, "a push-pull pair of poses"),
    "marker_motion": (0.05, "a longer campaign, poses measured again at its end"),
    "payload": (0.25, "poses that turn on all sides"),
    "platform_slip": (0.05, "poses measured again at the end"),
    # Frames and camera: 6 to 11 degrees, a fifth of the scale or an LED off by a tenth of the
    # length do not survive the first look at the data.
    "base_frame_misalignment": (0.1, "poses that bend and turn on all sides"),
    "camera_scale": (0.2, "larger translations"),
    "fts_frame": (0.2, "larger forces"),
    "led_occlusion": (0.1, "larger tilts"),
    "tip_frame_misalignment": (0.1, "poses that bend and turn on all sides"),
    # The sensor: a third in gain, a tenth in cross-talk, a quarter of the range in its zero or
    # nearly half of its play are beyond any data sheet; it is repaired, not modelled.
    "fts_crosstalk": (0.1, "loads on every axis"),
    "fts_drift": (0.25, "a longer campaign"),
    "fts_gain": (0.3, "loads on every axis"),
    "fts_hysteresis": (0.4, "approaches from several sides"),
    "fts_offset": (0.25, "poses that turn on all sides"),
    "fts_saturation": (4.0, "larger loads"),
    "fts_thermal_drift": (0.05, "a warm-up between the poses"),
    # Clocks: half a second is seen against the arm's own encoders.
    "time_skew": (0.5, "faster ways ([rig] speed_m_s) and more samples ([rig] stream_Hz)"),
}
"""id: largest size in shares of the unit's measure (`measure`), and what shows the effect.

Round figures by judgement, each set where its group says; none is measured."""


def measure(unit: str, scale: Scale) -> float:
    """One of a unit, as the rig measures it."""
    force = min(scale.ranges[:3])
    lateral, bending = min(scale.rest_stiffness[1:3]), min(scale.rest_stiffness[4:])
    return {
        "1": 1.0,
        "rad": 1.0,
        "1/K": 1.0,
        "s": 1.0,
        "m": scale.length_m,
        "N": force,
        "N/K": force,
        "kg": force / GRAVITY_M_S2,
        "1/N or 1/(N m)": 1.0 / force,
        "N/m": lateral,
        "rad/(N m)": 1.0 / bending,
    }[unit]


def largest_size(effect: str, unit: str, scale: Scale) -> float:
    """The largest size of an effect that something real could have, in its unit."""
    return LARGEST[effect][0] * measure(unit, scale)


def check_size(effect: str, strength: float, size: float, unit: str, scale: Scale) -> None:
    """CannotHide where the wanted strength asks for more than that."""
    largest = largest_size(effect, unit, scale)
    if abs(size) <= largest:
        return
    command = f" (`ecm design … --preset diagnosable --effects {effect}`)"
    raise CannotHide(
        f"--hide {effect}={strength:g}: with this plan that strength asks for a size of "
        f"{_words(abs(size), unit)}, and nothing real exceeds {_words(largest, unit)}. Hide it at "
        f"most at s = {_down(strength * largest / abs(size))}, an estimate from this size, or "
        f"plan {LARGEST[effect][1]}{'' if effect in MOVING else command}"
    )


def _words(size: float, unit: str) -> str:
    """A size with its unit; a share in percent."""
    return f"{100.0 * size:.3g} %" if unit == "1" else f"{size:.3g} {unit}"


def _down(value: float) -> str:
    """Two digits, never above."""
    digits = f"{0.95 * value:.1e}"
    return f"{float(digits):g}"
